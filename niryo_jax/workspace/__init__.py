"""Workspace analysis: what an arm can reach, exactly, and where to put it.

Needs the extra `workspace` (xarray, zarr, matplotlib, filelock, rich) where it is used; importing
it needs jax and numpy alone.
"""

from niryo_jax.workspace import plots
from niryo_jax.workspace.capability import Estimate, capability_map, estimate, open_map, resume
from niryo_jax.workspace.compare import compare
from niryo_jax.workspace.description import collisions_of, robot_of
from niryo_jax.workspace.export import from_npz, to_npz, to_ply
from niryo_jax.workspace.extent import extent
from niryo_jax.workspace.forward import forward_map, joint_samples
from niryo_jax.workspace.measures import PoseMeasures, pose_measures
from niryo_jax.workspace.orientations import Orientations, given, orientations
from niryo_jax.workspace.placement import BasePlacements, base_placement
from niryo_jax.workspace.processes import one_of_many
from niryo_jax.workspace.progress import progress_bar
from niryo_jax.workspace.spec import MapSpec
from niryo_jax.workspace.store import StoreError
from niryo_jax.workspace.volume import Volume, reachable_volume, section

__all__ = [
    "BasePlacements",
    "Estimate",
    "MapSpec",
    "Orientations",
    "PoseMeasures",
    "StoreError",
    "Volume",
    "base_placement",
    "capability_map",
    "collisions_of",
    "compare",
    "estimate",
    "extent",
    "forward_map",
    "from_npz",
    "given",
    "joint_samples",
    "one_of_many",
    "open_map",
    "orientations",
    "plots",
    "pose_measures",
    "progress_bar",
    "reachable_volume",
    "resume",
    "robot_of",
    "section",
    "to_npz",
    "to_ply",
]
