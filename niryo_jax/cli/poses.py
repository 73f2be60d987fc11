"""Target poses as a person writes them: numbers, a matrix, or a file."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import typer
from numpy.typing import NDArray

from niryo_jax.cli.options import in_radians
from niryo_jax.lie.rpy import pose_from_rpy

Vector = NDArray[np.float64]


def read_pose(
    position: list[float] | None,
    rpy: tuple[float, float, float] | None,
    matrix: str | None,
    file: Path | None,
    *,
    degrees: bool,
    millimetres: bool,
) -> Vector:
    """The (4, 4) pose that the arguments of `ik` describe, in metres.

    Raises:
        typer.BadParameter: none or several descriptions, or one that cannot be read.
    """
    given = [bool(position) or rpy is not None, matrix is not None, file is not None]
    if sum(given) != 1:
        raise typer.BadParameter(
            "give the pose in one way: X Y Z --rpy R P Y, or --matrix, or --pose-file"
        )
    if matrix is not None:
        pose = _parse_matrix(matrix)
    elif file is not None:
        pose = _load(file)
    elif position is None or len(position) != 3 or rpy is None:
        raise typer.BadParameter("X Y Z --rpy R P Y: expected three lengths and three angles")
    else:
        pose = pose_from_rpy([*position, *in_radians(rpy, degrees)])
    if millimetres:
        pose[:3, 3] /= 1e3
    return pose


def _parse_matrix(text: str) -> Vector:
    words = [word for word in re.split(r"[\s,;\[\]]+", text) if word]
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError as error:
        raise typer.BadParameter(f"--matrix: {error}") from error
    if numbers.size == 12:
        numbers = np.concatenate([numbers, [0, 0, 0, 1]])
    if numbers.size != 16:
        raise typer.BadParameter(
            "--matrix: expected 16 numbers row by row, or 12 without the last row, "
            f"got {len(words)}"
        )
    return numbers.reshape(4, 4)


def _load(file: Path) -> Vector:
    try:
        if file.suffix == ".npy":
            pose = np.array(np.load(file, allow_pickle=False), dtype=np.float64)
        else:
            pose = np.array(json.loads(file.read_text(encoding="utf-8")), dtype=np.float64)
    except (OSError, ValueError, TypeError) as error:
        raise typer.BadParameter(
            f"--pose-file: {file} cannot be read as a 4 x 4 matrix in JSON or .npy: {error}"
        ) from error
    if pose.shape != (4, 4):
        raise typer.BadParameter(f"--pose-file: expected shape (4, 4), got {pose.shape} in {file}")
    return pose
