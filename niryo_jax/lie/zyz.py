"""Euler angles ZYZ: R = Rz(alpha) Ry(beta) Rz(gamma), with beta in [0, pi]; in numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from niryo_jax.tolerances import SINGULAR_ANGLE


def zyz_from_rotation(rotation: ArrayLike) -> NDArray[np.float64]:
    """(..., 3) angles alpha, beta, gamma of rotations (..., 3, 3), radians.

    Alpha and gamma are in (-pi, pi]. Where beta is 0 or pi only alpha + gamma, or alpha - gamma, is
    determined: there gamma is 0, and alpha is atan2(r21, r11) at 0 and atan2(-r21, -r11) at pi.
    """
    r = np.asarray(rotation, np.float64)
    sine = np.hypot(r[..., 2, 0], r[..., 2, 1])
    beta = np.arctan2(sine, r[..., 2, 2])
    sign = np.where(r[..., 2, 2] < 0, -1.0, 1.0)
    free = sine < SINGULAR_ANGLE.of(r.dtype)
    along = np.arctan2(sign * r[..., 1, 0], sign * r[..., 0, 0])
    alpha = np.where(free, along, np.arctan2(r[..., 1, 2], r[..., 0, 2]))
    gamma = np.where(free, 0.0, np.arctan2(r[..., 2, 1], -r[..., 2, 0]))
    # A negative zero would make -180 degrees of 180.
    return np.stack([alpha, beta, gamma], axis=-1) + 0.0


def rotation_from_zyz(angles: ArrayLike) -> NDArray[np.float64]:
    """(..., 3, 3) rotations of angles (..., 3), radians."""
    alpha, beta, gamma = np.moveaxis(np.asarray(angles, np.float64), -1, 0)
    return _about_z(alpha) @ _about_y(beta) @ _about_z(gamma)


def _about_z(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return np.stack([c, -s, o, s, c, o, o, o, o + 1], -1).reshape(*angle.shape, 3, 3)


def _about_y(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    return np.stack([c, o, s, o, o + 1, o, -s, o, c], -1).reshape(*angle.shape, 3, 3)
