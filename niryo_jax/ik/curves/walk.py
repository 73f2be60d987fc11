"""Along the solutions of an arm with one joint to spare, point by point.

From a solution the arm goes along the null space of its Jacobian, by a step that no joint exceeds,
and Newton's method brings the tool back to the pose. Where that leads elsewhere, or the curve turns
too much, the step is made again, shorter; a curve that crosses another is followed straight on.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.pose_error import extent, within_tolerance
from niryo_jax.specialise import Geometry, specialised_for_any_tool
from niryo_jax.tolerances import SELF_MOTION

POINTS = 64
"""How many steps are tried at a time."""

SHORTEST = 1e-5
"""A curve that no step as long as this (radians) continues ends there."""

_CORRECTIONS = 3
_STRAIGHT = 0.9
_SETTLED = 8
_FARTHEST = 0.25


class Walk(NamedTuple):
    """Where walkers are.

    Attributes:
        q: (rows, n) solutions.
        heading: (rows, n) where they go, the largest entry 1 or -1.
        stride: (rows,) how far at a time.
    """

    q: jax.Array
    heading: jax.Array
    stride: jax.Array


class Points(NamedTuple):
    """What they passed.

    Attributes:
        q: (POINTS, rows, n) solutions; reached: (POINTS, rows) which of them are new.
        position_error, rotation_error: (POINTS, rows) metres and radians.
    """

    q: jax.Array
    reached: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array


@specialised_for_any_tool
def walk_on(
    geometry: Geometry, pose: jax.Array, walk: Walk, step: jax.Array
) -> tuple[Walk, Points]:
    """The next points of walkers on the solutions of poses (rows, 4, 4), at most a `step` apart."""
    goal, size = lanes.contiguous_lanes(pose, 2), extent(pose)
    dependent = SELF_MOTION.of(pose.dtype)

    def corrected(
        i: jax.Array, state: tuple[jax.Array, ...]
    ) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array, jax.Array]:
        q, heading, *_ = state
        twist, jacobian, (metres, radians) = rolled.near_twist(geometry, goal, q)
        inverse = rolled.pseudo_inverse(jacobian, dependent)
        seen = rolled.added(jacobian * heading[None], 1)
        rests = heading - rolled.added(inverse * seen[None], 1)
        move = rolled.added(inverse * twist[None], 1)
        return jnp.where(i < _CORRECTIONS, q + move, q), heading, rests, metres, radians

    def try_step(state: tuple[jax.Array, ...], _: None) -> tuple[tuple[jax.Array, ...], Points]:
        q, heading, stride = state
        ahead = q + stride * heading
        start = ahead, heading, heading, stride, stride
        new, _, rests, metres, radians = jax.lax.fori_loop(0, _CORRECTIONS + 1, corrected, start)
        lengths = jnp.sum(rests * rests, axis=0) * jnp.sum(heading * heading, axis=0)
        straight = jnp.sum(rests * heading, axis=0) > _STRAIGHT * jnp.sqrt(lengths)
        moved = jnp.max(jnp.abs(new - q), axis=0)
        stayed = jnp.max(jnp.abs(new - ahead), axis=0) < 0.5 * stride
        reached = within_tolerance(metres, radians, size=size) & straight & stayed
        reached = reached & (moved <= step) & (stride >= SHORTEST)
        turned = rests / jnp.maximum(jnp.max(jnp.abs(rests), axis=0), 1e-30)
        longer = jnp.minimum(1.5 * stride, 0.95 * step)
        state = (
            jnp.where(reached, new, q),
            jnp.where(reached, turned, heading),
            jnp.where(reached, longer, stride / 3),
        )
        return state, Points(state[0], reached, metres, radians)

    begin = walk.q.T, walk.heading.T, walk.stride
    (q, heading, stride), points = jax.lax.scan(try_step, begin, length=POINTS)
    points = points._replace(q=jnp.swapaxes(points.q, 1, 2))
    return Walk(q.T, heading.T, stride), points


@specialised_for_any_tool
def with_joint_held(
    geometry: Geometry, pose: jax.Array, q: jax.Array, held: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Solutions (rows, n) next to joint vectors, of which the joint `held` (rows,) stays as it is;
    metres and radians by which they miss."""
    goal = lanes.contiguous_lanes(pose, 2)
    moves = jnp.asarray(jnp.arange(geometry.joints)[:, None] != held, q.dtype)

    def step(i: jax.Array, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        del i
        q, *_ = state
        twist, jacobian, errors = rolled.near_twist(geometry, goal, q)
        inverse = rolled.pseudo_inverse(jacobian * moves[None], SELF_MOTION.of(q.dtype))
        move = rolled.added(inverse * twist[None], 1)
        return q + jnp.clip(move, -_FARTHEST, _FARTHEST), *errors

    far = jnp.full(len(q), jnp.inf, q.dtype)
    new, _, _ = jax.lax.fori_loop(0, _SETTLED, step, (q.T, far, far))
    metres, radians = rolled.pose_errors(geometry, goal, new)
    return new.T, metres, radians
