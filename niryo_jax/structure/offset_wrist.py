"""The numbers of an offset-wrist arm: what its complete inverse kinematics is written in.

Such an arm has six revolute joints of which axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet.
The letters are those of docs/theory/complete-ik.md. The base frame has its origin in the shoulder
and the axes (e, e1 x e, e1), with e the part of e2 at right angles to e1. P1 and P2 = e2 x P1 span
the plane of upper arm and forearm, P1 being the part of e1 in it.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from types import ModuleType
from typing import Any

import numpy as np

from niryo_jax.structure.axes import (
    axis_point,
    distance_between,
    joint_kinds,
    meeting_point,
    perpendicular_to,
    sine_between,
)
from niryo_jax.structure.conditions import is_offset_wrist
from niryo_jax.structure.rounding import off_by
from niryo_jax.tolerances import (
    ARM_NUMBER,
    AXES_EXACT,
    AXES_MEET,
    AXES_NEARLY_MEET,
    AXES_NEARLY_PARALLEL,
)

FIELDS: dict[str, tuple[int, ...]] = {
    "base": (3, 3),
    "shoulder": (3,),
    "centre": (3,),
    "spoke": (3,),
    "axis_6": (3,),
    "radius": (),
    "upper_arm": (),
    "forearm": (),
    "sideways": (),
    "shoulder_angle": (2,),
    "axis_4": (3,),
    "axis_5": (3,),
    "hand": (3,),
    "wrist_angle": (),
    "twist": (2, 3),
    "upper_arm_angle": (2,),
    "elbow_angle": (2,),
    "turn_3": (),
    "off": (),
}
"""Name and shape of the numbers, in order: `niryo_jax.ik.offset_wrist.parameters` explains them."""

_ENDS = np.cumsum([math.prod(shape) for shape in FIELDS.values()])[:-1]

_NAMES = np.repeat(list(FIELDS), [math.prod(shape) for shape in FIELDS.values()])

_OF_TOOL = _NAMES == "centre"
"""Which of the numbers say where the tool is."""

_FAR = 0.1


@dataclasses.dataclass(frozen=True)
class KnownNumbers:
    """What is known of an arm while tracing.

    Attributes:
        entries: its numbers in the order of `FIELDS`; None where a number is not 0, 1 or -1.
        is_far: whether the wrist offset is more than a tenth of the shorter link, so that the
            condition is far from a sinusoid. A hint to what is sooner; no proof rests on it.
    """

    entries: tuple[float | None, ...]
    is_far: bool


def known_numbers_of(screws: np.ndarray) -> KnownNumbers | None:
    """The zeros and ones of an arm, whatever its tool is, from screws (n, 6); None of others."""
    if offset_wrist_arm(screws) is None:
        return None
    numbers = concrete_numbers(screws, np.zeros(3))
    entries = tuple(None if of_tool else x for x, of_tool in zip(_plain_numbers(numbers), _OF_TOOL))
    arm = dict(zip(FIELDS, np.split(numbers, _ENDS)))
    links = min(arm["upper_arm"][0], arm["forearm"][0])
    return KnownNumbers(entries, bool(arm["radius"][0] > _FAR * links))


def concrete_numbers(screws: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """`arm_numbers` of data, computed once for each arm."""
    return _concrete_numbers(*(np.asarray(x, float).tobytes() for x in (screws, tool)))


@functools.lru_cache(maxsize=256)
def _concrete_numbers(screws: bytes, tool: bytes) -> np.ndarray:
    numbers = arm_numbers(np.frombuffer(screws).reshape(-1, 6), np.frombuffer(tool), np)
    numbers.setflags(write=False)
    return numbers


def arm_numbers(screws: Any, tool: Any, xp: ModuleType) -> Any:
    """All numbers of an arm in one vector, from screws (6, 6) and the tool's position (3,) at home.

    `xp` is numpy or jax.numpy. At home the tool frame is turned as the space frame is. Axes that
    should meet and miss each other are taken to meet half-way between.
    """
    e1, e2, e3, e4, e5, e6 = screws[:, :3]
    shoulder = meeting_point(screws[0], screws[1], xp)
    wrist = meeting_point(screws[3], screws[4], xp)
    cos_lean = e1 @ e2
    sin_lean = xp.sqrt(1 - cos_lean**2)
    e = (e2 - cos_lean * e1) / sin_lean
    base = xp.stack([e, xp.cross(e1, e), e1])
    p1 = (e1 - cos_lean * e2) / sin_lean
    p2 = xp.cross(e2, p1)

    upper = -perpendicular_to(screws[2], shoulder, xp)
    upper = upper - (upper @ e2) * e2
    fore = wrist - shoulder - upper
    sideways = fore @ e2
    fore = fore - sideways * e2
    a, b = xp.sqrt(upper @ upper), xp.sqrt(fore @ fore)
    along = fore / b
    third = xp.cross(e2, along)
    on_forearm = xp.stack([e2, along, third])

    away = perpendicular_to(screws[5], wrist, xp)
    radius = xp.sqrt(away @ away)
    hand_side = e5 - (e5 @ e6) * e6
    # On a spherical wrist any spoke does.
    spherical = radius < ARM_NUMBER
    spoke = xp.where(spherical, hand_side, away)
    spoke = spoke / xp.sqrt(spoke @ spoke)
    radius = xp.where(spherical, 0.0, radius)

    cos_wrist = e4 @ e5
    bent_5 = e5 - cos_wrist * e4
    bent_5 = bent_5 / xp.sqrt(bent_5 @ bent_5)
    side_6 = e6 - (e6 @ e5) * e5
    side_6 = side_6 / xp.sqrt(side_6 @ side_6)
    frame = xp.stack([e4, e5, xp.cross(e4, e5)], axis=1)
    twist = xp.linalg.solve(frame, xp.stack([side_6, xp.cross(e5, side_6)], axis=1)).T

    fields = {
        "base": base,
        "shoulder": shoulder,
        "centre": wrist - xp.where(spherical, 0.0, 1.0) * away - tool,
        "spoke": spoke,
        "axis_6": e6,
        "radius": radius,
        "upper_arm": a,
        "forearm": b,
        "sideways": sideways,
        "shoulder_angle": xp.stack([cos_lean, sin_lean]),
        "axis_4": on_forearm @ e4,
        "axis_5": on_forearm @ bent_5,
        "hand": xp.stack([e5 @ e6, e5 @ spoke, e5 @ xp.cross(e6, spoke)]),
        "wrist_angle": cos_wrist,
        "twist": twist,
        "upper_arm_angle": xp.stack([upper @ p1, upper @ p2]) / a,
        "elbow_angle": xp.stack([upper @ fore, e2 @ xp.cross(upper, fore)]) / (a * b),
        "turn_3": xp.sign(e2 @ e3),
        "off": off_by(screws, xp) * (1.0 + 1.0 / xp.minimum(a, b)),
    }
    return xp.concatenate([xp.reshape(fields[name], (-1,)) for name in FIELDS])


def numbers_are_as_known(known: KnownNumbers, numbers: Any) -> Any:
    """Whether the numbers of a traced arm that are known are what they are taken for."""
    taken = [(i, x) for i, x in enumerate(known.entries) if x is not None]
    places, values = np.array([i for i, _ in taken]), np.array([x for _, x in taken])
    # What is off by anything is not what is exact.
    limit = np.where(_NAMES[places] == "off", AXES_EXACT, AXES_MEET.of(numbers.dtype))
    return (abs(numbers[places] - values) < limit).all()


def _plain_numbers(numbers: np.ndarray) -> tuple[float | None, ...]:
    """The zeros and ones among the numbers of an arm, up to rounding; None for the others."""
    rounded = np.round(numbers)
    plain = (np.abs(numbers - rounded) < ARM_NUMBER) & (np.abs(rounded) <= 1)
    return tuple(float(x) + 0.0 if simple else None for x, simple in zip(rounded, plain))


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
    if len(screws) != 6 or not is_offset_wrist(screws):
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
    if sine_between(w2, w3) > AXES_NEARLY_PARALLEL:
        return None
    if (
        min(sine_between(w1, w2), sine_between(w4, w5), sine_between(w5, w6))
        <= AXES_NEARLY_PARALLEL
    ):
        return None
    if max(distance_between(*screws[:2]), distance_between(*screws[3:5])) > AXES_NEARLY_MEET:
        return None
    shoulder, wrist = meeting_point(*screws[:2]), meeting_point(*screws[3:5])
    on_3 = axis_point(screws[2])
    elbow = on_3 + ((wrist - on_3) @ w3) * w3
    turned = np.where(np.arange(6)[:, None] == 2, np.sign(w2 @ w3) * w2, axes)
    return turned, np.stack([shoulder, shoulder, elbow, wrist, wrist, axis_point(screws[5])])
