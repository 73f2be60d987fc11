"""What a calibration needs of an arm: joint values, and what an instrument sees there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Moving(Protocol):
    """What these need of an arm; `NiryoArm` has it."""

    @property
    def learning_mode(self) -> bool: ...
    @learning_mode.setter
    def learning_mode(self, enabled: bool) -> None: ...
    def move_joints(self, q: ArrayLike) -> Vector: ...
    def joints(self) -> Vector: ...


def visit(arm: Moving, q: ArrayLike, look: Callable[[], ArrayLike]) -> tuple[Vector, Vector]:
    """Move to joint vectors, one after the other, and look at each.

    Args:
        arm: connected and calibrated.
        q: (N, 6) joint vectors, radians.
        look: what an instrument sees of the tool, once the arm stands: a pose (4, 4), a position
            (3,) or a distance, metres, in the space frame.

    Returns:
        (N, 6) joint values read back from the arm, radians, and what was seen (N, ...): what
        `niryo_jax.calibration.fit` is made for.

    Raises:
        NiryoError: what the arm raises; it stands where it is then.
    """
    read, seen = list[Vector](), list[Vector]()
    for target in np.asarray(q, float):
        read.append(arm.move_joints(target))
        seen.append(np.asarray(look(), float))
    return np.array(read), np.array(seen)


def touch(
    arm: Moving, places: ArrayLike, ready: Callable[[int, Vector], object]
) -> tuple[Vector, Vector]:
    """Read the joints while somebody holds the tip of the tool, by hand, at known places.

    The arm is in learning mode, in which its motors are off, and stays so.

    Args:
        arm: connected and calibrated.
        places: (N, 3) the known places, metres, in the space frame.
        ready: called with the number of a place and the place; returns once the tip is there.

    Returns:
        (N, 6) joint values, radians, and the places (N, 3): measured positions of the tip, so the
        robot of `niryo_jax.calibration.fit` is the one `with_tool` that ends there.

    Raises:
        ValueError: places of another shape, or not finite.
        NiryoError: what the arm raises.
    """
    known = np.asarray(places, float)
    if known.ndim != 2 or known.shape[1] != 3 or not np.all(np.isfinite(known)):
        raise ValueError(f"places: expected finite (N, 3), got shape {known.shape}")
    arm.learning_mode = True
    read = list[Vector]()
    for number, place in enumerate(known):
        ready(number, place)
        read.append(arm.joints())
    return np.array(read).reshape(-1, 6), known
