"""Roll, pitch and yaw as robots and URDF use them: R = Rz(yaw) Ry(pitch) Rx(roll); in numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def pose_from_rpy(values: Sequence[float]) -> NDArray[np.float64]:
    """(4, 4) pose from (x, y, z, roll, pitch, yaw), metres and radians."""
    x, y, z, *angles = (float(value) for value in values)
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def rpy_from_pose(pose: NDArray[np.float64]) -> list[float]:
    """(x, y, z, roll, pitch, yaw) of a (4, 4) pose, metres and radians.

    Roll is read after undoing yaw, so the three angles rebuild the rotation at gimbal lock too,
    where yaw alone is arbitrary.
    """
    (r00, r01, r02), (r10, r11, r12), (r20, _, _) = pose[:3, :3]
    yaw = np.arctan2(r10, r00)
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-r20, c * r00 + s * r10)
    roll = np.arctan2(s * r02 - c * r12, c * r11 - s * r01)
    return [float(value) for value in (*pose[:3, 3], roll, pitch, yaw)]
