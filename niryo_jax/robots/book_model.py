"""An arm as a textbook draws it: directions of the axes, points on them, the tool frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np

from niryo_jax.arguments import check_text
from niryo_jax.robot import Robot

Direction = Literal["x", "y", "z", "-x", "-y", "-z"]
Point = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class BookModel:
    """An arm as the book draws it, at q = 0 in the space frame. Metres and degrees.

    Attributes:
        name: identifier, as in `robots.load`.
        joints: per joint the direction of its axis and a point on it; no point for a slide.
        tool: directions of the x, y and z axis of the tool frame.
        tool_point: position of the tool frame.
        limits: source name -> ((lower, upper), ...) per joint, metres for a slide. The first is the
            default; without any, the joints are unlimited.
        source: where the geometry comes from.
    """

    name: str
    joints: tuple[tuple[Direction, Point | None], ...]
    tool: tuple[Direction, Direction, Direction]
    tool_point: Point
    limits: Mapping[str, tuple[tuple[float, float], ...]]
    source: str

    def robot(self, limits: str | None = None) -> Robot:
        """The arm as a `Robot`, with the joint limits of the named source."""
        if limits is not None:
            check_text("limits", limits)
        if limits is not None and limits not in self.limits:
            known = ", ".join(self.limits) or "none"
            raise ValueError(f"limits: {limits!r} is not a source of {self.name}; known: {known}")
        slides = [point is None for _, point in self.joints]
        home = np.eye(4)
        home[:3, :3] = np.stack([_vector(direction) for direction in self.tool], axis=1)
        home[:3, 3] = self.tool_point
        lower = upper = None
        if self.limits:
            ranges = self.limits[next(iter(self.limits)) if limits is None else limits]
            lower, upper = np.where(slides, np.transpose(ranges), np.deg2rad(np.transpose(ranges)))
        return Robot.from_axes(
            [_vector(direction) for direction, _ in self.joints],
            [point or (0.0, 0.0, 0.0) for _, point in self.joints],
            home,
            prismatic=slides,
            lower=lower,
            upper=upper,
            name=self.name,
        )

    def redrawn(
        self, reversed_joints: tuple[int, ...], tool: tuple[Direction, Direction, Direction]
    ) -> BookModel:
        """The same arm with some joints counted the other way and with another tool frame.

        The range of a joint that is counted the other way is mirrored, as the arm stays the same.
        """
        joints = tuple(
            (_OPPOSITE[direction] if i in reversed_joints else direction, point)
            for i, (direction, point) in enumerate(self.joints)
        )
        limits = {
            source: tuple(
                (-high, -low) if i in reversed_joints else (low, high)
                for i, (low, high) in enumerate(ranges)
            )
            for source, ranges in self.limits.items()
        }
        return dataclasses.replace(self, joints=joints, tool=tool, limits=limits)


_OPPOSITE: dict[Direction, Direction] = {
    "x": "-x",
    "y": "-y",
    "z": "-z",
    "-x": "x",
    "-y": "y",
    "-z": "z",
}


def _vector(direction: Direction) -> np.ndarray:
    unit = np.zeros(3)
    unit["xyz".index(direction[-1])] = -1.0 if direction[0] == "-" else 1.0
    return unit
