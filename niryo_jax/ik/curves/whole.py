"""Whole curves of solutions, joint limits left out, from solutions that are on them.

How many there are, and how long they are, differs from pose to pose: numpy keeps the books, and
JAX goes along the curves of all poses at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.execution.padding import BLOCK, program_size
from niryo_jax.ik.curves.walk import SHORTEST, Walk, walk_on
from niryo_jax.ik.results.curves import CurveEnd
from niryo_jax.jacobian import space_jacobian
from niryo_jax.robot import Robot

_MOST = 64
_FARTHEST = 200.0
_BESIDE = 0.1
_FEWEST = 3
_TURN = 2 * np.pi


class Curve(NamedTuple):
    """A whole curve.

    Attributes:
        points: (k, n) solutions in their order; joints do not jump by whole turns.
        metres, radians: (k,) by how much they miss the pose.
        turns: (n,) what is added to the first point to make it the one behind the last, of a curve
            that is closed; None of others.
        ends: what happens at its two ends.
    """

    points: np.ndarray
    metres: np.ndarray
    radians: np.ndarray
    turns: np.ndarray | None
    ends: tuple[CurveEnd, CurveEnd]


def whole_curves(
    robot: Robot, pose: jax.Array, seeds: np.ndarray, found: np.ndarray, step: float
) -> list[list[Curve]]:
    """The curves of each pose (rows, 4, 4) that its seeds (rows, k, n) are on, where `found`."""
    left, turns = found.copy(), turning(robot)
    curves: list[list[Curve]] = [[] for _ in range(len(pose))]
    for _ in range(_MOST):
        rows = np.nonzero(left.any(axis=1))[0]
        if not len(rows):
            break
        for start in range(0, len(rows), BLOCK):
            part = rows[start : start + BLOCK]
            first = left[part].argmax(axis=1)
            left[part, first] = False
            for row, curve in zip(part, _followed(robot, pose[part], seeds[part, first], step)):
                if len(curve.points) >= _FEWEST:
                    curves[row].append(curve)
                    others = np.nonzero(left[row])[0]
                    covered = _on_curve(curve, seeds[row][others], turns)
                    left[row, others[covered]] = False
    return curves


def turning(robot: Robot) -> np.ndarray:
    """(n,) which joints return to their place after a whole turn."""
    return np.any(np.asarray(robot.screws)[:, :3], axis=1)


def _followed(robot: Robot, pose: jax.Array, q: np.ndarray, step: float) -> Iterator[Curve]:
    """The curves through solutions (rows, n) of poses."""
    heading = np.linalg.svd(np.asarray(space_jacobian(robot, q)))[2][:, -1]
    heading = heading / np.abs(heading).max(axis=1, keepdims=True)
    ahead = _one_way(robot, pose, q, heading, step)
    some = np.array([i for i, (_, end) in enumerate(ahead) if end is not CurveEnd.CLOSED], int)
    behind = _one_way(robot, pose[some], q[some], -heading[some], step) if len(some) else []
    back = dict(zip(some.tolist(), behind))
    for i, (way, end) in enumerate(ahead):
        parts, other_end = [np.append(q[i], [0.0, 0.0])[None], way], end
        if i in back:
            other, other_end = back[i]
            parts.insert(0, other[::-1])
        points, metres, radians = np.split(np.concatenate(parts), [-2, -1], axis=1)
        turns = None
        if end is CurveEnd.CLOSED:
            rounds = np.round((points[-1] - points[0]) / _TURN)
            turns = np.where(turning(robot), _TURN * rounds, 0.0)
        yield Curve(points, metres[:, 0], radians[:, 0], turns, (other_end, end))


def _one_way(
    robot: Robot, pose: jax.Array, q: np.ndarray, heading: np.ndarray, step: float
) -> list[tuple[np.ndarray, CurveEnd]]:
    """What is passed from solutions (rows, n) on: (k, n + 2) points, metres and radians, without
    the first; and how it ends."""
    rows, turns = len(q), turning(robot)
    index = np.resize(np.arange(rows), program_size(rows))
    start = q[index], heading[index], np.full(len(index), step)
    walk = Walk(*(jnp.asarray(x, pose.dtype) for x in start))
    goals, longest = pose[index], jnp.asarray(step, pose.dtype)
    passed: list[list[np.ndarray]] = [[] for _ in range(rows)]
    ends: list[CurveEnd | None] = [None] * rows
    last, gone, count = q.copy(), np.zeros(rows), np.zeros(rows, int)
    while None in ends:
        walk, points = walk_on(robot, goals, walk, longest, quick=True)
        errors = (x[..., None] for x in (points.position_error, points.rotation_error))
        new = np.concatenate([points.q, *errors], axis=-1)
        reached, stuck = np.asarray(points.reached), np.asarray(walk.stride) < SHORTEST
        for row in (i for i in range(rows) if ends[i] is None):
            mine = new[reached[:, row], row]
            way = np.concatenate([last[row][None], mine[:, :-2]])
            gone[row] += np.abs(np.diff(way, axis=0)).max(axis=1, initial=0).sum()
            back = _returns(way, q[row], heading[row], turns, max(0, _FEWEST - count[row]))
            if back is not None:
                mine, ends[row] = mine[:back], CurveEnd.CLOSED
            elif stuck[row]:
                ends[row] = CurveEnd.SINGULAR
            elif gone[row] > _FARTHEST:
                ends[row] = CurveEnd.CUT_SHORT
            passed[row].append(mine)
            last[row], count[row] = way[-1], count[row] + len(mine)
    return [(np.concatenate(way), end) for way, end in zip(passed, ends) if end is not None]


def _beside(
    way: np.ndarray, q: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of joint vectors (m, n) beside the stretches between points (k, n): (m, k-1) where along each
    they are, from 0 to 1, and by how much they are off it; (k-1,) how long it is."""
    along = np.diff(way, axis=0)
    away = q[:, None] - way[None, :-1]
    away = away - np.where(turns, _TURN * np.round(away / _TURN), 0.0)
    square = np.maximum(np.sum(along * along, axis=1), 1e-30)
    share = np.sum(away * along, axis=2) / square
    off = np.abs(away - share[..., None] * along).max(axis=2)
    return share, off, np.abs(along).max(axis=1)


def _returns(
    way: np.ndarray, start: np.ndarray, heading: np.ndarray, turns: np.ndarray, first: int
) -> int | None:
    """How many points of a way (k, n) behind its first are new before it comes back to its start,
    which it may do from the stretch of number `first` on; None where it does not."""
    share, off, length = _beside(way, start[None], turns)
    onward = np.diff(way, axis=0) @ heading > 0
    passes = (share[0] > 0) & (share[0] <= 1) & (off[0] < _BESIDE * length) & onward
    passes[:first] = False
    return int(passes.argmax()) if passes.any() else None


def _on_curve(curve: Curve, q: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Which joint vectors (m, n) are on a curve."""
    points = curve.points
    if curve.turns is not None:
        points = np.concatenate([points, (points[0] + curve.turns)[None]])
    share, off, length = _beside(points, q, turns)
    return np.any((share >= -_BESIDE) & (share <= 1 + _BESIDE) & (off < _BESIDE * length), axis=1)
