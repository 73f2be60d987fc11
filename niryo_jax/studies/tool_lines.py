"""Joints along straight lines of the tool."""

from __future__ import annotations

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from niryo_jax.chain import forward_kinematics
from niryo_jax.execution.padding import filled_up
from niryo_jax.ik import follow
from niryo_jax.motion import cartesian_trajectory
from niryo_jax.robot import Robot

Vector = NDArray[np.float64]

_AT_ONCE = 512
"""Poses are followed in multiples of so many, the last repeated, so that programs are few."""

_LEGS = 32
"""So are lines between stops."""


def followed(robot: Robot, poses: ArrayLike, start: Vector) -> tuple[Vector, str]:
    """Joints (k, n) along poses (k, 4, 4) on the branch of joints `start` (n,), and why they end
    on the way; an empty word where they do not."""
    given = np.asarray(poses)
    count = len(given)
    path = follow(robot, filled_up(given, _AT_ONCE), start)
    return np.array(path.q, np.float64)[:count], "" if np.all(path.ok) else path.message


def between_stops(robot: Robot, stops: Vector, count: int) -> Vector:
    """Poses (count (w - 1) + 1, 4, 4) on straight lines between joints (w, n), each line in so many
    equal parts."""
    poses = [np.asarray(forward_kinematics(robot, stops[0]))[None]]
    for first in range(0, len(stops) - 1, _LEGS):
        part = stops[first : first + _LEGS + 1]
        corners = forward_kinematics(robot, filled_up(part, _LEGS + 1))
        lines = cartesian_trajectory(corners[:-1], corners[1:], 1.0, count + 1, lambda u: u).pose
        poses.append(np.asarray(lines)[: len(part) - 1, 1:].reshape(-1, 4, 4))
    return np.concatenate(poses)
