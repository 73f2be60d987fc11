"""A capability map as the voxels that can be seen of it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from niryo_jax.workspace.drawing import colours
from niryo_jax.workspace.fields import shown, variable
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr


@dataclasses.dataclass(frozen=True)
class Voxels:
    """The voxels of a map in which there is something of a variable.

    Attributes:
        of: the variable.
        edge: of a voxel, metres.
        centres: of all voxels of the grid along x, y and z, metres.
        there: (x, y, z) where there is something.
        colour: (x, y, z, 3) by the value, in the colours of the plots.
        least, most: the values of both ends of the colours.
    """

    of: str
    edge: float
    centres: tuple[NDArray[np.float64], ...]
    there: NDArray[np.bool_]
    colour: NDArray[np.uint8]
    least: float
    most: float

    @classmethod
    def of_map(cls, map: xr.Dataset, of: str) -> Voxels:
        """Those of a variable over the voxels of a capability map.

        Raises:
            ValueError: the map has no such variable. ImportError: matplotlib is not installed.
        """
        there = shown(map, of).transpose(*VOXELS).values
        values = variable(map, of, VOXELS).values.astype(np.float64)
        palette, scale = colours(map, of)
        least, most = float(scale.vmin or 0.0), float(scale.vmax or 0.0)
        painted = np.asarray(palette(scale(np.where(there, values, least)), bytes=True))
        centres = tuple(np.asarray(map[axis].values, np.float64) for axis in VOXELS)
        edge = float(map.attrs["voxel"])
        return cls(of, edge, centres, there, painted[..., :3], least, most)

    def cut(self, axis: int, share: float) -> NDArray[np.bool_]:
        """(x, y, z) what there is behind a plane across an axis, 0 to 2, at a share of its range.

        Behind is as the camera stands at first: below along x and z, above along y.
        """
        count = len(self.centres[axis])
        below = np.arange(count) < round(share * count)
        kept = ~below if axis == 1 else below
        return self.there & np.expand_dims(kept, tuple({0, 1, 2} - {axis}))

    def surface(self, there: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Centres (m, 3) and colours (m, 3) of the voxels that have a side free."""
        padded = np.pad(there, 1)
        hidden = np.ones_like(there)
        for axis in range(3):
            for shift in (-1, 1):
                hidden &= np.roll(padded, shift, axis)[1:-1, 1:-1, 1:-1]
        seen = np.nonzero(there & ~hidden)
        points = np.stack([centres[index] for centres, index in zip(self.centres, seen)], axis=1)
        return points.astype(np.float32), self.colour[seen]


def variables_of(map: xr.Dataset) -> tuple[str, ...]:
    """The variables over the voxels of a map, the first of which is shown first."""
    return tuple(str(name) for name in map.data_vars if set(map[name].dims) == set(VOXELS))
