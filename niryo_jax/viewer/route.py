"""Straight ways of the tool from waypoint to waypoint, and which branches can do them."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from numpy.typing import NDArray

from niryo_jax.ik import IKSolutions, inverse_kinematics
from niryo_jax.motion import best_path, cartesian_trajectory
from niryo_jax.robot import Robot
from niryo_jax.viewer.colours import PATH, Colour, of_branch
from niryo_jax.viewer.session import Vector
from niryo_jax.viewer.shape import Shape

SAMPLES = 41
"""Of each straight way, its ends included."""

_APART = 0.012
"""Between the lines of two branches, as a share of the reach."""


@dataclasses.dataclass(frozen=True)
class Line:
    """A line of one colour, in pieces.

    Attributes:
        pieces: (m, 2, 3) metres.
        colour: of all of them.
    """

    pieces: NDArray[np.float32]
    colour: Colour


@dataclasses.dataclass(frozen=True)
class Route:
    """A path, and what became of it.

    Attributes:
        q: (k, n) joint vectors; those that are not `reached` are the last one that is.
        reached: how many of the k samples are.
        path: the way of the tool, as far as it goes.
        branches: for each branch a line above the way, wherever a solution of it is within the
            limits.
        message: in words.
    """

    q: Vector
    reached: int
    path: Line
    branches: tuple[Line, ...]
    message: str


def plan(robot: Robot, shape: Shape, waypoints: NDArray[np.float64], q_start: Vector) -> Route:
    """The cheapest way through waypoints (w, 4, 4), w >= 2, from joints (n,).

    Where the shape has a collision model, joint vectors that touch anything are not taken.

    Raises:
        ValueError: fewer waypoints, or an arm of which not all solutions are known.
    """
    poses = straight(waypoints)
    found = best_path(robot, poses, q_start=q_start, collision=shape.model, world=shape.world)
    solutions: IKSolutions = jax.device_get(inverse_kinematics(robot, poses))
    reached = int(found.reached)
    position = poses[:, :3, 3]
    return Route(
        np.asarray(found.q, np.float64),
        reached,
        Line(_pieces(position, np.arange(len(position)) < reached), PATH),
        branch_lines(solutions, position, _APART * shape.reach),
        found.message,
    )


def straight(waypoints: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 4, 4) poses on straight ways between waypoints (w, 4, 4)."""
    if len(waypoints) < 2:
        raise ValueError(f"waypoints: expected two or more, got {len(waypoints)}")
    even = np.linspace(0.0, 1.0, SAMPLES)
    ways = cartesian_trajectory(waypoints[:-1], waypoints[1:], 1.0, SAMPLES, even).pose
    parts = np.asarray(ways, np.float64)
    return np.concatenate([parts[0], *parts[1:, 1:]])


def branch_lines(
    solutions: IKSolutions, position: NDArray[np.float64], apart: float
) -> tuple[Line, ...]:
    """A line for each branch, wherever it has a solution within the limits.

    Args:
        solutions: of k poses, as numpy.
        position: (k, 3) of the tool.
        apart: metres from the path to the first line, and from line to line, upward.
    """
    within, label = np.asarray(solutions.within_limits), np.asarray(solutions.label)
    branches = np.unique(label[within & (label >= 0)])
    lines = list[Line]()
    for row, branch in enumerate(branches, start=1):
        there = np.any(within & (label == branch), axis=1)
        raised = position + np.array([0.0, 0.0, row * apart])
        lines.append(Line(_pieces(raised, there), of_branch(int(branch))))
    return tuple(lines)


def _pieces(position: NDArray[np.float64], there: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(m, 2, 3) from each sample to the next where both are there."""
    both = there[:-1] & there[1:]
    return np.stack([position[:-1][both], position[1:][both]], axis=1).astype(np.float32)
