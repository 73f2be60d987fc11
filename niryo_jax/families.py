"""Families of arms that closed forms solve, found from how the joint axes lie to each other.

What is found is static: it says which formulas of `niryo_jax.ik.closed_form` apply, not the numbers
in them. A solver may take a chain from its other end, since exp(S1 q1) ... exp(Sn qn) = T is solved
where exp(Sn (-qn)) ... exp(S1 (-q1)) = T^-1 is.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Literal

import numpy as np

from niryo_jax.structure import (
    AxisRelation,
    axis_point,
    joint_kinds,
    meeting_point,
    nearly_offset_wrist_axes,
    offset_wrist_arm,
    relation,
)
from niryo_jax.tolerances import AXES_MEET, AXES_PARALLEL

_PARALLEL = (AxisRelation.PARALLEL, AxisRelation.COINCIDENT)


Surface = Literal["plane", "sphere", "general"]


@dataclasses.dataclass(frozen=True)
class Shoulder:
    """Three joints that bring a point p to a point k: exp(S1 q1) exp(S2 q2) exp(S3 q3) p = k.

    Joints 2 and 3 keep p on a plane or on a sphere, which joint 1 must bring k to; or the axes are
    in general position, which takes the roots of a quartic.

    Attributes:
        kinds: the kinds of the joints, in the order in which they are solved.
        surface: on what the last two keep the point.
        reverse: whether they are solved from the other end, for exp(-S3 q3) ... k = p.
    """

    kinds: tuple[str, str, str]
    surface: Surface
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        first = self.kinds[0] == "revolute" or self.surface == "sphere"
        return first + ("revolute" in self.kinds[1:])


@dataclasses.dataclass(frozen=True)
class SphericalWrist:
    """Three axes at one end meet in a point, which the other three joints place.

    Attributes:
        shoulder: how they place it.
        reverse: whether the axes that meet are the first three.
    """

    shoulder: Shoulder
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return self.shoulder.signs + 1

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        where, others = ("1, 2, 3", "4, 5, 6") if self.reverse else ("4, 5, 6", "1, 2, 3")
        how = "axes in general position"
        if self.shoulder.surface != "general":
            how = f"two of them keep it on a {self.shoulder.surface}"
        return (
            f"axes {where} meet in one point, which joints {others} place ({how})",
            f"axes {where} in a plane, that point on another axis, joints {others} at the edge of "
            "what they reach",
        )


@dataclasses.dataclass(frozen=True)
class ThreeParallel:
    """Axes 2, 3 and 4 are parallel, 5 and 6 meet; or from the other end 3, 4, 5, and 1 and 2.

    Attributes:
        kind: the kind of the joint that is solved first.
        turns: 1 or -1 for each of the three: whether it points as the first of them does.
        reverse: whether they are counted from the other end.
    """

    kind: str
    turns: tuple[int, int, int]
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 2 + (self.kind == "revolute")

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        parallel, meeting = ("3, 4 and 5", "1 and 2") if self.reverse else ("2, 3 and 4", "5 and 6")
        last = "2" if self.reverse else "5"
        return (
            f"axes {parallel} are parallel, {meeting} meet",
            f"the axes {parallel} in a plane, axis {last} turned so that the one behind it is "
            "parallel to them, the far end on axis 1",
        )


@dataclasses.dataclass(frozen=True)
class Schoenflies:
    """Four joints: three parallel axes, and a slide along them (SCARA).

    Attributes:
        slide: the index of the slide.
        turns: 1 or -1 for each of the others: whether it points as the first of them does.
    """

    slide: int
    turns: tuple[int, int, int]

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 1

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        return (
            "three parallel axes and a slide along them; poses are turned about these axes only",
            "the three axes in a plane",
        )


@dataclasses.dataclass(frozen=True)
class TwoTurnsTwoSlides:
    """Four joints: two axes that are not parallel, and two slides, in any order.

    Attributes:
        turns: the indices of the axes.
        slides: the indices of the slides.
    """

    turns: tuple[int, int]
    slides: tuple[int, int]

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 0

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        return (
            "two axes that are not parallel, and two slides; four of the six coordinates of a pose",
            "the slides parallel to each other, the second axis parallel to the first",
        )


@dataclasses.dataclass(frozen=True)
class SphericalShoulderAndWrist:
    """Seven joints: axes 1, 2 and 3 meet in a point, 5, 6 and 7 in another, as in a human arm.

    What is left to choose is the arm angle (`niryo_jax.arm_angle`).
    """

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 3

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        return (
            "axes 1, 2, 3 meet in one point and 5, 6, 7 in another",
            "either three axes in a plane, the arm stretched, the wrist on axis 1",
        )


Family = (
    SphericalWrist | ThreeParallel | Schoenflies | TwoTurnsTwoSlides | SphericalShoulderAndWrist
)


@dataclasses.dataclass(frozen=True)
class Plan:
    """How an arm is solved in closed form.

    Attributes:
        family: the family of the arm, or of what is left of it.
        locked: the index of the joint that is to be locked; None where none is.
        periodic: True for each joint of what is left that returns to its place after 2 pi.
        locked_turns: the same of the joint that is locked.
    """

    family: Family
    locked: int | None
    periodic: tuple[bool, ...]
    locked_turns: bool = False

    @property
    def by_arm_angle(self) -> bool:
        """Whether an arm angle is to be given."""
        return isinstance(self.family, SphericalShoulderAndWrist)


def find(screws: np.ndarray) -> tuple[Plan, ...]:
    """How an arm can be solved, from screws (n, 6); empty where no closed form does.

    An arm of seven joints has a plan for each joint that can be locked, first those that are
    commonly chosen: the third, then from the base on; and one by the arm angle if it has one.
    """
    kinds = joint_kinds(screws)
    periodic = tuple(kind == "revolute" for kind in kinds)
    if len(screws) != 7:
        family = _find(screws)
        return () if family is None else (Plan(family, None, periodic),)
    found: list[Plan] = []
    for joint in (2, 0, 1, 3, 4, 5, 6):
        family, other = (_find(lock(screws, joint, value)) for value in _GENERIC)
        if family is not None and family == other:
            others = periodic[:joint] + periodic[joint + 1 :]
            found.append(Plan(family, joint, others, periodic[joint]))
    if set(kinds) == {"revolute"} and _is_anthropomorphic(screws):
        found.append(Plan(SphericalShoulderAndWrist(), None, periodic))
    return tuple(found)


_GENERIC = (0.6180339887, -1.3247179572)
"""Values of a locked joint at which no accident makes axes parallel or meet."""


def _find(screws: np.ndarray) -> Family | None:
    kinds = joint_kinds(screws)
    if "helical" in kinds:
        return None
    if len(screws) == 4:
        return _schoenflies(screws, kinds) or _two_turns_two_slides(screws, kinds)
    if len(screws) != 6:
        return None
    for reverse in (False, True):
        ordered, its_kinds = (screws[::-1], kinds[::-1]) if reverse else (screws, kinds)
        found = _spherical_wrist(ordered, its_kinds, reverse)
        found = found or _three_parallel(ordered, its_kinds, reverse)
        if found is not None:
            return found
    return None


def lock(screws: np.ndarray, joint: int, value: float) -> np.ndarray:
    """The screws (n - 1, 6) of the arm that is left where one joint stays at a value."""
    w, v = screws[joint, :3], screws[joint, 3:]
    if not np.any(w):
        rotation, position = np.eye(3), value * v
    else:
        hat = np.cross(np.eye(3), w)
        rotation = np.eye(3) + np.sin(value) * hat + (1 - np.cos(value)) * hat @ hat
        along = (w @ v) * w
        position = (np.eye(3) - rotation) @ np.cross(w, v) + value * along
    after = screws[joint + 1 :]
    turned, shifted = after[:, :3] @ rotation.T, after[:, 3:] @ rotation.T
    moved = np.concatenate([turned, shifted + np.cross(position, turned)], axis=1)
    return np.concatenate([screws[:joint], moved])


def _spherical_wrist(
    screws: np.ndarray, kinds: Sequence[str], reverse: bool
) -> SphericalWrist | None:
    if set(kinds[3:]) != {"revolute"} or _centre(screws[3:]) is None:
        return None
    shoulder = _shoulder(screws[:3], kinds[:3])
    return None if shoulder is None else SphericalWrist(shoulder, reverse)


def _centre(screws: np.ndarray) -> np.ndarray | None:
    """Where three axes meet, if they do and neighbours are not parallel."""
    first, second, third = screws
    for pair in ((first, second), (second, third)):
        if relation(*pair) is not AxisRelation.INTERSECTING:
            return None
    point = meeting_point(first, second)
    return point if np.linalg.norm(point - meeting_point(second, third)) < AXES_MEET else None


def _is_anthropomorphic(screws: np.ndarray) -> bool:
    centres = _centre(screws[:3]), _centre(screws[4:])
    return all(point is not None and _off(screws[3], point) > AXES_MEET for point in centres)


def _shoulder(screws: np.ndarray, kinds: Sequence[str]) -> Shoulder | None:
    for reverse in (False, True):
        ordered, its_kinds = (screws[::-1], kinds[::-1]) if reverse else (screws, kinds)
        surface = _surface(ordered, its_kinds)
        if surface is not None:
            first, second, third = its_kinds
            return Shoulder((first, second, third), surface, reverse)
    skew = set(kinds) == {"revolute"} and all(
        relation(a, b) is AxisRelation.SKEW for a, b in itertools.pairwise(screws)
    )
    return Shoulder(("revolute", "revolute", "revolute"), "general", False) if skew else None


def _surface(screws: np.ndarray, kinds: Sequence[str]) -> Surface | None:
    """On what joints 2 and 3 keep every point, if joint 1 can bring another one there."""
    first, second, third = screws
    pair = kinds[1], kinds[2]
    if pair == ("revolute", "revolute"):
        how = relation(second, third)
        if how is AxisRelation.INTERSECTING:
            centre = meeting_point(second, third)
            on_axis = kinds[0] == "revolute" and _off(first, centre) < AXES_MEET
            return None if on_axis else "sphere"
        normal = second[:3] if how is AxisRelation.PARALLEL else None
    elif pair == ("prismatic", "prismatic"):
        normal = np.cross(second[3:], third[3:])
        normal = normal if np.linalg.norm(normal) > AXES_PARALLEL else None
    else:
        turn, slide = (second, third) if kinds[1] == "revolute" else (third, second)
        normal = turn[:3] if abs(turn[:3] @ slide[3:]) < AXES_PARALLEL else None
    if normal is None:
        return None
    if kinds[0] == "revolute":
        leaves = np.linalg.norm(np.cross(first[:3], normal)) > AXES_PARALLEL
    else:
        leaves = abs(first[3:] @ normal) > AXES_PARALLEL
    return "plane" if leaves else None


def _off(screw: np.ndarray, point: np.ndarray) -> float:
    return float(np.linalg.norm(np.cross(screw[:3], point - axis_point(screw))))


def _turns(screws: np.ndarray) -> tuple[int, int, int]:
    a, b, c = (1 if screws[0, :3] @ screw[:3] > 0 else -1 for screw in screws)
    return a, b, c


def _three_parallel(
    screws: np.ndarray, kinds: Sequence[str], reverse: bool
) -> ThreeParallel | None:
    if set(kinds[1:]) != {"revolute"} or not _all_parallel_and_apart(screws[1:4]):
        return None
    if relation(screws[4], screws[5]) is not AxisRelation.INTERSECTING:
        return None
    normal = screws[1, :3]
    if relation(screws[3], screws[4]) in _PARALLEL:
        return None
    across = screws[0, 3:] @ normal if kinds[0] == "prismatic" else 0.0
    if kinds[0] == "revolute":
        across = np.linalg.norm(np.cross(screws[0, :3], normal))
    if abs(across) < AXES_PARALLEL:
        return None
    return ThreeParallel(kinds[0], _turns(screws[1:4]), reverse)


def _all_parallel_and_apart(screws: np.ndarray) -> bool:
    first, second, third = screws
    return (
        relation(first, second) is AxisRelation.PARALLEL
        and relation(second, third) is AxisRelation.PARALLEL
    )


def _schoenflies(screws: np.ndarray, kinds: Sequence[str]) -> Schoenflies | None:
    if sorted(kinds) != ["prismatic", "revolute", "revolute", "revolute"]:
        return None
    slide = list(kinds).index("prismatic")
    axes = np.delete(screws, slide, axis=0)
    along = np.linalg.norm(np.cross(screws[slide, 3:], axes[0, :3])) < AXES_PARALLEL
    if not along or not _all_parallel_and_apart(axes):
        return None
    return Schoenflies(slide, _turns(axes))


def _two_turns_two_slides(screws: np.ndarray, kinds: Sequence[str]) -> TwoTurnsTwoSlides | None:
    if sorted(kinds) != ["prismatic", "prismatic", "revolute", "revolute"]:
        return None
    a, b = (i for i, kind in enumerate(kinds) if kind == "revolute")
    c, d = (i for i, kind in enumerate(kinds) if kind == "prismatic")
    if relation(screws[a], screws[b]) in _PARALLEL:
        return None
    between = any(c < turn < d for turn in (a, b))
    if not between and np.linalg.norm(np.cross(screws[c, 3:], screws[d, 3:])) < AXES_PARALLEL:
        return None
    return TwoTurnsTwoSlides((a, b), (c, d))


def describe(screws: np.ndarray) -> list[str]:
    """The family of an arm, its solver, the solutions to expect, and its singularities."""
    plans = find(screws)
    arm = offset_wrist_arm(screws)
    spherical = arm is not None and np.linalg.norm(arm.offset) < AXES_MEET
    if arm is not None and (spherical or not plans):
        offset = float(np.linalg.norm(arm.offset)) * 1e3
        family = "1 and 2 meet, 2 parallel to 3, 4 and 5 meet; "
        family += "spherical wrist" if spherical else f"wrist offset {offset:.4g} mm"
        how = "every solution, in closed form, at most 8"
        singular = "the wrist on axis 1, the arm stretched or folded, axes 4 and 6 aligned"
        if not spherical:
            how = "every solution, with a proof that there is no other; mostly 4 to 8, at most 16"
            singular = "the wrist on axis 1, the arm stretched or folded, two solutions merging"
    elif plans:
        family, singular = plans[0].family.describe()
        most = 2 ** plans[0].family.signs
        how = f"every solution, in closed form, at most {most}"
        joints = [plan.locked + 1 for plan in plans if plan.locked is not None]
        if joints:
            family = f"with joint {joints[0]} locked and the others renumbered, {family}"
            how += f" for each value of a locked joint (one of {joints})"
            how += " or each arm angle" * plans[-1].by_arm_angle
    elif nearly_offset_wrist_axes(screws) is not None:
        return [
            "family: nearly 1 and 2 meet, 2 parallel to 3, 4 and 5 meet",
            "inverse kinematics: from all solutions of the nearest such arm; not proved",
        ]
    else:
        return ["inverse kinematics: Newton-Raphson from many guesses; some may be missed"]
    return [f"family: {family}", f"inverse kinematics: {how}", f"singularities: {singular}"]
