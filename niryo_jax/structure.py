"""Kinematic structure: what kind each joint is, and how the axes lie to each other.

Found in numpy from concrete screws (n, 6), space frame; the solver that fits is chosen from it.
"""

from __future__ import annotations

import dataclasses
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
)


def joint_kinds(screws: np.ndarray) -> tuple[str, ...]:
    """The kind of each joint: "revolute", "prismatic" or "helical"."""

    def kind(screw: np.ndarray) -> str:
        if not np.any(screw[:3]):
            return "prismatic"
        return "helical" if abs(screw[:3] @ screw[3:]) > PITCH else "revolute"

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


def distance_between(first: np.ndarray, second: np.ndarray) -> float:
    """The shortest distance between two rotation axes, metres."""
    between = axis_point(second) - axis_point(first)
    normal = np.cross(first[:3], second[:3])
    length = np.linalg.norm(normal)
    if length < AXES_PARALLEL:
        return float(np.linalg.norm(np.cross(first[:3], between)))
    return float(abs(between @ normal) / length)


def relation(first: np.ndarray, second: np.ndarray) -> AxisRelation:
    """How two rotation axes, given as screws, lie to each other."""
    parallel = np.linalg.norm(np.cross(first[:3], second[:3])) < AXES_PARALLEL
    touching = distance_between(first, second) < AXES_MEET
    if parallel:
        return AxisRelation.COINCIDENT if touching else AxisRelation.PARALLEL
    return AxisRelation.INTERSECTING if touching else AxisRelation.SKEW


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
    sine_square = xp.sum(xp.cross(w1, w2) ** 2)
    xi1, xi2 = (ahead - cosine * back) / sine_square, (cosine * ahead - back) / sine_square
    return 0.5 * (r1 + xi1 * w1 + r2 + xi2 * w2)


def perpendicular_to(screw: Any, point: Any, xp: ModuleType = np) -> Any:
    """The vector from a rotation axis to a point, at right angles to the axis."""
    away = point - axis_point(screw, xp)
    return away - (away @ screw[:3]) * screw[:3]


@dataclasses.dataclass(frozen=True)
class OffsetWristArm:
    """A six-axis arm whose axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet.

    Attributes:
        shoulder: (3,) where axes 1 and 2 meet, at q = 0, metres.
        wrist: (3,) where axes 4 and 5 meet, at q = 0.
        offset: (3,) from axis 6 to the wrist at right angles to the axis: the wrist is spherical
            where it is zero.
        wrist_range: the least and the greatest distance of the wrist from the shoulder, metres.
    """

    shoulder: np.ndarray
    wrist: np.ndarray
    offset: np.ndarray
    wrist_range: tuple[float, float]


def offset_wrist_arm(screws: np.ndarray) -> OffsetWristArm | None:
    """The arm's structure if it belongs to the family of the Niryo arms, else None."""
    if len(screws) != 6 or set(joint_kinds(screws)) != {"revolute"}:
        return None
    wanted = {
        (0, 1): AxisRelation.INTERSECTING,
        (1, 2): AxisRelation.PARALLEL,
        (3, 4): AxisRelation.INTERSECTING,
    }
    if any(relation(screws[i], screws[j]) is not want for (i, j), want in wanted.items()):
        return None
    if relation(screws[4], screws[5]) in (AxisRelation.PARALLEL, AxisRelation.COINCIDENT):
        return None
    shoulder, wrist = meeting_point(screws[0], screws[1]), meeting_point(screws[3], screws[4])
    upper_arm = perpendicular_to(screws[2], shoulder)
    forearm = perpendicular_to(screws[2], wrist)
    sideways = float((wrist - shoulder) @ screws[2, :3])
    lengths = float(np.linalg.norm(upper_arm)), float(np.linalg.norm(forearm))
    return OffsetWristArm(
        shoulder=shoulder,
        wrist=wrist,
        offset=perpendicular_to(screws[5], wrist),
        wrist_range=(
            float(np.hypot(sideways, lengths[0] - lengths[1])),
            float(np.hypot(sideways, lengths[0] + lengths[1])),
        ),
    )


def nearly_offset_wrist_axes(screws: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Directions and points (6, 3) of the axes of the offset-wrist arm that is nearest to an arm.

    Axes 1 and 2, and 4 and 5, are moved to meet half-way between; axis 3 is made parallel to axis
    2, through the point of it nearest to where 4 and 5 meet. All else stays as it is.

    Returns:
        None where the arm has other joints than six revolute ones, or is farther from any such arm
        than `AXES_NEARLY_MEET` and `AXES_NEARLY_PARALLEL` allow.
    """
    if screws.shape != (6, 6) or set(joint_kinds(screws)) != {"revolute"}:
        return None
    w1, w2, w3, w4, w5, w6 = axes = screws[:, :3]
    if _sine(w2, w3) > AXES_NEARLY_PARALLEL:
        return None
    if min(_sine(w1, w2), _sine(w4, w5), _sine(w5, w6)) <= AXES_NEARLY_PARALLEL:
        return None
    if max(distance_between(*screws[:2]), distance_between(*screws[3:5])) > AXES_NEARLY_MEET:
        return None
    shoulder, wrist = meeting_point(*screws[:2]), meeting_point(*screws[3:5])
    on_3 = axis_point(screws[2])
    elbow = on_3 + ((wrist - on_3) @ w3) * w3
    turned = np.where(np.arange(6)[:, None] == 2, np.sign(w2 @ w3) * w2, axes)
    return turned, np.stack([shoulder, shoulder, elbow, wrist, wrist, axis_point(screws[5])])


def _sine(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.linalg.norm(np.cross(first, second)))


def relations(screws: np.ndarray) -> list[str]:
    """How neighbouring axes lie, a line each."""
    kinds, lines = joint_kinds(screws), list[str]()
    for i, (first, second) in enumerate(itertools.pairwise(screws)):
        if "prismatic" in kinds[i : i + 2]:
            continue
        how = relation(first, second)
        apart = distance_between(first, second)
        gap = f", {apart * 1e3:.4g} mm apart" if apart > AXES_MEET else ""
        lines.append(f"axes {i + 1} and {i + 2} {how.value}{gap}")
    return lines
