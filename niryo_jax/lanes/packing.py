"""Columns into the last axis of an array and back: linear, and each the transpose of the other.

They are primitives of their own because the derivatives that JAX would find are slow: the transpose
of slices is a sum of padded arrays, that of a chain of selects a sum over all columns for each.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from niryo_jax._jax import instantiate_zeros, linear_primitive


def pack_columns(columns: Sequence[jax.Array], shape: tuple[int, ...]) -> jax.Array:
    """The array (..., k) or (..., k, l) of its k or k l >= 1 columns (...,) of one dtype."""
    return _pack.bind(*columns, shape=shape)


def unpack_columns(rows: jax.Array) -> list[jax.Array]:
    """The k columns (...,) of an array (..., k)."""
    return _unpack.bind(rows)


def _select(*columns: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    # Selects on the numbers of row and column stay one fused loop, which XLA compiles several
    # times faster than a concatenation and, up to some tens of columns, runs faster too.
    batch = columns[0].ndim
    whole = (*columns[0].shape, *shape)

    def choose(parts: Sequence[jax.Array], axis: int) -> jax.Array:
        number = lax.broadcasted_iota(jnp.int32, whole, batch + axis)
        out = jnp.zeros(whole, columns[0].dtype)
        for index, part in enumerate(parts):
            out = jnp.where(number == index, part, out)
        return out

    spread = [column.reshape(*column.shape, *[1] * len(shape)) for column in columns]
    if len(shape) == 1:
        return choose(spread, 0)
    rows, width = shape
    return choose([choose(spread[i * width : (i + 1) * width], 1) for i in range(rows)], 0)


def _stack(*columns: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    return jnp.stack(columns, axis=-1).reshape(*columns[0].shape, *shape)


def _slices(rows: jax.Array) -> list[jax.Array]:
    return [rows[..., index] for index in range(rows.shape[-1])]


@functools.lru_cache(maxsize=4096)
def _outputs(function: Callable[..., Any], *arguments: Any, **options: Any) -> list[Any]:
    # What JAX's own operations make of the arguments says also what shard_map wants to know.
    return list(jax.make_jaxpr(functools.partial(function, **options))(*arguments).out_avals)


def _pack_batched(
    columns: Sequence[Any], axes: Sequence[int | None], shape: tuple[int, ...]
) -> tuple[jax.Array, int]:
    size = next(x.shape[axis] for x, axis in zip(columns, axes) if axis is not None)
    moved = [
        jnp.broadcast_to(x, (size, *x.shape)) if axis is None else jnp.moveaxis(x, axis, 0)
        for x, axis in zip(columns, axes)
    ]
    return pack_columns(moved, shape), 0


def _unpack_batched(rows: Sequence[Any], axes: Sequence[int]) -> tuple[list[jax.Array], list[int]]:
    columns = unpack_columns(jnp.moveaxis(rows[0], axes[0], 0))
    return columns, [0] * len(columns)


def _pack_transposed(rate: Any, *columns: Any, shape: tuple[int, ...]) -> list[jax.Array]:
    batch = rate.shape[: rate.ndim - len(shape)]
    return unpack_columns(rate.reshape(*batch, len(columns)))


def _unpack_transposed(rates: Sequence[Any], rows: Any) -> list[jax.Array]:
    del rows
    return [pack_columns([instantiate_zeros(rate) for rate in rates], (len(rates),))]


_pack = linear_primitive(
    "pack_columns",
    _select,
    lambda *columns, shape: _outputs(_stack, *columns, shape=shape)[0],
    _pack_transposed,
    _pack_batched,
    static=("shape",),
)
_unpack = linear_primitive(
    "unpack_columns",
    _slices,
    lambda rows: _outputs(_slices, rows),
    _unpack_transposed,
    _unpack_batched,
    multiple_results=True,
)
