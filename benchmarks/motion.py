"""Paths and their times beside toppra and ruckig, on one core.

    python -m benchmarks.motion [--moves 100000] [--paths 64] [--rounds 5]

What is aimed at: a line of 300 mm at 1 kHz to 1e-9 m without a jump; lines that one branch cannot
finish done on another; 1,000 paths of 100 samples a second by `best_path`; durations within 1 % of
toppra's on the same splines; moves from point to point as short as ruckig's. The exit code is 1
where a limit or a line is not kept.
"""

from __future__ import annotations

import argparse
import importlib
import logging
from collections.abc import Callable
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
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
from niryo_jax import motion

LEAST = 0.1
"""Seconds a round lasts at the least."""

ON_LINE = 1e-9
"""Metres that the tool may be off the line."""

BETWEEN = 1e-4
"""A share by which a limit may be passed between nodes."""

NEAR = 0.01
"""A share by which a duration may differ from the peer's."""

WAYPOINTS, NODES, FEW = 8, 1024, 200
"""Waypoints of a path, nodes of toppra's grid, moves that ruckig handles in a run."""


def straight(count: int) -> np.ndarray:
    """Poses of the tool along 300 mm."""
    ends = np.tile(np.eye(4), (2, 1, 1))
    ends[:, :3, 3] = [0.25, -0.15, 0.2], [0.25, 0.15, 0.2]
    return np.asarray(motion.cartesian_trajectory(*ends, 1.0, count, lambda u: u).pose)


def check_line(robot: nj.Robot, limits: motion.MotionLimits, report: Report) -> None:
    """A line at 1 kHz: first its time, then the joint vectors of every millisecond."""
    coarse = motion.best_path(robot, straight(301))
    timed = motion.retime(coarse, limits, robot=robot)
    # In the middle two joints turn round at a node of the second: rounding must not hold it up.
    half = motion.retime(coarse, limits, robot=robot, intervals=2048)
    if abs(float(half.duration / timed.duration) - 1) > 1e-3:
        report.wrong.append(f"the line: {half.duration:.3f} or {timed.duration:.3f} s")
    at = timed.every(1e-3)
    position = np.asarray(nj.forward_kinematics(robot, at.q))[:, :3, 3]
    between = float(np.max(np.linalg.norm(position[:, [0, 2]] - [0.25, 0.2], axis=1)))
    poses = np.tile(np.eye(4), (len(at.time), 1, 1))
    poses[:, :3, 3] = [0.25, 0.0, 0.2]
    poses[:, 1, 3] = np.clip(position[:, 1], -0.15, 0.15)
    exact = motion.best_path(robot, poses)
    reached = np.asarray(nj.forward_kinematics(robot, exact.q))[:, :3, 3]
    off = float(np.max(np.linalg.norm(reached - poses[:, :3, 3], axis=1)))
    step = np.max(np.abs(np.diff(exact.q, axis=0)) / (1e-3 * np.asarray(limits.velocity)))
    holds = bool(exact.ok) and max(off, between) < ON_LINE and step < 1 + BETWEEN
    if not holds:
        report.wrong.append(f"the line: off by {max(off, between):.1e} m, steps of {step:.2f}")
    report.sections.append(
        f"A line of 300 mm, {float(timed.duration):.3f} s, {len(at.time):,} samples at 1 kHz: "
        f"solved at each, off by {off:.0e} m; read from the spline through 301 samples, by "
        f"{between:.0e} m; the largest step is {step:.2f} of what the velocity limits allow."
    )
    text = f"300 mm at 1 kHz within {ON_LINE:g} m of the line, without a jump"
    report.claims.append(Claim(text, holds))


def check_other_branch(robot: nj.Robot, report: Report) -> None:
    """Random lines which `follow`, begun on the solution that comes first, does not finish."""
    rng = np.random.default_rng(4)
    q = rng.uniform(robot.lower, robot.upper, (2, 64, 6))
    q[1] = np.clip(q[0] + rng.uniform(-1, 1, (64, 6)), robot.lower, robot.upper)
    a, b = np.asarray(nj.forward_kinematics(robot, q))
    lines = np.asarray(motion.cartesian_trajectory(a, b, 1.0, 60, lambda u: u).pose)
    best = motion.best_path(robot, lines)
    saved = lost = 0
    for poses, joints, ok in zip(lines, best.q, best.ok):
        first = nj.inverse_kinematics(robot, poses[0])
        followed = bool(np.all(nj.follow(robot, poses, first.q[0]).ok))
        saved += bool(ok) and not followed
        lost += followed and not ok
        if ok:
            miss = np.abs(np.asarray(nj.forward_kinematics(robot, joints)) - poses).max()
            if miss > ON_LINE or np.max(np.abs(np.diff(joints, axis=0))) > 0.5:
                report.wrong.append("a line that best_path calls done is not")
    report.sections.append(
        f"Of {len(lines)} random lines best_path does {np.sum(best.ok)}, {saved} of which the "
        f"branch that comes first does not finish ({lost} the other way round)."
    )
    text = "lines that one branch cannot finish are found on another"
    report.claims.append(Claim(text, saved > 0 and not lost))


def smooth_lines(robot: nj.Robot, paths: int, samples: int) -> np.ndarray:
    """Poses (paths, samples, 4, 4) of random straight lines of joint vectors."""
    rng = np.random.default_rng(0)
    start = rng.uniform(robot.lower, robot.upper, (paths, 1, 6))
    end = np.clip(start + rng.uniform(-0.5, 0.5, start.shape), robot.lower, robot.upper)
    share = np.linspace(0, 1, samples)[:, None]
    return np.asarray(nj.forward_kinematics(robot, (1 - share) * start + share * end))


def by_toppra(
    limits: motion.MotionLimits, q: np.ndarray, knots: np.ndarray
) -> Callable[[], np.ndarray]:
    """The durations of the same splines, path by path; the splines are made outside."""
    ta = importlib.import_module("toppra")
    logging.getLogger("toppra").setLevel(logging.ERROR)
    constraint, algorithm = (
        importlib.import_module(f"toppra.{name}") for name in ("constraint", "algorithm")
    )
    velocity, acceleration = (
        np.stack([-np.asarray(x), np.asarray(x)], axis=1)
        for x in (limits.velocity, limits.acceleration)
    )
    splines = [ta.SplineInterpolator(s, path, bc_type="not-a-knot") for s, path in zip(knots, q)]
    grid = np.linspace(0, 1, NODES + 1)

    def run() -> np.ndarray:
        out = []
        for spline in splines:
            both = [
                constraint.JointVelocityConstraint(velocity),
                constraint.JointAccelerationConstraint(acceleration),
            ]
            problem = algorithm.TOPPRA(
                both, spline, gridpoints=grid, parametrizer="ParametrizeConstAccel"
            )
            out.append(problem.compute_trajectory().duration)
        return np.array(out)

    return run


def by_ruckig(
    limits: motion.MotionLimits, start: np.ndarray, end: np.ndarray
) -> Callable[[], np.ndarray]:
    """The durations of moves, one by one."""
    ruckig = importlib.import_module("ruckig")
    given, solver = ruckig.InputParameter(6), ruckig.Ruckig(6)
    given.max_velocity, given.max_acceleration, given.max_jerk = (
        np.asarray(x).tolist() for x in (limits.velocity, limits.acceleration, limits.jerk)
    )
    ends = list(zip(start.tolist(), end.tolist()))
    answer = ruckig.Trajectory(6)

    def run() -> np.ndarray:
        out = []
        for given.current_position, given.target_position in ends:
            solver.calculate(given, answer)
            out.append(answer.duration)
        return np.array(out)

    return run


def shares(path: motion.TimedPath, limits: motion.MotionLimits) -> tuple[float, float]:
    """The largest velocity and acceleration, as shares of their limits, on a fine grid."""
    time = np.linspace(0, 1, 20_001) * np.asarray(path.duration)[:, None]
    found = path.at(time)
    velocity, acceleration = (
        float(np.max(np.abs(np.asarray(rate)) / np.asarray(most)))
        for rate, most in (
            (found.velocity, limits.velocity),
            (found.acceleration, limits.acceleration),
        )
    )
    return velocity, acceleration


def measure(
    moves: int, paths: int, lines: int, rounds: int, report: Report, skip: tuple[str, ...] = ()
) -> None:
    """Add rates, answers and claims to a report."""
    robot, limits = nj.robots.niryo_one(), motion.niryo_limits()
    rng = np.random.default_rng(1)
    start, end = rng.uniform(robot.lower, robot.upper, (2, moves, 6))
    q = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper, (paths, WAYPOINTS, 6))
    many = smooth_lines(robot, lines, 100)

    def peers(name: str) -> bool:
        if name in skip or version_of(name) is None:
            report.sections.append(f"{name}: not installed (pip install {name})")
            return False
        return True

    given = jax.device_put((start, end))
    runs: list[tuple[str, str, int, Callable[[], Any]]] = [
        ("best_path, 100 samples", "path", lines, lambda: motion.best_path(robot, many)),
        ("retime", "path", paths, lambda: motion.retime(q, limits)),
        (f"retime, {NODES:,}", "path", paths, lambda: motion.retime(q, limits, intervals=NODES)),
        ("retime, one path", "path", 1, lambda: motion.retime(q[0], limits)),
    ]
    for profile in ("trapezoid", "scurve", "quintic"):
        runs.append(
            (
                f"point_to_point, {profile}",
                "move",
                moves,
                lambda p=profile: motion.point_to_point(*given, limits, p).duration,
            )
        )
    if peers("toppra"):
        knots = np.asarray(motion.retime(q, limits).spline.knots)
        runs.append((f"toppra, {NODES:,}", "path", paths, by_toppra(limits, q, knots)))
    if peers("ruckig"):
        few = min(FEW, moves)
        runs.append(("ruckig", "move", few, by_ruckig(limits, start[:few], end[:few])))
    subjects = [Timed(name, size, run) for name, _, size, run in runs]
    alternate(subjects, rounds, LEAST)
    of = {subject.name: subject for subject in subjects}
    rows = [
        [s.name, f"{s.rate:,.0f} {what}s/s", f"{s.spread:.0%}", f"{s.first:.2f}"]
        for s, (_, what, *_) in zip(subjects, runs)
    ]
    head = ("by", "rate", "spread", "first call (s)")
    report.sections.append(table(head, rows))
    report.data["subjects"] = [subject.facts() for subject in subjects]
    _judge(of, limits, moves, report)


def _judge(of: dict[str, Timed], limits: motion.MotionLimits, moves: int, report: Report) -> None:
    """Answers looked at, and claims."""
    best = of["best_path, 100 samples"]
    if not np.all(best.result.ok):
        report.wrong.append("best_path: lines of joint vectors within the limits are not done")
    text = f"best_path: {best.rate:,.0f} paths of 100 samples a second on one core, of 1,000"
    report.claims.append(Claim(text, best.rate >= 1000))
    path = of["retime"].result
    velocity, acceleration = shares(path, limits)
    if max(velocity, acceleration) > 1 + BETWEEN:
        report.wrong.append(f"retime: {velocity:.4f} and {acceleration:.4f} of its limits")
    report.sections.append(
        f"Between its nodes retime comes to {velocity:.6f} of a velocity limit, and to "
        f"{acceleration:.6f} of an acceleration limit."
    )
    theirs = of.get(f"toppra, {NODES:,}")
    ours, ratio, holds = np.asarray(path.duration), "-", None
    if theirs is not None:
        off = ours / theirs.result - 1
        holds = bool(np.all(np.abs(off) < NEAR))
        ratio = f"{off.min():+.2%} to {off.max():+.2%}"
    report.claims.append(Claim(f"durations within 1 % of toppra's ({ratio})", holds))
    for name in ("retime", f"retime, {NODES:,}", "retime, one path"):
        over = np.nan if theirs is None else of[name].rate / theirs.rate
        text = f"{name}: {over:.1f} times as many paths a second as toppra"
        report.claims.append(Claim(text, None if theirs is None else bool(over >= 1)))
    theirs = of.get("ruckig")
    curve = of["point_to_point, scurve"]
    ratio, holds, over = "-", None, np.nan
    if theirs is not None:
        off = np.asarray(curve.result)[: len(theirs.result)] / theirs.result - 1
        holds = bool(np.all(np.abs(off) < 1e-6))
        ratio, over = f"{np.abs(off).max():.0e}", curve.rate / theirs.rate
    report.claims.append(Claim(f"S-curves as short as ruckig's (to {ratio})", holds))
    text = f"{moves:,} S-curves: {over:.1f} times as many a second as ruckig"
    report.claims.append(Claim(text, None if theirs is None else bool(over >= 1)))


def main() -> int:
    """Run, print, and return the exit code."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=100_000)
    parser.add_argument("--paths", type=int, default=64)
    parser.add_argument("--lines", type=int, default=1_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    facts = about("toppra", "ruckig", moves=options.moves, paths=options.paths)
    report = Report("Time along paths", facts, [header(facts)])
    robot = nj.robots.niryo_one()
    check_line(robot, motion.niryo_limits(), report)
    check_other_branch(robot, report)
    measure(options.moves, options.paths, options.lines, options.rounds, report)
    return report.finish("motion" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
