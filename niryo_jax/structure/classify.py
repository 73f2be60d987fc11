"""Which closed form solves an arm, found from how its joint axes lie to each other, in numpy."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from niryo_jax.structure.axes import joint_kinds, lock
from niryo_jax.structure.closure import ByClosure
from niryo_jax.structure.conditions import GENERIC, fits, has_polynomial
from niryo_jax.structure.families import (
    ClosedFormPlan,
    Family,
    PlanarArm,
    Schoenflies,
    Shoulder,
    SphericalShoulderAndWrist,
    SphericalWrist,
    ThreeParallel,
    TwoTurnsTwoSlides,
)
from niryo_jax.structure.offset_wrist import (
    KnownNumbers,
    known_numbers_of,
    nearly_offset_wrist_axes,
    offset_wrist_arm,
)
from niryo_jax.structure.rounding import concrete_off_by
from niryo_jax.tolerances import AXES_MEET

_POSTURES = 64


class Structure(NamedTuple):
    """What is known of an arm from how its axes lie.

    Attributes:
        offset_wrist: which numbers of an offset-wrist arm are 0, 1 or -1; None of other arms.
        plans: how it can be solved in closed form.
        general: how it can be solved by the roots of one polynomial: an arm of six revolute joints
            that is of none of these kinds, and one of seven by locking the first or the last.
    """

    offset_wrist: KnownNumbers | None
    plans: tuple[ClosedFormPlan, ...]
    general: tuple[ByClosure, ...] = ()


def structure_of(screws: Any) -> Structure:
    """The structure of an arm, from concrete screws (n, 6); found once for each arm.

    Screws in float32 are looked at as such: axes meet and are parallel to within its rounding.
    """
    screws = np.asarray(screws)
    dtype = np.float32 if screws.dtype.itemsize < 8 else np.float64
    return _structure_of(screws.astype(dtype).tobytes(), screws.shape, dtype)


@functools.lru_cache(maxsize=256)
def _structure_of(numbers: bytes, shape: tuple[int, ...], dtype: type) -> Structure:
    screws = np.frombuffer(numbers, dtype).reshape(shape)
    exact = concrete_off_by(screws) == 0
    plans = closed_form_plans(screws)
    plans = tuple(dataclasses.replace(plan, is_exact=exact) for plan in plans)
    known = known_numbers_of(screws)
    ways = tuple[ByClosure, ...]()
    if set(joint_kinds(screws)) == {"revolute"}:
        if len(screws) == 6 and known is None and not plans:
            ways = (ByClosure(),)
        elif len(screws) == 7:
            ways = tuple(ByClosure(joint) for joint in _by_self_motion(screws) if joint in (0, 6))
    return Structure(known, plans, tuple(way for way in ways if has_polynomial(way.left(screws))))


def closed_form_plans(screws: np.ndarray) -> tuple[ClosedFormPlan, ...]:
    """How an arm can be solved, from screws (n, 6); empty where no closed form does.

    An arm of seven joints has a plan for each joint that can be locked, first those that turn most
    while the tool rests; and one by the arm angle if it has one.
    """
    kinds = joint_kinds(screws)
    periodic = tuple(kind == "revolute" for kind in kinds)
    if len(screws) != 7:
        family = _find(screws)
        return () if family is None else (ClosedFormPlan(family, None, periodic),)
    found = dict[int, ClosedFormPlan]()
    for joint in range(7):
        family, other = (_find(lock(screws, joint, value)) for value in GENERIC)
        if family is not None and family == other:
            others = periodic[:joint] + periodic[joint + 1 :]
            found[joint] = ClosedFormPlan(family, joint, others, periodic[joint])
    plans = [found[joint] for joint in _by_self_motion(screws) if joint in found] if found else []
    if fits(SphericalShoulderAndWrist(), screws):
        plans.append(ClosedFormPlan(SphericalShoulderAndWrist(), None, periodic))
    return tuple(plans)


def _by_self_motion(screws: np.ndarray) -> list[int]:
    """The joints of an arm of seven, first those that turn most while the tool rests.

    What a pose leaves free is spread over the values of these; a joint that the pose nearly fixes
    has values at which nothing is found. Judged by where they hardly turn, at random postures.
    """
    moves = list[np.ndarray]()
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, len(screws))):
        rest, columns = screws.astype(float), list[np.ndarray]()
        for value in q:
            columns.append(rest[0])
            rest = lock(rest, 0, value)
        moves.append(np.abs(np.linalg.svd(np.stack(columns, axis=1))[2][-1]))
    return np.argsort(-np.quantile(moves, 0.25, axis=0), kind="stable").tolist()


def _find(screws: np.ndarray) -> Family | None:
    """The first family that an arm is of."""
    return next((family for family in _possible(screws) if fits(family, screws)), None)


def _possible(screws: np.ndarray) -> Iterator[Family]:
    """The families that joints of these kinds could make, those that are sooner solved first."""
    kinds = joint_kinds(screws)
    if "helical" in kinds:
        return
    slides = [i for i, kind in enumerate(kinds) if kind == "prismatic"]
    turns = [i for i, kind in enumerate(kinds) if kind == "revolute"]
    if len(screws) == 4 and len(slides) == 1:
        yield Schoenflies(slides[0], _turns(screws[turns]))
    elif len(screws) == 4 and len(slides) == 2:
        yield TwoTurnsTwoSlides((turns[0], turns[1]), (slides[0], slides[1]))
    elif len(screws) < 6 and not slides:
        yield from _planar_arms(screws)
    elif len(screws) == 6:
        for reverse in (False, True):
            ordered, its_kinds = (screws[::-1], kinds[::-1]) if reverse else (screws, kinds)
            if set(its_kinds[3:]) == {"revolute"}:
                yield from (SphericalWrist(shoulder, reverse) for shoulder in _shoulders(its_kinds))
            if set(its_kinds[1:]) == {"revolute"}:
                yield ThreeParallel(its_kinds[0], _turns(ordered[1:4]), reverse)


def _shoulders(kinds: Sequence[str]) -> Iterator[Shoulder]:
    for reverse in (False, True):
        first, second, third = kinds[2::-1] if reverse else kinds[:3]
        if second == third == "revolute":
            yield Shoulder((first, second, third), "sphere", reverse)
        yield Shoulder((first, second, third), "plane", reverse)
    if set(kinds[:3]) == {"revolute"}:
        yield Shoulder(("revolute", "revolute", "revolute"), "general", False)


def _planar_arms(screws: np.ndarray) -> Iterator[PlanarArm]:
    for parallel, roll in itertools.product((3, 2), (False, True)):
        if len(screws) == 1 + parallel + roll:
            # With a roll the arm looks the same from its other end.
            for reverse in (False,) if roll else (False, True):
                ordered = screws[::-1] if reverse else screws
                yield PlanarArm(_turns(ordered[1 : 1 + parallel]), roll, reverse)


def _turns(screws: np.ndarray) -> tuple[int, ...]:
    return tuple(1 if screws[0, :3] @ screw[:3] > 0 else -1 for screw in screws)


def describe(screws: np.ndarray) -> list[str]:
    """The family of an arm, its solver, the solutions to expect, and its singularities."""
    plans = closed_form_plans(screws)
    arm = offset_wrist_arm(screws)
    spherical = arm is not None and np.linalg.norm(arm.offset) < AXES_MEET.of(screws.dtype)
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
        joints = [plan.locked for plan in plans if plan.locked is not None]
        if joints:
            family = f"without axis {joints[0] + 1} and the others renumbered, {family}"
            known = ", ".join(map(str, sorted(joints)))
            how += f" for each value of a locked joint (its index, counted from 0, one of {known})"
            how += " or each arm angle" * plans[-1].by_arm_angle
    elif joint_kinds(screws) == ("revolute",) * 6 and has_polynomial(screws):
        family = "six revolute joints of no special geometry"
        if nearly_offset_wrist_axes(screws) is not None:
            family = "nearly 1 and 2 meet, 2 parallel to 3, 4 and 5 meet"
        how = "every solution, from the roots of one polynomial, mostly with a proof; at most 16"
        singular = "two solutions merging"
    else:
        return ["inverse kinematics: Newton-Raphson from many guesses; some may be missed"]
    return [f"family: {family}", f"inverse kinematics: {how}", f"singularities: {singular}"]
