"""The variables of a capability map: names, axes, types, meanings and units."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

VOXELS = ("x", "y", "z")
POSES = (*VOXELS, "orientation")


class Variable(NamedTuple):
    """One variable of a map."""

    dims: tuple[str, ...]
    dtype: type[np.generic]
    meaning: str
    units: str

    @property
    def of_chunks(self) -> bool:
        """Whether it has one row for each chunk, rather than values for each voxel."""
        return self.dims[0] == "chunk"

    @property
    def fill(self) -> float:
        """What stands where nothing was computed."""
        return float("nan") if issubclass(self.dtype, np.floating) else 0


def _measure(name: str, meaning: str, units: str) -> dict[str, Variable]:
    """The variables of one measure of a pose, over the voxels and over the poses."""

    def over(dims: tuple[str, ...], of: str) -> Variable:
        return Variable(dims, np.float32, f"{meaning}, {of}", units)

    return {
        f"{name}_best": over(VOXELS, "best over the orientations that are reached"),
        f"{name}_mean": over(VOXELS, "mean over the orientations that are reached"),
        f"pose_{name}": over(POSES, "of the best solution within the limits"),
    }


MEASURES = {
    "manipulability": ("manipulability: product of the singular values of the Jacobian", "m^3"),
    "limit_margin": ("distance of the joint nearest to a limit", "rad"),
    "singular_value": ("smallest singular value of the body Jacobian", "1"),
    "position_noise": ("RMS position error for independent joint errors", "m/rad"),
}
"""The measures of a pose: meaning and units."""

VARIABLES: dict[str, Variable] = {
    "reachability_index": Variable(
        VOXELS, np.float32, "share of the orientations that are reached within the limits", "1"
    ),
    "reachability_index_unlimited": Variable(
        VOXELS, np.float32, "share of the orientations that are reached, limits ignored", "1"
    ),
    "colliding_fraction": Variable(
        VOXELS, np.float32, "share of the orientations that only postures that collide reach", "1"
    ),
    "dexterous_fraction": Variable(
        VOXELS, np.float32, "share of the orientations that are reached clear of singularities", "1"
    ),
    "undecided_fraction": Variable(
        VOXELS, np.float32, "share of the orientations whose solutions are not proved complete", "1"
    ),
    "solutions_mean": Variable(
        VOXELS, np.float32, "mean number of solutions of an orientation within the limits", "1"
    ),
    "solutions_mean_unlimited": Variable(
        VOXELS, np.float32, "mean number of solutions of an orientation, limits ignored", "1"
    ),
    "solutions_most": Variable(
        VOXELS, np.uint8, "most solutions of any orientation within the limits", "1"
    ),
    "orientation_reached": Variable(
        ("chunk", "orientation"), np.int32, "voxels reached within the limits", "1"
    ),
    "solution_histogram": Variable(
        ("chunk", "solutions"), np.int64, "poses with so many solutions within the limits", "1"
    ),
    "pose_solutions": Variable(POSES, np.uint8, "solutions within the limits", "1"),
    "pose_solutions_unlimited": Variable(POSES, np.uint8, "solutions, limits ignored", "1"),
    **{
        key: one
        for name, (meaning, units) in MEASURES.items()
        for key, one in _measure(name, meaning, units).items()
    },
}
"""Every variable of a map by name; those over the poses are kept only where asked for."""

_OF_COLLISIONS = frozenset({"colliding_fraction"})


def variables(full: bool, collisions: bool) -> dict[str, Variable]:
    """The variables of a map, with or without those of each pose, and those of collisions."""
    return {
        name: one
        for name, one in VARIABLES.items()
        if (full or one.dims != POSES) and (collisions or name not in _OF_COLLISIONS)
    }
