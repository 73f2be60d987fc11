"""Positions as requests have them: lists of numbers on system 4, dictionaries too on system 5."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from niryo_jax.hardware.simulated import planning
from niryo_jax.hardware.simulated.answers import ParameterRefused, RobotRefused, numbers, of_type
from niryo_jax.hardware.simulated.arm import Vector
from niryo_jax.lie.rpy import pose_from_rpy

POSE_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")

POSE_METADATA = {"version": 1, "frame": "", "length_unit": "METERS"}
"""What system 5 says of poses whose angles are those of system 4."""


def pose_in_frame(params: Sequence[Any]) -> Vector:
    """A pose (4, 4) from x, y, z, roll, pitch, yaw and the name of a frame, which must be empty."""
    *values, frame = params
    pose = pose_from_rpy(numbers(values))
    if frame:
        raise RobotRefused(f"Frame {str(frame)[:80]} does not exist")
    return pose


def joints_of(position: Any) -> list[float] | None:
    """The joints of a position of system 5, radians; None where it is a pose."""
    fields = _fields(position)
    if fields.get("obj_type") == "POSE" or "x" in fields:
        return None
    return numbers([value for key, value in fields.items() if re.fullmatch(r"joint_\d", str(key))])


def pose_of(position: Any) -> Vector:
    """The pose (4, 4) of a position of system 5 that is one."""
    fields = _fields(position)
    return pose_from_rpy(numbers([fields[key] for key in POSE_KEYS]))


def _fields(position: Any) -> Mapping[str, Any]:
    if not isinstance(position, Mapping):
        raise RobotRefused(f"{type(position).__name__!r} object has no attribute 'pop'")
    return position


def waypoint(values: Any) -> Vector:
    """A pose (4, 4) from x, y, z and roll, pitch, yaw or a quaternion."""
    row = _checked_row(values)
    if len(row) == 6:
        return pose_from_rpy(row)
    pose = pose_from_rpy([*row[:3], 0.0, 0.0, 0.0])
    pose[:3, :3] = planning.rotation(row[3:])
    return pose


def _checked_row(values: Any) -> list[float]:
    row = of_type(values, list)
    if len(row) not in (6, 7):
        raise ParameterRefused(f"7 or 6 parameters expected, given: {len(row)}")
    return numbers(row)


def six(values: Sequence[Any]) -> list[float]:
    """Six finite numbers."""
    if len(values) != 6:
        raise RobotRefused(f"Joint array must have 6 joints, got {len(values)}")
    return numbers(values)
