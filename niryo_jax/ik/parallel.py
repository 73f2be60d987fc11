"""One large batch on all cores, or on all devices that hold it.

XLA runs a loop over blocks of poses on one core, and gathers what is spread over devices before it
cuts it into blocks. Arrays that are concrete are cut here instead, and each piece is solved in a
thread of its own: a compiled program does not hold Python's lock.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from niryo_jax.robot import is_concrete

_LEAST = 4096
"""Fewer poses are solved sooner than threads are started."""

_ALIGNMENT = 64
"""Bytes; memory that begins elsewhere JAX copies before it uses it."""

Result = TypeVar("Result")
Tree = Callable[..., Any]


def in_parallel(
    solve: Callable[..., Result],
    arrays: Sequence[jax.Array],
    batch: tuple[int, ...],
    size_of_program: Callable[[int], int],
    tree_map: Tree = jax.tree.map,
) -> Result:
    """`solve(*arrays)`, piece by piece and side by side where that is sooner.

    Args:
        solve: a function of arrays (..., ...) that treats each element of the batch by itself.
        arrays: all with the axes of the batch in front.
        batch: these axes.
        size_of_program: size of a batch -> what it is padded to, so that pieces share a program.
        tree_map: as `jax.tree.map`, of the arrays of a result that have the batch in front.
    """
    if not is_concrete(*arrays):
        return solve(*arrays)
    sharding = arrays[0].sharding
    if isinstance(sharding, NamedSharding) and len(sharding.device_set) > 1:
        return _on_devices(solve, arrays, batch, sharding, tree_map)
    size = math.prod(batch)
    on_cpu = all(device.platform == "cpu" for device in sharding.device_set)
    pieces = min(_cores(), size // _LEAST) if on_cpu else 1
    if pieces < 2:
        return solve(*arrays)
    return _on_cores(solve, arrays, batch, size_of_program(-(-size // pieces)), tree_map)


def _cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _on_cores(
    solve: Callable[..., Result],
    arrays: Sequence[jax.Array],
    batch: tuple[int, ...],
    piece: int,
    tree_map: Tree,
) -> Result:
    size = math.prod(batch)
    rows = [array.reshape(size, *array.shape[len(batch) :]) for array in arrays]
    starts = range(0, size, piece)

    def some(start: int) -> Result:
        return solve(*(_piece(array, start, piece) for array in rows))

    with ThreadPoolExecutor(len(starts)) as pool:
        parts = _run(pool, some, starts)

        def join(*parts: jax.Array) -> jax.Array:
            # XLA would concatenate on one core, and the first touch of fresh memory is what costs.
            whole = _aligned((size, *parts[0].shape[1:]), parts[0].dtype)

            def copy(start: int, part: jax.Array) -> None:
                rows = whole[start : start + piece]
                np.copyto(rows, np.asarray(part)[: len(rows)])

            list(pool.map(copy, starts, parts))
            return jax.device_put(whole.reshape(*batch, *whole.shape[1:]), may_alias=True)

        return tree_map(join, *parts)


def _on_devices(
    solve: Callable[..., Result],
    arrays: Sequence[jax.Array],
    batch: tuple[int, ...],
    sharding: NamedSharding,
    tree_map: Tree,
) -> Result:
    axes = len(batch)
    shared = NamedSharding(sharding.mesh, PartitionSpec(*sharding.spec[:axes]))
    arrays = [jax.device_put(array, shared) for array in arrays]
    shards = list(zip(*(array.addressable_shards for array in arrays)))

    def some(shards: Sequence[Any]) -> Result:
        return solve(*(shard.data for shard in shards))

    with ThreadPoolExecutor(len(shards)) as pool:
        parts = _run(pool, some, shards)

    def join(*parts: jax.Array) -> jax.Array:
        shape = (*batch, *parts[0].shape[axes:])
        return jax.make_array_from_single_device_arrays(shape, shared, list(parts))

    return tree_map(join, *parts)


def _run(pool: ThreadPoolExecutor, function: Callable[..., Result], items: Any) -> list[Result]:
    """The results, ready, side by side."""

    def ready(item: Any) -> Result:
        return jax.block_until_ready(function(item))

    # A precision that was chosen for a `with` block holds in its own thread only.
    if pool.submit(jnp.result_type, float).result() != jnp.result_type(float):
        return [ready(item) for item in items]
    return list(pool.map(ready, items))


def _piece(rows: jax.Array, start: int, count: int) -> jax.Array:
    """So many rows from a place on, and the last row again where there are no more."""
    some = rows[start : start + count]
    missing = count - len(some)
    return (
        jnp.pad(some, ((0, missing), *[(0, 0)] * (rows.ndim - 1)), mode="edge") if missing else some
    )


def _aligned(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """An empty array that JAX can take over without a copy."""
    dtype = np.dtype(dtype)
    size = math.prod(shape) * dtype.itemsize
    raw = np.empty(size + _ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)
