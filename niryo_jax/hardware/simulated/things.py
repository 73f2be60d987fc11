"""What a simulated arm can grip: a point, or blocks that stand on the table and on each other."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from niryo_jax.lie.rpy import pose_from_rpy, rpy_from_pose

Vector = NDArray[np.float64]

# How far from the tool centre point the middle of a thing may be and still be gripped, metres. The
# jaws of gripper 1 are about 20 mm long and 27 mm apart.
REACH = 0.03


@dataclasses.dataclass
class Thing:
    """A cuboid, or a point.

    Attributes:
        size: (3,) metres along its axes.
        pose: (4, 4) of the middle of its base in the space frame; upright where it stands, and in
            the tool frame while it is held.
    """

    size: Vector
    pose: Vector

    @property
    def top(self) -> float:
        """Height of its top where it stands, metres."""
        return float(self.pose[2, 3] + self.size[2])

    @property
    def middle(self) -> Vector:
        """(3,) its middle."""
        return self.pose[:3, 3] + self.pose[:3, 2] * self.size[2] / 2

    @property
    def footprint(self) -> Vector:
        """(4, 2) the corners of its base, one after the other round it."""
        return footprint(self.size, self.pose)


class Things:
    """All of them, and which one the tool holds. Not thread-safe."""

    def __init__(self) -> None:
        self._all: list[Thing] = []
        self._held: Thing | None = None

    @property
    def holding(self) -> bool:
        """Whether one is held."""
        return self._held is not None

    def put(self, poses: ArrayLike, size: Sequence[float]) -> None:
        """Put things of one size there, in the place of all before."""
        self._all = [Thing(np.array(size, float), pose) for pose in np.array(poses, float)]
        self._held = None

    def poses(self, tool: Vector) -> Vector:
        """(k, 4, 4) in the space frame, where the tool frame is at a pose (4, 4)."""
        poses = [tool @ x.pose if x is self._held else x.pose for x in self._all]
        return np.array(poses).reshape(-1, 4, 4)

    def grasp(self, tool: Vector, centre: Vector) -> None:
        """Hold the one nearest to the tool's centre point (3,), in the tool frame, if in reach."""
        point = tool[:3, :3] @ centre + tool[:3, 3]
        near = sorted(self._all, key=lambda x: float(np.linalg.norm(x.middle - point)))
        if near and np.linalg.norm(near[0].middle - point) <= REACH:
            self._held = near[0]
            self._held.pose = np.linalg.inv(tool) @ self._held.pose

    def release(self, tool: Vector) -> None:
        """Let the one that is held fall straight down, upright, on the table or what is below."""
        thing, self._held = self._held, None
        if thing is None:
            return
        x, y, *_, yaw = rpy_from_pose(tool @ thing.pose)
        thing.pose = pose_from_rpy((x, y, 0.0, 0.0, 0.0, yaw))
        below = [x.top for x in self._all if x is not thing and _overlap(x, thing)]
        thing.pose[2, 3] = max(below, default=0.0)


def footprint(size: Sequence[float] | Vector, pose: Vector) -> Vector:
    """(4, 2) the corners, one after the other, of an upright base (its sides are the first two of
    `size`) whose middle is at a pose (4, 4)."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.asarray(size)[:2] / 2
    return corners @ pose[:2, :2].T + pose[:2, 3]


def _overlap(a: Thing, b: Thing) -> bool:
    """Whether two footprints do: no side of either has the other's corners all beyond it."""
    corners = a.footprint, b.footprint
    for sides in corners:
        for side in np.roll(sides, -1, axis=0) - sides:
            across = np.array([-side[1], side[0]])
            low, high = (x @ across for x in corners)
            if low.max() <= high.min() or high.max() <= low.min():
                return False
    return True
