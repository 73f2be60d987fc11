"""The joint vector that belongs to a root of the polynomial: no choice of sign is left."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.ik.general.elimination import eliminated, solved
from niryo_jax.ik.general.polynomial import (
    Equations,
    at_angle,
    half_angle_rows,
    null_basis,
    smallest,
)
from niryo_jax.lanes import Lane
from niryo_jax.lanes.batch_last import kept
from niryo_jax.structure.closure import ClosureNumbers

_START = 1.0, 0.7, -0.9, 0.8, 1.1, -0.6


def joint_vectors(numbers: ClosureNumbers, equations: Equations, angle: jax.Array) -> jax.Array:
    """(6, r) joint vectors of the roots `angle` (r,), each with the equations of its pose."""
    minors, left = equations
    sin, cos = (kept(x.array) for x in lanes.sincos(Lane(angle)))
    least = smallest(angle.dtype)
    basis, _ = null_basis(at_angle(minors, cos, sin), numbers.places, least)
    one = basis[0]
    upper, lower = _null_vector(half_angle_rows(basis), least).reshape(2, 3, -1)
    theta_x = _double_angle(upper, lower)
    half_x = _half_angle(theta_x)
    unknowns = half_x[0] * upper + half_x[1] * lower
    scale, cos_y, sin_y = jnp.sum(one * unknowns, axis=1)
    sign = jnp.where(scale < 0.0, -1.0, 1.0)
    theta_y = lanes.atan2(Lane(sin_y * sign), Lane(cos_y * sign)).array
    for cos, sin in (_half_angle(angle), half_x, _half_angle(theta_y)):
        left = cos * left[:, 0] + sin * left[:, 1]
    # What vanishes is a linear form in the half angle of the last joint, four times over.
    theta_last = _double_angle(-left[:4, 1], left[:4, 0])
    cos, sin = _half_angle(theta_last)
    coordinates = (cos * left[4:, 0] + sin * left[4:, 1]).reshape(2, 2, -1)
    theta_next = _double_angle(coordinates[0], coordinates[1])
    theta_j = _double_angle(coordinates[:, 0], coordinates[:, 1])
    q = jnp.stack([angle, theta_x, theta_y, theta_last, theta_j, theta_next])
    return kept(q)[numbers.order]


def _half_angle(angle: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Cosine and sine of half an angle."""
    sin, cos = lanes.sincos(Lane(0.5 * angle))
    return kept(cos.array), kept(sin.array)


def _double_angle(cos: jax.Array, sin: jax.Array) -> jax.Array:
    """The angle t where (cos, sin) (2, k, ...) is a vector times (cos, sin) of t / 2."""
    y, x = 2.0 * jnp.sum(cos * sin, axis=0), jnp.sum(cos * cos - sin * sin, axis=0)
    return kept(lanes.atan2(Lane(y), Lane(x)).array)


def _null_vector(matrix: list[jax.Array], least: float) -> jax.Array:
    """(n, r) what n rows (n, r) of a matrix that is singular to rounding are closest to
    annihilating: a step of inverse iteration."""
    rows = [
        kept(jnp.concatenate([row, jnp.full_like(row[:1], start)]))
        for row, start in zip(matrix, _START)
    ]
    units, _ = eliminated(rows, least)
    vector = solved(units)[:, 0]
    return vector / jnp.maximum(jnp.max(jnp.abs(vector), axis=0), 1e-30)
