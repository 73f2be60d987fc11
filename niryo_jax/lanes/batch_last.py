"""Arrays whose last axis is the batch: each lane is a slice of them, contiguous in memory."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.lanes.scalar import Lane, Lanes, materialise


def lanes_in(array: jax.Array) -> Lanes:
    """The lanes of an array (..., r), an element of the result for each of its rows."""
    out = np.empty(array.shape[:-1], dtype=object)
    for index in np.ndindex(out.shape):
        out[index] = Lane(array[index])
    return out


def stacked(lanes: Lanes, like: jax.Array) -> jax.Array:
    """The array (..., r) of lanes, each as a row (r,) of the shape and dtype of one."""
    rows = [jnp.broadcast_to(jnp.asarray(x.value, like.dtype), like.shape) for x in lanes.ravel()]
    return jnp.stack(rows).reshape(*lanes.shape, *like.shape)


def times(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """(m, n, r) (n, r) -> (m, r)."""
    return _sum([matrix[:, j] * vector[j] for j in range(len(vector))])


def transposed_times(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """(m, n, r) (m, r) -> (n, r)."""
    return _sum([matrix[i] * vector[i] for i in range(len(vector))])


def squared(matrix: jax.Array) -> jax.Array:
    """(m, n, r) -> (n, n, r): A^T A."""
    rows = [matrix[i] for i in range(len(matrix))]
    return kept(_sum([row[:, None] * row[None] for row in rows]))


def kept(array: jax.Array, by: jax.Array | None = None) -> jax.Array:
    """`materialise` of an array: what each entry of a product reads is not worked out for each."""
    return materialise(Lane(array), None if by is None else Lane(by)).array


def _sum(terms: list[jax.Array]) -> jax.Array:
    return functools.reduce(jnp.add, terms)
