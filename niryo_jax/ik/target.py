"""Targets of inverse kinematics: poses as they come, made into rigid motions or refused."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, check_shape, on_lanes
from niryo_jax.lie import se3, so3
from niryo_jax.tolerances import POSE_ROTATION


class Target(NamedTuple):
    """Rigid motions to reach.

    Attributes:
        pose: (..., 4, 4) the nearest rigid motion; the identity where the input is not one.
        distance: (...,) Frobenius distance from the input; infinite where there is none near.
        valid: (...,) whether the input is a rigid motion to within the tolerance.
    """

    pose: jax.Array
    distance: jax.Array
    valid: jax.Array


@jax.jit
def make_target(pose: ArrayLike) -> Target:
    """Make poses (..., 4, 4) into rigid motions, and say which are none."""
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    identity = jnp.eye(4, dtype=pose.dtype)
    # Invalid input is replaced before anything is computed from it, so that it can neither make
    # a derivative NaN nor be told apart from a rotation only by what comes out.
    usable = on_lanes(_is_near_rotation, ("pose", pose, (4, 4))) > 0.5
    motion, distance = on_lanes(
        _nearest, ("pose", jnp.where(usable[..., None, None], pose, identity), (4, 4))
    )
    valid = usable & (distance <= POSE_ROTATION)
    return Target(
        jnp.where(valid[..., None, None], motion, identity),
        jnp.where(usable, distance, jnp.inf),
        valid,
    )


def _is_near_rotation(pose: Lanes) -> Lane:
    """1 where the rotation block is near enough to a rotation for `orthonormalise_lanes`."""
    r = pose[:3, :3]
    gram = r @ r.T - lanes.identity(3)
    near = (lanes.norm(gram.ravel()) < 0.5) & (r[0] @ lanes.cross(r[1], r[2]) > 0.0)
    finite = near
    for lane in pose.ravel():
        finite = finite & (abs(lane) < jnp.inf)
    return lanes.select(finite, 1.0, 0.0)


def _nearest(pose: Lanes) -> tuple[Lanes, Lane]:
    rotation = so3.orthonormalise_lanes(pose[:3, :3])
    motion = se3.assemble(rotation, pose[:3, 3])
    return motion, lanes.norm((pose - motion).ravel())
