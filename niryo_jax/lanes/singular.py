"""Singular values of many small matrices at once, the batch last: no LAPACK call for each."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

_TURNS = {np.dtype(np.float64): 6, np.dtype(np.float32): 5}


def singular_values(matrix: jax.Array) -> jax.Array:
    """The singular values of matrices (m, n, ...): (min(m, n), ...), in no order.

    One-sided Jacobi (Hestenes): pairs of rows are turned until all are at right angles; then their
    lengths are the singular values, the small ones to full accuracy where rows are well scaled.
    Every round turns disjoint pairs, so that it is one loop over the batch.
    """
    rows = matrix if matrix.shape[0] <= matrix.shape[1] else jnp.swapaxes(matrix, 0, 1)
    count = rows.shape[0]
    # An odd one gets a row of zeros for a partner, which stays zero.
    pairs = (count + 1) // 2
    rows = jnp.pad(rows, [(0, 2 * pairs - count)] + [(0, 0)] * (rows.ndim - 1))
    # A tournament: the first row stays, the others move on by one place after each round.
    order = np.concatenate([[0], np.roll(np.arange(1, 2 * pairs), 1)])
    rounds = _TURNS[np.dtype(rows.dtype)] * max(1, 2 * pairs - 1)

    def play(_: int, rows: jax.Array) -> jax.Array:
        first, second = rows[:pairs], rows[pairs:][::-1]
        a, b = jnp.sum(first * first, axis=1), jnp.sum(second * second, axis=1)
        product = jnp.sum(first * second, axis=1)
        apart = product == 0
        slope = (b - a) / jnp.where(apart, 1.0, 2 * product)
        tangent = jnp.where(slope >= 0, 1.0, -1.0) / (jnp.abs(slope) + jnp.sqrt(1 + slope * slope))
        tangent = jnp.where(apart, 0.0, tangent)
        cosine = 1 / jnp.sqrt(1 + tangent * tangent)
        cosine, sine = cosine[:, None], (tangent * cosine)[:, None]
        turned = cosine * first - sine * second, sine * first + cosine * second
        return jnp.concatenate([turned[0], turned[1][::-1]])[order]

    rows = jax.lax.fori_loop(0, rounds, play, rows)
    # After whole tournaments every row is back in its place.
    return jnp.sqrt(jnp.sum(rows * rows, axis=1))[:count]
