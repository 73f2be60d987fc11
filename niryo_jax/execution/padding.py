"""How batches of any size become few programs of bounded memory."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from niryo_jax._jax import is_concrete
from niryo_jax.execution.compaction import at_once

Result = TypeVar("Result")

BLOCK = 256
"""So many poses at a time stay in the cache of a core."""

SMALL = 1024
"""Fewer poses at a time are solved by programs that are compiled fast rather than run fast."""

_CHUNK_ON_ACCELERATOR = 4096


def is_small(size: int) -> bool:
    """Whether a batch of a `program_size` is small."""
    return size <= SMALL


def program_size(size: int) -> int:
    """The batch size to compile for: few different ones, at most a quarter more than asked."""
    for few in (1, 16, 64, 256, 512, SMALL):
        if size <= few:
            return few
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


def filled_up(rows: NDArray[Any], multiple: int) -> NDArray[Any]:
    """Rows (k, ...), k of 1 or more, with the last repeated up to a multiple of so many."""
    return np.pad(rows, [(0, -len(rows) % multiple), *[(0, 0)] * (rows.ndim - 1)], mode="edge")


def is_symbolic(batch: tuple[Any, ...]) -> bool:
    """Whether the size of a batch is not known (`jax.export.symbolic_shape`)."""
    return not all(isinstance(size, int) for size in batch)


def one_by_one(
    solve: Callable[..., Result],
    arrays: Sequence[jax.Array],
    batch: tuple[Any, ...],
    tree_map: Callable[..., Any] = jax.tree.map,
) -> Result:
    """`solve` of one element after the other, for a batch whose size is not known.

    Arguments as `devices.on_all_cores`. What is no array of the batch, and `tree_map` leaves alone,
    gets the elements as an axis in front.
    """
    size = math.prod(batch)
    rows = tuple(x.reshape(size, *x.shape[len(batch) :]) for x in arrays)
    answer = jax.lax.map(lambda elements: solve(*(x[None] for x in elements)), rows)
    return tree_map(lambda x: x.reshape(*batch, *x.shape[2:]), answer)


def cut_rows(rows: jax.Array, batch: tuple[int, ...]) -> jax.Array:
    """The first elements of a row, in the shape of their batch."""
    return rows[: math.prod(batch)].reshape(*batch, *rows.shape[1:])


def in_chunks(solve: Callable[[jax.Array], Result], pose: jax.Array) -> Result:
    """`solve` of poses (..., 4, 4), which it gets as (chunk, 4, 4), so many at a time.

    Memory stays bounded, and few different shapes are compiled, each of which is a program. Every
    array of a result has the batch in front.
    """
    batch = pose.shape[:-2]
    if is_symbolic(batch):
        return one_by_one(solve, [pose], batch)
    size = math.prod(batch)
    most = at_once(BLOCK, _CHUNK_ON_ACCELERATOR)
    chunk = min(most, program_size(size))
    chunks = max(1, -(-size // chunk))
    parts = padded_rows(pose, len(batch), chunks * chunk).reshape(chunks, chunk, 4, 4)
    if chunks > 1 and not is_concrete(parts):
        answer = jax.tree.map(jnp.concatenate, jax.lax.map(solve, parts))
    else:
        # On concrete poses, programs are shared by all robots whose zeros are in the same places.
        answer = jax.tree.map(lambda *x: jnp.concatenate(x), *[solve(part) for part in parts])
    return jax.tree.map(lambda x: cut_rows(x, batch), answer)
