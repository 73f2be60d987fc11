"""The variables of a map, looked up by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from niryo_jax.arguments import shown as shown_value
from niryo_jax.workspace.variables import MEASURES, VARIABLES, VOXELS

if TYPE_CHECKING:
    import xarray as xr

SHARES = frozenset(
    name
    for name, one in VARIABLES.items()
    if one.dims == VOXELS and name.rsplit("_", 1)[0] not in MEASURES
)
"""The variables per voxel that are 0, rather than NaN, where nothing is reached."""


def check_map(name: str, value: object) -> None:
    """Raise a TypeError unless it is a Dataset."""
    if not (hasattr(value, "data_vars") and hasattr(value, "attrs")):
        raise TypeError(f"{name}: expected an xarray.Dataset, got {shown_value(value)}")


def variable(map: xr.Dataset, name: str, dims: Sequence[str]) -> xr.DataArray:
    """A variable of a map, with its axes in this order.

    Raises:
        ValueError: the map has none over these axes; the message names those it has.
    """
    if name in map.data_vars and set(map[name].dims) == set(dims):
        return map[name].transpose(*dims)
    others = [str(other) for other in map.data_vars if set(map[other].dims) == set(dims)]
    raise ValueError(
        f"map: expected a variable {name!r} over ({', '.join(dims)}); "
        f"over these it has {', '.join(others) or 'none'}"
    )


def shown(map: xr.Dataset, of: str) -> xr.DataArray:
    """Which voxels have something to show of a variable, booleans (x, y, z).

    Those where a share or a count is not 0, where a measure is not NaN; of a comparison, those
    that either map reaches.

    Raises:
        ValueError: the map has no such variable.
    """
    values = variable(map, of, VOXELS)
    there = values.notnull()
    if "reached" in map:
        return there & (variable(map, "reached", VOXELS) > 0)
    return there & (values != 0) if of in SHARES or values.dtype.kind in "iu" else there
