"""Inverse kinematics: solvers and their one result type."""

from niryo_jax.ik.closed_form.srs import arm_angle
from niryo_jax.ik.dispatch import Method, inverse_kinematics, method_for
from niryo_jax.ik.methods.seeded import BranchStatus, SeededBranches, seeded_branches
from niryo_jax.ik.newton.newton_raphson import NewtonResult, newton_raphson
from niryo_jax.ik.paths.follow import JointPath, follow
from niryo_jax.ik.paths.nearest_reachable import nearest_reachable
from niryo_jax.ik.results.curves import CurveEnd, SolutionCurves
from niryo_jax.ik.results.limits import wrap_into_limits
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import IKStatus, Singularity, UnreachableReason

__all__ = [
    "BranchStatus",
    "CurveEnd",
    "IKSolutions",
    "IKStatus",
    "JointPath",
    "Method",
    "NewtonResult",
    "SeededBranches",
    "Singularity",
    "SolutionCurves",
    "UnreachableReason",
    "arm_angle",
    "follow",
    "inverse_kinematics",
    "method_for",
    "nearest_reachable",
    "newton_raphson",
    "seeded_branches",
    "wrap_into_limits",
]
