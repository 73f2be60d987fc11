"""Inverse kinematics of arms with one joint to spare: their solutions as curves.

Complete sets for many ways to spend the joint meet every curve that is longer, seen in that joint,
than the values are apart. From one of them on each, walkers go all the way round; the parts within
the joint limits are returned.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_number
from niryo_jax.execution.padding import in_chunks
from niryo_jax.ik.curves.whole import turning, whole_curves
from niryo_jax.ik.curves.within import Part, parts_within_limits
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.methods.sampled import spread_sets
from niryo_jax.ik.results.curves import SolutionCurves
from niryo_jax.ik.results.limits import limit_margin, limits_of
from niryo_jax.ik.results.status import IKStatus
from niryo_jax.ik.target import make_target
from niryo_jax.jacobian import manipulability
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot

STEP = 0.05
"""Radians that no joint exceeds from one point to the next, if not told otherwise."""

_SMALLEST, _LARGEST = 1e-3, 0.5
_SAMPLES = 32


def solve_curves(robot: Robot, pose: ArrayLike, step: float = STEP) -> SolutionCurves:
    """The solutions of an arm with seven joints, as curves within its joint limits.

    Curves are met at 32 arm angles, or values of `robot.spare.locked` (docs/families.md), and of an
    arm of which no joint can be locked where multi-start finds them. So one is missed that lies
    between two of these values altogether; the walks along the others are without gaps.

    Args:
        robot: a concrete arm of seven joints.
        pose: (..., 4, 4) concrete targets in the space frame, metres; projected to SE(3) first.
        step: radians (metres of slides) that no joint exceeds from one point to the next.

    Returns:
        `SolutionCurves`. Each point reaches its pose to 1e-12 m and rad.

    Raises:
        ValueError: a wrong shape, an arm of fewer or more joints, a step that is not between 1e-3
            and 0.5.
        TypeError: a traced robot or pose.
    """
    step = check_number("step", step, "1e-3 to 0.5, radians", lambda x: _SMALLEST <= x <= _LARGEST)
    if robot.joints != 7:
        raise ValueError(
            f"redundancy 'curves' needs an arm of seven joints, whose solutions are curves; "
            f"{robot.name} has {robot.joints}"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    if not is_concrete(pose, *jax.tree.leaves(robot)):
        raise TypeError(
            "redundancy 'curves' needs a concrete robot and pose: how many points a curve has "
            "cannot be known while tracing"
        )
    target = make_target(pose)
    batch = pose.shape[:-2]
    goals = target.pose.reshape(-1, 4, 4)
    seeds, found, none = _seeds(robot, goals)
    valid = np.asarray(target.valid).reshape(-1)
    curves = whole_curves(robot, goals, seeds, found & valid[:, None], step)
    parts = parts_within_limits(robot, goals, curves, step)
    status = np.where([bool(x) for x in parts], IKStatus.SOLVED, IKStatus.OUTSIDE_LIMITS)
    status = np.where([bool(x) for x in curves], status, none)
    status = np.where(valid, status, IKStatus.INVALID_POSE)
    return _assembled(robot, parts, status, batch, pose.dtype)


def _seeds(robot: Robot, pose: jax.Array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows, k, n) solutions on the curves, (rows, k) which there are, and (rows,) a status where
    there is none."""

    if not robot.plans or not len(pose):
        sets = solve_multistart(robot, pose)
        return np.asarray(sets.q), np.asarray(sets.found), np.asarray(sets.status)

    def sets_of(part: jax.Array) -> tuple[jax.Array, ...]:
        sets = spread_sets(robot, part, _SAMPLES)
        return sets.q, sets.found, sets.status

    q, found, status = map(np.asarray, in_chunks(sets_of, pose))
    nowhere = np.all(status == IKStatus.UNREACHABLE, axis=1) & robot.plans[-1].by_arm_angle
    status = np.where(nowhere, IKStatus.UNREACHABLE, IKStatus.UNDECIDED)
    return q.reshape(len(q), -1, robot.joints), found.reshape(len(q), -1), status


def _assembled(
    robot: Robot,
    parts: list[list[Part]],
    status: np.ndarray,
    batch: tuple[int, ...],
    dtype: Any,
) -> SolutionCurves:
    shape = len(parts), max(map(len, parts), default=1) or 1
    most = max((len(part.points) for mine in parts for part in mine), default=1)
    q = np.zeros((*shape, most, robot.joints))
    errors = np.full((2, *shape, most), np.inf)
    valid = np.zeros((*shape, most), bool)
    length = np.zeros(shape)
    ends, joints = np.zeros((*shape, 2), np.int32), np.full((*shape, 2), -1, np.int32)
    for row, mine in enumerate(parts):
        for i, part in enumerate(mine):
            points = slice(len(part.points))
            q[row, i, points], valid[row, i, points] = part.points, True
            errors[:, row, i, points] = part.metres, part.radians
            length[row, i] = part.length
            ends[row, i] = [end.kind for end in part.ends]
            joints[row, i] = [end.joint for end in part.ends]
    found = np.any(valid, axis=2)

    def shaped(x: np.ndarray) -> jax.Array:
        kind = dtype if x.dtype.kind == "f" else None
        return jnp.asarray(x.reshape((*batch, *x.shape[1:])), kind)

    lower, upper = limits_of(robot.lower, robot.upper, dtype)
    points = shaped(q)
    return SolutionCurves(
        q=points,
        valid=shaped(valid),
        position_error=shaped(errors[0]),
        rotation_error=shaped(errors[1]),
        limit_margin=limit_margin(points, lower, upper),
        manipulability=manipulability(robot, points),
        found=shaped(found),
        length=shaped(length),
        ends=shaped(ends),
        end_joint=shaped(joints),
        status=shaped(status.astype(np.int32)),
        count=shaped(np.asarray([len(mine) for mine in parts], np.int32)),
        lower=lower,
        upper=upper,
        periodic=tuple(turning(robot).tolist()),
    )
