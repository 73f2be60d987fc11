"""Exponential and logarithm of SE(3), with gradients, beside jaxlie.

    python -m benchmarks.lie [--poses 65536] [--rounds 7] [--save]

Both sides get the same twists and motions in one run, jitted, on one core: jaxlie with `vmap`,
as it is documented, as quaternions and as 4 x 4 matrices. The gradient is that of a weighted sum of
the result. The exit code is 1 when an answer of niryo_jax is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks.measure import Claim, Report, Timed, about, alternate, header, table, version_of

TIMES = 10.0
"""How many times as fast as jaxlie's matrices."""

RIGHT = {"float64": 1e-12, "float32": 1e-5}
"""How far an entry may be from that of a series in float64; a gradient is a sum of some of them."""

LEAST = 0.05

Functions = dict[str, Callable[[jax.Array], jax.Array]]


def ours() -> Functions:
    """exp and log of a batch."""
    return {"exp": nj.se3.exp, "log": nj.se3.log}


def theirs() -> dict[str, Functions]:
    """jaxlie's, whose tangents are (v, omega)."""
    import jaxlie

    def swap(x: jax.Array) -> jax.Array:
        return jnp.concatenate([x[..., 3:], x[..., :3]], axis=-1)

    def exp(twist: jax.Array) -> jax.Array:
        return jaxlie.SE3.exp(swap(twist)).as_matrix()

    def log(pose: jax.Array) -> jax.Array:
        return swap(jaxlie.SE3.from_matrix(pose).log())

    def exp_quaternion(twist: jax.Array) -> jax.Array:
        return jaxlie.SE3.exp(swap(twist)).wxyz_xyz

    def log_quaternion(pose: jax.Array) -> jax.Array:
        return swap(jaxlie.SE3(pose).log())

    def batched(function: Callable[[jax.Array], jax.Array]) -> Callable[[jax.Array], jax.Array]:
        return jax.vmap(function)

    return {
        "jaxlie, matrices": {"exp": batched(exp), "log": batched(log)},
        "jaxlie, quaternions": {"exp": batched(exp_quaternion), "log": batched(log_quaternion)},
    }


def gradient(function: Callable[[jax.Array], jax.Array]) -> Callable[[jax.Array], jax.Array]:
    """The gradient of a sum of the result with weights that tell its entries apart."""

    def weighted(x: jax.Array) -> jax.Array:
        y = function(x)
        weights = jnp.arange(1, y[0].size + 1, dtype=y.dtype).reshape(y.shape[1:])
        return jnp.sum(y * weights)

    return jax.grad(weighted)


def series(twist: np.ndarray) -> np.ndarray:
    """exp by scaling and squaring of a Taylor series."""
    small = np.zeros((len(twist), 4, 4))
    w = twist[:, :3]
    small[:, [2, 0, 1], [1, 2, 0]], small[:, [1, 2, 0], [2, 0, 1]] = w, -w
    small[:, :3, 3] = twist[:, 3:]
    small /= 2**10
    term, out = np.eye(4), np.eye(4)
    for k in range(1, 10):
        term = term @ small / k
        out = out + term
    for _ in range(10):
        out = out @ out
    return out


def measure(poses: int, rounds: int) -> Report:
    """Both functions and both gradients, in both precisions."""
    facts = about("jaxlie", rounds=rounds, poses=poses)
    report = Report("SE(3)", {"about": facts}, [header(facts)])
    rng = np.random.default_rng(0)
    twist = rng.standard_normal((poses, 6))
    twist[:, :3] *= (
        3.0 * rng.uniform(size=(poses, 1)) / np.linalg.norm(twist[:, :3], axis=1)[:, None]
    )
    pose = series(twist)
    libraries = {"niryo_jax": ours()}
    if version_of("jaxlie") is not None:
        libraries |= theirs()
    rows = list[tuple[str, str, Timed]]()
    for dtype in ("float64", "float32"):
        given = {"exp": jnp.asarray(twist, dtype), "log": jnp.asarray(pose, dtype)}
        for library, functions in libraries.items():
            for name, function in functions.items():
                x = given[name]
                if library.endswith("quaternions") and name == "log":
                    x = jax.jit(functions["exp"])(given["exp"])
                for what, jitted in (
                    (name, jax.jit(function)),
                    (f"{name}, gradient", jax.jit(gradient(function))),
                ):
                    timed = Timed(library, poses, lambda f=jitted, x=x: f(x))
                    rows.append((what, dtype, timed))
        truth = {"exp": pose, "log": twist}
        for what, kind, timed in rows:
            if timed.name == "niryo_jax" and kind == dtype and what in truth:
                far = float(np.max(np.abs(np.asarray(timed.result) - truth[what])))
                if not far < RIGHT[dtype]:
                    report.wrong.append(f"{what}, {dtype}: misses by {far:.1e}")
    alternate([timed for _, _, timed in rows], rounds, LEAST)
    mine = {(what, dtype): t for what, dtype, t in rows if t.name == "niryo_jax"}
    _check_gradients(given, mine, report)
    lines = []
    for what, dtype, timed in rows:
        over = mine[what, dtype].rate / timed.rate
        lines.append(
            [what, dtype, timed.name, f"{timed.rate:,.0f}", f"{timed.spread:.0%}", f"{over:,.1f}"]
        )
        report.data[f"{what}, {dtype}, {timed.name}"] = timed.facts()
        if timed.name == "jaxlie, matrices":
            text = f"{what}, {dtype}, at least {TIMES:.0f} x jaxlie on matrices: {over:,.1f} x"
            report.claims.append(Claim(text, over >= TIMES))
    head = ["what", "type", "library", "poses/s", "spread", "ours / its"]
    report.sections.append(table(head, lines))
    return report


def _check_gradients(
    given: dict[str, jax.Array], mine: dict[tuple[str, str], Timed], report: Report
) -> None:
    """Our gradients in float64 against central differences."""
    for name, function in ours().items():
        x = np.asarray(given[name], np.float64)[:64]
        weigh = gradient(function)
        direction = np.random.default_rng(1).standard_normal(x.shape)
        if name == "log":
            # Along motions: a matrix that is none has no logarithm.
            direction = x @ np.asarray(nj.se3.hat(direction[:, 0, :1] * np.ones(6)))
        h = 1e-5
        ends = [np.asarray(function(x + s * h * direction)).reshape(64, -1) for s in (1, -1)]
        weights = np.arange(1, ends[0].shape[1] + 1)
        slope = (ends[0] - ends[1]) @ weights / (2 * h)
        told = np.sum(np.asarray(weigh(jnp.asarray(x))) * direction, axis=tuple(range(1, x.ndim)))
        far = float(np.max(np.abs(slope - told) / (1 + np.abs(slope))))
        if not far < 1e-6:
            report.wrong.append(f"{name}, gradient: differs from differences by {far:.1e}")


def main() -> int:
    """Measure, print, and fail where an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=65_536)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    return measure(options.poses, options.rounds).finish("lie" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
