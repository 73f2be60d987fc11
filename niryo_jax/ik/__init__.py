"""Inverse kinematics: solvers and their one result type."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from jax.typing import ArrayLike

from niryo_jax.ik.complete import solve_complete
from niryo_jax.ik.continuation import nominal, solve_by_continuation
from niryo_jax.ik.follow import JointPath, follow
from niryo_jax.ik.multistart import solve_multistart
from niryo_jax.ik.newton import NewtonResult, newton_raphson
from niryo_jax.ik.reachable import nearest_reachable
from niryo_jax.ik.seeded import BranchStatus, SeededBranches, seeded_branches, solve_seeded
from niryo_jax.ik.solutions import IKSolutions, IKStatus, Obstacle, Singularity, wrap_into_limits
from niryo_jax.robot import Robot

Method = Literal["complete", "continuation", "multistart", "seeded"]


def inverse_kinematics(robot: Robot, pose: ArrayLike, method: Method | None = None) -> IKSolutions:
    """All joint vectors that bring the tool to a pose, for a batch of poses.

    Args:
        robot: the arm. A traced robot keeps the structure of the concrete one it was made from.
        pose: (..., 4, 4) targets in the space frame, metres. Poses that are slightly off SE(3),
            as printed ones are, are projected to it and the distance is reported.
        method: how to solve.
            "complete": every real solution, or a proof that there is none, for six revolute joints
            of which axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet; in closed form where
            the wrist is spherical (docs/theory/complete-ik.md).
            "continuation": for arms that are nearly of that kind (calibrated ones): the complete
            sets of the nearest such arm, refined by Newton-Raphson on the true one.
            "multistart": Newton-Raphson from 64 guesses, for any open chain.
            "seeded": Paden-Kahan guesses refined by Newton-Raphson, for the same arms (Todorovic
            et al. 2024, algorithm 2): about 95 % of all solutions.
            Where not given, the first of these four that fits the arm. `complete` of the answer
            is False except for the first.

    Returns:
        `IKSolutions` with 16 slots. Nothing is raised for a pose that cannot be solved:
        `status` says why, so that good and bad poses can be mixed in one batch. Derivatives of q
        with respect to the pose are those of the implicit function theorem, of any order, in
        forward and reverse mode; by the complete method also those with respect to the geometry.

    Raises:
        ValueError: a wrong shape, an unknown method, an arm that the method does not fit.
        TypeError: a traced robot, for a method that needs a concrete one.
    """
    if method is None:
        method = _method_for(robot)
    if method not in _SOLVERS:
        raise ValueError(f"method: expected one of {', '.join(_SOLVERS)}, got {method!r}")
    return _SOLVERS[method](robot, pose)


_SOLVERS: dict[Method, Callable[[Robot, ArrayLike], IKSolutions]] = {
    "complete": solve_complete,
    "continuation": solve_by_continuation,
    "multistart": solve_multistart,
    "seeded": solve_seeded,
}


def _method_for(robot: Robot) -> Method:
    if not isinstance(robot, Robot):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"robot: expected a niryo_jax.Robot, got {type(robot).__name__}")
    if robot.offset_wrist is not None:
        return "complete"
    return "multistart" if nominal(robot) is None else "continuation"


__all__ = [
    "BranchStatus",
    "IKSolutions",
    "IKStatus",
    "JointPath",
    "NewtonResult",
    "Obstacle",
    "SeededBranches",
    "Singularity",
    "follow",
    "inverse_kinematics",
    "nearest_reachable",
    "newton_raphson",
    "seeded_branches",
    "wrap_into_limits",
]
