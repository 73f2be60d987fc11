"""A `Robot` from the frames of its joints: what the readers of other descriptions share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.robot import Robot
from niryo_jax.tolerances import ARM_NUMBER


def robot_from_frames(
    frames: Any,
    axes: Any,
    home: Any,
    *,
    prismatic: Sequence[bool] | None,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
    joint_names: Sequence[str] | None,
    name: str,
) -> Robot:
    """Build a robot from the pose of a frame on each joint axis.

    Zeros and ones that the sines and cosines of right angles miss by rounding are restored: every
    solver is faster where the numbers of an arm are exactly that.

    Args:
        frames: (n, 4, 4) pose of each joint's frame in the space frame at q = 0, metres.
        axes: (n, 3) the joint axis in its frame, of any length but zero.
        home: (4, 4) pose of the tool frame at q = 0.
        prismatic, lower, upper, joint_names, name: as in `Robot.from_axes`.

    Raises:
        ValueError: as `Robot.from_axes`.
    """
    xp = np if is_concrete(frames, home) else jnp
    parts: tuple[Any, ...]
    parts = xp.einsum("nij,nj->ni", frames[:, :3, :3], axes), frames[:, :3, 3], home
    return Robot.from_axes(
        *(map(_restored, parts) if xp is np else parts),
        prismatic=prismatic,
        lower=lower,
        upper=upper,
        joint_names=joint_names,
        name=name,
    )


def _restored(numbers: np.ndarray) -> np.ndarray:
    """The numbers, with 0, 1 and -1 where they are that up to rounding."""
    plain = np.clip(np.round(numbers), -1.0, 1.0)
    return np.where(np.abs(numbers - plain) < ARM_NUMBER, plain, numbers) + 0.0
