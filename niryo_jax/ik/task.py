"""What of a pose is bound: all of it, the position and one axis of the tool, or the position."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import as_data, check_choice, shown

TaskName = Literal["pose", "direction", "position"]

BOUND: dict[TaskName, tuple[int, str]] = {
    "pose": (6, "position and orientation"),
    "direction": (5, "position and direction of the tool axis"),
    "position": (3, "position"),
}
"""How many coordinates each task binds, and which in words."""


@dataclasses.dataclass(frozen=True)
class Task:
    """What of a pose is bound.

    Attributes:
        name: which.
        axis: for "direction" the unit vector that is bound, in the tool frame.
    """

    name: TaskName
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)

    @property
    def bound(self) -> int:
        """How many coordinates are bound."""
        return BOUND[self.name][0]

    def across(self) -> np.ndarray:
        """(k, 3) orthonormal: the directions, in the tool frame, about which no turn is left."""
        if self.name == "pose":
            return np.eye(3)
        if self.name == "position":
            return np.zeros((0, 3))
        axis = np.array(self.axis)
        first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(axis, first)])


POSE = Task("pose")


def task_of(name: TaskName, tool_axis: ArrayLike | Sequence[float]) -> Task:
    """A task by its name.

    Args:
        name: "pose", "direction" or "position".
        tool_axis: (3,) the axis that "direction" binds, in the tool frame, of any length but zero.

    Raises:
        ValueError: another name; an axis of another shape, or that has no direction.
        TypeError: an axis that is traced, or not made of real numbers.
    """
    check_choice("task", name, BOUND)
    if not is_concrete(tool_axis):
        raise TypeError("tool_axis: expected a concrete vector, got a traced one")
    axis = np.asarray(as_data("tool_axis", tool_axis), float)
    largest = float(np.max(np.abs(axis), initial=0.0))
    if axis.shape != (3,) or not 0 < largest < np.inf:
        raise ValueError(
            f"tool_axis: expected a vector (3,) that is not zero, got {shown(tool_axis)}"
        )
    axis = axis / largest  # Whose square is neither too large nor too small for a number.
    unit = tuple(float(x) for x in axis / np.linalg.norm(axis))
    return Task(name, unit) if name == "direction" else Task(name)
