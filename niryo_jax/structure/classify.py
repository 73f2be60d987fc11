"""Which closed form solves an arm, found from how its joint axes lie to each other, in numpy."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from niryo_jax.structure.axes import (
    AxisRelation,
    axis_point,
    joint_kinds,
    meeting_point,
    relation,
)
from niryo_jax.structure.families import (
    ClosedFormPlan,
    Family,
    Schoenflies,
    Shoulder,
    SphericalShoulderAndWrist,
    SphericalWrist,
    Surface,
    ThreeParallel,
    TwoTurnsTwoSlides,
)
from niryo_jax.structure.offset_wrist import nearly_offset_wrist_axes, offset_wrist_arm
from niryo_jax.tolerances import AXES_MEET, AXES_PARALLEL

_PARALLEL = (AxisRelation.PARALLEL, AxisRelation.COINCIDENT)


def closed_form_plans(screws: np.ndarray) -> tuple[ClosedFormPlan, ...]:
    """How an arm can be solved, from screws (n, 6); empty where no closed form does.

    An arm of seven joints has a plan for each joint that can be locked, first those that are
    commonly chosen: the third, then from the base on; and one by the arm angle if it has one.
    """
    kinds = joint_kinds(screws)
    periodic = tuple(kind == "revolute" for kind in kinds)
    if len(screws) != 7:
        family = _find(screws)
        return () if family is None else (ClosedFormPlan(family, None, periodic),)
    found: list[ClosedFormPlan] = []
    for joint in (2, 0, 1, 3, 4, 5, 6):
        family, other = (_find(lock(screws, joint, value)) for value in _GENERIC)
        if family is not None and family == other:
            others = periodic[:joint] + periodic[joint + 1 :]
            found.append(ClosedFormPlan(family, joint, others, periodic[joint]))
    if set(kinds) == {"revolute"} and _is_anthropomorphic(screws):
        found.append(ClosedFormPlan(SphericalShoulderAndWrist(), None, periodic))
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
    plans = closed_form_plans(screws)
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
