"""What of a timed plan is one `NiryoArm.execute`, and how the joints then move.

The robot's own command for several stops moves the tool along straight lines between them. Near a
singularity of the wrist joints 4 and 6 would turn far out and back on such a line, though the tool
hardly leaves the trajectory. There each stop has to be a move of its own.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware import execution
from niryo_jax.hardware.execution import Execution
from niryo_jax.hardware.targets import JointTargets
from niryo_jax.motion import JointTrajectory
from niryo_jax.robot import Robot
from niryo_jax.studies.timed_plan import TimedPlan
from niryo_jax.studies.tool_lines import between_stops, followed

Vector = NDArray[np.float64]

WITHIN = 2e-3
"""Radians by which joints may leave the trajectory between two stops: so the tool of a Niryo stays
within 2 mm of it, and the jaws of gripper 1 above the table."""

_POSES = 16
"""On each line between two stops, at which its joints are looked at."""

_ASIDE = 0.05
"""Radians by which joints may leave the straight way between two stops on a line of the tool."""


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of a timed plan that is sent in one.

    Attributes:
        first, last: its steps.
        trajectory: its joints as they are to be told, its times from 0.
        moves: as single moves, by which its joints go straight from stop to stop.
        lines: by the robot's own command for several stops; None where single moves it must be.
        on_lines: (k, n) the joints that are then told on the way, in equal parts of each line.
    """

    first: int
    last: int
    trajectory: JointTrajectory
    moves: Execution
    lines: Execution | None
    on_lines: Vector | None


@functools.lru_cache(maxsize=4)
def sections(timed: TimedPlan, within: float = WITHIN) -> tuple[Section, ...]:
    """The sections of a timed plan, in order: motions from rest to rest, or their single steps
    where not all of a motion can be done on lines of the tool.

    They are kept, since what has been looked at is then sent.

    Args:
        timed: the plan.
        within: radians by which joints may leave the trajectory between two stops.

    Raises:
        TargetRejected: the trajectory is none for this arm (`NiryoArm.execute`).
    """
    out = list[Section]()
    for first, last in timed.motions:
        whole = _section(timed, first, last, within)
        single = whole.lines is None and first < last
        steps = range(first, last + 1)
        out += [_section(timed, i, i, within) for i in steps] if single else [whole]
    return tuple(out)


def _section(timed: TimedPlan, first: int, last: int, within: float) -> Section:
    robot, part = timed.plan.robot, timed.part(first, last)
    targets = JointTargets(robot)
    moves, lines = (execution.plan(robot, targets, part, within, x) for x in (False, True))
    on_lines = _on_lines(robot, lines.stops)
    if on_lines is None:
        return Section(first, last, part, moves, None, None)
    return Section(first, last, part, moves, lines, on_lines)


def _on_lines(robot: Robot, stops: Vector) -> Vector | None:
    """Joints (k, n) along straight lines of the tool between stops (w, n), k = 16 (w - 1) + 1; None
    where they leave the straight way of the joints."""
    q, ends = followed(robot, between_stops(robot, stops, _POSES), stops[0])
    if ends:
        return None
    share = np.arange(1, _POSES + 1)[:, None] / _POSES
    straight = stops[:-1, None] + share * np.diff(stops, axis=0)[:, None]
    aside = np.abs(q[1:] - straight.reshape(q[1:].shape))
    return q if np.max(aside) < _ASIDE else None
