"""The numbers of an offset-wrist arm: what its complete inverse kinematics is written in.

Such an arm has six revolute joints of which axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet.
The letters are those of docs/theory/complete-ik.md. The base frame has its origin in the shoulder
and the axes (e, e1 x e, e1), with e the part of e2 at right angles to e1. P1 and P2 = e2 x P1 span
the plane of upper arm and forearm, P1 being the part of e1 in it.
"""

from __future__ import annotations

import functools
from types import ModuleType
from typing import Any

import numpy as np

from niryo_jax.structure import meeting_point, offset_wrist_arm, perpendicular_to
from niryo_jax.tolerances import ARM_NUMBER

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
    "lean": (2,),
    "axis_4": (3,),
    "axis_5": (3,),
    "hand": (3,),
    "wrist_angle": (),
    "twist": (2, 3),
    "raised": (2,),
    "bent": (2,),
    "turn_3": (),
}
"""Name and shape of the numbers, in their order; `niryo_jax.ik.arm.Arm` says what they are."""

Known = tuple[float | None, ...]
"""The numbers of an arm in the order of its fields; None where a number is not 0, 1 or -1."""


def find(screws: np.ndarray, home: np.ndarray) -> Known | None:
    """The zeros and ones of an arm, from screws (n, 6) and home (4, 4); None of another arm."""
    if offset_wrist_arm(screws) is None:
        return None
    return known_numbers(concrete_numbers(screws, home))


def concrete_numbers(screws: np.ndarray, home: np.ndarray) -> np.ndarray:
    """`arm_numbers` of data, computed once for each arm."""
    return _concrete_numbers(*(np.asarray(x, float).tobytes() for x in (screws, home)))


@functools.lru_cache(maxsize=256)
def _concrete_numbers(screws: bytes, home: bytes) -> np.ndarray:
    numbers = arm_numbers(
        np.frombuffer(screws).reshape(-1, 6), np.frombuffer(home).reshape(4, 4), np
    )
    numbers.setflags(write=False)
    return numbers


def arm_numbers(screws: Any, home: Any, xp: ModuleType) -> Any:
    """All numbers of an arm in one vector, from screws (6, 6) and home pose (4, 4).

    `xp` is numpy or jax.numpy. Axes that should meet and miss each other are taken to meet half-way
    between.
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
    rotation, position = home[:3, :3], home[:3, 3]

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
        "centre": rotation.T @ (wrist - xp.where(spherical, 0.0, 1.0) * away - position),
        "spoke": rotation.T @ spoke,
        "axis_6": rotation.T @ e6,
        "radius": radius,
        "upper_arm": a,
        "forearm": b,
        "sideways": sideways,
        "lean": xp.stack([cos_lean, sin_lean]),
        "axis_4": on_forearm @ e4,
        "axis_5": on_forearm @ bent_5,
        "hand": xp.stack([e5 @ e6, e5 @ spoke, e5 @ xp.cross(e6, spoke)]),
        "wrist_angle": cos_wrist,
        "twist": twist,
        "raised": xp.stack([upper @ p1, upper @ p2]) / a,
        "bent": xp.stack([upper @ fore, e2 @ xp.cross(upper, fore)]) / (a * b),
        "turn_3": xp.sign(e2 @ e3),
    }
    return xp.concatenate([xp.reshape(fields[name], (-1,)) for name in FIELDS])


def known_numbers(numbers: np.ndarray) -> Known:
    """The zeros and ones among the numbers of an arm, up to rounding; None for the others."""
    rounded = np.round(numbers)
    plain = (np.abs(numbers - rounded) < ARM_NUMBER) & (np.abs(rounded) <= 1)
    return tuple(float(x) + 0.0 if simple else None for x, simple in zip(rounded, plain))


def is_spherical(known: Known) -> bool:
    """Whether axes 4, 5 and 6 of an arm meet in one point."""
    sizes = [int(np.prod(shape)) for shape in FIELDS.values()]
    return known[sum(sizes[: list(FIELDS).index("radius")])] == 0.0
