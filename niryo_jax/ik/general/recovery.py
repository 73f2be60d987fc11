"""The joint vector that belongs to a root of the polynomial: no choice of sign is left.

Matrices have the roots as their last axis, and are eliminated row by row, not number by
number, which makes a small program.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.general.polynomial import Equations
from niryo_jax.lanes import Lane
from niryo_jax.structure.closure import COLUMNS, ClosureNumbers

_START = 1.0, 0.7, -0.9, 0.8, 1.1, -0.6


def joint_vectors(
    numbers: ClosureNumbers, equations: Equations, owner: jax.Array, angle: jax.Array
) -> jax.Array:
    """(6, r) joint vectors of the roots `angle` (r,) of the poses `owner` (r,)."""
    rows, size = equations.minors.shape[-1], len(angle)
    table = jnp.concatenate([equations.minors.reshape(-1, rows), equations.products])
    table = lanes.materialise(Lane(table.T)).array[owner].T
    of_minors = 3 * COLUMNS * 6
    minors = table[:of_minors].reshape(3, COLUMNS, 6, size)
    products = table[of_minors:].reshape(8, 2, 2, 2, 2, size)
    sin, cos = (x.array for x in lanes.sincos(Lane(angle)))
    matrix = jnp.swapaxes(minors[0] + cos * minors[1] + sin * minors[2], 0, 1)
    solved = -_reduced(matrix)
    free = jnp.broadcast_to(jnp.eye(3, dtype=angle.dtype)[..., None], (3, 3, size))
    one, cos_x, sin_x = jnp.concatenate([solved, free])[numbers.places].reshape(3, 3, 3, size)
    # What (cos, sin) of half the angle of x times the free unknowns are a zero of.
    half_angle = jnp.concatenate(
        [
            jnp.concatenate([cos_x - one, sin_x], axis=1),
            jnp.concatenate([sin_x, -(cos_x + one)], axis=1),
        ]
    )
    upper, lower = _null_vector(half_angle).reshape(2, 3, size)
    theta_x = _double_angle(upper, lower)
    half_x = _half_angle(theta_x)
    unknowns = half_x[0] * upper + half_x[1] * lower
    scale, cos_y, sin_y = jnp.sum(one * unknowns, axis=1)
    sign = jnp.where(scale < 0.0, -1.0, 1.0)
    theta_y = lanes.atan2(Lane(sin_y * sign), Lane(cos_y * sign)).array
    left = products
    for cos, sin in (_half_angle(angle), half_x, _half_angle(theta_y)):
        left = cos * left[:, 0] + sin * left[:, 1]
    # What vanishes is a linear form in the half angle of the last joint, four times over.
    theta_last = _double_angle(-left[:4, 1], left[:4, 0])
    cos, sin = _half_angle(theta_last)
    coordinates = (cos * left[4:, 0] + sin * left[4:, 1]).reshape(2, 2, size)
    theta_next = _double_angle(coordinates[0], coordinates[1])
    theta_j = _double_angle(coordinates[:, 0], coordinates[:, 1])
    q = jnp.stack([angle, theta_x, theta_y, theta_last, theta_j, theta_next])
    return lanes.materialise(Lane(q)).array[numbers.order]


def _half_angle(angle: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Cosine and sine of half an angle."""
    sin, cos = lanes.sincos(Lane(0.5 * angle))
    return lanes.materialise(cos).array, lanes.materialise(sin).array


def _double_angle(cos: jax.Array, sin: jax.Array) -> jax.Array:
    """The angle t where (cos, sin) (2, k, ...) is a vector times (cos, sin) of t / 2."""
    y, x = 2.0 * jnp.sum(cos * sin, axis=0), jnp.sum(cos * cos - sin * sin, axis=0)
    return lanes.materialise(lanes.atan2(Lane(y), Lane(x))).array


def _reduced(matrix: jax.Array) -> jax.Array:
    """What (n, m, r) holds behind its first n columns when these are made those of the identity
    (Gauss and Jordan, with exchange of rows): (n, m - n, r)."""
    n = len(matrix)
    number = np.arange(n)[:, None]
    # Rows that are equally good are told apart by their number.
    preference = 1.0 - 1e-6 * number
    least = float(jnp.finfo(matrix.dtype).tiny) ** 0.5
    rows = matrix
    for k in range(n):
        column, others = rows[:, 0], rows[:, 1:]
        worth = jnp.where(number >= k, jnp.abs(column) * preference, -1.0)
        worth = lanes.materialise(Lane(worth)).array
        best = (worth == jnp.max(worth, axis=0))[:, None]
        chosen = jnp.sum(jnp.where(best, rows, 0.0), axis=0)
        pivot, chosen = chosen[0], chosen[1:]
        unit = lanes.materialise(
            Lane(chosen / jnp.where(jnp.abs(pivot) > least, pivot, least))
        ).array
        column = jnp.where(best[:, 0], column[k], column)
        others = jnp.where(best, others[k], others)
        rest = others - column[:, None] * unit
        rows = lanes.materialise(Lane(jnp.where((number == k)[:, None], unit, rest))).array
    return rows


def _null_vector(matrix: jax.Array) -> jax.Array:
    """(n, r) what a matrix (n, n, r) that is singular to rounding is closest to annihilating: a
    step of inverse iteration."""
    start = jnp.asarray(_START, matrix.dtype)[:, None, None]
    right = jnp.broadcast_to(start, (len(matrix), 1, matrix.shape[-1]))
    vector = _reduced(jnp.concatenate([matrix, right], axis=1))[:, 0]
    return vector / jnp.maximum(jnp.max(jnp.abs(vector), axis=0), 1e-30)
