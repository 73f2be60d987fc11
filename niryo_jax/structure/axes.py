"""Kinematic structure: what kind each joint is, and how the axes lie to each other.

Found in numpy from concrete screws (n, 6), space frame; the solver that fits is chosen from it.
"""

from __future__ import annotations

import itertools
from enum import Enum
from types import ModuleType
from typing import Any

import numpy as np

from niryo_jax.tolerances import (
    AXES_MEET,
    AXES_NEARLY_MEET,
    AXES_NEARLY_PARALLEL,
    AXES_PARALLEL,
    PITCH,
    SCREW_NORM,
    TINY,
)


def joint_kinds(screws: np.ndarray) -> tuple[str, ...]:
    """The kind of each joint: "revolute", "prismatic" or "helical"."""

    def kind(screw: np.ndarray) -> str:
        if not np.any(screw[:3]):
            return "prismatic"
        pitch = abs(screw[:3] @ screw[3:])
        return "helical" if pitch > PITCH.of(screws.dtype) else "revolute"

    return tuple(kind(screw) for screw in screws)


class AxisRelation(Enum):
    """How two joint axes lie to each other."""

    COINCIDENT = "coincide"
    PARALLEL = "are parallel"
    INTERSECTING = "meet"
    SKEW = "miss each other"


def axis_point(screw: Any, xp: ModuleType = np) -> Any:
    """The point of a rotation axis closest to the origin, omega x v (|omega| = 1)."""
    return xp.cross(screw[:3], screw[3:])


def is_revolute(screw: Any, xp: ModuleType = np) -> Any:
    """Whether a screw is a pure rotation."""
    turns = abs(xp.linalg.norm(screw[:3]) - 1) < SCREW_NORM.of(screw.dtype)
    return turns & (abs(screw[:3] @ screw[3:]) <= PITCH.of(screw.dtype))


def is_prismatic(screw: Any, xp: ModuleType = np) -> Any:
    """Whether a screw is a translation."""
    return xp.all(screw[:3] == 0)


def distance_between(first: Any, second: Any, xp: ModuleType = np) -> Any:
    """The shortest distance between two rotation axes, metres."""
    between = axis_point(second, xp) - axis_point(first, xp)
    normal = xp.cross(first[:3], second[:3])
    length = xp.linalg.norm(normal)
    parallel = length < AXES_PARALLEL.of(first.dtype)
    aside = xp.linalg.norm(xp.cross(first[:3], between))
    return xp.where(parallel, aside, abs(between @ normal) / xp.where(parallel, 1.0, length))


def sine_between(first: Any, second: Any, xp: ModuleType = np) -> Any:
    """The sine of the angle between two directions (3,)."""
    return xp.linalg.norm(xp.cross(first, second))


def are_parallel(first: Any, second: Any, xp: ModuleType = np) -> Any:
    """Whether two rotation axes are parallel, or coincide."""
    return sine_between(first[:3], second[:3], xp) < AXES_PARALLEL.of(first.dtype)


def do_meet(first: Any, second: Any, xp: ModuleType = np) -> Any:
    """Whether two rotation axes meet in one point."""
    near = distance_between(first, second, xp) < AXES_MEET.of(first.dtype)
    return ~are_parallel(first, second, xp) & near


def relation(first: np.ndarray, second: np.ndarray) -> AxisRelation:
    """How two rotation axes, given as screws, lie to each other."""
    if are_parallel(first, second):
        touching = distance_between(first, second) < AXES_MEET.of(first.dtype)
        return AxisRelation.COINCIDENT if touching else AxisRelation.PARALLEL
    return AxisRelation.INTERSECTING if do_meet(first, second) else AxisRelation.SKEW


def meeting_point(first: Any, second: Any, xp: ModuleType = np) -> Any:
    """The midpoint of the shortest segment between two rotation axes that are not parallel.

    `xp` is numpy or jax.numpy, for screws that are traced. With r = r_i + xi_i w_i on axis i,
    [w1 -w2] xi = r2 - r1, solved by least squares. (Todorovic et al., eq. 20, print r1 - r2, which
    gives the mirror image of the point.)
    """
    w1, w2 = first[:3], second[:3]
    r1, r2 = axis_point(first, xp), axis_point(second, xp)
    cosine, between = w1 @ w2, r2 - r1
    ahead, back = w1 @ between, w2 @ between
    sine_square = xp.maximum(xp.sum(xp.cross(w1, w2) ** 2), TINY)
    xi1, xi2 = (ahead - cosine * back) / sine_square, (cosine * ahead - back) / sine_square
    return 0.5 * (r1 + xi1 * w1 + r2 + xi2 * w2)


def lock(screws: Any, joint: int, value: Any, xp: ModuleType = np) -> Any:
    """The screws (n - 1, 6) of the arm that is left where one joint stays at a value."""
    w, v = screws[joint, :3], screws[joint, 3:]
    hat = xp.cross(xp.eye(3, dtype=screws.dtype), w)
    rotation = xp.eye(3, dtype=screws.dtype) + xp.sin(value) * hat
    rotation = rotation + (1 - xp.cos(value)) * (hat @ hat)
    # A slide does not turn and moves along v; of a screw only its pitch moves along w.
    along = xp.where(xp.any(w != 0), (w @ v) * w, v)
    position = (xp.eye(3, dtype=screws.dtype) - rotation) @ xp.cross(w, v) + value * along
    after = screws[joint + 1 :]
    turned, shifted = after[:, :3] @ rotation.T, after[:, 3:] @ rotation.T
    moved = xp.concatenate([turned, shifted + xp.cross(position, turned)], axis=1)
    return xp.concatenate([screws[:joint], moved.astype(screws.dtype)])


def perpendicular_to(screw: Any, point: Any, xp: ModuleType = np) -> Any:
    """The vector from a rotation axis to a point, at right angles to the axis."""
    away = point - axis_point(screw, xp)
    return away - (away @ screw[:3]) * screw[:3]


def relations(screws: np.ndarray) -> list[str]:
    """How neighbouring axes lie, a line each; axes are counted from 1.

    Axes that should be parallel or meet, and were written with rounded numbers, are told by the
    angle (rad) or the distance by which they miss.
    """
    kinds, lines = joint_kinds(screws), list[str]()
    for i, (first, second) in enumerate(itertools.pairwise(screws)):
        if "prismatic" in kinds[i : i + 2]:
            continue
        how, apart = relation(first, second).value, distance_between(first, second)
        sine = sine_between(first[:3], second[:3])
        if AXES_PARALLEL.of(screws.dtype) <= sine <= AXES_NEARLY_PARALLEL:
            # Where such axes meet is nowhere near the arm.
            how = f"miss parallel by {sine:.2g} rad"
            apart = np.linalg.norm(np.cross(first[:3], axis_point(second) - axis_point(first)))
        gap = f", {apart * 1e3:.4g} mm apart" if apart > AXES_MEET.of(screws.dtype) else ""
        lines.append(f"axes {i + 1} and {i + 2} {how}{gap}")
    return lines + _missed_points(screws)


def _missed_points(screws: np.ndarray) -> list[str]:
    """Which three neighbouring axes nearly meet in one point, and by how much they miss it."""
    kinds, lines = joint_kinds(screws), list[str]()
    for i in range(len(screws) - 2):
        three, pairs = screws[i : i + 3], list(itertools.pairwise(screws[i : i + 3]))
        if set(kinds[i : i + 3]) != {"revolute"}:
            continue
        if any(sine_between(a[:3], b[:3]) <= AXES_NEARLY_PARALLEL for a, b in pairs):
            continue
        first, second = (meeting_point(a, b) for a, b in pairs)
        gaps = [distance_between(a, b) for a, b in pairs]
        miss = max(float(np.linalg.norm(second - first)), *gaps)
        if AXES_MEET.of(three.dtype) <= miss <= AXES_NEARLY_MEET:
            names = f"axes {i + 1}, {i + 2} and {i + 3}"
            lines.append(f"{names} miss one point by {miss * 1e3:.2g} mm")
    return lines
