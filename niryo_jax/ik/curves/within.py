"""The parts of curves of solutions within the joint limits, and where joints come to these."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.execution.padding import program_size
from niryo_jax.ik.curves.walk import with_joint_held
from niryo_jax.ik.curves.whole import Curve, turning
from niryo_jax.ik.newton.pose_error import extent, within_tolerance
from niryo_jax.ik.results.curves import CurveEnd
from niryo_jax.robot import Robot
from niryo_jax.tolerances import LIMIT_ROUNDING


class End(NamedTuple):
    """An end of a part.

    Attributes:
        kind: what happens there.
        joint: the index of the joint that is at its limit, or -1.
        place: (n,) the joint vector there to first order; None where no joint is.
    """

    kind: CurveEnd
    joint: int = -1
    place: np.ndarray | None = None


class Part(NamedTuple):
    """A part of a curve within the limits: points (k, n) in their order, metres and radians (k,) by
    which they miss the pose, and its two ends."""

    points: np.ndarray
    metres: np.ndarray
    radians: np.ndarray
    ends: tuple[End, End]

    @property
    def length(self) -> float:
        """The way along it in joint space."""
        closed = self.ends[0].kind is CurveEnd.CLOSED
        points = np.concatenate([self.points, self.points[: int(closed)]])
        steps = np.diff(points, axis=0)
        if closed:
            # The first point may be whole turns away from the last.
            steps[-1] -= 2 * np.pi * np.round(steps[-1] / (2 * np.pi))
        return float(np.linalg.norm(steps, axis=1).sum())


def parts_within_limits(
    robot: Robot, pose: jax.Array, curves: list[list[Curve]], step: float
) -> list[list[Part]]:
    """The parts of the curves of each pose (rows, 4, 4), the longest first.

    Each joint is in one of the turns that bring it within its limits, and goes on from there.
    """
    given = np.asarray(robot.lower, float), np.asarray(robot.upper, float), turning(robot)
    parts = [[part for curve in row for part in _within(curve, *given)] for row in curves]
    ends = [
        (row, i, side, end.joint, end.place)
        for row, mine in enumerate(parts)
        for i, part in enumerate(mine)
        for side, end in enumerate(part.ends)
        if end.place is not None
    ]
    if ends:
        rows, _, _, joints, places = (np.array(x) for x in zip(*ends))
        for (row, i, side, *_), exact in zip(ends, _exact(robot, pose, rows, joints, places, step)):
            if exact is not None:
                parts[row][i] = _longer(parts[row][i], side, *exact)
    return [sorted(mine, key=lambda part: -part.length) for mine in parts]


def _within(
    curve: Curve, lower: np.ndarray, upper: np.ndarray, turns: np.ndarray
) -> Iterator[Part]:
    points, count = curve.points, len(curve.points)
    shift = _turns_within(points, lower, upper, turns)
    margin = _margin(points + shift, lower, upper)
    rounding = LIMIT_ROUNDING.of(points.dtype)
    left = margin >= -rounding
    rounds, whole = 0, points
    if curve.turns is not None:
        # A joint that winds about passes through its range in so many rounds.
        span = np.where(np.isfinite(upper - lower), upper - lower, 0.0)
        winds = curve.turns != 0
        rounds = 1 + int(np.max(span[winds] / np.abs(curve.turns[winds]), initial=0.0))
        around = np.arange(-rounds, rounds + 1)[:, None, None]
        whole = (points + around * curve.turns).reshape(-1, points.shape[1])
    while left.any():
        start = int(np.where(left, margin, -np.inf).argmax())
        way, at = whole + shift[start], rounds * count + start
        outside = np.nonzero(_margin(way, lower, upper) < -rounding)[0]
        first = int(outside[outside < at].max(initial=-1)) + 1
        last = int(outside[outside > at].min(initial=len(way)))
        closed = curve.turns is not None and first == 0 and last == len(way)
        if closed:
            first, last = at, at + count
        index = np.arange(first, last)
        left[index % count] = False

        before, behind = (End(kind) for kind in curve.ends)
        if not closed and first > 0:
            before = _crossing(way[first], way[first - 1], lower, upper)
        if not closed and last < len(way):
            behind = _crossing(way[last - 1], way[last], lower, upper)
        errors = curve.metres[index % count], curve.radians[index % count]
        yield Part(way[index], *errors, (before, behind))


def _turns_within(
    q: np.ndarray, lower: np.ndarray, upper: np.ndarray, turns: np.ndarray
) -> np.ndarray:
    """What whole turns to add to joint vectors (k, n) so that each joint that turns is nearest to
    the middle of its range, where it is within its limits if it is with any."""
    low, high = np.isfinite(lower), np.isfinite(upper)
    # Where there is no limit, one a whole turn from the other stands for it.
    bottom = np.where(low, lower, np.where(high, upper - 2 * np.pi, -np.pi))
    top = np.where(high, upper, bottom + 2 * np.pi)
    middle = 0.5 * (bottom + top)
    return np.where(turns, 2 * np.pi * np.round((middle - q) / (2 * np.pi)), 0.0)


def _margin(q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    return np.minimum(q - lower, upper - q).min(axis=-1)


def _crossing(inner: np.ndarray, outer: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> End:
    """Where the first joint comes to its limit between two joint vectors."""
    limit = np.where(outer > inner, upper, lower)
    beyond = (outer < lower) | (outer > upper)
    share = np.where(beyond, (limit - inner) / np.where(beyond, outer - inner, 1.0), np.inf)
    joint = int(share.argmin())
    place = inner + share[joint] * (outer - inner)
    place[joint] = limit[joint]
    return End(CurveEnd.LIMIT, joint, place)


def _exact(
    robot: Robot,
    pose: jax.Array,
    rows: np.ndarray,
    joints: np.ndarray,
    places: np.ndarray,
    step: float,
) -> Iterator[tuple[np.ndarray, float, float] | None]:
    """The solutions next to places (m, n) with one joint at its limit, by how many metres and
    radians they miss; None where there is none, since the curve only touches the limit."""
    index = np.resize(np.arange(len(rows)), program_size(len(rows)))
    goals = pose[rows[index]]
    guesses = jnp.asarray(places[index], pose.dtype)
    q, metres, radians = with_joint_held(
        robot, goals, guesses, jnp.asarray(joints[index]), quick=True
    )
    good = np.asarray(within_tolerance(metres, radians, 10.0, extent(goals)))
    q, metres, radians = map(np.asarray, (q, metres, radians))
    inside = _margin(q, np.asarray(robot.lower), np.asarray(robot.upper))
    good = good & (inside >= -LIMIT_ROUNDING.of(q.dtype))
    for i, place in enumerate(places):
        near = good[i] and np.abs(q[i] - place).max() <= step
        yield (q[i], float(metres[i]), float(radians[i])) if near else None


def _longer(part: Part, side: int, q: np.ndarray, metres: float, radians: float) -> Part:
    """The part with one more point, at its beginning (side 0) or its end."""
    at = len(part.points) if side else 0
    points = np.insert(part.points, at, q, axis=0)
    errors = np.insert(part.metres, at, metres), np.insert(part.radians, at, radians)
    return Part(points, *errors, part.ends)
