"""Targets of inverse kinematics: poses as they come, made into rigid motions or refused; and the
joint vectors that answers are to be near to."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import as_floating, check_shape, on_lanes
from niryo_jax.lie import se3, so3
from niryo_jax.tolerances import POSE_ROTATION


class Target(NamedTuple):
    """Rigid motions to reach.

    Attributes:
        pose: (..., 4, 4) the nearest rigid motion; where the input is not `valid`, any that is
            nearly one.
        distance: (...,) Frobenius distance from the input; infinite where there is none near.
        valid: (...,) whether the input is a rigid motion to within the tolerance.
    """

    pose: jax.Array
    distance: jax.Array
    valid: jax.Array


@jax.jit
def make_target(pose: ArrayLike) -> Target:
    """Make poses (..., 4, 4) into rigid motions, and say which are none."""
    given = on_lanes(_usable, ("pose", pose, (4, 4)))
    # A loop, which XLA does not work out again for each of the many that use a target.
    motion = jax.lax.fori_loop(
        0, so3.ORTHONORMALISING, lambda _, x: on_lanes(_nearer, ("pose", x, (4, 4))), given
    )
    checks = on_lanes(_checks, ("pose", pose, (4, 4)), ("motion", motion, (4, 4)))
    return Target(motion, checks[..., 0], checks[..., 1] > 0.5)


def _usable(pose: Lanes) -> Lanes:
    """The pose; the identity where it is unusable, so that it cannot make a derivative NaN."""
    return lanes.choose(_is_near_rotation(pose), pose, _IDENTITY)


def _nearer(pose: Lanes) -> Lanes:
    return se3.assemble(so3.orthonormalise_step_lanes(pose[:3, :3]), pose[:3, 3])


def _checks(pose: Lanes, motion: Lanes) -> Lanes:
    """The distance, infinite where the pose is unusable, and 1 where it is a rigid motion."""
    usable = _is_near_rotation(pose)
    distance = lanes.norm((lanes.choose(usable, pose, motion) - motion).ravel())
    valid = usable & (distance <= POSE_ROTATION)
    reported = lanes.select(usable, distance, jnp.inf)
    return lanes.lanes_of([reported, lanes.select(valid, 1.0, 0.0)])


def _is_near_rotation(pose: Lanes) -> lanes.Condition:
    """Whether all is finite and the rotation block is nearly a rotation."""
    r = pose[:3, :3]
    gram = r @ r.T - lanes.identity(3)
    near = (gram.ravel() @ gram.ravel() < 0.25) & (r[0] @ lanes.cross(r[1], r[2]) > 0.0)
    for lane in (*pose[:3, 3], *pose[3]):
        near = near & (abs(lane) < jnp.inf)
    return near


_IDENTITY = lanes.identity(4)


def make_reference(q_ref: ArrayLike, pose: jax.Array, joints: int) -> jax.Array:
    """Reference joint vectors (..., n), one for each pose (..., 4, 4).

    Raises:
        ValueError: another number of joints, or a batch that is not that of the poses.
        TypeError: no array of real numbers.
    """
    reference = as_floating("q_ref", q_ref)
    check_shape("q_ref", reference, (joints,))
    batch = pose.shape[:-2]
    if jnp.broadcast_shapes(batch, reference.shape[:-1]) != batch:
        raise ValueError(
            f"q_ref: expected the batch of the poses, {batch}, got {reference.shape[:-1]}"
        )
    return jnp.broadcast_to(reference, (*batch, joints)).astype(pose.dtype)
