"""Joint rates of twists, of the Niryo One and of a Panda, beside other ways to them, on one core.

    python -m benchmarks.velocity [--twists 10000] [--rounds 5] [--save]

Without limits beside numpy's least squares; within limits of rates and positions beside qpax, an
interior point method in JAX, and scipy's `lsq_linear`. The others are given the Jacobians, and
those in loops of Python a few hundred of the twists. The exit code is 1 where rates of ours exceed
a limit, miss the twist away from singularities, or are not the optimum by conditions that plain
numpy looks at.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks import reference
from benchmarks.honesty import REAL_ARMS, from_file
from benchmarks.measure import (
    Claim,
    Report,
    Timed,
    about,
    alternate,
    header,
    table,
    version_of,
)

RIGHT = {"float64": 1e-11, "float32": 2e-4}
"""How far rates may be from what they should do: rad/s and m/s, and the share of the optimum."""

LEAST = 0.1
"""Seconds a round lasts at the least."""

FEW = 300
"""Twists that a loop of Python handles in a run."""

DT, FASTEST = 0.01, 1.0
"""Seconds that rates are kept, and rad/s that no joint exceeds."""

EACH, AT = 1_000, 100.0
"""What is aimed at: so many arms at so many Hz; and no other way is faster."""


def tool_jacobian(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, 6, n) that of the tool's origin, in the axes of the space frame."""
    jacobian = reference.space_jacobian(robot, q).copy()
    position = reference.forward_kinematics(robot, q)[:, :3, 3]
    jacobian[:, 3:] += np.cross(jacobian[:, :3], position[:, :, None], axis=1)
    return jacobian


class Case:
    """What is asked of an arm."""

    def __init__(self, robot: nj.Robot, size: int) -> None:
        rng = np.random.default_rng(0)
        n = robot.joints
        self.robot = robot
        self.q = rng.uniform(robot.lower, robot.upper, (size, n))
        self.twist = rng.uniform(-1, 1, (size, 6)) * np.array([1, 1, 1, 0.3, 0.3, 0.3])
        self.jacobian = tool_jacobian(robot, self.q)
        self.lower = np.clip((robot.lower - self.q) / DT, -FASTEST, FASTEST)
        self.upper = np.clip((robot.upper - self.q) / DT, -FASTEST, FASTEST)

    def ours(self, dtype: str, limited: bool) -> Callable[[], nj.motion.VelocityResult]:
        """The verb; damping as it is without further ado."""
        q, twist = (jax.device_put(x.astype(dtype)) for x in (self.q, self.twist))
        limits: dict[str, Any] = {}
        if limited:
            limits = {"rate_limits": np.full(self.robot.joints, FASTEST), "dt": DT}
        return lambda: nj.motion.velocity_ik(self.robot, q, twist, **limits)

    def wrong(self, found: nj.motion.VelocityResult, dtype: str, limited: bool) -> list[str]:
        """What of an answer is not right, by plain numpy."""
        rate, right = np.asarray(found.rate, float), RIGHT[dtype]
        residual = self.twist - np.einsum("bij,bj->bi", self.jacobian, rate)
        square = np.asarray(found.damping, float)[:, None] ** 2
        slope = square * rate - np.einsum("bij,bi->bj", self.jacobian, residual)
        lower, upper = (self.lower, self.upper) if limited else (-np.inf, np.inf)
        beyond = float(np.max(np.maximum(lower - rate, rate - upper)))
        missed = float(np.max(np.abs(rate - np.clip(rate - slope, lower, upper))))
        regular = np.asarray(found.damping) == 0
        free = regular & ~np.any(np.asarray(found.saturated), axis=-1)
        off = float(np.max(np.abs(residual[free]), initial=0.0))
        out: list[str] = []
        if not beyond < (1e-12 if dtype == "float64" else 1e-3):
            out.append(f"a limit is exceeded by {beyond:.1e}")
        if not missed < right:
            out.append(f"the conditions of an optimum are missed by {missed:.1e}")
        if not off < right:
            out.append(f"a twist is missed by {off:.1e}")
        return out

    def cost(self, rate: np.ndarray, square: np.ndarray) -> np.ndarray:
        """(k,) what is to be least, of the first twists."""
        rate = np.asarray(rate, float)
        k = len(rate)
        off = np.einsum("bij,bj->bi", self.jacobian[:k], rate) - self.twist[:k]
        return np.sum(off**2, axis=1) + square[:k] * np.sum(rate**2, axis=1)


def by_qpax(case: Case, square: np.ndarray) -> tuple[str, int, Callable[[], np.ndarray]]:
    """All twists at once, in one program."""
    qpax = importlib.import_module("qpax")
    n = case.robot.joints
    jacobian, twist, lower, upper = map(
        jnp.asarray, (case.jacobian, case.twist, case.lower, case.upper)
    )
    # Where there are joints to spare it wants a little damping.
    damping = jnp.asarray(square + (1e-9 if n > 6 else 0.0))

    @jax.jit
    def solve(*given: jax.Array) -> jax.Array:
        def one(
            a: jax.Array, b: jax.Array, s: jax.Array, lower: jax.Array, upper: jax.Array
        ) -> jax.Array:
            eye = jnp.eye(n)
            bounds = jnp.concatenate([eye, -eye]), jnp.concatenate([upper, -lower])
            none = jnp.zeros((0, n)), jnp.zeros(0)
            return qpax.solve_qp(a.T @ a + s * eye, -a.T @ b, *none, *bounds, solver_tol=1e-8)[0]

        return jax.vmap(one)(*given)

    return "qpax", len(twist), lambda: solve(jacobian, twist, damping, lower, upper)


def by_scipy(case: Case, square: np.ndarray) -> tuple[str, int, Callable[[], np.ndarray]]:
    """A loop of Python over `lsq_linear`."""
    optimize = importlib.import_module("scipy.optimize")
    n = case.robot.joints

    def run() -> np.ndarray:
        out = np.empty((min(FEW, len(case.q)), n))
        for k in range(len(out)):
            matrix = np.vstack([case.jacobian[k], np.sqrt(square[k]) * np.eye(n)])
            right = np.concatenate([case.twist[k], np.zeros(n)])
            box = case.lower[k], case.upper[k]
            out[k] = optimize.lsq_linear(matrix, right, box, method="bvls").x
        return out

    return "scipy, loop over lsq_linear", min(FEW, len(case.q)), run


def by_numpy(case: Case, square: np.ndarray) -> tuple[str, int, Callable[[], np.ndarray]]:
    """A loop of Python over the damped least squares, as with pinocchio's Jacobians."""
    n = case.robot.joints

    def run() -> np.ndarray:
        out = np.empty((min(FEW, len(case.q)), n))
        for k in range(len(out)):
            matrix = np.vstack([case.jacobian[k], np.sqrt(square[k]) * np.eye(n)])
            out[k] = np.linalg.lstsq(matrix, np.concatenate([case.twist[k], np.zeros(n)]))[0]
        return out

    return "numpy, loop over lstsq", min(FEW, len(case.q)), run


def by_stacked(case: Case, square: np.ndarray) -> tuple[str, int, Callable[[], np.ndarray]]:
    """numpy's stacked solve of J^T (J J^T + s)^-1."""
    turned = np.swapaxes(case.jacobian, 1, 2)

    def run() -> np.ndarray:
        gram = case.jacobian @ turned + square[:, None, None] * np.eye(6)
        return (turned @ np.linalg.solve(gram, case.twist[..., None]))[..., 0]

    return "numpy, stacked solve", len(case.q), run


PEERS: dict[bool, dict[str, list[Callable[..., tuple[str, int, Callable[[], np.ndarray]]]]]] = {
    False: {"numpy": [by_numpy, by_stacked]},
    True: {"qpax": [by_qpax], "scipy": [by_scipy]},
}
"""Within limits or not, by the package that pip takes."""


def measure(
    robot: nj.Robot, size: int, rounds: int, report: Report, skip: tuple[str, ...] = ()
) -> None:
    """Add the section and the claims of an arm to a report."""
    case, rows = Case(robot, size), list[list[str]]()
    for limited in (False, True):
        what = "within limits" if limited else "no limits"
        ours = {
            dtype: Timed(f"niryo_jax, {dtype}", size, case.ours(dtype, limited)) for dtype in RIGHT
        }
        square = np.asarray(ours["float64"].result.damping) ** 2
        best = case.cost(ours["float64"].result.rate, square)
        peers: list[Timed] = []
        for package, builders in PEERS[limited].items():
            if package in skip or version_of(package) is None:
                report.sections.append(f"{package}: not installed (pip install {package})")
                continue
            for build in builders:
                name, count, run = build(case, square)
                peers.append(Timed(name, count, run))
        subjects = [*ours.values(), *peers]
        alternate(subjects, rounds, LEAST)
        first = ours["float64"].rate
        for dtype, subject in ours.items():
            for sentence in case.wrong(subject.result, dtype, limited):
                report.wrong.append(f"{robot.name}, {what}, {subject.name}: {sentence}")
        for subject in subjects:
            result = subject.result
            rate = np.asarray(result if subject in peers else result.rate, float)
            over = float(np.nanmax(case.cost(rate, square) - best[: len(rate)]))
            miss = f"{max(over, 0.0):.0e}" if np.all(np.isfinite(rate)) else "not finite"
            cells = [what, subject.name, f"{subject.rate:,.0f}", f"{subject.spread:.0%}"]
            rows.append([*cells, f"{first / subject.rate:.1f}", miss, f"{subject.first:.2f}"])
        key = f"{robot.name}, {what}"
        report.data[key] = [subject.facts() for subject in subjects]
        over = first / max((peer.rate for peer in peers), default=np.nan)
        arms = first / AT
        report.claims += [
            Claim(f"{key}: {arms:,.0f} arms at {AT:.0f} Hz, of {EACH:,}", arms >= EACH),
            Claim(
                f"{key}: {over:.1f} times as fast as the fastest other way",
                None if np.isnan(over) else over >= 1,
            ),
        ]
    head = [
        *("what", "by", "twists/s", "spread", "ours / it"),
        *("costs more than ours by", "first call (s)"),
    ]
    report.sections += [f"{robot.name}, {size:,} random postures and twists:", table(head, rows)]


def main() -> int:
    """Run, print, and return the exit code."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twists", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    facts = about("qpax", "scipy", twists=options.twists)
    report = Report("Joint rates of twists", facts, [header(facts)])
    panda = next(case.robot for case in from_file(REAL_ARMS) if case.robot.name == "panda")
    for robot in (nj.robots.niryo_one(), panda):
        measure(robot, options.twists, options.rounds, report)
    return report.finish("velocity" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
