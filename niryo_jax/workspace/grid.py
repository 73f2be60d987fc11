"""The grid of voxels of a map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from niryo_jax.arguments import as_data, check_positive
from niryo_jax.workspace.variables import VOXELS

_ROUNDING = 1e-9
"""Share of a voxel by which a bound may lie outside of a whole voxel without adding one."""

_MOST = 1e12
"""More voxels than any store holds."""


@dataclass(frozen=True)
class Grid:
    """Cubes of one size that fill a box, in places that are whole multiples of their edge.

    Any two grids of one voxel size line up, bit for bit, however their boxes were found.

    Attributes:
        voxel: length of an edge, metres.
        first: (x, y, z) index of the first voxel, which spans first * voxel to
            (first + 1) * voxel in the space frame.
        shape: how many voxels along x, y and z.

    Raises:
        ValueError: a voxel that is not positive and finite, less than one voxel along an axis.
    """

    voxel: float
    first: tuple[int, int, int]
    shape: tuple[int, int, int]

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_voxel(self.voxel)
        if len(self.first) != 3:
            raise ValueError(f"first: expected three indices, got {self.first}")
        if len(self.shape) != 3 or min(self.shape) < 1:
            raise ValueError(f"shape: expected three counts of at least 1, got {self.shape}")

    @property
    def size(self) -> int:
        """The number of voxels."""
        return math.prod(self.shape)

    @property
    def centres(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The coordinates of the voxels' centres along x, y and z, metres."""
        x, y, z = (
            (np.arange(first, first + count) + 0.5) * self.voxel
            for first, count in zip(self.first, self.shape)
        )
        return x, y, z

    @property
    def coordinates(self) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
        """The centres as the coordinates of a Dataset: dimension, values, attributes."""
        return {
            axis: (axis, centres, {"units": "m", "long_name": f"{axis} of the voxels' centres"})
            for axis, centres in zip(VOXELS, self.centres)
        }

    @property
    def lower(self) -> np.ndarray:
        """(3,) the least corner, metres."""
        return np.array(self.first) * self.voxel

    @property
    def upper(self) -> np.ndarray:
        """(3,) the greatest corner, metres."""
        return (np.array(self.first) + np.array(self.shape)) * self.voxel

    @classmethod
    def covering(cls, lower: ArrayLike, upper: ArrayLike, voxel: float) -> Grid:
        """The least grid that holds a box: widened outward to whole voxels.

        Args:
            lower, upper: (3,) corners of the box, metres.
            voxel: length of an edge, metres.

        Raises:
            ValueError: a voxel that is not positive and finite; corners of another shape, not
                finite, or that leave nothing between them.
        """
        check_voxel(voxel)
        low, high = check_box(lower, upper)
        with np.errstate(over="ignore", invalid="ignore"):
            first = np.floor(low / voxel + _ROUNDING)
            last = np.maximum(np.ceil(high / voxel - _ROUNDING), first + 1)
            size = np.prod(last - first)
        if not size < _MOST:
            raise ValueError(f"voxel: {voxel} m is too small for a box of {high - low} m")
        x, y, z = (int(index) for index in first)
        nx, ny, nz = (int(count) for count in last - first)
        return cls(float(voxel), (x, y, z), (nx, ny, nz))


def check_voxel(voxel: float) -> None:
    """Raise a ValueError unless the edge of a voxel is positive and finite."""
    check_positive("voxel", voxel, "a positive length in metres")


def check_box(lower: ArrayLike, upper: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a box as (3,) float64 arrays.

    Raises:
        ValueError: another shape, numbers that are not finite, nothing between the corners.
    """
    low, high = (np.asarray(as_data("bounds", x), np.float64) for x in (lower, upper))
    if low.shape != (3,) or high.shape != (3,):
        raise ValueError(
            "bounds: expected two corners of shape (3,), lower and upper; "
            f"got shapes {low.shape} and {high.shape}"
        )
    if not (np.all(np.isfinite(low)) and np.all(np.isfinite(high))):
        raise ValueError(f"bounds: expected finite corners, got {low} and {high}")
    if not np.all(low < high):
        raise ValueError(f"bounds: the box is empty; expected lower < upper, got {low} and {high}")
    return low, high
