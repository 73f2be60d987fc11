"""Rigid motions in numpy, for a few dozen measurements: nothing to compile, always in float64.

Formulas: Lynch & Park, *Modern Robotics*, sections 3.2 and 3.3; the derivative of the exponential
after Murray, Li & Sastry, section 2.3, as a series, for twists of a parameter are small.
"""

from __future__ import annotations

import numpy as np

_TERMS = 24


def hat(w: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 3, 3): the matrix of w x."""
    x, y, z = np.moveaxis(w, -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*x.shape, 3, 3)


def exp(twist: np.ndarray) -> np.ndarray:
    """(..., 6) -> (..., 4, 4): the motion of a twist (omega, v)."""
    w, v = twist[..., :3], twist[..., 3:]
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    square = angle * angle
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - square / 6 + square**2 / 120, np.sin(safe) / safe)
    b = np.where(small, 0.5 - square / 24, 2 * (np.sin(safe / 2) / safe) ** 2)
    c = np.where(small, 1 / 6 - square / 120, (safe - np.sin(safe)) / safe**3)
    k = hat(w)
    out = np.zeros((*w.shape[:-1], 4, 4))
    out[..., :3, :3] = np.eye(3) + a * k + b * (k @ k)
    out[..., :3, 3] = ((np.eye(3) + b * k + c * (k @ k)) @ v[..., None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def adjoint(pose: np.ndarray) -> np.ndarray:
    """(..., 4, 4) -> (..., 6, 6): what a motion makes of twists."""
    rotation, place = pose[..., :3, :3], pose[..., :3, 3]
    out = np.zeros((*pose.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = rotation
    out[..., 3:, :3] = hat(place) @ rotation
    return out


def left_derivative(twist: np.ndarray) -> np.ndarray:
    """(6,) -> (6, 6): D with d exp(t) = [D dt] exp(t), the sum of ad(t)^k / (k + 1)!."""
    ad = np.zeros((6, 6))
    ad[:3, :3] = ad[3:, 3:] = hat(twist[:3])
    ad[3:, :3] = hat(twist[3:])
    term, total = np.eye(6), np.eye(6)
    for k in range(2, _TERMS):
        term = term @ ad / k
        total = total + term
    return total


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """(..., 3, 3) -> (..., 3): the logarithm, of turns less than half a one."""
    skew = np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    sine = 0.5 * np.linalg.norm(skew, axis=-1)
    cosine = 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    per = np.where(sine > 1e-9, angle / np.where(sine > 1e-9, sine, 1.0), 1.0)
    return 0.5 * skew * per[..., None]
