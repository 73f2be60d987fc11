"""Moves from one joint vector to another, from rest to rest, all joints arriving together."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.arguments import check_choice, check_finite, shown
from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape
from niryo_jax.motion.extremes import largest
from niryo_jax.motion.limits import MotionLimits, as_arrays, check_limits_of
from niryo_jax.motion.paths import JointTrajectory
from niryo_jax.motion.profiles import Profile, Shape, at, shape_of
from niryo_jax.motion.times import every_step

PROFILES = "trapezoid", "quintic", "scurve"


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PointToPoint:
    """Moves in closed form.

    Attributes:
        q_start, q_end: (..., n) radians (metres).
        duration: (...,) seconds; 0 where there is no way to go.
        shape: of each joint's own shortest move, which is run through slower by those that have
            time to spare.
        profile: "trapezoid", "quintic" or "scurve"; static.
    """

    q_start: jax.Array
    q_end: jax.Array
    duration: jax.Array
    shape: Shape
    profile: Profile = dataclasses.field(metadata={"static": True})

    def at(self, time: ArrayLike) -> JointTrajectory:
        """The moves at times (k,) or (..., k), seconds; at rest before 0 and after the duration.

        Raises:
            ValueError: a shape that does not broadcast against that of the moves.
            TypeError: no numbers.
        """
        t = as_floating("time", time).astype(self.q_start.dtype)
        check_shape("time", t, (-1,))
        broadcast_batch(("time", t, 1), ("moves", self.duration, 0))
        return JointTrajectory(t, *_at(self.profile, self, t))

    def every(self, step: float) -> JointTrajectory:
        """The moves every so many seconds, from 0 to the first step at or after the longest's end.

        Raises:
            ValueError: a step that is not positive, or more samples than memory has room for.
            TypeError: no number; a duration that is traced.
        """
        return self.at(every_step(step, self.duration, self.q_start.size))


def point_to_point(
    q_start: ArrayLike,
    q_end: ArrayLike,
    limits: MotionLimits,
    profile: Profile = "trapezoid",
    *,
    straight: bool = False,
) -> PointToPoint:
    """The shortest moves from rest to rest on which all joints start and arrive together.

    The joint that needs longest takes its shortest time, and each other joint runs through its own
    shortest move as much slower: so no moves of all joints are shorter, of any shape under the
    limits of a trapezoid (velocity, acceleration) or of an S-curve (jerk as well).

    Args:
        q_start, q_end: (..., n) radians (metres for prismatic joints); batch axes broadcast. No
            whole turns are added or taken away.
        limits: of the joints.
        profile: "trapezoid": constant acceleration, constant velocity; the jerk is not bounded.
            "scurve": the acceleration rises and falls at the largest jerk. "quintic": the
            polynomial of `quintic_time_scaling`, smoother and longer (its jerk is bounded where the
            limits have one).
        straight: whether the joints keep to the straight line between both joint vectors, as those
            of a quintic always do. That may take longer.

    Returns:
        A `PointToPoint`; differentiable with respect to both ends and the limits. Formulas in
        `motion.profiles`.

    Raises:
        ValueError: wrong shapes, numbers that are not finite, an unknown profile, an S-curve
            without a jerk, limits of another number of joints.
        TypeError: no arrays of numbers, no limits.
    """
    start, end = as_floating("q_start", q_start), as_floating("q_end", q_end)
    check_shape("q_start", start, (-1,))
    check_shape("q_end", end, (start.shape[-1],))
    for name, value in (("q_start", start), ("q_end", end)):
        check_finite(name, value)
    batch = broadcast_batch(("q_start", start, 1), ("q_end", end, 1))
    limits = check_limits_of(limits, start.shape[-1])
    check_choice("profile", profile, PROFILES)
    if profile == "scurve" and limits.jerk is None:
        raise ValueError("limits: expected a jerk for the profile 'scurve', got None")
    if not isinstance(straight, bool):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"straight: expected True or False, got {shown(straight)}")
    dtype = jnp.result_type(start, end)
    ends = (jnp.broadcast_to(q.astype(dtype), (*batch, start.shape[-1])) for q in (start, end))
    return _shortest(profile, straight, *ends, as_arrays(limits, dtype))


@functools.partial(jax.jit, static_argnums=(0, 1))
def _shortest(
    profile: Profile, straight: bool, start: jax.Array, end: jax.Array, limits: MotionLimits
) -> PointToPoint:
    length = jnp.abs(end - start)
    if straight:
        # One move of length 1 for all joints, as fast as the one that is bounded most.
        moves = length > 0
        share = jnp.where(moves, length, 1.0)
        bound = jax.tree.map(lambda most: jnp.where(moves, share / most, 0.0), limits)
        least = jax.tree.map(lambda rest: largest(rest)[..., None], bound)
        any_moves = jnp.any(moves, axis=-1, keepdims=True)
        least = jax.tree.map(lambda rest: 1.0 / jnp.where(any_moves, rest, 1.0), least)
        one = shape_of(profile, jnp.where(any_moves, jnp.ones_like(share[..., :1]), 0.0), least)
        duration, rise, hold = (jnp.broadcast_to(x, length.shape) for x in one[1:4])
        shape = Shape(length, duration, rise, hold, one.top * length)
    else:
        shape = shape_of(profile, length, limits)
    duration = largest(shape.duration)
    return PointToPoint(start, end, duration, shape, profile)


@functools.partial(jax.jit, static_argnums=0)
def _at(profile: Profile, moves: PointToPoint, t: jax.Array) -> tuple[jax.Array, ...]:
    shape = Shape(*(part[..., None, :] for part in moves.shape))
    total = moves.duration[..., None, None]
    own = shape.duration / jnp.where(total > 0, total, 1.0)
    done = at(profile, shape, jnp.where(t[..., None] < total, t[..., None] * own, jnp.inf))
    start, end = moves.q_start[..., None, :], moves.q_end[..., None, :]
    sign = jnp.sign(end - start)
    # From the nearer end, so that both are met exactly.
    near = done.s < 0.5 * shape.length
    q = jnp.where(near, start + sign * done.s, end - sign * (shape.length - done.s))
    return q, sign * done.velocity * own, sign * done.acceleration * own**2
