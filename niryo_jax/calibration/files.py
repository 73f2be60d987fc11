"""Measurements from files: a table with a head that names columns and units."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from niryo_jax.arguments import check_path
from niryo_jax.lie import rpy, se3, so3
from niryo_jax.robot import Robot, check_is_robot

_UNITS = {"rad": 1.0, "deg": np.pi / 180, "m": 1.0, "mm": 1e-3}
_PLACE, _ANGLES, _QUATERNION = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("qw", "qx", "qy", "qz")


class Table(NamedTuple):
    """What a file says: q (N, n), and poses (N, 4, 4), positions (N, 3) or distances (N,)."""

    q: np.ndarray
    measured: np.ndarray


def read_measurements(path: str | os.PathLike[str], robot: Robot) -> Table:
    """Joint values and what was measured there, from a file of comma-separated values.

    The first row names the columns. Those of the joints are called as the joints of the robot are,
    or q1, q2, ..., with a unit behind: `joint_1_deg`, `q2_rad`, `q3_m`. What was measured is
    `x_mm`, `y_mm`, `z_mm` (or `_m`), alone or with `roll_deg`, `pitch_deg`, `yaw_deg` (or `_rad`;
    R = Rz(yaw) Ry(pitch) Rx(roll)) or with the quaternion `qw`, `qx`, `qy`, `qz`; or one
    `distance_mm`.
    Other columns are left alone. Lines that begin with # are left out.

    Raises:
        ValueError: a column that is missing, twice there or without a unit; a row that is too short
            or has no number; named by file and line.
        OSError: a file that cannot be read.
    """
    check_path("path", path)
    check_is_robot(robot)
    lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    kept = [
        (i, line) for i, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    if not kept:
        raise ValueError(f"{path}: expected a row that names the columns, got an empty file")
    head, *rows = ([word.strip() for word in next(csv.reader([line]))] for _, line in kept)
    columns = dict[str, tuple[int, float | None]]()
    for i, word in enumerate(head):
        name, _, unit = word.rpartition("_")
        known = unit in _UNITS and bool(name)
        key = name if known else word
        if key in columns:
            raise ValueError(f"{path}: two columns are called {key}")
        columns[key] = i, _UNITS[unit] if known else None
    numbers = np.array([_numbers(path, *pair, len(head)) for pair in zip(rows, kept[1:])])
    numbers = numbers.reshape(len(rows), len(head))

    def column(*names: str) -> np.ndarray:
        """(N,) the first of these that there is, in radians and metres."""
        name = next((name for name in names if name in columns), None)
        if name is None:
            units = ", ".join(f"_{unit}" for unit in _UNITS)
            raise ValueError(
                f"{path}: expected a column {' or '.join(names)} with its unit ({units}), got "
                + ", ".join(head)
            )
        index, unit = columns[name]
        if unit is None:
            raise ValueError(
                f"{path}: the column {name} has no unit, as in {name}_deg or {name}_mm"
            )
        values = numbers[:, index] * unit
        if not np.all(np.isfinite(values)):
            line = kept[1 + int(np.argmin(np.isfinite(values)))][0]
            raise ValueError(f"{path}, line {line}: {name} is no finite number")
        return values

    joints = [column(name, f"q{i + 1}") for i, name in enumerate(robot.joint_names)]
    q = np.stack(joints, axis=-1)
    if "distance" in columns:
        return Table(q, column("distance"))
    place = np.stack([column(name) for name in _PLACE], axis=-1)
    if all(name in columns for name in _QUATERNION):
        quaternion = numbers[:, [columns[name][0] for name in _QUATERNION]]
        return Table(q, _poses(_rotations(path, quaternion), place))
    if any(name in columns for name in _ANGLES):
        angles = np.stack([column(name) for name in _ANGLES], axis=-1)
        values = np.concatenate([place, angles], axis=-1)
        return Table(q, np.array([rpy.pose_from_rpy(row) for row in values]).reshape(-1, 4, 4))
    return Table(q, place)


def _numbers(
    path: str | os.PathLike[str], row: list[str], where: tuple[int, str], width: int
) -> list[float]:
    if len(row) != width:
        raise ValueError(f"{path}, line {where[0]}: expected {width} columns, got {len(row)}")

    def number(word: str) -> float:
        try:
            return float(word)
        except ValueError:
            return float("nan")

    return [number(word) for word in row]


def _rotations(path: str | os.PathLike[str], quaternion: np.ndarray) -> np.ndarray:
    """(N, 3, 3) of quaternions, the real part first."""
    size = np.linalg.norm(quaternion, axis=1, keepdims=True)
    if not np.all(np.abs(size - 1.0) < 1e-2):
        raise ValueError(f"{path}: qw, qx, qy, qz: expected quaternions of length 1")
    scalar, vector = (quaternion / size)[:, :1], (quaternion / size)[:, 1:]
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, scalar)
    return np.asarray(so3.exp(vector * angle / np.maximum(sine, 1e-300)))


def _poses(rotation: np.ndarray, place: np.ndarray) -> np.ndarray:
    return np.asarray(se3.from_rotation_and_position(rotation, place))
