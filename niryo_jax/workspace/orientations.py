"""Evenly spread orientations of the tool."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from niryo_jax.arguments import as_data, check_choice, check_count, check_fits
from niryo_jax.tolerances import MOTION

KINDS = ("super-fibonacci", "directions", "random")
"""The sets that `orientations` can make."""

_NUMBERS = 100
"""To make one orientation, a few copies of its rotation and its quaternion are held."""

_PHI = math.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the root of psi^4 = psi + 4


@dataclass(frozen=True, eq=False)
class Orientations:
    """A set of orientations, and what it was made from.

    Attributes:
        rotations: (M, 3, 3) float64, the tool frame in the space frame.
        kind: one of `KINDS`, or "given".
        seed: the seed it was made with.
        rolls: how many orientations share a direction of approach; 1 unless `kind` is
            "directions".
        axis: (3,) unit axis of approach in the tool frame; for `kind` "directions" only.
    """

    rotations: np.ndarray
    kind: str
    seed: int = 0
    rolls: int = 1
    axis: tuple[float, float, float] | None = None

    def __len__(self) -> int:
        """The number of orientations M."""
        return len(self.rotations)

    @property
    def quaternions(self) -> np.ndarray:
        """(M, 4) unit quaternions (w, x, y, z), w >= 0."""
        return quaternions_of(self.rotations)


def orientations(
    number: int = 200,
    kind: str = "super-fibonacci",
    *,
    seed: int = 0,
    rolls: int = 1,
    axis: Sequence[float] = (1.0, 0.0, 0.0),
) -> Orientations:
    """Orientations that are spread evenly over all rotations.

    Args:
        number: how many, M.
        kind: "super-fibonacci": a spiral through the unit quaternions (Alexa, Super-Fibonacci
            Spirals, CVPR 2022, algorithm 1); "directions": directions of approach on a Fibonacci
            sphere, each with so many rolls about it; "random": uniform and independent (Shoemake,
            Uniform Random Rotations, Graphics Gems III, 1992).
        seed: for "random", which set; for the others a seed other than 0 turns the whole set by a
            random rotation, which gives an independent set of the same evenness.
        rolls: for "directions", rolls about each direction, evenly spread over a turn; the number
            of directions is number / rolls.
        axis: for "directions", the axis of approach in the tool frame, of any length: x for the
            Niryo arms, z for many others.

    Returns:
        The orientations, and what they were made from.

    Raises:
        ValueError: a number or rolls below 1, rolls that do not divide the number or go with
            another kind, an unknown kind, a negative seed, an axis that is not a direction.
    """
    number = check_fits("number", number, 1, _NUMBERS)
    check_choice("kind", kind, KINDS)
    seed = check_count("seed", seed, 0, sys.maxsize)
    rolls = check_count("rolls", rolls, 1, sys.maxsize)
    if number % rolls:
        raise ValueError(
            f"rolls: expected a number that divides the {number} orientations, got {rolls}"
        )
    if rolls > 1 and kind != "directions":
        raise ValueError(f'rolls: only the kind "directions" has rolls, got {rolls} for {kind!r}')
    if kind == "random":
        return Orientations(rotations_of(_random_quaternions(number, seed)), kind, seed)
    turn = rotations_of(_random_quaternions(1, seed))[0] if seed else np.eye(3)
    if kind == "super-fibonacci":
        return Orientations(turn @ rotations_of(_super_fibonacci(number)), kind, seed)
    unit = _direction(axis)
    rotations = turn @ _approaches(number // rolls, rolls, unit)
    x, y, z = unit.tolist()
    return Orientations(rotations, kind, seed, rolls, (x, y, z))


def given(rotations: ArrayLike) -> Orientations:
    """Orientations of one's own.

    Args:
        rotations: (M, 3, 3) or (3, 3), the tool frame in the space frame.

    Raises:
        ValueError: another shape, no rotation at all, or matrices that are not rotations.
    """
    array = np.asarray(as_data("rotations", rotations), np.float64)
    if array.ndim < 2 or array.ndim > 3 or array.shape[-2:] != (3, 3) or array.size == 0:
        raise ValueError(f"rotations: expected shape (M, 3, 3) with M >= 1, got {array.shape}")
    array = array.reshape(-1, 3, 3)
    identity = array @ np.swapaxes(array, 1, 2)
    right = np.abs(identity - np.eye(3)).max(axis=(1, 2)) < MOTION
    right &= np.linalg.det(np.where(right[:, None, None], array, 0.0)) > 0
    if not np.all(right):
        wrong = int(np.argmin(right))
        raise ValueError(
            f"rotations: expected rotation matrices, got number {wrong}:\n{array[wrong]}"
        )
    return Orientations(array, "given")


def rotations_of(quaternions: np.ndarray) -> np.ndarray:
    """(M, 4) unit quaternions (w, x, y, z) -> (M, 3, 3) rotations (Lynch & Park, appendix B.3)."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_of(rotations: np.ndarray) -> np.ndarray:
    """(M, 3, 3) rotations -> (M, 4) unit quaternions (w, x, y, z), w >= 0.

    The rows of the matrix 4 q q^T are multiples of q; the longest one is the most accurate.
    """
    r = rotations
    trace = np.trace(r, axis1=1, axis2=2)
    products = np.empty((len(r), 4, 4))
    products[:, 0, 0] = 1 + trace
    products[:, 1:, 1:] = r + np.swapaxes(r, 1, 2) + (1 - trace)[:, None, None] * np.eye(3)
    products[:, 0, 1:] = np.stack([r[:, 2, 1], r[:, 0, 2], r[:, 1, 0]], axis=1)
    products[:, 0, 1:] -= np.stack([r[:, 1, 2], r[:, 2, 0], r[:, 0, 1]], axis=1)
    products[:, 1:, 0] = products[:, 0, 1:]
    longest = np.argmax(np.diagonal(products, axis1=1, axis2=2), axis=1)
    q = products[np.arange(len(r)), longest]
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    return np.where(q[:, :1] < 0, -q, q)


def _direction(axis: Sequence[float]) -> np.ndarray:
    vector = np.asarray(as_data("axis", axis), np.float64)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not np.isfinite(length) or length == 0:
        raise ValueError(f"axis: expected a direction of shape (3,), got {axis}")
    return vector / length


def _super_fibonacci(number: int) -> np.ndarray:
    s = np.arange(number) + 0.5
    return _on_tori(s / number, s / _PHI, s / _PSI)


def _random_quaternions(number: int, seed: int) -> np.ndarray:
    return _on_tori(*np.random.default_rng(seed).random((3, number)))


def _on_tori(share: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(M, 4) unit quaternions from three numbers, which if uniform in [0, 1) give uniform ones."""
    small, large = np.sqrt(share), np.sqrt(1.0 - share)
    alpha, beta = 2 * np.pi * first, 2 * np.pi * second
    parts = small * np.sin(alpha), small * np.cos(alpha), large * np.sin(beta), large * np.cos(beta)
    return np.stack(parts, axis=1)


def _approaches(directions: int, rolls: int, axis: np.ndarray) -> np.ndarray:
    """(directions * rolls, 3, 3) rotations; those that share a direction lie side by side."""
    i = np.arange(directions) + 0.5
    height = 1.0 - 2.0 * i / directions
    azimuth = np.pi * (1.0 + math.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - height * height)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    towards = np.stack([radius * cos, radius * sin, height], axis=1)
    east = np.stack([-sin, cos, np.zeros_like(sin)], axis=1)
    north = np.cross(towards, east)
    goal = np.stack([towards, east, north], axis=2)

    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across = across / np.linalg.norm(across)
    tool = np.stack([axis, across, np.cross(axis, across)])

    roll = 2 * np.pi * np.arange(rolls) / rolls
    about = np.zeros((rolls, 3, 3))
    about[:, 0, 0] = 1.0
    about[:, 1, 1] = about[:, 2, 2] = np.cos(roll)
    about[:, 2, 1] = np.sin(roll)
    about[:, 1, 2] = -about[:, 2, 1]
    return (goal[:, None] @ about @ tool).reshape(-1, 3, 3)
