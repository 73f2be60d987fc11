"""Where to put an arm so that it reaches a set of poses: the inverse of a capability map.

A task pose T in the world is the pose B^-1 T in the frame of a base at B. So one map answers for
every place of the base: it rules out, by looking up, the placements from which some task position
lies outside of what the arm reaches. Those that are left are tried with complete inverse
kinematics, at the task poses themselves and not at the centres of voxels.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from niryo_jax.arguments import (
    as_data,
    check_count,
    check_fits,
    check_motion,
    check_number,
    check_positive,
)
from niryo_jax.collision import CollisionCheck
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.tolerances import AXES_PARALLEL
from niryo_jax.workspace.description import collisions_of, robot_of
from niryo_jax.workspace.fields import check_map
from niryo_jax.workspace.measures import pose_measures
from niryo_jax.workspace.progress import Progress

if TYPE_CHECKING:
    import xarray as xr

_POSES_AT_ONCE = 32_768
"""So many poses are solved in one call, or hardly less: one program, and memory stays flat."""

_MOST_PLACES = 1e8
_ROUNDING = 1e-9
"""Share of a step by which a region may be too short for a place on its edge."""


class BasePlacements(NamedTuple):
    """Placements of the base, best first.

    Attributes:
        base: (k, 4, 4) pose of the arm's base (its space frame) in the world.
        position: (k, 3) where it stands, metres.
        heading: (k,) turn about the vertical, radians in [0, 2 pi).
        reached: (k, t) which task poses have a solution within the joint limits.
        share: (k,) of the task poses that are reached.
        margin: (k,) distance of a joint from its nearest limit, radians, of the best solution of
            the reached task pose for which that is least.
        manipulability: (k,) of the reached task pose for which it is least, likewise.
        candidates: how many placements were looked up.
        evaluated: for how many of them inverse kinematics was computed.
    """

    base: np.ndarray
    position: np.ndarray
    heading: np.ndarray
    reached: np.ndarray
    share: np.ndarray
    margin: np.ndarray
    manipulability: np.ndarray
    candidates: int
    evaluated: int


def base_placement(
    map: xr.Dataset,
    task_poses: ArrayLike,
    *,
    robot: Robot | None = None,
    region: Sequence[Sequence[float]] | None = None,
    step: float | None = None,
    headings: int = 24,
    height: float = 0.0,
    most: int = 100,
    progress: Progress | None = None,
) -> BasePlacements:
    """Where on a level floor to put an arm so that it reaches task poses; best first.

    Candidates are the points of a grid in the middle of `region`, each with evenly spread headings.
    For each the map tells how many task positions lie in or beside a voxel that is reached with any
    orientation. They are evaluated by complete inverse kinematics from the most promising down,
    until those left cannot reach as many task poses as the best that was found. So every placement
    that is returned does what it says; and no candidate does better, unless the map saw nothing of
    what is reached: where that is thinner than a voxel, or the map has few orientations.

    Args:
        map: capability map of the arm. What lies outside of its box counts as not reached. Where
            collisions were looked at in it, they are here: obstacles stand around the base, and
            move with it.
        task_poses: (t, 4, 4) of the tool, world frame, metres.
        robot: the arm, where it is not the one that the map was made of.
        region: ((x0, y0), (x1, y1)) in which the base may stand, metres; where not given, the box
            of the task positions widened by the reach of the arm.
        step: distance of neighbouring places, metres; the voxel of the map where not given.
        headings: how many turns about the vertical. One is looked at of an arm that cannot tell
            them apart: whose first joint is that turn, and has no limits.
        height: z of the base, metres.
        most: how many placements are returned.
        progress: called with how many placements are evaluated, and how many are to be so far.

    Returns:
        `BasePlacements` by `share`, then `margin`: those evaluated that reach a task pose.

    Raises:
        ValueError: task poses of another shape, none, or not rigid motions; an empty region; a
            step, headings or `most` that is not positive; a height that is not finite; a map in
            which nothing is reached.
    """
    tasks = _check_tasks(task_poses)
    check_map("map", map)
    if robot is not None:
        check_is_robot(robot)
    step = float(map.attrs["voxel"]) if step is None else step
    _check_numbers(step, headings, height, most)
    robot = robot_of(map) if robot is None else robot
    collisions = collisions_of(map)
    seen = _Seen.by(map)
    places = _places(_region(region, tasks, seen.reach), step)
    headings = check_fits("headings", headings, 1, len(places))
    turns = np.arange(1 if _turns_freely(robot) else headings) * (2 * np.pi / headings)
    counts = seen.counts(tasks, places, turns, height)

    batch = max(1, _POSES_AT_ONCE // len(tasks))
    best, evaluated = _Found.none(len(tasks)), 0
    for level in range(len(tasks), 0, -1):
        if level < best.most:
            break
        turn, place = np.nonzero(counts == level)
        for start in range(0, len(turn), batch):
            # A program for a small batch takes longer to compile than a full one to run.
            which = np.minimum(np.arange(start, start + batch), len(turn) - 1)
            base = _bases(places[place[which]], turns[turn[which]], height)
            found = _evaluate(robot, base, turns[turn[which]], tasks, collisions)
            new = min(batch, len(turn) - start)
            best, evaluated = best.merged(found, new, most), evaluated + new
            if progress is not None:
                progress(evaluated, int(np.sum(counts >= level)))
    return BasePlacements(
        base=best.base,
        position=best.base[:, :3, 3],
        heading=best.heading,
        reached=best.reached,
        share=np.mean(best.reached, axis=1),
        margin=best.margin,
        manipulability=best.manipulability,
        candidates=counts.size,
        evaluated=evaluated,
    )


class _Found(NamedTuple):
    """What is known of placements: fields of `BasePlacements`."""

    base: np.ndarray
    heading: np.ndarray
    reached: np.ndarray
    margin: np.ndarray
    manipulability: np.ndarray

    @classmethod
    def none(cls, tasks: int) -> _Found:
        reached = np.empty((0, tasks), bool)
        return cls(np.empty((0, 4, 4)), np.empty(0), reached, np.empty(0), np.empty(0))

    @property
    def most(self) -> int:
        """How many task poses the best one reaches."""
        return int(np.sum(self.reached[:1]))

    def merged(self, other: _Found, count: int, most: int) -> _Found:
        """The best of these and the first so many of others that reach any task pose."""
        both = _Found(*(np.concatenate([x, y[:count]]) for x, y in zip(self, other)))
        reached = np.sum(both.reached, axis=1)
        order = np.lexsort((-both.manipulability, -both.margin, -reached))
        order = order[reached[order] > 0][:most]
        return _Found(*(x[order] for x in both))


class _Seen(NamedTuple):
    """Where a map saw something reached, or could not tell, in a voxel or one of those around it.

    Attributes:
        near: (x, y, z) flags, False on all sides.
        first: (3,) index of the first of its voxels.
        voxel: metres.
    """

    near: np.ndarray
    first: np.ndarray
    voxel: float

    @classmethod
    def by(cls, map: xr.Dataset) -> _Seen:
        voxel = float(map.attrs["voxel"])
        possible = map["reachability_index"].to_numpy() + map["undecided_fraction"].to_numpy() > 0
        if not np.any(possible):
            raise ValueError(
                "map: nothing in it is reached; has it orientations that the arm can take?"
            )
        near = np.pad(possible, 2)
        for axis in range(3):
            near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
        first = [math.floor(float(map[axis][0]) / voxel) - 2 for axis in "xyz"]
        return cls(near, np.array(first), voxel)

    @property
    def reach(self) -> float:
        """The greatest distance from the z axis, metres."""
        columns = np.argwhere(np.any(self.near, axis=2)) + self.first[:2]
        outer = np.maximum(np.abs(columns), np.abs(columns + 1))
        return self.voxel * float(np.max(np.hypot(*outer.T)))

    def counts(
        self, tasks: np.ndarray, places: np.ndarray, turns: np.ndarray, height: float
    ) -> np.ndarray:
        """(headings, places) how many task positions are near to what is reached."""
        counts = np.zeros((len(turns), len(places)), np.int32)
        level = self._index(tasks[:, 2, 3] - height, 2)
        for k, (c, s) in enumerate(zip(np.cos(turns), np.sin(turns))):
            for position, z in zip(tasks[:, :2, 3], level):
                x, y = (position - places).T
                plane = self.near[:, :, z]
                counts[k] += plane[self._index(c * x + s * y, 0), self._index(c * y - s * x, 1)]
        return counts

    def _index(self, coordinate: np.ndarray, axis: int) -> np.ndarray:
        index = np.floor(coordinate / self.voxel).astype(np.int64) - self.first[axis]
        return np.clip(index, 0, self.near.shape[axis] - 1)


def _evaluate(
    robot: Robot,
    base: np.ndarray,
    heading: np.ndarray,
    tasks: np.ndarray,
    collisions: CollisionCheck | None,
) -> _Found:
    """What complete inverse kinematics says of bases (k, 4, 4)."""
    rotation = base[:, None, :3, :3]
    pose = np.zeros((len(base), len(tasks), 4, 4))
    pose[..., :3, :3] = np.swapaxes(rotation, -1, -2) @ tasks[:, :3, :3]
    away = tasks[:, :3, 3] - base[:, None, :3, 3]
    pose[..., :3, 3] = (away[..., None, :] @ rotation)[..., 0, :]
    pose[..., 3, 3] = 1
    measures = pose_measures(robot, pose, collisions=collisions)
    reached = np.asarray(measures.solutions) > 0

    def least(measure: ArrayLike) -> np.ndarray:
        return np.min(np.where(reached, measure, np.inf), axis=1)

    margin, manipulability = least(measures.limit_margin), least(measures.manipulability)
    return _Found(base, heading, reached, margin, manipulability)


def _bases(place: np.ndarray, turn: np.ndarray, height: float) -> np.ndarray:
    """(k, 4, 4) upright bases at places (k, 2) turned by angles (k,)."""
    base = np.zeros((len(place), 4, 4))
    base[:, 0, 0] = base[:, 1, 1] = np.cos(turn)
    base[:, 1, 0] = np.sin(turn)
    base[:, 0, 1] = -base[:, 1, 0]
    base[:, 2, 2] = base[:, 3, 3] = 1
    base[:, :2, 3] = place
    base[:, 2, 3] = height
    return base


def _turns_freely(robot: Robot) -> bool:
    """Whether the first joint does all that a turn of the base about the vertical would do."""
    about_z = np.abs(np.abs(robot.known_screws()[0]) - (0, 0, 1, 0, 0, 0))
    free = np.isneginf(robot.lower[0]) and np.isposinf(robot.upper[0])
    return bool(free and np.all(about_z < AXES_PARALLEL.of(float)))


def _region(
    region: Sequence[Sequence[float]] | None, tasks: np.ndarray, reach: float
) -> np.ndarray:
    """(2, 2) the corners in which the base may stand."""
    if region is None:
        at = tasks[:, :2, 3]
        return np.stack([at.min(axis=0) - reach, at.max(axis=0) + reach])
    corners = np.asarray(as_data("region", region), np.float64)
    if corners.shape != (2, 2) or not np.all(np.isfinite(corners)):
        raise ValueError(f"region: expected ((x0, y0), (x1, y1)), finite, got {region}")
    if np.any(corners[0] > corners[1]):
        raise ValueError(f"region: expected x0 <= x1 and y0 <= y1, got the empty {region}")
    return corners


def _places(region: np.ndarray, step: float) -> np.ndarray:
    """(n, 2) a grid in the middle of a region, so that it turns and moves along with it."""
    count = np.floor((region[1] - region[0]) / step + _ROUNDING) + 1
    if np.prod(count) > _MOST_PLACES:
        raise ValueError(f"step: {step} m gives {np.prod(count):.1e} places; expected a longer one")
    count = count.astype(np.int64)
    x, y = (
        middle + (np.arange(n) - (n - 1) / 2) * step
        for middle, n in zip(region.mean(axis=0), count)
    )
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _check_tasks(task_poses: ArrayLike) -> np.ndarray:
    tasks = np.asarray(as_data("task_poses", task_poses), np.float64)
    if tasks.ndim != 3 or tasks.shape[1:] != (4, 4):
        raise ValueError(f"task_poses: expected shape (t, 4, 4), got {tasks.shape}")
    if not len(tasks):
        raise ValueError("task_poses: expected at least one pose, got none")
    check_motion("task_poses", tasks)
    return tasks


def _check_numbers(step: float, headings: int, height: float, most: int) -> None:
    check_positive("step", step, "a positive length in metres")
    check_count("headings", headings, 1, sys.maxsize)
    check_count("most", most, 1, sys.maxsize)
    check_number("height", height, "finite metres", math.isfinite)
