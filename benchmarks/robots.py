"""Exact inverse kinematics of the robots of the founding book, one for each family.

    python -m benchmarks.robots [--poses 65536] [--recall 5000] [--rounds 7] [--only ur16e ...]
                                [--save]

Each arm gets poses made from random joint vectors. Its complete sets are checked against a search
(Newton-Raphson from many starts, which knows nothing of closed forms) and against forward
kinematics in plain numpy; the exit code is 1 where one is missing or wrong. Then they are timed on
one core beside eaik's batched call on the same arm, where eaik solves it.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import io
from typing import Any, NamedTuple

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import reference
from benchmarks.measure import Claim, Report, Timed, about, alternate, header, table, version_of
from niryo_jax import families
from niryo_jax.ik.methods.multistart import solve_multistart

ARMS = {
    "abb_irb120": None,
    "abb_irb1600": None,
    "abb_irb6620lx": None,
    "abb_irb910sc": None,
    "ur16e": None,
    "kuka_iiwa14": (2, 0.6),
}
"""The arms, and of the one with seven joints the joint that is locked and its value."""

STARTS = 256
SAME = 1e-6
RIGHT = 1e-11
TIMES = 4
PEER_POSES = 8_192

POSE_OF_THE_BOOK = (
    (-0.8401, 0.5318, 0.1069, -0.4226),
    (0.5391, 0.7968, 0.2731, 0.2161),
    (0.0600, 0.2870, -0.9560, 0.1709),
    (0.0, 0.0, 0.0, 1.0),
)
NUMERIC_OF_THE_BOOK = (-1.9134, -0.1847, -0.3630, -0.1163, -1.0924, 1.4402)


class Case(NamedTuple):
    """One arm and its poses."""

    name: str
    robot: nj.Robot
    locked: tuple[int, float] | None
    q: np.ndarray
    pose: np.ndarray

    def solve(self, pose: Any) -> nj.IKSolutions:
        """All solutions of poses."""
        return nj.inverse_kinematics(self.robot, pose, locked=self.locked)


def case(name: str, poses: int) -> Case:
    """An arm with poses made from joint vectors within its limits."""
    robot, locked = nj.robots.load(name), ARMS[name]
    turn = np.pi
    q = np.random.default_rng(0).uniform(
        np.maximum(robot.lower, -turn), np.minimum(robot.upper, turn), (poses, robot.joints)
    )
    if locked is not None:
        q[:, locked[0]] = locked[1]
    parts = np.array_split(q, 1 + poses // 65_536)
    pose = np.concatenate([reference.forward_kinematics(robot, part) for part in parts])
    return Case(name, robot, locked, q, pose)


def check(case: Case, count: int, report: Report) -> list[str]:
    """Recall and precision of the first poses; a row of the table."""
    robot, pose, q = case.robot, case.pose[:count], case.q[:count]
    turns = np.array(robot.plans[0].periodic if case.locked is None else [True] * robot.joints)

    def far(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        wrapped = (a - b + np.pi) % (2 * np.pi) - np.pi
        return np.abs(np.where(turns, wrapped, a - b)).max(axis=-1)

    mine = case.solve(pose)
    found, solutions = np.asarray(mine.found), np.asarray(mine.q)
    owner = np.nonzero(found)[0]
    reached = reference.forward_kinematics(robot, solutions[found])
    misses = float(np.abs(reached - pose[owner]).max())
    made = np.any(found & (far(solutions, q[:, None]) < SAME), axis=1)
    searched = _search(case, pose)
    theirs, exist = np.asarray(searched.q), np.asarray(searched.found)
    known = np.zeros(exist.shape, bool)
    for slot in range(solutions.shape[1]):
        one = solutions[:, slot, None]
        known |= found[:, slot, None] & (far(theirs, one) < SAME)
    missed = int(np.sum(exist & ~known))
    proved = float(np.mean(np.asarray(mine.complete)))
    for text, bad in (
        (f"{missed} solutions of the search are missing", missed),
        (f"{int(np.sum(~made))} generating joint vectors are missing", not made.all()),
        (f"an answer misses by {misses:.1e}", not misses < RIGHT),
    ):
        if bad:
            report.wrong.append(f"{case.name}: {text}")
    counts = sorted({int(n) for n in np.asarray(mine.count)})
    report.data[f"recall, {case.name}"] = {
        "poses": count,
        "solutions": int(found.sum()),
        "search": int(exist.sum()),
        "missed": missed,
        "largest miss": misses,
        "proved complete": proved,
    }
    return [
        case.name,
        f"{count:,}",
        f"{found.sum():,}",
        f"{exist.sum():,}",
        f"{missed}",
        f"{misses:.0e}",
        f"{proved:.2%}",
        ", ".join(map(str, counts)),
    ]


def _search(case: Case, pose: np.ndarray) -> nj.IKSolutions:
    """What many starts find, on the arm that is left where a joint is locked."""
    if case.locked is None:
        return solve_multistart(case.robot, pose, starts=STARTS)
    joint, value = case.locked
    robot = case.robot
    screws = families.lock(np.asarray(robot.screws), joint, value)
    motion = np.asarray(nj.se3.exp(value * robot.screws[joint]))
    left = nj.Robot.from_screws(screws, motion @ np.asarray(robot.home))
    answer = solve_multistart(left, pose, starts=STARTS)
    q = np.insert(np.asarray(answer.q), joint, value, axis=-1)
    return dataclasses.replace(answer, q=q)


def eaik(case: Case) -> Timed | None:
    """eaik's batched call on the arm with one thread; None where eaik is not there or refuses."""
    if version_of("eaik") is None or set(case.robot.plans[0].periodic) != {True}:
        return None
    from eaik.IK_HP import HPRobot

    screws, home = np.asarray(case.robot.screws), np.asarray(case.robot.home)
    points = [*np.cross(screws[:, :3], screws[:, 3:]), home[:3, 3]]
    steps = np.diff(points, axis=0, prepend=np.zeros((1, 3)))
    with contextlib.redirect_stdout(io.StringIO()):
        robot = HPRobot(screws[:, :3], steps, [] if case.locked is None else [case.locked])
    if not robot.hasKnownDecomposition():
        return None
    # It takes the tool frame to be parallel to the space frame at home.
    given = case.pose[:PEER_POSES].copy()
    given[:, :3, :3] = given[:, :3, :3] @ home[:3, :3].T
    poses = list(given)

    def solve() -> list[Any]:
        return robot.IK_batched(poses, num_worker_threads=1)

    for answer, pose in zip(solve()[:16], poses):
        exact = np.asarray(answer.Q)[~np.asarray(answer.is_LS, bool)]
        if not any(np.abs(robot.fwdKin(q) - pose).max() < 1e-6 for q in exact):
            return None
    return Timed("eaik, batched", len(poses), lambda: len(solve()))


def book_example() -> str:
    """The pose that the book solves, and what its two answers are worth."""
    robot = nj.robots.abb_irb120(up="y", edition=2018)
    pose = np.array(POSE_OF_THE_BOOK)
    answer = nj.inverse_kinematics(robot, pose)
    numeric = reference.forward_kinematics(robot, np.array([NUMERIC_OF_THE_BOOK]))[0]
    away = float(np.linalg.norm(numeric[:3, 3] - pose[:3, 3]))
    many = jax.device_put(np.broadcast_to(pose, (65_536, 4, 4)))
    timed = Timed("the pose of the book", len(many), lambda: nj.inverse_kinematics(robot, many))
    alternate([timed], 7, 0.1)
    each = timed.seconds / timed.size * 1e6
    return (
        f"The book's pose of the IRB120: {int(answer.count)} solutions, {each:.2f} us a pose in a "
        f"batch of {timed.size:,} on one core. The book gives 371 us for one exact solution and "
        f"106 ms for a numeric solver, whose printed answer misses by {away:.3f} m."
    )


def measure(poses: int, recall: int, rounds: int, only: list[str]) -> Report:
    """All arms."""
    facts = about("eaik", rounds=rounds, poses=poses, recall=recall)
    report = Report("Robots of the book", {"about": facts}, [header(facts)])
    checks, rows = [], []
    for name in only or ARMS:
        print(f"  {name}", flush=True)
        this = case(name, poses)
        checks.append(check(this, recall, report))
        runs = []
        for dtype in ("float64", "float32"):
            solve = functools.partial(this.solve, jax.device_put(this.pose.astype(dtype)))
            runs.append(Timed(f"niryo_jax, {dtype}", poses, solve))
        theirs = eaik(this)
        if theirs is not None:
            runs.append(theirs)
        alternate(runs, rounds, 0.1)
        for run in runs:
            over = runs[0].rate / run.rate
            cells = [name, run.name, f"{run.rate:,.0f}", f"{run.spread:.0%}", f"{over:.2f}"]
            rows.append([*cells, f"{run.first:.1f}"])
            report.data[f"{name}, {run.name}"] = run.facts()
        if theirs is not None:
            over = runs[0].rate / theirs.rate
            text = f"{name}: at least {TIMES} x eaik's batched call, one core: {over:.2f} x"
            report.claims.append(Claim(text, over >= TIMES))
        jax.clear_caches()
    head = ["arm", "poses", "solutions", "of the search", "missed", "largest miss", "complete"]
    report.sections.append(table([*head, "counts"], checks))
    head = ["arm", "solver", "poses/s", "spread", "ours / its", "first call (s)"]
    report.sections.append(table(head, rows))
    report.sections.append(book_example())
    return report


def main() -> int:
    """Measure, print, and fail where an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=65_536)
    parser.add_argument("--recall", type=int, default=5_000, help="poses that are searched")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", nargs="*", default=[], choices=list(ARMS))
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    report = measure(options.poses, options.recall, options.rounds, options.only)
    return report.finish("robots" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
