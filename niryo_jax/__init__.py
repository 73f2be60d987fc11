"""Batched, differentiable kinematics in JAX for the Niryo One and for open chains in general.

Functions compute in the precision of their arguments, float32 or float64; integers are taken in the
one that JAX is set to, and float16 and bfloat16 are refused. An argument that is none is named.
"""

# Before anything else: from here on Ctrl-C ends a command in a word.
from niryo_jax import interruption as interruption  # isort: split

import importlib
from typing import TYPE_CHECKING, Any

from niryo_jax import motion, robots, subproblems
from niryo_jax._version import __version__
from niryo_jax.chain import forward_kinematics, link_poses
from niryo_jax.differential import joint_rates, tool_velocity
from niryo_jax.ik import (
    CurveEnd,
    IKSolutions,
    IKStatus,
    NewtonResult,
    Singularity,
    SolutionCurves,
    UnreachableReason,
    arm_angle,
    follow,
    inverse_kinematics,
    nearest_reachable,
    newton_raphson,
)
from niryo_jax.jacobian import (
    autodiff_space_jacobian,
    body_jacobian,
    condition_number,
    free_direction,
    manipulability,
    singular_values,
    space_jacobian,
)
from niryo_jax.lie import se3, so3
from niryo_jax.robot import Robot

if TYPE_CHECKING:
    from niryo_jax import calibration, collision, uncertainty, viewer, workspace

__all__ = [
    "CurveEnd",
    "IKSolutions",
    "IKStatus",
    "NewtonResult",
    "Robot",
    "Singularity",
    "SolutionCurves",
    "UnreachableReason",
    "__version__",
    "arm_angle",
    "autodiff_space_jacobian",
    "body_jacobian",
    "calibration",
    "collision",
    "condition_number",
    "follow",
    "forward_kinematics",
    "free_direction",
    "inverse_kinematics",
    "joint_rates",
    "link_poses",
    "manipulability",
    "motion",
    "nearest_reachable",
    "newton_raphson",
    "robots",
    "se3",
    "singular_values",
    "so3",
    "space_jacobian",
    "subproblems",
    "tool_velocity",
    "uncertainty",
    "viewer",
    "workspace",
]

_LATER = ("calibration", "collision", "uncertainty", "viewer", "workspace")
"""Packages imported where they are first used: a third of all the modules that there are."""


def __getattr__(name: str) -> Any:
    """The packages of `_LATER`."""
    if name in _LATER:
        return importlib.import_module(f"niryo_jax.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
