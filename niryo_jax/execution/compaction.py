"""A choice of rows, worked on so many at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp

from niryo_jax.lanes.matrices import product

State = TypeVar("State")


def at_once(on_a_core: int, on_accelerator: int) -> int:
    """How many rows to work on at a time: what fits a core's cache, or what fills an accelerator.

    A step of a loop costs an accelerator the start of all its kernels, however few rows it has.
    """
    return on_a_core if jax.default_backend() == "cpu" else max(on_a_core, on_accelerator)


def for_each_chunk(
    which: jax.Array,
    chunk: int,
    body: Callable[[State, jax.Array, jax.Array], State],
    state: State,
) -> State:
    """Run `body(state, rows, live)` on the chosen rows, so many at a time."""
    size = which.shape[0]
    place, count = running_count(which)
    place = jnp.where(which, place - 1, size + chunk)
    order = jnp.zeros(size + chunk, jnp.int32)
    order = order.at[place].set(jnp.arange(size, dtype=jnp.int32), mode="drop")

    def step(carry: tuple[jax.Array, State]) -> tuple[jax.Array, State]:
        at, state = carry
        rows = jax.lax.dynamic_slice_in_dim(order, at, chunk)
        return at + chunk, body(state, rows, at + jnp.arange(chunk) < count)

    return jax.lax.while_loop(lambda carry: carry[0] < count, step, (jnp.int32(0), state))[1]


def running_count(which: jax.Array) -> tuple[jax.Array, jax.Array]:
    """How many are true up to and including each, and in all."""
    # A small product with a triangle of ones costs a fraction of a cumulative sum.
    side = 64
    table = jnp.pad(which, (0, -len(which) % side)).reshape(-1, side).astype(jnp.float32)
    within = product(table, jnp.triu(jnp.ones((side, side), jnp.float32)))
    # Whole numbers of float32 are exact in a row of the table, not in a batch of many millions.
    within = within.astype(jnp.int32)
    before = jnp.cumsum(within[:, -1])
    count = within + (before - within[:, -1])[:, None]
    return count.reshape(-1)[: len(which)], before[-1]


def append(
    rows: jax.Array, count: jax.Array, new: jax.Array, which: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Write the chosen rows of `new` behind the first `count` rows; and how many there are then.

    What stands behind those is overwritten, as many rows as `new` has. Where there is no room for
    as many, some of the chosen are lost, and the count tells.
    """
    place, total = running_count(which)
    most = min(len(new), len(rows))
    order = jnp.zeros(most, jnp.int32)
    order = order.at[jnp.where(which, place - 1, most)].set(
        jnp.arange(len(new), dtype=jnp.int32), mode="drop"
    )
    # One piece that is written in place: a scatter copies all rows at each step of a loop.
    at = jnp.minimum(count, len(rows) - most)
    return jax.lax.dynamic_update_slice_in_dim(rows, new[order], at, 0), count + total


def tally(counts: jax.Array, owner: jax.Array, which: jax.Array) -> jax.Array:
    """The counts (rows,), with one more for each of the chosen that belong to an owner."""
    return counts.at[owner.astype(jnp.int32)].add(which.astype(jnp.int32), mode="drop")
