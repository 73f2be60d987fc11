"""What is looked at of a path of joint vectors before it is timed."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_finite
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.motion.best_path import BestPath
from niryo_jax.motion.limits import CartesianLimits
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.tolerances import LIMIT_ROUNDING, PATH_LIMITS


def as_samples(path: ArrayLike | BestPath) -> jax.Array:
    """Joint vectors (..., k, n).

    Raises:
        ValueError: a wrong shape, no samples, numbers that are not finite, a path that is not done.
        TypeError: no numbers.
    """
    if isinstance(path, BestPath):
        if not np.all(path.ok):
            raise ValueError(f"path: expected one that is done, got: {path.message}")
        path = path.q
    q = as_floating("path", path)
    check_shape("path", q, (-1, -1))
    if not q.shape[-2]:
        raise ValueError(f"path: expected one sample or more, got shape {q.shape}")
    check_finite("path", q)
    return q


def check_arm(robot: Robot | None, cartesian: Any, joints: int) -> None:
    """Raise an error unless both are None, or an arm of so many joints and limits of its tool."""
    if robot is not None:
        check_is_robot(robot)
        if robot.joints != joints:
            raise ValueError(f"path: expected {robot.joints} joints, got {joints}")
    if not isinstance(cartesian, CartesianLimits | None):
        raise TypeError(f"cartesian: expected CartesianLimits, got {type(cartesian).__name__}")
    if cartesian is not None and robot is None:
        raise ValueError("cartesian: expected a robot as well, whose tool is bounded")


def check_samples(robot: Robot, q: jax.Array) -> None:
    """Raise a ValueError that names the first sample beyond the limits of a joint."""
    first = _first_beyond(robot, q, LIMIT_ROUNDING.of(q.dtype))
    if first is not None:
        *path, sample, joint = first
        words = _words(robot, joint, q[first], tuple(path))
        raise ValueError(f"path: sample {sample}{words}")


def check_between(
    robot: Robot, q: jax.Array, s: jax.Array, fine: jax.Array, before: int, batch: tuple[int, ...]
) -> None:
    """The same of paths (paths, ...) through the samples, at shares s of their length.

    They come after so many `before` of all of the batch.
    """
    first = _first_beyond(robot, fine, PATH_LIMITS.of(q.dtype))
    if first is not None:
        path, place, joint = first
        chords = np.linalg.norm(np.diff(np.asarray(q[path]), axis=0), axis=-1)
        sample = int(np.searchsorted(np.cumsum(chords) / np.sum(chords), float(s[path, place])))
        which = tuple(map(int, np.unravel_index(before + path, batch))) if batch else ()
        words = _words(robot, joint, fine[first], which)
        raise ValueError(
            f"path: the spline between samples {sample} and {sample + 1}{words}; samples that are "
            "closer keep it nearer to them"
        )


def _first_beyond(robot: Robot, q: jax.Array, tolerance: float) -> tuple[int, ...] | None:
    if not is_concrete(q, robot.lower, robot.upper):
        return None
    numbers, lower, upper = (np.asarray(x) for x in (q, robot.lower, robot.upper))
    # Not a number is refused by itself.
    beyond = np.argwhere((numbers < lower - tolerance) | (numbers > upper + tolerance))
    return tuple(beyond[0].tolist()) if len(beyond) else None


def _words(robot: Robot, joint: int, value: jax.Array, path: tuple[int, ...]) -> str:
    of = f" of path {path}" if path else ""
    low, high = (float(np.asarray(x)[joint]) for x in (robot.lower, robot.upper))
    return (
        f"{of} leaves the limits of {robot.joint_names[joint]}, {low:.4f} to {high:.4f}: "
        f"{float(value):.4f}"
    )
