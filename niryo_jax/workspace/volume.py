"""The volume that an arm reaches, with a bound of its error, and plane sections of a map."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from niryo_jax.arguments import check_choice, check_number
from niryo_jax.workspace.fields import check_map, variable
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr

_FORWARD = "samples"
_ROUNDING = 1e-9
"""Share of a voxel."""


class Volume(NamedTuple):
    """A volume and its bounds, cubic metres.

    Attributes:
        value: the voxels that count, times the volume of one.
        lower, upper: what the volume lies between.
        boundary: the number of voxels in which the boundary may run, from which the bounds come.
    """

    value: float
    lower: float
    upper: float
    boundary: int


def reachable_volume(
    map: xr.Dataset, *, of: str = "reachability_index", at_least: float = 0.0
) -> Volume:
    """The volume of the region in which a variable of a map is above a share.

    The value is (voxels that count) * voxel^3. In a capability map a voxel counts for its centre.
    The bounds hold where the region and what surrounds it are at least two voxels thick and the
    boundary is, at the scale of a voxel and its neighbours, a plane or the edge or corner of a
    block along the axes:

    - A plane that cuts a voxel separates its centre from that of one of its 26 neighbours. (With
      the normal n, a cut voxel's centre is nearer to the plane than (|nx| + |ny| + |nz|) / 2, and
      towards one of the corners the next centre is twice as far.) So a voxel that agrees with all
      26 is right.
    - A plane leaves the half of the voxel in which its centre lies, a block's edge a quarter, its
      corner an eighth. So a voxel that differs from its neighbours along k axes is wrong by at
      most 1 - 2^-k of itself: what counts by too much, what does not by too little.
    - A voxel that differs from diagonal neighbours only is wrong by at most a quarter (next to an
      edge; a plane leaves 1/48 at most).

    The bounds shrink in proportion to the voxel; the errors of single voxels mostly cancel, so that
    the value is as a rule much better. Features thinner than a voxel, and edges sharper than a
    right angle, are not covered. The region is that of the map: within its box, and for its set
    of orientations.

    In a forward map (`of="samples"`) a voxel counts if a sample met it, however little of it can be
    reached, so that every voxel that differs from a neighbour may be wrong by the whole; the
    value is mostly too large, and the bounds hold if the samples are dense enough to meet every
    voxel inside of the region.

    Args:
        map: a capability map or a forward map.
        of: the variable: "reachability_index", "dexterous_fraction", "samples"...
        at_least: a voxel counts where the variable is above zero and at least this: 1.0 for the
            volume in which every orientation is reached.

    Raises:
        ValueError: a variable that the map has not, or not for every voxel.
    """
    edge = _voxel_of(map)
    at_least = check_number("at_least", at_least, "a number", lambda x: not math.isnan(x))
    values = variable(map, of, VOXELS).values
    # A share is compared as it is stored: 0.7 of the orientations is below 0.7 in float32.
    share = values.dtype.type(at_least) if values.dtype.kind == "f" else at_least
    counts = (values > 0) & (values >= share)
    wrong = _any_differs(counts).astype(float) if of == _FORWARD else _wrong(counts)
    number = int(counts.sum())
    # Halves and eighths add up without rounding.
    least, most = number - float(wrong[counts].sum()), number + float(wrong[~counts].sum())
    cube = edge**3
    return Volume(number * cube, least * cube, most * cube, int(np.count_nonzero(wrong)))


def section(map: xr.Dataset, axis: str, at: float) -> xr.Dataset:
    """The plane of voxels that holds a coordinate.

    Args:
        map: a capability map or a forward map.
        axis: the axis that the plane is perpendicular to: "x", "y" or "z".
        at: the coordinate along it, metres. On the face between two voxels the upper one is taken.

    Returns:
        The map without that axis; the coordinate of the plane's centres is kept as a scalar.

    Raises:
        ValueError: an unknown axis, or a coordinate outside of the map.
    """
    check_map("map", map)
    check_choice("axis", axis, VOXELS)
    at = check_number("at", at, "a number of metres", math.isfinite)
    edge, centres = _voxel_of(map), map[axis].values
    first, count = round(float(centres[0]) / edge - 0.5), len(centres)
    # A multiple of the edge is meant as such, though its quotient may be rounded.
    place = at / edge - first
    if not -_ROUNDING <= place <= count + _ROUNDING:
        low, high = first * edge, (first + count) * edge
        raise ValueError(f"at: the map spans {axis} from {low:.6g} to {high:.6g} m, got {at} m")
    index = math.floor(place + _ROUNDING)
    return map.isel({axis: min(max(index, 0), count - 1)})


def _voxel_of(map: xr.Dataset) -> float:
    """The edge of a map's voxels, metres.

    Raises:
        ValueError: the Dataset is not a map.
    """
    check_map("map", map)
    missing = [name for name in VOXELS if name not in map.coords]
    if "voxel" not in map.attrs or missing:
        raise ValueError(
            'map: expected a Dataset with coordinates x, y and z and the attribute "voxel"'
        )
    return float(map.attrs["voxel"])


def _wrong(counts: np.ndarray) -> np.ndarray:
    """The share of itself by which each voxel is wrong at most."""
    axes = np.zeros(counts.shape, np.int64)
    for axis in range(3):
        before, after = _neighbours(counts, axis)
        axes += (before != counts) | (after != counts)
    beside = np.where(_any_differs(counts), 0.25, 0.0)
    return np.where(axes > 0, 1.0 - 0.5**axes, beside)


def _any_differs(counts: np.ndarray) -> np.ndarray:
    """Where a voxel differs from any of its 26 neighbours."""
    some = every = counts
    for axis in range(3):
        before, after = _neighbours(some, axis)
        some = some | before | after
        before, after = _neighbours(every, axis)
        every = every & before & after
    return some != every


def _neighbours(counts: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """What lies one voxel before and behind; what lies outside of the map does not count."""
    widened = np.pad(counts, [(int(i == axis),) * 2 for i in range(3)])
    size = counts.shape[axis]
    before, after = (np.take(widened, range(at, at + size), axis=axis) for at in (0, 2))
    return before, after
