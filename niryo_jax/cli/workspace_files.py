"""What `niryo-jax workspace` reads and writes, and how it says that it cannot."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from niryo_jax import interruption
from niryo_jax import workspace as ws
from niryo_jax.cli.outcome import ExitCode, Failure
from niryo_jax.workspace.orientations import rotations_of

if TYPE_CHECKING:
    import xarray as xr


@contextlib.contextmanager
def refusals() -> Generator[None]:
    """What the library refuses, and what is not installed, as failures of the command."""
    try:
        yield
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    except MemoryError as error:
        raise Failure(f"this needs more memory than there is: {error}", ExitCode.USAGE) from error
    except ValueError as error:
        raise Failure(str(error), ExitCode.USAGE) from error
    except OSError as error:
        raise Failure(str(error), ExitCode.STORE) from error


@contextlib.contextmanager
def resumable() -> Generator[None]:
    """Say of a map that is interrupted how it goes on."""
    interruption.raise_again()
    try:
        yield
    except KeyboardInterrupt:
        raise Failure(
            "interrupted; the map can be resumed: the same command goes on where this one ended",
            ExitCode.INTERRUPTED,
        ) from None


@contextlib.contextmanager
def written(path: Path) -> Generator[None]:
    """A file that cannot be written, as a wrong argument."""
    try:
        yield
    except OSError as error:
        raise Failure(f"cannot write {path}: {error.strerror or error}", ExitCode.USAGE) from error


def whole_map(store: Path) -> xr.Dataset:
    """A map that is finished."""
    found = ws.open_map(store, partial=True)
    if missing := found.attrs.get("chunks_missing"):
        raise Failure(
            f"{store}: {missing} of {found.sizes['chunk']} chunks are not computed yet; "
            f"`niryo-jax workspace resume {store}` goes on",
            ExitCode.STORE,
        )
    return found


def file_name(robot: str) -> str:
    """A robot's name, which a URDF file chooses freely, as that of a file in this directory."""
    return re.sub(r"[^\w-]+", "_", robot) or "robot"


def task_poses(path: Path) -> np.ndarray:
    """(t, 4, 4) poses of a file."""
    try:
        if path.suffix == ".npy":
            with path.open("rb") as file:
                array = np.lib.format.read_array(file, allow_pickle=False)
            return np.asarray(array, np.float64)
        text = path.read_text(encoding="utf-8")
        lines = [line.split() for line in (raw.split("#")[0] for raw in text.splitlines())]
        rows = [[float(word) for word in words] for words in lines if words]
    except (ValueError, TypeError, OSError) as error:
        raise Failure(f"TASKS: cannot read {path}: {error}", ExitCode.USAGE) from error
    wrong = [len(row) for row in rows if len(row) != 7]
    if wrong or not rows:
        raise Failure(
            f"TASKS: expected lines of seven numbers (x y z, quaternion w x y z) in {path}, got "
            f"{f'one of {wrong[0]}' if wrong else 'none'}",
            ExitCode.USAGE,
        )
    numbers = np.array(rows)
    lengths = np.linalg.norm(numbers[:, 3:], axis=1, keepdims=True)
    if not np.all(np.isfinite(numbers)) or not np.all((lengths > 0) & (lengths < np.inf)):
        raise Failure(
            f"TASKS: expected finite numbers and quaternions other than zero in {path}",
            ExitCode.USAGE,
        )
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3] = numbers[:, :3]
    poses[:, :3, :3] = rotations_of(numbers[:, 3:] / lengths)
    return poses
