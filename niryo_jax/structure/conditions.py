"""What must hold of an arm's axes for the formulas of a family to solve it.

Written once for numpy, which finds the family of a concrete arm, and for jax.numpy, which tells
inside a program whether a traced arm still is what the program takes it for.
"""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np

from niryo_jax.structure.axes import (
    are_parallel,
    distance_between,
    do_meet,
    is_prismatic,
    is_revolute,
    lock,
    meeting_point,
    perpendicular_to,
    sine_between,
)
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
from niryo_jax.tolerances import AXES_MEET, AXES_PARALLEL

GENERIC = (0.6180339887, -1.3247179572)
"""Values of a locked joint at which no accident makes axes parallel or meet."""

Holds = Any
"""A bool, or an array of one where the screws are traced."""


def plan_fits(plan: ClosedFormPlan, screws: Any, xp: ModuleType = np) -> Holds:
    """Whether an arm, given as screws (n, 6), is of the plan's family with its joint locked."""
    if plan.locked is None:
        return fits(plan.family, screws, xp)
    rest = (lock(screws, plan.locked, value, xp) for value in GENERIC)
    return _all((fits(plan.family, screws, xp) for screws in rest), xp)


def fits(family: Family, screws: Any, xp: ModuleType = np) -> Holds:
    """Whether an arm, given as screws (n, 6), is of a family."""
    if isinstance(family, SphericalWrist):
        conditions = _spherical_wrist(family, _ordered(screws, family.reverse), xp)
    elif isinstance(family, ThreeParallel):
        conditions = _three_parallel(family, _ordered(screws, family.reverse), xp)
    elif isinstance(family, Schoenflies):
        conditions = _schoenflies(family, screws, xp)
    elif isinstance(family, TwoTurnsTwoSlides):
        conditions = _two_turns_two_slides(family, screws, xp)
    elif isinstance(family, PlanarArm):
        conditions = _planar_arm(family, _ordered(screws, family.reverse), xp)
    else:
        conditions = _spherical_shoulder_and_wrist(family, screws, xp)
    return _all(conditions, xp)


def are_revolute(screws: Any, xp: ModuleType = np) -> Holds:
    """Whether all screws (n, 6) are those of revolute joints."""
    return _all((is_revolute(screw, xp) for screw in screws), xp)


def has_polynomial(screws: np.ndarray) -> bool:
    """Whether the polynomial of six revolute joints, screws (6, 6), tells anything.

    Where all neighbouring axes meet it vanishes for every way of elimination and every pose.
    """
    return not all(do_meet(*pair) for pair in itertools.pairwise(screws))


def is_offset_wrist(screws: Any, xp: ModuleType = np) -> Holds:
    """Whether axes 1 and 2 of six meet, 2 and 3 are parallel, 4 and 5 meet."""

    def conditions() -> Iterator[Holds]:
        yield from (is_revolute(screw, xp) for screw in screws)
        yield do_meet(screws[0], screws[1], xp)
        yield _parallel_and_apart(screws[1], screws[2], xp)
        yield do_meet(screws[3], screws[4], xp)
        yield ~are_parallel(screws[4], screws[5], xp)

    return _all(conditions(), xp)


def _all(conditions: Iterator[Holds], xp: ModuleType) -> Holds:
    """Whether all hold; in numpy no more are looked at than are needed."""
    return all(conditions) if xp is np else functools.reduce(operator.and_, conditions)


def _ordered(screws: Any, reverse: bool) -> Any:
    return screws[::-1] if reverse else screws


def _is_of_kind(screw: Any, kind: str, xp: ModuleType) -> Holds:
    return is_revolute(screw, xp) if kind == "revolute" else is_prismatic(screw, xp)


def _parallel_and_apart(first: Any, second: Any, xp: ModuleType) -> Holds:
    apart = distance_between(first, second, xp) >= AXES_MEET.of(first.dtype)
    return are_parallel(first, second, xp) & apart


def _spherical_wrist(family: SphericalWrist, screws: Any, xp: ModuleType) -> Iterator[Holds]:
    yield from _centre(screws[3:], xp)
    yield from _shoulder(family.shoulder, screws[:3], xp)


def _centre(screws: Any, xp: ModuleType) -> Iterator[Holds]:
    """Three axes meet, and neighbours are not parallel."""
    first, second, third = screws
    yield from (is_revolute(screw, xp) for screw in screws)
    yield do_meet(first, second, xp)
    yield do_meet(second, third, xp)
    apart = meeting_point(first, second, xp) - meeting_point(second, third, xp)
    yield xp.linalg.norm(apart) < AXES_MEET.of(screws.dtype)


def _shoulder(shoulder: Shoulder, screws: Any, xp: ModuleType) -> Iterator[Holds]:
    first, second, third = screws = _ordered(screws, shoulder.reverse)
    kinds = shoulder.kinds
    yield from (_is_of_kind(screw, kind, xp) for screw, kind in zip(screws, kinds))
    small = AXES_PARALLEL.of(screws.dtype)
    if shoulder.surface == "general":
        for a, b in itertools.pairwise(screws):
            apart = distance_between(a, b, xp) >= AXES_MEET.of(screws.dtype)
            yield ~are_parallel(a, b, xp) & apart
    elif shoulder.surface == "sphere":
        yield do_meet(second, third, xp)
        if kinds[0] == "revolute":
            centre = meeting_point(second, third, xp)
            yield _off(first, centre, xp) >= AXES_MEET.of(screws.dtype)
    else:
        pair = kinds[1:]
        if pair == ("revolute", "revolute"):
            normal = second[:3]
            yield _parallel_and_apart(second, third, xp)
        elif pair == ("prismatic", "prismatic"):
            normal = xp.cross(second[3:], third[3:])
            yield xp.linalg.norm(normal) > small
        else:
            turn, slide = (second, third) if pair[0] == "revolute" else (third, second)
            normal = turn[:3]
            yield abs(normal @ slide[3:]) < small
        if kinds[0] == "revolute":
            yield sine_between(first[:3], normal, xp) > small
        else:
            yield abs(first[3:] @ normal) > small


def _off(screw: Any, point: Any, xp: ModuleType) -> Any:
    return xp.linalg.norm(perpendicular_to(screw, point, xp))


def _three_parallel(family: ThreeParallel, screws: Any, xp: ModuleType) -> Iterator[Holds]:
    yield _is_of_kind(screws[0], family.kind, xp)
    yield from (is_revolute(screw, xp) for screw in screws[1:])
    yield from _turning_alike(screws[1:4], family.turns, xp)
    yield do_meet(screws[4], screws[5], xp)
    yield ~are_parallel(screws[3], screws[4], xp)
    normal, small = screws[1, :3], AXES_PARALLEL.of(screws.dtype)
    if family.kind == "revolute":
        yield sine_between(screws[0, :3], normal, xp) >= small
    else:
        yield abs(screws[0, 3:] @ normal) >= small


def _turning_alike(screws: Any, turns: tuple[int, ...], xp: ModuleType) -> Iterator[Holds]:
    """Parallel axes, none on its neighbour, that turn as is told."""
    yield from (_parallel_and_apart(a, b, xp) for a, b in itertools.pairwise(screws))
    yield from ((screws[0, :3] @ screw[:3]) * turn > 0 for screw, turn in zip(screws, turns))


def _schoenflies(family: Schoenflies, screws: Any, xp: ModuleType) -> Iterator[Holds]:
    slide = screws[family.slide]
    axes = screws[np.array([i for i in range(4) if i != family.slide])]
    yield is_prismatic(slide, xp)
    yield from (is_revolute(screw, xp) for screw in axes)
    across = sine_between(slide[3:], axes[0, :3], xp)
    yield across < AXES_PARALLEL.of(screws.dtype)
    yield from _turning_alike(axes, family.turns, xp)


def _two_turns_two_slides(
    family: TwoTurnsTwoSlides, screws: Any, xp: ModuleType
) -> Iterator[Holds]:
    (a, b), (c, d) = family.turns, family.slides
    yield from (is_revolute(screws[i], xp) for i in (a, b))
    yield from (is_prismatic(screws[i], xp) for i in (c, d))
    yield ~are_parallel(screws[a], screws[b], xp)
    if not any(c < turn < d for turn in (a, b)):
        across = sine_between(screws[c, 3:], screws[d, 3:], xp)
        yield across >= AXES_PARALLEL.of(screws.dtype)


def _planar_arm(family: PlanarArm, screws: Any, xp: ModuleType) -> Iterator[Holds]:
    yield from (is_revolute(screw, xp) for screw in screws)
    behind = 1 + len(family.turns)
    yield from _turning_alike(screws[1:behind], family.turns, xp)
    for screw in (screws[0], *screws[behind:]):
        yield ~are_parallel(screw, screws[1], xp)


def _spherical_shoulder_and_wrist(
    family: SphericalShoulderAndWrist, screws: Any, xp: ModuleType
) -> Iterator[Holds]:
    del family
    yield is_revolute(screws[3], xp)
    for three in (screws[:3], screws[4:]):
        yield from _centre(three, xp)
        centre = meeting_point(three[0], three[1], xp)
        yield _off(screws[3], centre, xp) > AXES_MEET.of(screws.dtype)
