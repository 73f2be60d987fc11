"""A plan of steps as one timed trajectory, with rests where the gripper acts."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from niryo_jax.arguments import check_number, check_positive
from niryo_jax.hardware.pick_and_place import Plan, StepUnsolvable
from niryo_jax.motion import JointTrajectory, MotionLimits, niryo_limits, retime
from niryo_jax.motion.limits import check_limits_of
from niryo_jax.robots import MODELS
from niryo_jax.studies.timed_motions import Motion, motions_of

Vector = NDArray[np.float64]
Way = Literal["start", "line", "free", "rest"]

DWELL = 1.0
"""Seconds that the arm rests while its gripper acts: longer than that of a Niryo takes."""

SAMPLING = 0.01
"""Seconds between two samples, at most."""

_ROW = 256
"""Times are looked up in rows of a multiple of this, so that programs are few."""


@dataclasses.dataclass(frozen=True)
class TimedStep:
    """When a step of a plan begins and ends.

    Attributes:
        begin, end: seconds from the start of the trajectory.
        first, last: the samples of the trajectory at these times.
        way: "start", where the arm is brought before; "line", a vertical one of the tool; "free";
            or "rest", where the gripper acts or the arm is sent where it stands.
        rests: whether the arm is at rest at its end.
    """

    begin: float
    end: float
    first: int
    last: int
    way: Way
    rests: bool


@dataclasses.dataclass(frozen=True, eq=False)
class TimedPlan:
    """A plan as one trajectory, which begins where its first step ends; compared by identity.

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

    def part(self, first: int, last: int) -> JointTrajectory:
        """What steps `first` to `last` move, its times from 0, as the joints are to be told."""
        part = slice(self.steps[first].first, self.steps[last].last + 1)
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
    motions = motions_of(plan)
    done = _timed(plan, limits, motions, step) if motions else []
    return _assembled(plan, motions, done, float(dwell), step)


@dataclasses.dataclass(frozen=True)
class _Done:
    """A motion in time: its samples, and which of them end its moves."""

    trajectory: JointTrajectory
    ends: tuple[int, ...]


def _timed(plan: Plan, limits: MotionLimits, motions: list[Motion], step: float) -> list[_Done]:
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
    plan: Plan, motions: list[Motion], done: list[_Done], dwell: float, step: float
) -> TimedPlan:
    """Motions and rests, one after the other."""
    start = plan.steps[0].joints
    at_rest = np.zeros((1, len(start)))
    parts = [JointTrajectory(np.zeros(1), start[None], at_rest, at_rest)]  # pyright: ignore[reportArgumentType]
    steps = [TimedStep(0.0, 0.0, 0, 0, "start", rests=True)]
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
            for line, when, last in zip(motion.lines, whens, lasts):
                before, way = steps[-1], "line" if line else "free"
                rests = last == lasts[-1]
                steps.append(TimedStep(before.end, when, before.last, last, way, rests))
            number += len(lasts)
            continue
        # The gripper acts, or the arm is sent where it stands.
        rest = dwell if plan.steps[number].step.action != "move" else 0.0
        count = math.ceil(rest / step)
        stays = np.broadcast_to(plan.steps[number].joints, (count + 1, len(start)))
        still = np.zeros_like(stays)
        add(JointTrajectory(np.linspace(0.0, rest, count + 1), stays, still, still))  # pyright: ignore[reportArgumentType]
        steps.append(TimedStep(begin, begin + rest, first, first + count, "rest", rests=True))
        number += 1
    whole = JointTrajectory(*map(np.concatenate, zip(*parts)))  # pyright: ignore[reportArgumentType]
    ranges = [(motion.first, motion.first + len(motion.ends) - 1) for motion in motions]
    return TimedPlan(plan, tuple(steps), whole, tuple(ranges))
