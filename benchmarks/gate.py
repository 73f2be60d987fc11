"""Whether anything has become slower: times beside a fixed program, and what they were before.

    python -m benchmarks --gate [--save]

What a machine does in a second changes from hour to hour and from machine to machine; how long one
program takes beside another changes less. Each of ours alternates with a program that knows nothing
of niryo_jax, on one core, and its share is compared with the one in `results/gate.json`, which
`--save` writes. First calls are compared with the compilation of that program.

The exit code is 1 where a share has grown by more than the stated spread, or an answer is wrong. On
another kind of processor than that of the stored shares only wrong answers fail.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
from collections.abc import Callable, Iterator
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks import reference
from benchmarks.measure import RESULTS, Timed, about, alternate, header, table

STORED = RESULTS / "gate.json"

LEAST, FIRST = 0.25, 0.6
"""By how much a share of running, and of first calls, may grow at the least: repeated runs of the
same code differ by half of it."""

SPREADS = 3.0
"""And by so many times the spread of the rounds, where that is more."""

ROUND = 0.1
"""Seconds a round lasts at the least."""

SIZE = 8192
RIGHT = {"float64": 1e-11, "float32": 2e-5}
"""Metres and entries of the rotation by which an answer may miss."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One of ours: what runs, and how far what it returned is from what is right."""

    name: str
    run: Callable[[], Any]
    error: Callable[[Any], float]
    right: float


@jax.jit
def fixed_program(x: jax.Array) -> jax.Array:
    """Some sines, products and quotients, whose compilation takes about a second."""
    total = x
    for k in range(1, 40):
        total = total + jnp.cos(k * x) * jnp.sin(x + k) / (k + x * x)
    return total


def cases(size: int) -> Iterator[Case]:
    """What is watched."""
    rng = np.random.default_rng(0)
    for name, dtypes in (
        ("niryo_one", ("float64", "float32")),
        ("abb_irb120", ("float64",)),
        ("ur16e", ("float64", "float32")),
        ("general", ("float64",)),
    ):
        robot = _general() if name == "general" else nj.robots.load(name)
        low, high = (
            np.nan_to_num(x, posinf=np.pi, neginf=-np.pi) for x in (robot.lower, robot.upper)
        )
        rows = size // 16 if name == "general" else size
        q = rng.uniform(low, high, (rows, 6))
        pose = reference.forward_kinematics(robot, q)
        for dtype in dtypes:
            right = RIGHT[dtype]
            given, joints = jax.device_put((pose.astype(dtype), q.astype(dtype)))
            yield Case(
                f"complete, {name}, {dtype}",
                lambda robot=robot, given=given: nj.inverse_kinematics(robot, given),
                lambda found, robot=robot, pose=pose: _misses(robot, pose, found),
                right,
            )
            if name != "niryo_one":
                continue
            yield Case(
                f"forward kinematics, {name}, {dtype}",
                lambda robot=robot, joints=joints: nj.forward_kinematics(robot, joints),
                lambda found, pose=pose: float(np.max(np.abs(np.asarray(found) - pose))),
                right,
            )
            jacobian = reference.space_jacobian(robot, q)
            yield Case(
                f"space Jacobian, {name}, {dtype}",
                lambda robot=robot, joints=joints: nj.space_jacobian(robot, joints),
                lambda found, truth=jacobian: float(np.max(np.abs(np.asarray(found) - truth))),
                right,
            )
            start = joints + 0.1
            yield Case(
                f"Newton-Raphson, {name}, {dtype}",
                lambda robot=robot, given=given, start=start: nj.newton_raphson(
                    robot, given, start
                ),
                lambda found, robot=robot, pose=pose: _newton_misses(robot, pose, found),
                10 * right,
            )


def _general() -> nj.Robot:
    """A UR16e off by a millimetre and a milliradian."""
    rng, arm = np.random.default_rng(3), nj.robots.load("ur16e")
    w, v = np.asarray(arm.screws)[:, :3], np.asarray(arm.screws)[:, 3:]
    points = np.cross(w, v) + 1e-3 * rng.standard_normal(w.shape)
    return nj.Robot.from_axes(w + 1e-3 * rng.standard_normal(w.shape), points, arm.home)


def _misses(robot: nj.Robot, pose: np.ndarray, found: Any) -> float:
    """The worst of all solutions; infinite where more than one pose of a hundred has none."""
    rows, slots = np.nonzero(np.asarray(found.found))
    if len(set(rows)) < 0.99 * len(pose):
        return np.inf
    q = np.asarray(found.q)[rows, slots].astype(np.float64)
    return float(np.max(np.abs(reference.forward_kinematics(robot, q) - pose[rows])))


def _newton_misses(robot: nj.Robot, pose: np.ndarray, found: Any) -> float:
    done = np.asarray(found.converged)
    if np.mean(done) < 0.9:
        return np.inf
    q = np.asarray(found.q, np.float64)[done]
    return float(np.max(np.abs(reference.forward_kinematics(robot, q) - pose[done])))


def measure(size: int, rounds: int) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Of each case its share of the fixed program, running and first, with the spread of the
    rounds (half of what lies between the quartiles, as a share); and wrong answers."""
    x = jax.device_put(np.linspace(0, 1, SIZE))
    yardstick = Timed("fixed", SIZE, lambda: fixed_program(x))
    shares, wrong = dict[str, dict[str, float]](), list[str]()
    for case in cases(size):
        ours = Timed(case.name, size, case.run)
        yardstick.rounds.clear()
        alternate([yardstick, ours], rounds, ROUND)
        each = sorted(a / b for a, b in zip(ours.rounds, yardstick.rounds))
        share = statistics.median(each)
        quarter = len(each) // 4
        shares[case.name] = {
            "running": share,
            "spread": 0.5 * (each[-1 - quarter] - each[quarter]) / share,
            "first": ours.first / yardstick.first,
        }
        error = case.error(ours.result)
        if not error < case.right:
            wrong.append(f"{case.name}: misses by {error:.1e}")
    return shares, wrong


def grown(
    now: dict[str, dict[str, float]], before: dict[str, dict[str, float]]
) -> Iterator[tuple[str, str, float, float, bool]]:
    """(case, what, growth, allowed, whether it is too much) of each share that was stored."""
    for name, old in before.items():
        if name not in now:
            yield name, "missing", np.inf, 0.0, True
            continue
        spread = SPREADS * max(old["spread"], now[name]["spread"])
        for what, allowed in (("running", max(LEAST, spread)), ("first", FIRST)):
            growth = now[name][what] / old[what] - 1.0
            yield name, what, growth, allowed, growth > allowed


def main() -> int:
    """Run, print, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=SIZE)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--save", action="store_true", help=f"write {STORED.name}")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_compilation_cache", False)
    facts = about(size=options.size)
    shares, wrong = measure(options.size, options.rounds)
    print(header(facts) + "\n")
    stored: dict[str, Any] = json.loads(STORED.read_text()) if STORED.exists() else {"shares": {}}
    rows, slower = [], []
    for name, what, growth, allowed, fails in grown(shares, stored["shares"]):
        share = shares.get(name, {}).get(what, np.nan)
        verdict = "slower" if fails else "pass"
        rows.append([name, what, f"{share:.3g}", f"{growth:+.0%}", f"{allowed:+.0%}", verdict])
        slower += [f"{name}, {what}"] * fails
    print(table(["what", "share", "now", "grown by", "allowed", ""], rows))
    print("\n".join(f"- WRONG: {x}" for x in wrong) or "- every answer of ours: right")
    if options.save:
        STORED.write_text(json.dumps({"about": facts, "shares": shares}, indent=1) + "\n")
        return 1 if wrong else 0
    here = stored.get("about", {}).get("machine") == facts["machine"]
    if slower and not here:
        print("- another processor than that of the stored shares: nothing fails for its speed")
    return 1 if wrong or (slower and here) else 0


if __name__ == "__main__":
    raise SystemExit(main())
