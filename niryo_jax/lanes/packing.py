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
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

_pack = Primitive("pack_columns")
_unpack = Primitive("unpack_columns")
_unpack.multiple_results = True


def pack_columns(columns: Sequence[jax.Array]) -> jax.Array:
    """The array (..., k) of k >= 1 columns (...,), all of one shape and dtype."""
    return _pack.bind(*columns)


def unpack_columns(rows: jax.Array) -> list[jax.Array]:
    """The k columns (...,) of an array (..., k)."""
    return _unpack.bind(rows)


def _select(*columns: jax.Array) -> jax.Array:
    # A chain of selects on the column number stays one fused loop, which XLA compiles several
    # times faster than a concatenation and, up to some tens of columns, runs faster too.
    shape = (*columns[0].shape, len(columns))
    number = lax.broadcasted_iota(jnp.int32, shape, len(shape) - 1)
    out = jnp.zeros(shape, columns[0].dtype)
    for index, column in enumerate(columns):
        out = jnp.where(number == index, column[..., None], out)
    return out


def _stack(*columns: jax.Array) -> jax.Array:
    return jnp.stack(columns, axis=-1)


def _slices(rows: jax.Array) -> list[jax.Array]:
    return [rows[..., index] for index in range(rows.shape[-1])]


@functools.lru_cache(maxsize=4096)
def _outputs(function: Callable[..., Any], *arguments: Any) -> list[Any]:
    # What JAX's own operations make of the arguments says also what shard_map wants to know.
    return list(jax.make_jaxpr(function)(*arguments).out_avals)


def _pack_batched(columns: Sequence[Any], axes: Sequence[int | None]) -> tuple[jax.Array, int]:
    size = next(x.shape[axis] for x, axis in zip(columns, axes) if axis is not None)
    moved = [
        jnp.broadcast_to(x, (size, *x.shape)) if axis is None else jnp.moveaxis(x, axis, 0)
        for x, axis in zip(columns, axes)
    ]
    return pack_columns(moved), 0


def _unpack_batched(rows: Sequence[Any], axes: Sequence[int]) -> tuple[list[jax.Array], list[int]]:
    columns = unpack_columns(jnp.moveaxis(rows[0], axes[0], 0))
    return columns, [0] * len(columns)


def _pack_transposed(rate: Any, *columns: Any) -> list[jax.Array]:
    del columns
    return unpack_columns(rate)


def _unpack_transposed(rates: Sequence[Any], rows: Any) -> list[jax.Array]:
    del rows
    return [pack_columns([ad.instantiate_zeros(rate) for rate in rates])]


_pack.def_impl(jax.jit(_select))
_pack.def_abstract_eval(lambda *columns: _outputs(_stack, *columns)[0])
mlir.register_lowering(_pack, mlir.lower_fun(_select, multiple_results=False))
ad.deflinear2(_pack, _pack_transposed)
batching.primitive_batchers[_pack] = _pack_batched

_unpack.def_impl(jax.jit(_slices))
_unpack.def_abstract_eval(lambda rows: _outputs(_slices, rows))
mlir.register_lowering(_unpack, mlir.lower_fun(_slices, multiple_results=True))
ad.deflinear2(_unpack, _unpack_transposed)
batching.primitive_batchers[_unpack] = _unpack_batched
