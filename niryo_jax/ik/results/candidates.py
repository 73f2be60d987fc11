"""Joint vectors that may be solutions, many for each pose."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax.ik.results.status import Singularity
from niryo_jax.lanes import Lanes


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


class JointVectors(NamedTuple):
    """Joint vectors of many poses that were verified.

    Attributes:
        q: (..., m, n).
        found: (..., m) whether it reaches the pose.
        position_error, rotation_error: (..., m) metres and radians by which it misses.
        label: (..., m) which branch it is on, or -1.
        singularity: (..., m) a `Singularity`.
    """

    q: jax.Array
    found: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array
    label: jax.Array
    singularity: jax.Array

    @classmethod
    def unlabelled(
        cls,
        q: jax.Array,
        found: jax.Array,
        position_error: jax.Array,
        rotation_error: jax.Array,
    ) -> JointVectors:
        """Joint vectors of a method that tells no branches and looks for no singularities."""
        label = jnp.full(found.shape, -1, jnp.int32)
        unknown = jnp.full(found.shape, Singularity.UNKNOWN, jnp.int32)
        return cls(q, found, position_error, rotation_error, label, unknown)


def in_slots(array: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    """Numbers of candidates in the shape (slots, batch), or where 2^k slots are told apart by k
    signs from any that broadcasts to (2, ..., 2, batch)."""
    if array.shape == shape:
        return array
    signs = shape[0].bit_length() - 1
    return jnp.broadcast_to(array, (2,) * signs + shape[1:]).reshape(shape)
