"""Whether what is said of a pose is true: no false proof, nothing spurious, at singularities too.

    python -m benchmarks.honesty [--poses 200] [--variants 2] [--random 200]
                                 [--arms FILE | --no-arms] [--save]

Poses are made by forward kinematics, so each has a solution that is known: a quarter with joints at
multiples of 45 degrees, where axes align and arms stretch. The arms are those that are shipped, as
they are and with errors of 1e-11 to 1e-2 in every axis, of numpy and of jax arrays, called as they
are and inside of `jax.jit`; as many at random as asked for, of all families, handed over in as many
ways, of which a quarter of the poses are at singularities that are searched for; and those of a
JSON file {"arms": {name: {"screws", "home", "lower", "upper"}}}, where no file is named 66 real
ones. A pose that is called unreachable, an answer called complete without the joint vector that
made the pose (or, at a singularity, without any), and a joint vector that misses its pose by more
than it says make it fail.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import re
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks import random_arms, reference
from benchmarks.measure import Report, about, header, table
from niryo_jax.ik import method_for

ERRORS = 1e-11, 1e-9, 1e-6, 1e-4, 1e-2
"""Radians and metres by which axes are off."""

MISS = 1e-9
"""Metres and entries of a rotation by which a solution may miss: what multi-start promises."""

SAME = 1e-4
"""Radians within which a joint vector is the one that made a pose."""

SINGULAR = 1e-7
"""The smallest singular value of the Jacobian below which a posture is singular."""

REAL_ARMS = Path(__file__).parent / "data" / "real_arms.json"
"""Arms of four to eight joints, read from public descriptions."""


@functools.lru_cache(maxsize=1)
def _jitted(_: Hashable) -> Callable[[nj.Robot, np.ndarray], nj.IKSolutions]:
    """The solver, compiled for one arm at a time: its programs go when the next arm comes."""
    return jax.jit(lambda robot, pose: nj.inverse_kinematics(robot, pose))


@dataclasses.dataclass
class Case:
    """An arm, and how it is handed over."""

    kind: str
    robot: nj.Robot
    jitted: bool = False
    searched: bool = False
    """Whether singular postures are searched for, where multiples of 45 degrees are none."""

    def solve(self, pose: np.ndarray) -> nj.IKSolutions:
        """All solutions of the poses."""
        if self.jitted:
            return _jitted(jax.tree.structure(self.robot))(self.robot, pose)
        return nj.inverse_kinematics(self.robot, pose)


def off(robot: nj.Robot, size: float, rng: np.random.Generator) -> np.ndarray:
    """Screws (n, 6) that are moved by twists of that size, each of its own."""
    screws = np.array(robot.screws)
    for screw in screws:
        if np.any(screw[:3]):
            turn, shift = rng.normal(size=(2, 3)) * size
            screw[:3] += np.cross(turn, screw[:3])
            screw[:3] /= np.linalg.norm(screw[:3])
            point = np.cross(np.array(screw[:3]), screw[3:]) + shift
            screw[3:] = np.cross(point, screw[:3])
    return screws


def cases(names: tuple[str, ...], variants: int) -> Iterator[Case]:
    """The shipped arms, as they are and changed."""
    for name in names:
        robot = nj.robots.load(name)
        rng = np.random.default_rng(sum(map(ord, name)))
        as_jax = jax.tree.map(jnp.asarray, robot)
        yield Case("numpy", robot)
        yield Case("jax arrays, jit", as_jax, jitted=True)
        tool = np.array(nj.se3.exp(rng.normal(size=6)))
        yield Case("another tool", robot.with_tool(tool))
        for size in ERRORS:
            for _ in range(variants):
                screws = off(robot, size, rng)
                # What an optimiser makes of a tree: the numbers change, what is assumed stays.
                moved = dataclasses.replace(as_jax, screws=jnp.asarray(screws))
                yield Case(f"off by {size:g}", moved)
                leaves = [moved.screws, moved.home, moved.lower, moved.upper]
                stale = jax.tree.unflatten(jax.tree.structure(as_jax), leaves)
                yield Case(f"off by {size:g}, jit", stale, jitted=True)


def at_random(count: int) -> Iterator[Case]:
    """Random arms of all families in turn, as they are and changed, handed over in three ways."""
    names = list(random_arms.FAMILIES | random_arms.OTHERS)
    for seed in range(count):
        name, rounds = names[seed % len(names)], seed // len(names)
        rng = np.random.default_rng(seed)
        robot = random_arms.arm(name, rng)
        # Limits as arms have them, in which a part of the solutions lies.
        turns = np.any(np.asarray(robot.screws)[:, :3], axis=1)
        middle, half = rng.uniform(-1, 1, robot.joints), rng.uniform(1.5, 3.1, robot.joints)
        lower, upper = (np.where(turns, middle + x, x / np.pi) for x in (-half, half))
        robot = dataclasses.replace(robot, lower=lower, upper=upper)
        kind = f"at random, {robot.joints} joints"
        size = (0.0, *ERRORS)[(seed + rounds) % (len(ERRORS) + 1)]
        way = ("numpy", "jax", "jit")[(seed + 2 * rounds) % 3]
        if way == "jit" and method_for(robot) == "multistart":
            # Guesses are for concrete arms.
            way = "jax"
        if way == "numpy":
            screws = off(robot, size, rng) if size else robot.screws
            yield Case(kind, dataclasses.replace(robot, screws=screws), searched=True)
            continue
        as_jax = jax.tree.map(jnp.asarray, robot)
        moved = dataclasses.replace(as_jax, screws=jnp.asarray(off(robot, size, rng)))
        if way == "jit":
            leaves = [moved.screws, moved.home, moved.lower, moved.upper]
            moved = jax.tree.unflatten(jax.tree.structure(as_jax), leaves)
        yield Case(f"{kind}, {way}", moved, way == "jit", searched=True)


def from_file(path: Path) -> Iterator[Case]:
    """The arms of a file."""
    for name, arm in json.loads(path.read_text())["arms"].items():
        lower, upper = (
            [sign * np.inf if x is None else x for x in arm[key]]
            for key, sign in (("lower", -1), ("upper", 1))
        )
        robot = nj.Robot.from_screws(
            arm["screws"], arm["home"], lower=lower, upper=upper, name=name
        )
        yield Case(f"{robot.joints} joints of a file", robot)


def joint_vectors(case: Case, poses: int, rng: np.random.Generator) -> np.ndarray:
    """(poses, n) within the limits, a quarter of them singular or at multiples of 45 degrees."""
    robot = case.robot
    low, high = (
        np.nan_to_num(np.asarray(x), neginf=-np.pi, posinf=np.pi)
        for x in (robot.lower, robot.upper)
    )
    q = rng.uniform(low, high, (poses, robot.joints))
    few = poses // 4
    if case.searched:
        q[:few] = _most_singular(_in_numpy(robot), q[:few], low, high, rng)
        return q
    turns = np.any(np.asarray(robot.screws)[:, :3], axis=1)
    step = np.pi / 4
    steps = rng.integers(np.ceil(low / step), np.floor(high / step) + 1, (few, robot.joints))
    q[:few] = np.where(turns, steps * step, q[:few])
    return np.clip(q, low, high)


def _most_singular(
    robot: nj.Robot, q: np.ndarray, low: np.ndarray, high: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """The postures (m, n) nearest to singular that moving a few joints, one at a time, leads to."""
    rows = np.arange(len(q))

    def smallest(joint: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(m, k) singular values where a joint (m,) of each posture has values (m, k)."""
        tried = np.repeat(q[:, None], values.shape[1], axis=1)
        tried[rows, :, joint] = values
        jacobian = reference.space_jacobian(robot, tried.reshape(-1, robot.joints))
        return np.linalg.svd(jacobian, compute_uv=False)[:, -1].reshape(values.shape)

    for _ in range(4):
        joint = rng.integers(0, robot.joints, len(q))
        left, right = low[joint], high[joint]
        # A grid about the least value so far, finer each time.
        for points in (65, *[9] * 26):
            values = left[:, None] + (right - left)[:, None] * np.linspace(0, 1, points)
            best = values[rows, smallest(joint, values).argmin(axis=1)]
            reach = (right - left) / (points - 1)
            left = np.maximum(best - reach, low[joint])
            right = np.minimum(best + reach, high[joint])
        q[rows, joint] = best
    return q


def judged(case: Case, poses: int, seed: int) -> dict[str, Any]:
    """Counts of what was said of the poses."""
    robot = case.robot
    q = joint_vectors(case, poses, np.random.default_rng(seed))
    pose = reference.forward_kinematics(_in_numpy(robot), q)
    answer = jax.block_until_ready(case.solve(pose))
    found, complete = np.asarray(answer.found), np.asarray(answer.complete)
    reached = reference.forward_kinematics(_in_numpy(robot), np.asarray(answer.q)[found])
    wanted = np.broadcast_to(pose[:, None], (*found.shape, 4, 4))[found]
    scale = 1 + np.abs(wanted[:, :3, 3]).max(axis=1, initial=0)
    allowed = MISS * scale
    if robot.joints < 6:
        # Next to what such an arm can do the nearest pose is an answer, which says how near it is.
        allowed += np.asarray(answer.position_error + answer.rotation_error)[found]
    spurious = np.abs(reached - wanted).max(axis=(1, 2), initial=0) > allowed
    apart = np.abs(np.asarray(answer.q) - q[:, None])
    turns = np.any(np.asarray(robot.screws)[:, :3], axis=1)
    apart = np.where(turns, np.minimum(apart % (2 * np.pi), -apart % (2 * np.pi)), apart)
    made = np.any(found & (apart.max(axis=2) < SAME), axis=1)
    jacobian = reference.space_jacobian(_in_numpy(robot), q)
    smallest = np.linalg.svd(jacobian, compute_uv=False)[:, -1]
    regular = smallest > 1e-3
    singular = smallest < SINGULAR
    status = np.asarray(answer.status)
    # Joints to spare: not all of infinitely many solutions, and those that are named are others.
    lost = complete & np.where(singular, ~found.any(axis=1), regular & ~made)
    lost &= robot.joints <= 6
    return {
        "poses": poses,
        "unreachable": int(np.sum(status == nj.IKStatus.UNREACHABLE)),
        "falsely complete": int(np.sum(lost)),
        "spurious": int(np.sum(spurious)),
        "complete": int(np.sum(complete)),
        "found": int(np.sum(found.any(axis=1))),
        "in limits": int(np.sum(status == nj.IKStatus.SOLVED)),
        "made-by": int(np.sum(made | ~regular)),
        "singular": int(np.sum(singular)),
    }


def _in_numpy(robot: nj.Robot) -> nj.Robot:
    return dataclasses.replace(
        robot, screws=np.asarray(robot.screws, float), home=np.asarray(robot.home, float)
    )


FALSE = "unreachable", "falsely complete", "spurious"


def measure(todo: list[Case], poses: int) -> Report:
    """All cases, and a table of the kinds."""
    facts = about(poses=poses, arms=len(todo))
    report = Report("Honesty", {"about": facts, "cases": []}, [header(facts)])
    kinds: dict[str, dict[str, int]] = {}
    for seed, case in enumerate(todo):
        counts = judged(case, poses, seed)
        text = f"{case.robot.name}, {case.kind}"
        print(f"  {text}: {counts}", flush=True)
        report.data["cases"].append({"case": text, **counts})
        report.wrong += [f"{text}: {counts[name]} {name}" for name in FALSE if counts[name]]
        total = kinds.setdefault(re.sub("^off by", "axes off by", case.kind), {"arms": 0})
        for name, count in {"arms": 1, **counts}.items():
            total[name] = total.get(name, 0) + count
    names = list(next(iter(kinds.values())))
    rows = [[kind, *(f"{total[name]:,}" for name in names)] for kind, total in kinds.items()]
    report.sections.append(table(["arms", *names], rows))
    return report


def main() -> int:
    """Judge, print, and fail where something false is said."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--variants", type=int, default=2)
    parser.add_argument("--random", type=int, default=200, help="how many random arms")
    parser.add_argument("--arms", type=Path, default=REAL_ARMS, help="a JSON file of further arms")
    parser.add_argument("--no-arms", dest="arms", action="store_const", const=None)
    parser.add_argument("--only", nargs="*", help="of these shipped arms alone")
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    names = nj.robots.names() if options.only is None else tuple(options.only)
    todo = [*cases(names, options.variants), *at_random(options.random)]
    if options.arms is not None:
        todo += from_file(options.arms)
    return measure(todo, options.poses).finish("honesty" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
