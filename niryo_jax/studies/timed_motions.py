"""The ways of a plan from rest to rest: lines of the tool, and smooth free ways between them.

A move whose poses differ along z alone is a vertical line of the tool. What lies between is free:
the joints pass through the pose where it meets a line along the line's own direction, and need not
stop there. The arm rests at the start, at the end, and where its gripper acts.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware.pick_and_place import Plan, StepUnsolvable
from niryo_jax.motion import cartesian_trajectory
from niryo_jax.studies.smooth_way import End, end_of, free_way, towards
from niryo_jax.studies.tool_lines import followed

Vector = NDArray[np.float64]

_LINE = 5e-4
"""Metres between two poses of a line that are solved: in between a spline misses by picometres."""

_SAME = 1e-9
_SAME_JOINTS = 1e-6


@dataclasses.dataclass(frozen=True)
class Motion:
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


def motions_of(plan: Plan) -> list[Motion]:
    """All motions; moves to where the arm stands are none, and stand between two."""
    lines = _Lines(plan)
    motions = list[Motion]()
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


def _motion(plan: Plan, lines: _Lines, group: list[int]) -> Motion:
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
    return Motion(group[0], q, tuple(ends.tolist()), tuple(x is not None for x in straight))


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
        here, there = np.round(start, 9).tobytes(), np.round(end, 9).tobytes()
        if (there, here) in self._known:
            return self._known[there, here][::-1]
        if (here, there) not in self._known:
            self._known[here, there] = self._solved(number, start, end)
        return self._known[here, there]

    def _solved(self, number: int, start: Vector, end: Vector) -> Vector:
        robot, step = self._plan.robot, self._plan.steps[number].step
        first, last = self._poses[number - 1], self._poses[number]
        assert first is not None
        assert last is not None
        count = 3 + math.ceil(abs(last[2, 3] - first[2, 3]) / _LINE)
        poses = cartesian_trajectory(first, last, 1.0, count, lambda u: u).pose
        q, ends = followed(robot, poses, start)
        if ends:
            raise StepUnsolvable(
                f"step {number + 1} ({step.title}) of {robot.name}, a line of the tool: {ends}"
            )
        if np.max(np.abs(q[[0, -1]] - [start, end])) > _SAME_JOINTS:
            raise StepUnsolvable(
                f"step {number + 1} ({step.title}) of {robot.name}: the line of the tool leads to "
                "other joints than those that were chosen for its end"
            )
        q[0], q[-1] = start, end
        return q
