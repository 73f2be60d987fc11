"""Why a path ends, in words."""

from __future__ import annotations

import math

import numpy as np

from niryo_jax.robot import Robot
from niryo_jax.tolerances import LIMIT_ROUNDING


def beyond_limits(robot: Robot, q: np.ndarray) -> str:
    """Which joint is farthest beyond its limit and by how much; empty where none is."""
    lower, upper = np.asarray(robot.lower), np.asarray(robot.upper)
    excess = np.maximum(lower - q, q - upper)
    joint = int(np.argmax(excess))
    if excess[joint] <= LIMIT_ROUNDING.of(q.dtype):
        return ""
    limit = (lower if q[joint] < lower[joint] else upper)[joint]
    return (
        f"the branch leaves the joint limits: {robot.joint_names[joint]} would be at "
        f"{math.degrees(q[joint]):.4g} deg, {math.degrees(excess[joint]):.3g} deg beyond its limit "
        f"of {math.degrees(limit):.4g} deg."
    )


def too_far(robot: Robot, change: np.ndarray, end: int, largest_step: float) -> str:
    """That the nearest solution at sample `end` is a change (n,) away that is too large."""
    joint = int(np.argmax(np.abs(change)))
    origin = f"sample {end - 1}" if end else "q_start"
    return (
        f"the nearest solution is {np.max(np.abs(change)):.3f} rad from {origin} in "
        f"{robot.joint_names[joint]}, farther than the largest step of {largest_step:.3f} rad."
    )
