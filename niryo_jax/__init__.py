"""Batched, differentiable kinematics in JAX for the Niryo One and for open chains in general."""

from niryo_jax import robots, subproblems
from niryo_jax.chain import forward_kinematics, link_poses
from niryo_jax.ik import (
    IKSolutions,
    IKStatus,
    NewtonResult,
    inverse_kinematics,
    newton_raphson,
)
from niryo_jax.jacobian import (
    autodiff_space_jacobian,
    body_jacobian,
    condition_number,
    manipulability,
    singular_values,
    space_jacobian,
)
from niryo_jax.lie import se3, so3
from niryo_jax.robot import Robot

__all__ = [
    "IKSolutions",
    "IKStatus",
    "NewtonResult",
    "Robot",
    "autodiff_space_jacobian",
    "body_jacobian",
    "condition_number",
    "forward_kinematics",
    "inverse_kinematics",
    "link_poses",
    "manipulability",
    "newton_raphson",
    "robots",
    "se3",
    "singular_values",
    "so3",
    "space_jacobian",
    "subproblems",
]
