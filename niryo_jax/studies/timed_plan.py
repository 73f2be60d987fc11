"""A plan of steps as one timed trajectory: lines of the tool, smooth free ways, rests of the arm.

A move whose poses differ along z alone is a vertical line of the tool. What lies between is free:
the joints pass through the pose where it meets a line along the line's own direction, and need not
stop there. The arm rests at the start, at the end, and where its gripper acts.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from niryo_jax.arguments import check_number, check_positive
from niryo_jax.hardware.pick_and_place import Plan, StepUnsolvable
from niryo_jax.ik import follow
from niryo_jax.motion import (
    JointTrajectory,
    MotionLimits,
    cartesian_trajectory,
    niryo_limits,
    retime,
)
from niryo_jax.motion.limits import check_limits_of
from niryo_jax.robots import MODELS
from niryo_jax.studies.smooth_way import End, end_of, free_way, towards

Vector = NDArray[np.float64]

DWELL = 1.0
"""Seconds that the arm rests while its gripper acts: longer than that of a Niryo takes."""

SAMPLING = 0.01
"""Seconds between two samples, at most."""

_LINE = 5e-4
"""Metres between two poses of a line that are solved: in between a spline misses by picometres."""

_ROW = 256
"""Times are looked up in rows of a multiple of this, so that programs are few."""

_SAME = 1e-9
_SAME_JOINTS = 1e-6


@dataclasses.dataclass(frozen=True)
class TimedStep:
    """When a step of a plan begins and ends.

    Attributes:
        begin, end: seconds from the start of the trajectory.
        first, last: the samples of the trajectory at these times.
        line: whether the tool goes along a vertical line.
        rests: whether the arm is at rest at its end.
    """

    begin: float
    end: float
    first: int
    last: int
    line: bool
    rests: bool


@dataclasses.dataclass(frozen=True)
class TimedPlan:
    """A plan as one trajectory, which begins where its first step ends.

    Attributes:
        plan: the steps, solved.
        steps: when each of them is done; the first takes no time.
        trajectory: joints (k, n), radians, and their rates at times (k,) that increase, from 0.
        motions: the first and the last step of each motion from rest to rest.
    """

    plan: Plan
    steps: tuple[TimedStep, ...]
    trajectory: JointTrajectory
    motions: tuple[tuple[int, int], ...]

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.steps[-1].end

    def motion(self, number: int) -> JointTrajectory:
        """The part from one rest to the next, its times from 0, as the joints are to be told."""
        first, last = (self.steps[i] for i in self.motions[number])
        part = slice(first.first, last.last + 1)
        time, *joints = (np.asarray(x)[part] for x in self.trajectory)
        return JointTrajectory(time - time[0], *map(self.plan.told, joints))  # pyright: ignore[reportArgumentType]


def timed_plan(
    plan: Plan,
    limits: MotionLimits | None = None,
    *,
    dwell: float = DWELL,
    step: float = SAMPLING,
) -> TimedPlan:
    """Time a plan within the velocities and accelerations of the joints, as fast as these allow.

    Args:
        plan: the steps, solved. Each move takes the percentage of its step of all velocities.
        limits: of the joints; those of the Niryo of the plan where not given.
        dwell: seconds that the arm rests where its gripper acts.
        step: seconds between two samples, at most.

    Returns:
        A `TimedPlan`. Lines are exact in float64 alone (`jax_enable_x64`).

    Raises:
        StepUnsolvable: a line of the tool that leaves the limits, or the branch of its ends; a
            free way that swings out of the limits.
        ValueError: no steps, an arm without known limits, limits of another number of joints, a
            time that is not positive (of the dwell: negative).
        TypeError: no numbers, no limits.
    """
    robot = plan.robot
    if not plan.steps:
        raise ValueError("plan: expected one step or more, got none")
    if limits is None:
        if robot.name not in MODELS:
            raise ValueError(f"limits: expected those of {robot.name}, which is no Niryo, got None")
        limits = niryo_limits(robot.name)
    check_limits_of(limits, robot.joints)
    check_number("dwell", dwell, "seconds, zero or more", lambda x: 0 <= x < math.inf)
    check_positive("step", step, "a positive number of seconds")
    motions = _motions(plan)
    done = _timed(plan, limits, motions, step) if motions else []
    return _assembled(plan, motions, done, float(dwell), step)


@dataclasses.dataclass(frozen=True)
class _Motion:
    """Moves from rest to rest.

    Attributes:
        first: the step of the first of them.
        q: (k, n) joint vectors on the way.
        ends: the samples at which each of them ends.
        lines: which of them are lines.
    """

    first: int
    q: Vector
    ends: tuple[int, ...]
    lines: tuple[bool, ...]


def _motions(plan: Plan) -> list[_Motion]:
    """All motions; moves to where the arm stands are none, and stand between two."""
    lines = _Lines(plan)
    motions = list[_Motion]()
    group = list[int]()

    def close() -> None:
        if group:
            motions.append(_motion(plan, lines, group))
        group.clear()

    for number in range(1, len(plan.steps)):
        if not _moves(plan, number):
            close()
            continue
        if group and lines.is_line(number) and lines.is_line(number - 1):
            # Two lines meet in a corner.
            close()
        group.append(number)
    close()
    return motions


def _moves(plan: Plan, number: int) -> bool:
    way = plan.steps[number].joints - plan.steps[number - 1].joints
    return plan.steps[number].step.action == "move" and float(np.max(np.abs(way))) > _SAME


def _motion(plan: Plan, lines: _Lines, group: list[int]) -> _Motion:
    stops = [plan.steps[i].joints for i in (group[0] - 1, *group)]
    straight = [lines.between(i) if lines.is_line(i) else None for i in group]
    ways = list[Vector]()
    for at, line in enumerate(straight):
        if line is not None:
            ways.append(line)
            continue
        chord = stops[at + 1] - stops[at]
        start, end = towards(stops[at], chord), towards(stops[at + 1], chord)
        if at > 0:
            start = _through(straight[at - 1], stops[at - 1 : at + 2])
        if at + 1 < len(group):
            after = straight[at + 1]
            backwards = None if after is None else after[::-1]
            end = _through(backwards, stops[at + 2 : at - 1 if at else None : -1])
            end = end.reversed()
        ways.append(free_way(start, end))
    q = np.concatenate([ways[0], *(way[1:] for way in ways[1:])])
    ends = np.cumsum([len(way) - 1 for way in ways])
    return _Motion(group[0], q, tuple(ends.tolist()), tuple(x is not None for x in straight))


def _through(line: Vector | None, stops: list[Vector]) -> End:
    """How a stop, the middle one of three, is passed: along the line that leads to it, or in the
    direction from the one before to the one after."""
    return end_of(line) if line is not None else towards(stops[1], stops[2] - stops[0])


class _Lines:
    """The vertical lines of a plan; one that is gone along twice is solved once."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._known = dict[tuple[bytes, bytes], Vector]()
        poses = list[Vector | None]()
        for planned in plan.steps:
            stays = poses[-1] if poses else None
            poses.append(stays if planned.step.pose is None else planned.step.pose)
        self._poses = poses

    def is_line(self, number: int) -> bool:
        """Whether a step is a move along z alone."""
        start, end = self._poses[number - 1], self._poses[number]
        if start is None or end is None or self._plan.steps[number].step.action != "move":
            return False
        apart = np.abs(end - start)
        rise = float(apart[2, 3])
        apart[2, 3] = 0.0
        return rise > _SAME and float(np.max(apart)) <= _SAME

    def between(self, number: int) -> Vector:
        """(k, n) joints along the line of a step."""
        start, end = (self._plan.steps[i].joints for i in (number - 1, number))
        ends = np.round(start, 9).tobytes(), np.round(end, 9).tobytes()
        if ends[::-1] in self._known:
            return self._known[ends[::-1]][::-1]
        if ends not in self._known:
            self._known[ends] = self._solved(number, start, end)
        return self._known[ends]

    def _solved(self, number: int, start: Vector, end: Vector) -> Vector:
        robot, step = self._plan.robot, self._plan.steps[number].step
        first, last = self._poses[number - 1], self._poses[number]
        assert first is not None
        assert last is not None
        count = 3 + math.ceil(abs(last[2, 3] - first[2, 3]) / _LINE)
        poses = cartesian_trajectory(first, last, 1.0, count, lambda u: u).pose
        path = follow(robot, poses, start)
        q = np.array(path.q, np.float64)
        if not np.all(path.ok):
            raise StepUnsolvable(
                f"step {number + 1} ({step.title}) of {robot.name}, a line of the tool: "
                f"{path.message}"
            )
        if np.max(np.abs(q[[0, -1]] - [start, end])) > _SAME_JOINTS:
            raise StepUnsolvable(
                f"step {number + 1} ({step.title}) of {robot.name}: the line of the tool leads to "
                "other joints than those that were chosen for its end"
            )
        q[0], q[-1] = start, end
        return q


@dataclasses.dataclass(frozen=True)
class _Done:
    """A motion in time: its samples, and which of them end its moves."""

    trajectory: JointTrajectory
    ends: tuple[int, ...]


def _timed(plan: Plan, limits: MotionLimits, motions: list[_Motion], step: float) -> list[_Done]:
    """All motions timed in one batch."""
    count = max(len(motion.q) for motion in motions)
    q, pace = np.empty((len(motions), count, plan.robot.joints)), np.ones((len(motions), count - 1))
    for row, motion in enumerate(motions):
        q[row, : len(motion.q)], q[row, len(motion.q) :] = motion.q, motion.q[-1]
        for number, (start, end) in enumerate(zip((0, *motion.ends), motion.ends)):
            pace[row, start:end] = plan.steps[motion.first + number].step.percent / 100
    try:
        path = retime(q, limits, robot=plan.robot, pace=pace)
    except ValueError as error:
        raise StepUnsolvable(
            f"{plan.robot.name}: the way of the motions that begin with steps "
            f"{', '.join(str(motion.first + 1) for motion in motions)}: {error}"
        ) from error
    knots, s, at = (np.asarray(x, np.float64) for x in (path.spline.knots, path.s, path.time))
    times, ends = list[Vector](), list[tuple[int, ...]]()
    for row, motion in enumerate(motions):
        nodes = np.argmin(np.abs(s[row, :, None] - knots[row, list(motion.ends)]), axis=0)
        parts, stop = [np.zeros(1)], [0]
        for start, end in zip((0, *nodes[:-1]), nodes):
            begin, finish = at[row, start], at[row, end]
            parts.append(np.linspace(begin, finish, 1 + math.ceil((finish - begin) / step))[1:])
            stop.append(stop[-1] + len(parts[-1]))
        times.append(np.concatenate(parts))
        ends.append(tuple(stop[1:]))
    width = -(-max(map(len, times)) // _ROW) * _ROW
    looked_up = np.stack([np.pad(time, (0, width - len(time)), mode="edge") for time in times])
    _, *found = path.at(looked_up)
    numbers = [np.asarray(x, np.float64) for x in found]
    return [
        _Done(JointTrajectory(time, *(x[row, : len(time)] for x in numbers)), stop)  # pyright: ignore[reportArgumentType]
        for row, (time, stop) in enumerate(zip(times, ends))
    ]


def _assembled(
    plan: Plan, motions: list[_Motion], done: list[_Done], dwell: float, step: float
) -> TimedPlan:
    """Motions and rests, one after the other."""
    start = plan.steps[0].joints
    at_rest = np.zeros((1, len(start)))
    parts = [JointTrajectory(np.zeros(1), start[None], at_rest, at_rest)]  # pyright: ignore[reportArgumentType]
    steps = [TimedStep(0.0, 0.0, 0, 0, line=False, rests=True)]
    of = {motion.first: (motion, timed) for motion, timed in zip(motions, done)}

    def add(part: JointTrajectory) -> None:
        """All of a part but its first sample, which is the last one so far."""
        time = steps[-1].end + np.asarray(part.time)[1:]
        parts.append(JointTrajectory(time, *(np.asarray(x)[1:] for x in part[1:])))  # pyright: ignore[reportArgumentType]

    number = 1
    while number < len(plan.steps):
        begin, first = steps[-1].end, steps[-1].last
        if number in of:
            motion, timed = of[number]
            add(timed.trajectory)
            lasts = [first + end for end in timed.ends]
            whens = [begin + float(timed.trajectory.time[end]) for end in timed.ends]
            for i, (when, last) in enumerate(zip(whens, lasts)):
                line, rests = motion.lines[i], i + 1 == len(lasts)
                steps.append(
                    TimedStep(steps[-1].end, when, steps[-1].last, last, line=line, rests=rests)
                )
            number += len(lasts)
            continue
        # The gripper acts, or the arm is sent where it stands.
        rest = dwell if plan.steps[number].step.action != "move" else 0.0
        count = math.ceil(rest / step)
        stays = np.broadcast_to(plan.steps[number].joints, (count + 1, len(start)))
        still = np.zeros_like(stays)
        add(JointTrajectory(np.linspace(0.0, rest, count + 1), stays, still, still))  # pyright: ignore[reportArgumentType]
        steps.append(TimedStep(begin, begin + rest, first, first + count, line=False, rests=True))
        number += 1
    whole = JointTrajectory(*map(np.concatenate, zip(*parts)))  # pyright: ignore[reportArgumentType]
    ranges = [(motion.first, motion.first + len(motion.ends) - 1) for motion in motions]
    return TimedPlan(plan, tuple(steps), whole, tuple(ranges))
