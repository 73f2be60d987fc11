"""How fast joints and the tool may move, as data with a named source."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.arguments import Array, as_data, check_choice, check_number, check_positive, is_known
from niryo_jax.collision.tree import Record
from niryo_jax.robots.niryo import MODELS

_NAMES = "velocity", "acceleration", "jerk"

JERK_PER_ACCELERATION = 10.0
"""Niryo publishes no jerk: ours, the full acceleration within a tenth of a second."""


@jax.tree_util.register_pytree_with_keys_class
@dataclasses.dataclass(frozen=True, eq=False)
class MotionLimits(Record):
    """The most that each joint may do, in both directions.

    Attributes:
        velocity: (n,) rad/s (m/s for prismatic joints).
        acceleration: (n,) rad/s^2.
        jerk: (n,) rad/s^3, or None where it is not bounded.

    The arrays are pytree leaves; what is known of them is checked.
    """

    velocity: Array
    acceleration: Array
    jerk: Array | None = None

    def __post_init__(self) -> None:
        """Check what is known.

        Raises:
            ValueError: wrong shapes, numbers that are not positive and finite.
            TypeError: no arrays of real numbers.
        """
        for name in _NAMES:
            value: Any = getattr(self, name)
            if name == "jerk" and value is None:
                continue
            array = as_data(name, value)
            expected = (self.joints,) if name != "velocity" else array.shape[:1]
            if array.ndim != 1 or array.shape != expected:
                shape = "(n,)" if name == "velocity" else f"{expected}, as the velocity"
                raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
            _check_positive(name, array)
            object.__setattr__(self, name, array)

    @property
    def joints(self) -> int:
        """n."""
        return self.velocity.shape[0]

    def scaled(
        self, velocity: float = 1.0, acceleration: float = 1.0, jerk: float = 1.0
    ) -> MotionLimits:
        """Shares of the limits: `scaled(0.3)` is what a Niryo's arm velocity of 30 % asks for.

        Raises:
            ValueError: a share that is not positive and finite.
            TypeError: no numbers.
        """
        shares = (velocity, acceleration, jerk)
        for name, share in zip(_NAMES, shares):
            check_positive(name, share)
        values = (getattr(self, name) for name in _NAMES)
        return MotionLimits(
            *(None if value is None else value * share for value, share in zip(values, shares))  # pyright: ignore[reportArgumentType]
        )


@jax.tree_util.register_pytree_with_keys_class
@dataclasses.dataclass(frozen=True, eq=False)
class CartesianLimits(Record):
    """The fastest that the tool may move.

    Attributes:
        linear: m/s of the origin of the tool frame; infinite where it is not bounded.
        angular: rad/s of the tool; infinite where it is not bounded.
    """

    linear: Any = math.inf
    angular: Any = math.inf

    def __post_init__(self) -> None:
        """Check what is known.

        Raises:
            ValueError: numbers that are not positive.
            TypeError: no numbers.
        """
        for name in ("linear", "angular"):
            value = getattr(self, name)
            if is_known(value) or not isinstance(value, jax.Array):
                check_number(name, value, "a positive number", lambda given: given > 0)


def niryo_limits(name: str = "niryo_one") -> MotionLimits:
    """The limits of the joints of a Niryo arm.

    Velocity and acceleration are those of the robot's own planner (joint_limits.yaml of MoveIt's
    configuration, `robots.NiryoModel.source`). No jerk is published: ours is
    `JERK_PER_ACCELERATION` times the acceleration. The URDF that the real Niryo One loads says
    1 rad/s of every joint, which its planner does not use.

    Args:
        name: "niryo_one", "niryo_ned" or "niryo_ned2".

    Raises:
        ValueError: another name.
    """
    check_choice("name", name, tuple(MODELS))
    model = MODELS[name]
    acceleration = np.array(model.max_acceleration)
    return MotionLimits(
        np.array(model.max_velocity), acceleration, JERK_PER_ACCELERATION * acceleration
    )


def check_limits_of(limits: object, joints: int) -> MotionLimits:
    """Limits of so many joints.

    Raises:
        TypeError: no `MotionLimits`.
        ValueError: those of an arm with another number of joints.
    """
    if not isinstance(limits, MotionLimits):
        raise TypeError(f"limits: expected MotionLimits, got {type(limits).__name__}")
    if limits.joints != joints:
        raise ValueError(f"limits: expected those of {joints} joints, got {limits.joints}")
    return limits


def as_arrays(limits: MotionLimits, dtype: Any) -> MotionLimits:
    """The same in the type that is computed with."""
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), limits)


def _check_positive(name: str, array: Any) -> None:
    if is_known(array):
        numbers = np.asarray(array)
        if not np.all((numbers > 0) & np.isfinite(numbers)):
            raise ValueError(f"{name}: expected positive, finite numbers, got {array}")
