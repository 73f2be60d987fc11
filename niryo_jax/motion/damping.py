"""How nearly singular an arm is, and the damping that this asks for."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.lanes import Lane
from niryo_jax.lanes.batch_last import lanes_in, squared, stacked, times
from niryo_jax.lanes.symmetric import factor, least_eigenvalue, solved
from niryo_jax.tolerances import APART_FROM_EIGENVALUE

_INVERSES = 3
"""Of the matrix less its eigenvalue: each brings the vector nearer by its share of the gap."""


def squared_smallest_value(matrix: jax.Array) -> jax.Array:
    """The square of the smallest singular value of matrices (m, n, r), (r,).

    Its derivative is u^T d(A A^T) u, finite also where the value is 0; where several values are the
    smallest it is that of some direction among theirs.
    """
    m, n = matrix.shape[:2]
    rows = matrix if m <= n else jnp.swapaxes(matrix, 0, 1)
    return _least(squared(jnp.swapaxes(rows, 0, 1)))


@jax.custom_jvp
def _least(matrix: jax.Array) -> jax.Array:
    """The least eigenvalue of symmetric matrices (m, m, r)."""
    return least_eigenvalue(lanes_in(matrix)).array


@_least.defjvp
def _least_jvp(
    primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[jax.Array, jax.Array]:
    (matrix,), (rate,) = primals, tangents
    value = _least(matrix)
    vector = _eigenvector(matrix, value)
    return value, jnp.sum(vector * times(rate, vector), axis=0)


def _eigenvector(matrix: jax.Array, value: jax.Array) -> jax.Array:
    """The unit eigenvector (m, r) of the least eigenvalue, by inverse iteration."""
    m = len(matrix)
    entries = lanes_in(matrix)
    apart = APART_FROM_EIGENVALUE.of(matrix.dtype) * np.diag(entries).sum() - Lane(value)
    factored = factor(entries + lanes.identity(m) * apart)
    # In general position: no eigenvector that an arm may have is at right angles to it.
    vector = lanes.lanes_of(np.cos(np.arange(1.0, m + 1)))
    for _ in range(_INVERSES):
        vector = solved(factored, vector)
        length = lanes.norm(vector)
        some = length > 0
        vector = lanes.materialised(
            vector * lanes.select(some, 1.0 / lanes.select(some, length, 1.0), 0.0)
        )
    return stacked(vector, value)


def damping_square(square: jax.Array, most: jax.Array, threshold: jax.Array) -> jax.Array:
    """(r,) the square of the damping for the square of the smallest singular value.

    0 above the threshold, and below it most^2 (1 - (value / threshold)^2) (Chiaverini, Siciliano &
    Egeland, 1994, after Nakamura & Hanafusa, 1986): largest where the arm is singular.
    """
    some = threshold > 0
    ratio = square / jnp.where(some, threshold * threshold, 1.0)
    return jnp.where(some & (ratio < 1), most * most * (1.0 - jnp.minimum(ratio, 1.0)), 0.0)
