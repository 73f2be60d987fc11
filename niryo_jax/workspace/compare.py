"""Comparison of two capability maps: two robots, or two sets of limits of one robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from niryo_jax.extras import need
from niryo_jax.workspace.fields import SHARES, check_map, variable
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr

_SAME = ("length", "dexterous", "orientations", "orientation_kind", "orientation_seed")
_ALIGNED = 1e-6
"""Share of a voxel by which a centre may be off by rounding."""


def compare(a: xr.Dataset, b: xr.Dataset) -> xr.Dataset:
    """What changes from map `a` to map `b`, over the box that holds both.

    What lies outside of a map's box counts as unreachable. So it is for a box found from the
    limits; a map of narrower bounds says nothing of what lies beyond them.

    Args:
        a, b: capability maps of one voxel size, the same orientations in the same order, and the
            same `length` and `dexterous`.

    Returns:
        A Dataset over (x, y, z), metres, in the base frame that the maps share:
        `<name>_difference`, b - a, in the unit of the variable, for each float variable that both
        maps have per voxel (NaN where a measure is missing in either); `reached` uint8, 0 where
        neither reaches the voxel, 1 only a, 2 only b, 3 both; `change` int8, -1 lost, 0 same,
        1 gained. A voxel is reached where `reachability_index` > 0. Attributes: `robot_a`,
        `robot_b`; `volume_a`, `volume_b`, `volume_common`, `volume_gained`, `volume_lost` (m^3);
        `reachability_index_mean_a` and `_b`, each the mean over the voxels that the map reaches
        (0 where it reaches none). Variables per orientation or chunk are left out.

    Raises:
        ValueError: a map has no `reachability_index`, or the maps differ in what they must share;
            the message names it.
        ImportError: xarray is not installed.
    """
    _check_comparable(a, b)
    xarray = need("xarray")
    grid_a, grid_b = _grid("a", a), _grid("b", b)
    union = _union(grid_a, grid_b)

    def on_union(map: xr.Dataset, grid: Grid, name: str) -> np.ndarray:
        given = map[name].transpose(*VOXELS).values
        values = np.full(union.shape, 0 if name in SHARES else np.nan, given.dtype)
        start = np.subtract(grid.first, union.first)
        values[tuple(slice(k, k + count) for k, count in zip(start, grid.shape))] = given
        return values

    variables: dict[str, Any] = {}
    for name in a.data_vars:
        if _is_voxel_float(a, name) and _is_voxel_float(b, name):
            difference = on_union(b, grid_b, str(name)) - on_union(a, grid_a, str(name))
            described = a[name].attrs
            variables[f"{name}_difference"] = (
                VOXELS,
                difference,
                {
                    "long_name": f"{described.get('long_name', name)}, difference",
                    "units": described.get("units", "1"),
                },
            )

    share_a = on_union(a, grid_a, "reachability_index")
    share_b = on_union(b, grid_b, "reachability_index")
    reached_a, reached_b = share_a > 0, share_b > 0
    change = reached_b.astype(np.int8) - reached_a.astype(np.int8)
    reached = reached_a.astype(np.uint8) + 2 * reached_b.astype(np.uint8)
    variables["change"] = (
        VOXELS,
        change,
        {"long_name": "reached: -1 lost, 0 same, 1 gained", "units": "1"},
    )
    variables["reached"] = (
        VOXELS,
        reached.astype(np.uint8),
        {"long_name": "reached: 0 by neither, 1 by a only, 2 by b only, 3 by both", "units": "1"},
    )

    def volume(where: np.ndarray) -> float:
        return int(np.count_nonzero(where)) * union.voxel**3

    return xarray.Dataset(
        variables,
        {axis: (axis, at, dict(a[axis].attrs)) for axis, at in zip(VOXELS, union.centres)},
        {
            "robot_a": a.attrs.get("robot_name", "a"),
            "robot_b": b.attrs.get("robot_name", "b"),
            "voxel": union.voxel,
            **{name: a.attrs[name] for name in _SAME if name in a.attrs},
            "volume_a": volume(reached_a),
            "volume_b": volume(reached_b),
            "volume_common": volume(reached_a & reached_b),
            "volume_gained": volume(change > 0),
            "volume_lost": volume(change < 0),
            "reachability_index_mean_a": _mean(share_a[reached_a]),
            "reachability_index_mean_b": _mean(share_b[reached_b]),
        },
    )


def _mean(values: np.ndarray) -> float:
    return float(values.mean(dtype=np.float64)) if values.size else 0.0


def _is_voxel_float(map: xr.Dataset, name: Any) -> bool:
    return name in map and set(map[name].dims) == set(VOXELS) and map[name].dtype.kind == "f"


def _grid(label: str, map: xr.Dataset) -> Grid:
    """The grid of a map, from the centres of its voxels."""
    voxel = float(map.attrs["voxel"])
    centres = [map[axis].values for axis in VOXELS]
    first = [round(at[0] / voxel - 0.5) for at in centres]
    shape = [len(at) for at in centres]
    grid = Grid(voxel, (first[0], first[1], first[2]), (shape[0], shape[1], shape[2]))
    for axis, given, expected in zip(VOXELS, centres, grid.centres):
        if not np.allclose(given, expected, rtol=0.0, atol=_ALIGNED * voxel):
            raise ValueError(
                f"{label}: expected voxel centres at (k + 1/2) x {voxel} m along {axis}, got "
                f"{given[0]} to {given[-1]} m"
            )
    return grid


def _union(a: Grid, b: Grid) -> Grid:
    """The grid from the first to the last voxel of both."""
    first = np.minimum(a.first, b.first)
    past = np.maximum(np.add(a.first, a.shape), np.add(b.first, b.shape))
    (i, j, k), (m, n, o) = first.tolist(), (past - first).tolist()
    return Grid(a.voxel, (i, j, k), (m, n, o))


def _check_comparable(a: xr.Dataset, b: xr.Dataset) -> None:
    check_map("a", a)
    check_map("b", b)
    for map in (a, b):
        variable(map, "reachability_index", VOXELS)
    for name in ("voxel", *_SAME):
        given = a.attrs.get(name), b.attrs.get(name)
        if given[0] != given[1]:
            raise ValueError(
                f"{name}: expected maps with the same, got {given[0]} in a and {given[1]} in b"
            )
    name = "orientation_quaternion"
    if name in a and name in b and not np.array_equal(a[name].values, b[name].values):
        raise ValueError(f"{name}: expected maps with the same orientations, got different ones")
