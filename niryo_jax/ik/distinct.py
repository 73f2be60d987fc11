"""Which joint vectors of a long list, of many poses, are new: duplicates lie side by side."""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.tolerances import SAME_SOLUTION


def distinct(q: jax.Array, owner: jax.Array) -> tuple[jax.Array, jax.Array]:
    """An order of joint vectors (r, n) by owner (r,), and which of them, so ordered, are new.

    A joint vector is not new where it is one of its owner's before it, up to whole turns.
    """
    # Equal joint vectors share their number, so that they are neighbours.
    order = _grouped(owner, _signature(q))
    return order, ~_repeats(q[order], owner[order])


def _signature(q: jax.Array) -> jax.Array:
    """A number between 0 and 1/2 for joint vectors (r, n), the same for whole turns."""
    total = jnp.zeros(q.shape[0], q.dtype)
    for joint, angle in enumerate(lanes.unpack(q)):
        # Nothing about these numbers matters but that no symmetry of an arm is one of theirs.
        total = total + math.cos(joint) * lanes.sincos(angle + (0.3 + 0.7 * joint))[0].array
    return 0.25 + 0.05 * total


def _grouped(owner: jax.Array, signature: jax.Array) -> jax.Array:
    """An order of the rows by owner, and for each by a number between 0 and 1/2."""
    # XLA on the CPU sorts lone integers ten times faster than floats or pairs: each row's number
    # goes with its key, so that a sort keeps what those before it have ordered.
    number = jnp.arange(owner.shape[0], dtype=jnp.int32)
    bits = owner.shape[0].bit_length()
    levels = 1 << (31 - bits)

    def sort(order: jax.Array, key: jax.Array) -> jax.Array:
        return order[jnp.sort((key[order] << bits) | number) & ((1 << bits) - 1)]

    # The number's second digit, its first, then the owner.
    high = (signature * levels).astype(jnp.int32)
    low = ((signature * levels - high) * levels).astype(jnp.int32)
    return functools.reduce(sort, (low, high, owner), number)


def _repeats(q: jax.Array, owner: jax.Array) -> jax.Array:
    """Whether a joint vector (r, n) of the same pose is equal to one of the three before it."""
    repeats = jnp.zeros(owner.shape, bool)
    for shift in (1, 2, 3):
        turn = jnp.abs(q[shift:] - q[:-shift])
        turn = jnp.minimum(turn, 2 * np.pi - turn)
        same = jnp.all(turn < SAME_SOLUTION.of(q.dtype), axis=1)
        same = same & (owner[shift:] == owner[:-shift])
        repeats = repeats | jnp.pad(same, (shift, 0))
    return repeats
