"""How batches of any size become few programs of bounded memory."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Literal, TypeVar

import jax
import jax.numpy as jnp

from niryo_jax.ik.solutions import IKSolutions, map_solutions
from niryo_jax.robot import is_concrete

BLOCK = 256
"""So many poses at a time stay in the cache of a core."""

_SMALL = 16
_CHUNK_ON_ACCELERATOR = 4096


def program_size(size: int) -> int:
    """The batch size to compile for: few different ones, at most a quarter more than asked."""
    if size <= _SMALL:
        return _SMALL
    if size <= BLOCK:
        return BLOCK
    blocks = -(-size // BLOCK)
    step = 1 << max(0, blocks.bit_length() - 3)
    return -(-blocks // step) * step * BLOCK


@functools.partial(jax.jit, static_argnums=(1, 2), static_argnames="mode")
def padded_rows(
    array: jax.Array, axes: int, size: int, mode: Literal["constant", "edge"] = "constant"
) -> jax.Array:
    """An array with so many batch axes as one row of elements, with zeros (or the last) behind."""
    rows = array.reshape(math.prod(array.shape[:axes]), *array.shape[axes:])
    padding = [(0, size - len(rows)), *[(0, 0)] * (rows.ndim - 1)]
    return jnp.pad(rows, padding, mode=mode if len(rows) else "constant")


def cut_rows(rows: jax.Array, batch: tuple[int, ...]) -> jax.Array:
    """The first elements of a row, in the shape of their batch."""
    return rows[: math.prod(batch)].reshape(*batch, *rows.shape[1:])


def in_chunks(solve: Callable[[jax.Array], IKSolutions], pose: jax.Array) -> IKSolutions:
    """`solve` of poses (..., 4, 4), which it gets as (chunk, 4, 4), so many at a time.

    Memory stays bounded, and few different shapes are compiled, each of which is a program.
    """
    batch = pose.shape[:-2]
    size = math.prod(batch)
    most = BLOCK if jax.default_backend() == "cpu" else _CHUNK_ON_ACCELERATOR
    chunk = min(most, program_size(size))
    chunks = max(1, -(-size // chunk))
    flat = jnp.pad(pose.reshape(size, 4, 4), ((0, chunks * chunk - size), (0, 0), (0, 0)))
    parts = flat.reshape(chunks, chunk, 4, 4)
    if chunks > 1 and not is_concrete(parts):
        answer = jax.lax.map(solve, parts)
        answer = dataclasses.replace(answer, lower=answer.lower[0], upper=answer.upper[0])
    else:
        # On concrete poses, programs are shared by all robots whose zeros are in the same places.
        answer = map_solutions(lambda *x: jnp.stack(x), *[solve(part) for part in parts])

    def to_batch(x: jax.Array) -> jax.Array:
        last = x.shape[2:]
        return x.reshape(chunks * chunk, *last)[:size].reshape(*batch, *last)

    return answer.map(to_batch)


State = TypeVar("State")


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
    within = jnp.matmul(table, jnp.triu(jnp.ones((side, side), jnp.float32)), precision="highest")
    # Whole numbers of float32 are exact in a row of the table, not in a batch of many millions.
    within = within.astype(jnp.int32)
    before = jnp.cumsum(within[:, -1])
    count = within + (before - within[:, -1])[:, None]
    return count.reshape(-1)[: len(which)], before[-1]
