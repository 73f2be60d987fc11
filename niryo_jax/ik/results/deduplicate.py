"""The different joint vectors of each pose."""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.compaction import running_count
from niryo_jax.ik.results.limits import without_whole_turns
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.tolerances import SAME_SOLUTION


def distinct(q: jax.Array, owner: jax.Array, rows: int, most: int) -> tuple[jax.Array, jax.Array]:
    """The joint vectors of each owner that are not the same as another, up to whole turns.

    Args:
        q: (r, n) joint vectors.
        owner: (r,) to whom each belongs, 0..rows - 1; `rows` for those that do not count.
        rows: how many owners there are.
        most: how many joint vectors an owner may have.

    Returns:
        (most, rows) the numbers of the joint vectors of each owner, -1 where there is none, and
        (rows,) whether an owner has more than fit.
    """
    # Equal joint vectors share their number, so that they are neighbours.
    order = _grouped(owner, _signature(q), rows)
    owner = owner[order]
    kept = (owner < rows) & ~_repeats(q[order], owner)
    count, _ = running_count(kept)
    first = jnp.searchsorted(owner, jnp.arange(rows))
    before = jnp.where(first > 0, count[first - 1], 0)
    place = count - 1 - before[jnp.minimum(owner, rows - 1)]
    fits = kept & (place < most)
    table = jnp.full((most, rows), -1, jnp.int32)
    table = table.at[jnp.where(fits, place, most), owner].set(order, mode="drop")
    crowded = jnp.zeros(rows, bool).at[jnp.where(kept & ~fits, owner, rows)]
    return table, crowded.set(True, mode="drop")


def _signature(q: jax.Array) -> jax.Array:
    """A number between 0 and 1/2 for joint vectors (r, n), the same for whole turns."""
    total = jnp.zeros(q.shape[0], q.dtype)
    for joint, angle in enumerate(lanes.unpack(q)):
        # Nothing about these numbers matters but that no symmetry of an arm is one of theirs.
        total = total + math.cos(joint) * lanes.sincos(angle + (0.3 + 0.7 * joint))[0].array
    return 0.25 + 0.05 * total


def _grouped(owner: jax.Array, signature: jax.Array, rows: int) -> jax.Array:
    """An order of the rows by owner, and for each by a number between 0 and 1/2."""
    # XLA sorts lone integers ten times faster than floats or pairs: each row's number goes with its
    # key, so that a sort keeps what those before it have ordered, digit by digit.
    number = jnp.arange(owner.shape[0], dtype=jnp.int32)
    bits = owner.shape[0].bit_length()
    digit = 31 - bits
    levels = 1 << digit

    def sort(order: jax.Array, key: jax.Array) -> jax.Array:
        return order[jnp.sort((key[order] << bits) | number) & ((1 << bits) - 1)]

    # The number's second digit, its first, then those of the owner from the last on.
    high = (signature * levels).astype(jnp.int32)
    low = ((signature * levels - high) * levels).astype(jnp.int32)
    owners = [(owner >> at) & (levels - 1) for at in range(0, rows.bit_length(), digit)]
    return functools.reduce(sort, (low, high, *owners), number)


def _repeats(q: jax.Array, owner: jax.Array) -> jax.Array:
    """Whether a joint vector (r, n) of the same pose is equal to one of the three before it."""
    repeats = jnp.zeros(owner.shape, bool)
    for shift in (1, 2, 3):
        turn = without_whole_turns(q[shift:] - q[:-shift], (True,) * q.shape[1])
        same = jnp.all(jnp.abs(turn) < SAME_SOLUTION.of(q.dtype), axis=1)
        same = same & (owner[shift:] == owner[:-shift])
        repeats = repeats | jnp.pad(same, (shift, 0))
    return repeats


def different(
    exists: jax.Array, q: Lanes, periodic: tuple[bool, ...], shape: tuple[int, ...], dtype: np.dtype
) -> jax.Array:
    """The candidates that exist, but for those that are the same as another one.

    Args:
        exists: what broadcasts to the shape.
        q: n lanes that broadcast to the shape. Where two candidates that differ in one sign alone
            are the same, the later is left out.
        periodic: n flags, True for a joint that returns to its place after 2 pi.
        shape: (2, ..., 2, batch), an axis for each sign.
        dtype: of the computation.
    """
    # As numbers, which are kept; truths would be worked out again for each slice.
    number = lanes.materialise(Lane(jnp.where(exists, jnp.ones((), dtype), 0.0))).array
    number = jnp.broadcast_to(number, shape)
    out = number > 0
    for axis in range(len(shape) - 1):
        farthest = jnp.zeros((), dtype)
        for lane, turns in zip(q, periodic):
            first, second = _halves(jnp.broadcast_to(lane.array, shape), axis)
            apart = jnp.abs(second - first)
            apart = jnp.minimum(apart, 2 * np.pi - apart) if turns else apart
            farthest = jnp.maximum(farthest, apart)
        first, second = _halves(number, axis)
        same = jnp.where(farthest < SAME_SOLUTION.of(dtype), first * second, 0.0)
        same = jnp.expand_dims(lanes.materialise(Lane(same)).array, axis)
        later = jax.lax.broadcasted_iota(jnp.int32, shape, axis) > 0
        out = out & ~((same > 0) & later)
    return out


def _halves(x: jax.Array, axis: int) -> list[jax.Array]:
    # `jnp.take` would look at whether the index is one of the array's.
    return [jax.lax.index_in_dim(x, i, axis, keepdims=False) for i in (0, 1)]


def duplicates(q: jax.Array, converged: jax.Array, periodic: tuple[bool, ...]) -> jax.Array:
    """(..., m): whether a joint vector is the same as one before it, up to whole turns."""
    apart = jnp.abs(without_whole_turns(q[..., :, None, :] - q[..., None, :, :], periodic))
    same = jnp.all(apart < SAME_SOLUTION.of(q.dtype), axis=-1) & converged[..., None, :]
    before = jnp.tri(q.shape[-2], k=-1, dtype=bool)
    return jnp.any(same & before, axis=-1) & converged
