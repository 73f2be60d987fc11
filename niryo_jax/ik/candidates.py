"""Joint vectors that may be solutions, many for each pose, slots first."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.lanes import Lanes
from niryo_jax.tolerances import SAME_SOLUTION


class Candidates(NamedTuple):
    """Joint vectors of many poses, slots first.

    Attributes:
        q: n lanes for `in_slots`.
        exists: (slots, batch) whether a slot holds a candidate.
        label: (slots, batch) of `branch_label`.
        singularity: (slots, batch) a `Singularity`.
        proved: (batch,) whether the candidates are proved to be all there can be.
    """

    q: Lanes
    exists: jax.Array
    label: jax.Array
    singularity: jax.Array
    proved: jax.Array


def in_slots(array: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    """Numbers of candidates in the shape (slots, batch), or where 2^k slots are told apart by k
    signs from any that broadcasts to (2, ..., 2, batch)."""
    if array.shape == shape:
        return array
    signs = shape[0].bit_length() - 1
    return jnp.broadcast_to(array, (2,) * signs + shape[1:]).reshape(shape)


def different(
    exists: jax.Array, q: Lanes, periodic: tuple[bool, ...], dtype: np.dtype
) -> jax.Array:
    """The candidates that exist, but for those that are the same as another one.

    Args:
        exists: (2, ..., 2, batch), an axis for each sign.
        q: n lanes that broadcast to this shape. Where two candidates that differ in one sign alone
            are the same, the later is left out.
        periodic: n flags, True for a joint that returns to its place after 2 pi.
        dtype: of the computation.
    """
    out = exists
    for axis in range(exists.ndim - 1):
        first, second = jnp.take(exists, 0, axis), jnp.take(exists, 1, axis)
        same = first & second
        for lane, turns in zip(q, periodic):
            value = jnp.broadcast_to(lane.array, exists.shape)
            apart = jnp.abs(jnp.take(value, 1, axis) - jnp.take(value, 0, axis))
            apart = jnp.minimum(apart, 2 * np.pi - apart) if turns else apart
            same = same & (apart < SAME_SOLUTION.of(dtype))
        out = out & ~jnp.stack([jnp.zeros_like(same), same], axis=axis)
    return out
