"""Records of arrays and labels as pytrees, of which what is known is checked once."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, Self

import jax

STATIC = {"static": True}
"""Metadata of a field that is no array."""


class Record:
    """A frozen dataclass whose arrays are the leaves of a pytree, and whose other fields static.

    JAX builds such records of anything that it puts in the place of arrays: that is not checked.
    """

    @classmethod
    def _names(cls, static: bool) -> list[str]:
        fields: Any = cls
        return [
            field.name
            for field in dataclasses.fields(fields)
            if field.metadata.get("static", False) == static
        ]

    def tree_flatten_with_keys(self) -> tuple[list[tuple[Any, Any]], tuple[Any, ...]]:
        """The arrays by their names, and the rest."""
        arrays = [
            (jax.tree_util.GetAttrKey(name), getattr(self, name)) for name in self._names(False)
        ]
        return arrays, tuple(getattr(self, name) for name in self._names(True))

    @classmethod
    def tree_unflatten(cls, static: tuple[Any, ...], arrays: Sequence[Any]) -> Self:
        """A record of these arrays, which may be anything."""
        record = object.__new__(cls)
        names: Iterable[str] = cls._names(False) + cls._names(True)
        for name, value in zip(names, (*arrays, *static)):
            object.__setattr__(record, name, value)
        return record
