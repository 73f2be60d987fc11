"""Records of lanes, kept as the rows of one array so that a few of many can be read at once."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from niryo_jax.lanes.scalar import Lane, Lanes, contiguous_lanes, map_lanes, materialise, pack

Record = TypeVar("Record")


def _lanes_of(leaf: Lane | Lanes) -> list[Lane]:
    return list(leaf.ravel()) if isinstance(leaf, np.ndarray) else [leaf]


def astype(record: Record, dtype: DTypeLike) -> Record:
    """A record of lanes and arrays of lanes in a dtype."""

    def convert(leaf: Lane | Lanes) -> Any:
        if isinstance(leaf, Lane):
            return leaf.astype(dtype)
        return map_lanes(lambda lane: lane.astype(dtype), leaf)

    return jax.tree.map(convert, record)


class RecordRows(Generic[Record]):
    """A record for each element of a batch: any nest of tuples of lanes and arrays of lanes.

    Args:
        record: the lanes.
        rows: the size of the batch.
        dtype: of the array.

    Attributes:
        array: (rows, c) all numbers of a record in a row.
    """

    def __init__(self, record: Record, rows: int, dtype: DTypeLike) -> None:
        leaves, self._structure = jax.tree.flatten(record)
        self._shapes = [leaf.shape if isinstance(leaf, np.ndarray) else None for leaf in leaves]
        numbers = [lane for leaf in leaves for lane in _lanes_of(leaf)]
        packed = pack(np.array(numbers, dtype=object), (rows,), dtype)
        # Every reader would pack it again.
        self.array = materialise(Lane(packed)).array

    def __getitem__(self, index: jax.Array | slice) -> Record:
        """The records of some rows, each number contiguous in memory."""
        numbers = contiguous_lanes(jnp.asarray(self.array)[index])
        leaves, at = list[Any](), 0
        for shape in self._shapes:
            size = 1 if shape is None else int(np.prod(shape))
            part = numbers[at : at + size]
            leaves.append(part[0] if shape is None else part.reshape(shape))
            at += size
        return jax.tree.unflatten(self._structure, leaves)
