"""Joint targets, checked before they are sent, and how long the way to them takes."""

from __future__ import annotations

import math

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from niryo_jax.hardware.errors import ArgumentRejected, TargetRejected
from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS

Vector = NDArray[np.float64]

# System 5 rounds a target to three decimals before it compares it with the limits; system 4
# compares exactly, so that a limit rounded to float32 may lie outside.
LIMIT_MARGIN = 1e-3

# What float32 may leave beyond a limit of pi radians after a few operations; radians.
_ROUNDING = 1e-6

# rad/s, slower than any joint of any Niryo: for a robot that is none of `niryo_jax.robots`.
_UNKNOWN_SPEED = 1.0


class JointTargets:
    """The limits and speeds of one six-joint arm, radians and rad/s.

    Attributes:
        names: of the joints.
        speed: (6,) the largest, rad/s.

    Raises:
        ArgumentRejected: the robot does not have six joints.
    """

    def __init__(self, robot: Robot) -> None:
        self._lower = np.asarray(robot.lower, dtype=np.float64)
        self._upper = np.asarray(robot.upper, dtype=np.float64)
        if self._lower.shape != (6,):
            raise ArgumentRejected(
                f"robot: expected an arm with 6 joints, got {robot.name} with {robot.joints}"
            )
        self.names = robot.joint_names
        model = MODELS.get(robot.name)
        self.speed: Vector = np.array(model.max_velocity) if model else np.full(6, _UNKNOWN_SPEED)

    def check(self, q: ArrayLike) -> Vector:
        """The target (6,) to send for q, at least LIMIT_MARGIN inside the limits.

        A joint at its limit may lie beyond it by what rounding to float32 leaves.

        Raises:
            TargetRejected: not six finite angles inside the limits.
        """
        try:
            target = np.asarray(q, dtype=np.float64)
        except (TypeError, ValueError):
            raise TargetRejected(f"q: expected 6 joint angles in radians, got {q!r}") from None
        if target.shape != (6,):
            raise TargetRejected(
                f"q: expected 6 joint angles in radians, shape (6,), got shape {target.shape}"
            )
        for name, value, lower, upper in zip(
            self.names, target, self._lower, self._upper, strict=True
        ):
            if not math.isfinite(value):
                raise TargetRejected(f"q: {name} is {value}; expected a finite angle in radians")
            if not lower - _ROUNDING <= value <= upper + _ROUNDING:
                raise TargetRejected(
                    f"q: {name} = {value:.7g} rad ({math.degrees(value):.5g} deg) lies outside its "
                    f"limits, {lower:.7g} to {upper:.7g} rad "
                    f"({math.degrees(lower):.5g} to {math.degrees(upper):.5g} deg)"
                )
        return np.clip(target, self._lower + LIMIT_MARGIN, self._upper - LIMIT_MARGIN)

    def travel_times(self, path: Vector) -> Vector:
        """(k - 1,) seconds from each of joints (k, 6) to the next, at the largest speeds."""
        return np.max(np.abs(np.diff(path, axis=0)) / self.speed, axis=1)
