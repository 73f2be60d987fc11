"""Target poses as a person writes them: numbers, a matrix, or a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import typer
from numpy.typing import NDArray

from niryo_jax.cli.options import finite, in_radians, numbers
from niryo_jax.cli.streams import read_stdin
from niryo_jax.lie.rpy import pose_from_rpy

Vector = NDArray[np.float64]


def read_pose(
    position: list[str] | None,
    rpy: tuple[str, str, str] | None,
    matrix: str | None,
    file: Path | None,
    *,
    degrees: bool,
    millimetres: bool,
    only_position: bool = False,
) -> Vector:
    """The (4, 4) pose that the arguments of `ik` describe, in metres.

    Where only the position is asked for, the angles may be missing.

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
    elif not position or (rpy is None and not only_position):
        raise typer.BadParameter("X Y Z --rpy R P Y: expected three lengths and three angles")
    else:
        place = finite("X Y Z", numbers(" ".join(position)), 3, "lengths")
        turn = finite("--rpy R P Y", numbers(" ".join(rpy or "000")), 3, "angles")
        pose = pose_from_rpy([*place, *in_radians(turn, degrees)])
    if millimetres:
        pose[:3, 3] /= 1e3
    return pose


def _parse_matrix(text: str) -> Vector:
    entries = numbers(text)
    if len(entries) == 12:
        entries += [0, 0, 0, 1]
    if len(entries) != 16:
        raise typer.BadParameter(
            "--matrix: expected 16 numbers row by row, or 12 without the last row, "
            f"got {len(entries)}"
        )
    return np.array(entries).reshape(4, 4)


def _load(file: Path) -> Vector:
    """The matrix of a file; of JSON on standard input where that is -."""
    try:
        if file.suffix == ".npy":
            with file.open("rb") as stream:
                array = np.lib.format.read_array(stream, allow_pickle=False)
            pose = np.array(array, dtype=np.float64)
        else:
            text = read_stdin() if str(file) == "-" else file.read_text(encoding="utf-8")
            pose = np.array(json.loads(text), dtype=np.float64)
    except (OSError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise typer.BadParameter(
            f"--pose-file: {file} cannot be read as a 4 x 4 matrix in JSON or .npy: {error}"
        ) from error
    if pose.shape != (4, 4):
        raise typer.BadParameter(f"--pose-file: expected shape (4, 4), got {pose.shape} in {file}")
    return pose
