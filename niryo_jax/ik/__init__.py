"""Inverse kinematics: solvers and their one result type."""

from __future__ import annotations

from typing import Literal

from jax.typing import ArrayLike

from niryo_jax.ik.newton import NewtonResult, newton_raphson
from niryo_jax.ik.seeded import SeededBranches, seeded_branches, solve_seeded
from niryo_jax.ik.solutions import BranchStatus, IKSolutions, IKStatus, wrap_into_limits
from niryo_jax.robot import Robot

Method = Literal["seeded"]


def inverse_kinematics(robot: Robot, pose: ArrayLike, method: Method = "seeded") -> IKSolutions:
    """All joint vectors found that bring the tool to a pose, for a batch of poses.

    Args:
        robot: a concrete arm.
        pose: (..., 4, 4) targets in the space frame, metres. Poses that are slightly off SE(3),
            as printed ones are, are projected to it and the distance is reported.
        method: "seeded": Paden-Kahan guesses refined by Newton-Raphson, for the Niryo family
            (Todorovic et al. 2024, algorithm 2). It finds about 95 % of all solutions and cannot
            prove that there is none, except beyond the arm's reach.

    Returns:
        `IKSolutions` with 16 slots. Nothing is raised for a pose that cannot be solved:
        `status` says why, so that good and bad poses can be mixed in one batch.

    Raises:
        ValueError: a wrong shape, an unknown method, an arm that the method does not fit.
        TypeError: a traced robot.
    """
    if method != "seeded":  # pyright: ignore[reportUnnecessaryComparison]
        raise ValueError(f"method: expected 'seeded', got {method!r}")
    return solve_seeded(robot, pose)


__all__ = [
    "BranchStatus",
    "IKSolutions",
    "IKStatus",
    "NewtonResult",
    "SeededBranches",
    "inverse_kinematics",
    "newton_raphson",
    "seeded_branches",
    "wrap_into_limits",
]
