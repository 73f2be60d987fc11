"""Whether a plan stays clear of the arm itself and of what stands around it.

Looked at along straight ways between joint vectors, which is how the robot moves, before anything
is sent. What the gripper holds has no shape here.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import jax
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from niryo_jax.collision import CollisionCheck, Distances
from niryo_jax.hardware.errors import NiryoError
from niryo_jax.hardware.pick_and_place import Plan

Vector = NDArray[np.float64]

SPACING = 0.002
"""Radians, summed over the joints, between two samples of a way: no point of a Niryo, which reaches
0.6 m, moves by more than 1.2 mm from one to the next."""

_SAME = 1e-9
"""Metres by which rounding may set apart what is equally near."""


class StepCollides(NiryoError):
    """The way of a step collides, or comes nearer than the margin; nothing of it was sent.

    Attributes:
        step: its number, from 1; 1 too where the way there from where the arm stands collides.
        pair: the names of the two that come nearest.
        distance: metres between them; negative where they penetrate.
        time: seconds from the start of a timed trajectory; None of a plan without times.
    """

    def __init__(
        self,
        message: str,
        step: int,
        pair: tuple[str, str],
        distance: float,
        time: float | None = None,
    ) -> None:
        super().__init__(message)
        self.step = step
        self.pair = pair
        self.distance = distance
        self.time = time


@dataclasses.dataclass(frozen=True)
class PlanClearance:
    """How clear the ways of a plan are.

    Attributes:
        clearance: (steps,) metres, the least along the way of each step to its end; of the first,
            and of steps that are no moves, where the arm then stands.
        pairs: what comes nearest on each of them; empty names where there is nothing to look at.
        samples: how many joint vectors were looked at.
    """

    clearance: Vector
    pairs: tuple[tuple[str, str], ...]
    samples: int

    @property
    def tightest(self) -> int:
        """The index of the step of least clearance, the first of them where several are."""
        return int(np.argmax(self.clearance <= np.min(self.clearance) + _SAME))


def check_plan(
    plan: Plan, check: CollisionCheck, q_start: ArrayLike | None = None
) -> PlanClearance:
    """Look at all ways of a plan, and refuse one that collides.

    Args:
        plan: the steps, solved.
        check: what the arm has to stay clear of.
        q_start: (n,) joints from which the first step is taken, radians; where not given, the arm
            is looked at where it stands after that step.

    Returns:
        The least clearance of each step.

    Raises:
        StepCollides: naming the first step that comes nearer than the margin, the two that do, and
            by how much they penetrate.
        ValueError: the model has links that the arm does not.
    """
    stops = [planned.joints for planned in plan.steps]
    first = stops[0] if q_start is None else np.asarray(q_start, np.float64)
    ways = [straight_way(*ends) for ends in itertools.pairwise([first, *stops])]
    shares = np.concatenate([np.linspace(0.0, 100.0, len(way)) for way in ways])
    step = np.repeat(np.arange(len(ways)), [len(way) for way in ways])
    found = check.distances(plan.robot, np.concatenate(ways))
    return of_steps(plan, check, found, step, lambda at: (f"{shares[at]:.0f} % of the way", None))


def of_steps(
    plan: Plan,
    check: CollisionCheck,
    found: Distances,
    step: NDArray[np.int64],
    place: Callable[[int], tuple[str, float | None]],
) -> PlanClearance:
    """The least clearance of each step of a plan.

    Args:
        plan: the steps.
        check: what the arm has to stay clear of.
        found: distances at joint vectors (m, n) or more, of which the first m count.
        step: (m,) the index of the step that each belongs to; each step has some.
        place: where on the way that is, in words, and in seconds where the plan has times.

    Raises:
        StepCollides: naming the first step that comes nearer than the margin.
    """
    found, count = jax.device_get(found), len(plan.steps)
    if not found.pairs:
        return PlanClearance(np.full(count, np.inf), (("", ""),) * count, len(step))
    least = np.min(found.distance, axis=-1)[: len(step)]
    clearance, pairs = np.empty(count), list[tuple[str, str]]()
    for number in range(count):
        own = np.flatnonzero(step == number)
        at = int(own[np.argmin(least[own])])
        clearance[number], pair = least[at], found.nearest_pair(at)
        pairs.append(pair)
        if not least[at] > check.margin:
            raise _refusal(plan, check, number, pair, float(least[at]), *place(at))
    return PlanClearance(clearance, tuple(pairs), len(step))


def check_approach(plan: Plan, check: CollisionCheck, q: ArrayLike) -> None:
    """Look at the way from where the arm stands to the first step of a plan.

    Args:
        plan, check: as for `check_plan`.
        q: (n,) the joints where it stands, radians.

    Raises:
        StepCollides, ValueError: as `check_plan`.
    """
    check_plan(dataclasses.replace(plan, steps=plan.steps[:1]), check, q)


def straight_way(start: Vector, end: Vector) -> Vector:
    """(k, n) joint vectors along the straight way, both ends included."""
    count = 1 + int(np.ceil(np.sum(np.abs(end - start)) / SPACING))
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


def _refusal(
    plan: Plan,
    check: CollisionCheck,
    number: int,
    pair: tuple[str, str],
    distance: float,
    where: str,
    time: float | None,
) -> StepCollides:
    """The error of a step, by its index, that comes too near: so much, `where` on its way."""
    title = plan.steps[number].step.title
    if distance < 0:
        how = f"penetrate by {-1e3 * distance:.1f} mm"
    else:
        how = f"come as near as {1e3 * distance:.1f} mm (margin {1e3 * check.margin:.1f} mm)"
    return StepCollides(
        f"step {number + 1} ({title}) of {plan.robot.name}: {pair[0]} and {pair[1]} {how}, "
        f"{where}; nothing of it was sent",
        number + 1,
        pair,
        distance,
        time,
    )
