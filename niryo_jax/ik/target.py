"""Targets of inverse kinematics: poses as they come, made into rigid motions or refused."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import on_lanes
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
    # One array of 18 columns, since XLA computes a loop again for each of its outputs.
    columns = on_lanes(_nearest, ("pose", pose, (4, 4)))
    motion = columns[..., :16].reshape(*columns.shape[:-1], 4, 4)
    return Target(motion, columns[..., 16], columns[..., 17] > 0.5)


def _nearest(pose: Lanes) -> Lanes:
    # Unusable input is replaced before anything is computed from it, so that it cannot make a
    # derivative NaN.
    usable = _is_near_rotation(pose)
    given = lanes.choose(usable, pose, _IDENTITY)
    motion = se3.assemble(so3.orthonormalise_lanes(given[:3, :3]), given[:3, 3])
    distance = lanes.norm((given - motion).ravel())
    valid = usable & (distance <= POSE_ROTATION)
    kept = lanes.choose(valid, motion, _IDENTITY)
    reported = lanes.select(usable, distance, jnp.inf)
    return lanes.lanes_of([*kept.ravel(), reported, lanes.select(valid, 1.0, 0.0)])


def _is_near_rotation(pose: Lanes) -> lanes.Condition:
    """Whether all is finite and the rotation block is nearly a rotation."""
    r = pose[:3, :3]
    gram = r @ r.T - lanes.identity(3)
    near = (gram.ravel() @ gram.ravel() < 0.25) & (r[0] @ lanes.cross(r[1], r[2]) > 0.0)
    for lane in (*pose[:3, 3], *pose[3]):
        near = near & (abs(lane) < jnp.inf)
    return near


_IDENTITY = lanes.identity(4)
