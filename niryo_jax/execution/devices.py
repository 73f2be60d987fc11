"""One large batch on all cores, or on all devices that hold it.

XLA runs a loop over blocks of poses on one core, and gathers what is spread over devices before it
cuts it into blocks. So a large batch of concrete arrays is cut here and each piece solved in a
thread of its own (a compiled program does not hold Python's lock), and what lies on several devices
becomes one program in which each works on its own rows.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AbstractMesh, Mesh, NamedSharding, PartitionSpec

from niryo_jax._jax import is_concrete
from niryo_jax.execution.padding import is_symbolic, one_by_one

_LEAST = 4096
"""Fewer poses are solved sooner than threads are started."""

_ALIGNMENT = 64
"""Bytes; memory that begins elsewhere JAX copies before it uses it."""

Result = TypeVar("Result")
Tree = Callable[..., Any]


class BatchSharding(NamedTuple):
    """How the rows of a batch are spread over the devices of a mesh."""

    mesh: Mesh | AbstractMesh
    rows: PartitionSpec

    @property
    def parts(self) -> int:
        """Into how many parts the rows are cut."""
        names = jax.tree.leaves(tuple(self.rows))
        return math.prod(self.mesh.shape[name] for name in names)


def batch_sharding(array: jax.Array, axes: int) -> BatchSharding | None:
    """How a concrete array lies on several devices; None where it does not."""
    sharding = array.sharding if is_concrete(array) else None
    if not isinstance(sharding, NamedSharding) or len(sharding.device_set) == 1:
        return None
    names = tuple(jax.tree.leaves(tuple(sharding.spec[:axes])))
    return BatchSharding(sharding.mesh, PartitionSpec(names)) if names else None


def on_each_device(
    function: Callable[..., Result], sharding: BatchSharding | None, same: int
) -> Callable[..., Result]:
    """A function of rows as one program in which each device works on its own rows.

    The first `same` arguments are the same for all rows.
    """
    if sharding is None:
        return function

    def in_specs(count: int) -> tuple[PartitionSpec, ...]:
        return (PartitionSpec(),) * same + (sharding.rows,) * (count - same)

    def spread_out(*arguments: Any) -> Result:
        return jax.shard_map(
            function,
            mesh=sharding.mesh,
            in_specs=in_specs(len(arguments)),
            out_specs=sharding.rows,
            check_vma=False,
        )(*arguments)

    return spread_out


def on_all_cores(
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
    if is_symbolic(batch):
        return one_by_one(solve, arrays, batch, tree_map)
    if not is_concrete(*arrays):
        return solve(*arrays)
    devices = arrays[0].sharding.device_set
    size = math.prod(batch)
    here = len(devices) == 1 and all(device.platform == "cpu" for device in devices)
    pieces = min(cores(), size // _LEAST) if here else 1
    if pieces < 2:
        return solve(*arrays)
    return _in_pieces(solve, arrays, batch, size_of_program(-(-size // pieces)), tree_map)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _in_pieces(
    solve: Callable[..., Result],
    arrays: Sequence[jax.Array],
    batch: tuple[int, ...],
    piece: int,
    tree_map: Tree,
) -> Result:
    size = math.prod(batch)
    rows = [array.reshape(size, *array.shape[len(batch) :]) for array in arrays]
    starts = range(0, size, piece)
    # A default device that was chosen for a `with` block holds in its own thread only.
    (device,) = arrays[0].sharding.device_set
    pieces = [[jax.device_put(_piece(x, start, piece), device) for x in rows] for start in starts]
    place = device if arrays[0].committed else None

    with ThreadPoolExecutor(len(starts)) as pool:
        parts = _run(pool, lambda piece: solve(*piece), pieces)

        def join(*parts: jax.Array) -> jax.Array:
            # XLA would concatenate on one core, and the first touch of fresh memory is what costs.
            whole = _aligned((size, *parts[0].shape[1:]), parts[0].dtype)

            def copy(start: int, part: jax.Array) -> None:
                rows = whole[start : start + piece]
                np.copyto(rows, np.asarray(part)[: len(rows)])

            list(pool.map(copy, starts, parts))
            return jax.device_put(whole.reshape(*batch, *whole.shape[1:]), place, may_alias=True)

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
