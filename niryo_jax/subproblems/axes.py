"""Rotation axes and what is measured against them."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import Motion
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import so3
from niryo_jax.tolerances import SUBPROBLEM_COINCIDENCE, SUBPROBLEM_RESIDUAL


class Axis(NamedTuple):
    """A rotation axis as a unit direction and its point closest to the origin."""

    direction: Lanes
    point: Lanes


def axis_of(screw: Lanes) -> Axis:
    """The axis of a screw of zero pitch."""
    # r = w x v is the pseudo-inverse solution of v = -w x r (Todorovic et al., eq. 10).
    return Axis(screw[:3], lanes.cross(screw[:3], screw[3:]))


def off_axis(axis: Axis, point: Lanes) -> tuple[Lanes, Lane]:
    """The part of point - r at right angles to the axis, and the height along the axis."""
    away = point - axis.point
    height = axis.direction @ away
    return away - height * axis.direction, height


def angle_about(axis: Axis, start: Lanes, end: Lanes) -> Lane:
    """The angle that turns `start` towards `end` about an axis (Todorovic et al., eq. 4)."""
    u, _ = off_axis(axis, start)
    v, _ = off_axis(axis, end)
    return lanes.atan2(axis.direction @ lanes.cross(u, v), u @ v)


def rotate(axis: Axis, angle: Lane, point: Lanes) -> Lanes:
    """Where a rotation about the axis carries a point."""
    rotation = so3.rotation_about(axis.direction, *lanes.sincos(angle))
    return rotation @ (point - axis.point) + axis.point


def motion_about(axis: Axis, angle: Lane) -> Motion:
    """The rotation about the axis as a rigid motion."""
    rotation = so3.rotation_about(axis.direction, *lanes.sincos(angle))
    return rotation, axis.point - rotation @ axis.point


def wrap(angle: Lane) -> Lane:
    """The same angle in (-pi, pi], for an angle within (-3 pi, 3 pi)."""
    angle = lanes.select(angle > jnp.pi, angle - 2 * jnp.pi, angle)
    return lanes.select(angle > -jnp.pi, angle, angle + 2 * jnp.pi)


class Scale(NamedTuple):
    """The tolerances of a problem, from the size of its lengths."""

    residual: Lane
    coincidence: Lane
    dtype: np.dtype


def scale_of(*vectors: Lanes) -> Scale:
    """The tolerances of a problem with these lengths in it."""
    size = Lane(0.0)
    for vector in vectors:
        for length in vector:
            size = size + abs(length)
    dtype = jnp.result_type(size.value)
    return Scale(
        size * SUBPROBLEM_RESIDUAL.of(dtype), size * SUBPROBLEM_COINCIDENCE.of(dtype), dtype
    )
