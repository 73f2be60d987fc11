"""Joints for poses, by complete inverse kinematics: where the arm can get, it gets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware.simulated.arm import SimulatedArm
from niryo_jax.ik import inverse_kinematics
from niryo_jax.lie import so3

Vector = NDArray[np.float64]

# Poses solved at once, so that a single program serves a pose and a line.
_BATCH = 16

# How far the arm may leave a line half-way between two of the poses on it: metres, and entries of
# the rotation.
_OFF, _TURNED = 5e-3, 0.05


def joints_for(arm: SimulatedArm, pose: Vector, near: Vector) -> Vector | None:
    """Joints (6,) inside the limits for a pose (4, 4) of the tool frame, nearest to `near` (6,)."""
    path = _chain(arm, np.repeat(pose[None], _BATCH, axis=0), near)
    return None if path is None else path[-1]


def along_line(arm: SimulatedArm, start: Vector, pose: Vector) -> Vector | None:
    """Joints (16, 6) from `start` (6,) straight to a pose (4, 4); None where the line breaks."""
    begin = arm.pose_at(start)
    turn = np.asarray(so3.log(begin[:3, :3].T @ pose[:3, :3]), dtype=np.float64)
    shares = np.arange(1, _BATCH + 1)[:, None] / _BATCH
    poses = np.tile(np.eye(4), (_BATCH, 1, 1))
    poses[:, :3, :3] = begin[:3, :3] @ np.asarray(so3.exp(shares * turn), dtype=np.float64)
    poses[:, :3, 3] = begin[:3, 3] + shares * (pose[:3, 3] - begin[:3, 3])
    path = _chain(arm, poses, start)
    if path is None:
        return None
    # Where two neighbours belong to different postures, half-way between them is far from the line.
    before = np.concatenate([begin[None], poses[:-1]])
    halfway = arm.pose_at((np.concatenate([start[None], path[:-1]]) + path) / 2)
    off = np.abs(halfway - (before + poses) / 2)
    return path if np.max(off[:, :3, 3]) < _OFF and np.max(off[:, :3, :3]) < _TURNED else None


def outside_box(arm: SimulatedArm, pose: Vector) -> str | None:
    """Which coordinate of a pose (4, 4) the robot does not accept, in its words."""
    for name, value, (low, high) in zip("xyz", pose[:3, 3], arm.model.position_bounds, strict=True):
        if not low <= value <= high:
            return f"{name} not in range ( {low} , {high} )"
    return None


def quaternion(pose: Vector) -> list[float]:
    """(x, y, z, w) of the rotation of a pose (4, 4)."""
    turn = np.asarray(so3.log(pose[:3, :3]), dtype=np.float64)
    half = np.linalg.norm(turn) / 2
    return [*(np.sinc(half / np.pi) / 2 * turn).tolist(), float(np.cos(half))]


def rotation(values: Sequence[float]) -> Vector:
    """(3, 3) rotation of a quaternion (x, y, z, w) of any length but zero."""
    w, axis = values[3], np.asarray(values[:3], dtype=np.float64)
    length = np.linalg.norm(axis)
    angle = 2 * np.arctan2(length, w)
    turn = axis * (angle / length) if length > 0 else np.zeros(3)
    return np.asarray(so3.exp(turn), dtype=np.float64)


def _chain(arm: SimulatedArm, poses: Vector, start: Vector) -> Vector | None:
    """For each pose the joints nearest to those before; None where one is missing."""
    solutions = inverse_kinematics(arm.robot, poses)
    path: list[Vector] = []
    near = start
    for index in range(len(poses)):
        q, ok = solutions.nearest(np.broadcast_to(near, (len(poses), 6)))
        if not ok[index]:
            return None
        near = np.clip(np.asarray(q[index], dtype=np.float64), arm.lower, arm.upper)
        path.append(near)
    return np.array(path)
