"""The arrays of a map in a Zarr store, before anything is computed."""

from __future__ import annotations

from typing import Any

import numpy as np

from niryo_jax.workspace.spec import MapSpec
from niryo_jax.workspace.variables import VOXELS

CHECKSUM = "chunk_checksum"
QUATERNIONS = "orientation_quaternion"
NOT_DONE = 0


def lay_out(zarr: Any, store: Any, spec: MapSpec) -> None:
    """An empty map: its axes, the orientations, and room for every variable."""
    group = zarr.create_group(store, attributes=spec.attributes())
    sizes = {**spec.sizes, "quaternion": 4}
    pieces = {**sizes, **dict.fromkeys(VOXELS, spec.chunk_edge), "chunk": 1}

    def room(
        name: str,
        dims: tuple[str, ...],
        pieces: dict[str, int],
        dtype: Any,
        fill: float,
        **about: str,
    ) -> Any:
        return group.create_array(
            name,
            shape=tuple(sizes[dim] for dim in dims),
            chunks=tuple(pieces[dim] for dim in dims),
            dtype=np.dtype(dtype).name,
            compressors=zarr.codecs.ZstdCodec(level=3, checksum=True),
            fill_value=fill,
            dimension_names=dims,
            attributes=about,
        )

    def whole(name: str, dims: tuple[str, ...], values: np.ndarray, **about: str) -> None:
        room(name, dims, sizes, np.float64, np.nan, **about)[:] = values

    for axis, (_, centres, about) in spec.grid.coordinates.items():
        whole(axis, (axis,), centres, **about)
    whole(
        QUATERNIONS,
        ("orientation", "quaternion"),
        spec.quaternions,
        long_name="tool frame in the space frame, (w, x, y, z)",
        units="1",
    )
    for name, one in spec.variables.items():
        about = {"long_name": one.meaning, "units": one.units}
        room(name, one.dims, pieces, one.dtype, one.fill, **about)
    room(CHECKSUM, ("chunk",), pieces, np.int64, NOT_DONE, long_name="checksum of what is stored")
