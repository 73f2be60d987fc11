"""Capability maps for other tools: npz archives and point clouds."""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from niryo_jax.arguments import check_path
from niryo_jax.extras import need
from niryo_jax.files import whole
from niryo_jax.workspace.drawing import colours
from niryo_jax.workspace.fields import check_map, shown
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr

_METADATA = "metadata"


def to_npz(map: xr.Dataset, path: str | Path) -> None:
    """Write all arrays of a map into one compressed file that `numpy.load` reads.

    Each variable and coordinate is an array of its own name. The array `metadata` holds a JSON
    text with the `attributes` of the map and of each array its `dims`, its `attributes` (with
    its unit) and whether it is a `coordinate`. One array at a time is in memory. The same map
    gives the same bytes, and the file is there whole or not at all.

    Args:
        map: the map, or any Dataset of arrays of numbers.
        path: the file to write, under this very name.

    Raises:
        ValueError: an array is named `metadata`, or holds Python objects.
        TypeError: an attribute is not a number, text, or list of them.
        OSError: the file cannot be written.
    """
    check_map("map", map)
    check_path("path", path)
    if _METADATA in map.variables:
        raise ValueError(f"map: expected no array named {_METADATA!r}, which holds the attributes")
    metadata = {
        "attributes": map.attrs,
        "arrays": {
            str(name): {
                "dims": array.dims,
                "attributes": array.attrs,
                "coordinate": name in map.coords,
            }
            for name, array in map.variables.items()
        },
    }
    text = json.dumps(metadata, default=_plain)
    with whole(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in map.variables.items():
            _write_array(archive, str(name), array.values)
        _write_array(archive, _METADATA, np.array(text))


def from_npz(path: str | Path) -> xr.Dataset:
    """Read a map that `to_npz` has written, bit for bit.

    Args:
        path: the file.

    Returns:
        The map, in memory. Attributes that were numpy numbers or arrays are Python's.

    Raises:
        ValueError: the file was not written by `to_npz`, or is damaged.
        OSError: the file cannot be read.
        ImportError: xarray is not installed.
    """
    check_path("path", path)
    xarray = need("xarray")
    parts: dict[bool, dict[str, Any]] = {True: {}, False: {}}
    with Path(path).open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                metadata = json.loads(str(_read_array(archive, _METADATA)))
                for name, array in metadata["arrays"].items():
                    values = _read_array(archive, name)
                    parts[array["coordinate"]][name] = array["dims"], values, array["attributes"]
        except (ValueError, KeyError, EOFError, zlib.error, zipfile.BadZipFile) as error:
            raise ValueError(
                f"path: expected a whole file written by to_npz, got {path}"
            ) from error
    return xarray.Dataset(parts[False], parts[True], metadata["attributes"])


def to_ply(
    map: xr.Dataset,
    path: str | Path,
    of: str = "reachability_index",
    at_least: float | None = None,
) -> int:
    """Write the voxels' centres as a point cloud: binary little-endian PLY.

    Each point has x, y, z (float, metres, base frame), red, green, blue (uchar, the colours of
    the plots) and every variable per voxel as a float of its name; NaN stays NaN. The file is
    there whole or not at all.

    Args:
        map: a capability map, a comparison or a forward map.
        path: the file to write.
        of: the variable that colours the points.
        at_least: leave out the voxels where it is less; by default those where there is nothing
            of it (0 for a share or a count, NaN for a measure).

    Returns:
        The number of points, which may be 0.

    Raises:
        ValueError: the map has no such variable per voxel.
        ImportError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    check_map("map", map)
    check_path("path", path)
    where = shown(map, of).transpose(*VOXELS).values
    values = map[of].transpose(*VOXELS).values
    if at_least is not None:
        where = where & (values >= at_least)
    palette, scale = colours(map, of)
    names = [str(name) for name in map.data_vars if set(map[name].dims) == set(VOXELS)]
    points = np.empty(
        np.count_nonzero(where),
        [
            *((name, "<f4") for name in VOXELS),
            *((name, "u1") for name in ("red", "green", "blue")),
            *((name, "<f4") for name in names),
        ],
    )
    for name, index in zip(VOXELS, np.nonzero(where)):
        points[name] = map[name].values[index]
    rgba = palette(scale(values[where]), bytes=True)
    for k, name in enumerate(("red", "green", "blue")):
        points[name] = rgba[:, k]
    for name in names:
        points[name] = map[name].transpose(*VOXELS).values[where]
    kinds = {"f": "float", "u": "uchar"}
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            f"comment voxel centres of {json.dumps(map.attrs.get('robot_name', 'a robot'))}",
            f"comment metres, in the base frame; edge of a voxel {map.attrs.get('voxel')}",
            f"comment colours: {of}",
            f"element vertex {len(points)}",
            *(
                f"property {kinds[points.dtype[name].kind]} {name}"
                for name in points.dtype.names or ()
            ),
            "end_header\n",
        ]
    )
    with whole(path) as file:
        file.write(header.encode("ascii"))
        file.write(points.tobytes())
    return len(points)


def _write_array(archive: zipfile.ZipFile, name: str, values: np.ndarray) -> None:
    # A ZipInfo of its own carries the fixed date of 1980, so that equal maps give equal files.
    entry = zipfile.ZipInfo(f"{name}.npy")
    entry.compress_type = zipfile.ZIP_DEFLATED
    with archive.open(entry, "w", force_zip64=True) as file:
        np.lib.format.write_array(file, np.asanyarray(values), allow_pickle=False)


def _read_array(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    with archive.open(f"{name}.npy") as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _plain(value: Any) -> Any:
    """A numpy number or array of an attribute, for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(
        f"attributes: expected numbers, text or lists of them, got {type(value).__name__}"
    )
