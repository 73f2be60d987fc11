"""By how much a joint vector misses a pose."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import Motion, compose, joint_motion
from niryo_jax.ik.task import Task
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3
from niryo_jax.specialise import Geometry
from niryo_jax.tolerances import IK_POSITION, IK_ROTATION, OFF_TASK, TINY

_OFF_ROOT, _OFF_POLISHED = 1000.0, 10.0
"""A root of a closed form misses by fewer times the least that is possible; a polished one too."""

Frame = Literal["body", "space"]


class Miss(NamedTuple):
    """By how much what is bound of a pose is missed.

    Attributes:
        twist: (k,) the rows, bound by the task, of the twist from tool to target.
        jacobian: (k, n) the same rows of the Jacobian.
        position, rotation: metres and radians.
    """

    twist: Lanes
    jacobian: Lanes
    position: Lane
    rotation: Lane


def miss(geometry: Geometry, target: Lanes, q: Lanes, frame: Frame, task: Task) -> Miss:
    """By how much joint vectors miss what a task binds of a target."""
    if task.name == "pose":
        twist, jacobian, away = _error_twist(geometry, target, q, frame)
        return Miss(twist, jacobian, away, lanes.norm(twist[:3]))
    (rotation, position), jacobian = pose_and_jacobian(geometry, q, "body", materialise=True)
    goal_rotation, goal = se3.split(target)
    away = goal - position
    axis, across = lanes.lanes_of(task.axis), lanes.lanes_of(task.across())
    angle, turn = Lane(0.0), lanes.lanes_of([])
    if len(across):
        wanted = lanes.materialised(rotation.T @ (goal_rotation @ axis))
        normal = lanes.cross(axis, wanted)
        sine = lanes.norm(normal)
        angle = lanes.atan2(sine, axis @ wanted)
        some = sine > TINY
        per = lanes.select(some, angle / lanes.select(some, sine, 1.0), 1.0)
        turn = across @ (per * normal)
    rows = np.concatenate([across @ jacobian[:3], jacobian[3:]])
    return Miss(np.concatenate([turn, rotation.T @ away]), rows, lanes.norm(away), angle)


def _error_twist(
    geometry: Geometry, target: Lanes, q: Lanes, frame: Frame
) -> tuple[Lanes, Lanes, Lane]:
    """The twist from tool to target, the Jacobian in the same frame, and the position error."""
    (rotation, position), jacobian = pose_and_jacobian(geometry, q, frame, materialise=True)
    goal_rotation, goal = se3.split(target)
    away = goal - position
    turn = lanes.materialised(rotation.T @ goal_rotation)
    twist = se3.log_lanes(turn, rotation.T @ away)
    if frame == "space":
        twist = se3.adjoint_lanes(rotation, position, twist)
    return twist, jacobian, lanes.norm(away)


def pose_errors(geometry: Geometry, target: Lanes, q: Lanes) -> tuple[jax.Array, jax.Array]:
    """Metres and radians by which joint vectors that nearly reach (4, 4) targets miss them."""
    motion: Motion | None = None
    for joint, angle in enumerate(q):
        step = joint_motion(geometry, joint, angle, materialise=True)
        motion = step if motion is None else compose(motion, step)
        if joint == geometry.joints // 2:
            # Both errors need the whole chain; half of it is kept rather than computed twice.
            rotation, position = (lanes.materialised(part) for part in motion)
            motion = rotation, position
    home = se3.split(geometry.home)
    rotation, position = home if motion is None else compose(motion, home)
    difference = pose_difference((rotation, position), se3.split(target))
    metres, radians = map(lanes.materialise, difference)
    return metres.array, radians.array


def pose_difference(first: Motion, second: Motion) -> tuple[Lane, Lane]:
    """Metres and radians between two poses that are all but the same."""
    away = (first[0] - second[0]).ravel()
    # The Frobenius norm is 2 sqrt(2) sin(angle / 2): the angle itself where that matters.
    return lanes.norm(first[1] - second[1]), lanes.norm(away) * math.sqrt(0.5)


def small_twist(pose: Motion, goal: Lanes) -> Lanes:
    """The body twist (6,) from a pose to a goal, (4, 4) lanes, that it all but reaches.

    Half the difference of R and R^T stands for the logarithm of R: the two have the same derivative
    at the identity.
    """
    rotation, position = pose
    goal_rotation, goal_position = se3.split(goal)
    turn = lanes.vee(rotation.T @ goal_rotation)
    return np.concatenate([turn, rotation.T @ (goal_position - position)])


def within_tolerance(
    position: jax.Array,
    rotation: jax.Array,
    share: jax.Array | float = 1.0,
    size: jax.Array | float = 1.0,
) -> jax.Array:
    """Whether misses are within that share of what a solution of that `extent` may miss by."""
    dtype = position.dtype
    near = position < share * size * IK_POSITION.of(dtype)
    return near & (rotation < share * IK_ROTATION.of(dtype))


def extent(pose: jax.Array) -> jax.Array:
    """(..., 4, 4) -> (...,): how far away a pose is, metres, or 1 where it is nearer.

    Rounding of a position grows with it: a gantry is tens of metres long.
    """
    return jnp.maximum(1.0, jnp.max(jnp.abs(pose[..., :3, 3]), axis=-1))


def may_take_pose(
    joints: int, position: jax.Array, rotation: jax.Array, tolerance: jax.Array | float
) -> jax.Array:
    """Whether a root of a closed form that misses may still become a solution.

    With fewer than six joints the closed form satisfies fewer conditions than a pose has, and most
    poses are missed by far. What it does of a pose that the arm can nearly take misses by a few
    times as much as the nearest that there is.
    """
    if joints >= 6:
        return jnp.ones(position.shape, bool)
    far = jnp.maximum(OFF_TASK.of(position.dtype), _OFF_ROOT * tolerance)
    return (position < far) & (rotation < far)


def nearest_taken(
    possible: jax.Array,
    exact: jax.Array,
    position: jax.Array,
    rotation: jax.Array,
    tolerance: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """Of polished candidates (rows, m) of arms with fewer joints than are bound, those that take
    the pose (`exact`), or the nearest that the arm can take; and which of the others may.

    A pose that misses what the arm can do by less than `tolerance` metres and radians has an
    answer. No candidate counts that misses by more than twice as much as the best one: it is on a
    sheet of the task space that passes by.
    """
    dtype = position.dtype
    near = exact | ((position <= tolerance) & (rotation <= tolerance))
    miss = jnp.where(possible & near, position + rotation, jnp.inf)
    least = jnp.min(miss, axis=-1, keepdims=True, initial=jnp.inf)
    found = possible & near & (exact | (miss <= 2 * least))
    # Where nothing is found, what is called out of reach is so by a good margin.
    far = jnp.where(jnp.isfinite(least), 0.0, _OFF_POLISHED * tolerance)
    far = jnp.maximum(OFF_TASK.of(dtype), far)
    return found, possible & ~found & (position < far) & (rotation < far)
