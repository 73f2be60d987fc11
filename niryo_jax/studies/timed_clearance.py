"""Whether a timed plan stays clear of the arm itself and of what stands around it.

Looked at along the trajectory, and along the ways between the stops that a Niryo is sent to: those
of its joints and those of its tool, whichever of its commands is used. What the gripper holds has
no shape here.
"""

from __future__ import annotations

import itertools

import jax
import numpy as np
from numpy.typing import NDArray

from niryo_jax.collision import CollisionCheck
from niryo_jax.hardware.plan_clearance import PlanClearance, refusal, straight_way
from niryo_jax.studies.sections import WITHIN, sections
from niryo_jax.studies.timed_plan import TimedPlan

Vector = NDArray[np.float64]


def check_timed(
    timed: TimedPlan, check: CollisionCheck, *, within: float = WITHIN
) -> PlanClearance:
    """Look at a whole timed plan as it is executed, and refuse one that collides.

    The way from where the arm stands to the start is for `plan_clearance.check_approach`.

    Args:
        timed: the plan.
        check: what the arm has to stay clear of.
        within: as for `execute_timed`.

    Returns:
        The least clearance of each step; of the first, where the arm then stands.

    Raises:
        StepCollides: naming the first step that comes nearer than the margin, the two that do, by
            how much they penetrate, and when.
        TargetRejected: the trajectory is none for this arm (`NiryoArm.execute`).
        ValueError: the model has links that the arm does not.
    """
    time, q, step = _looked_at(timed, within)
    found = jax.device_get(check.distances(timed.plan.robot, q))
    count = len(timed.steps)
    if not found.pairs:
        return PlanClearance(np.full(count, np.inf), (("", ""),) * count, len(q))
    least = np.min(found.distance, axis=-1)
    clearance, pairs = np.empty(count), list[tuple[str, str]]()
    for number in range(count):
        own = np.flatnonzero(step == number)
        at = int(own[np.argmin(least[own])])
        clearance[number], pair = least[at], found.nearest_pair(at)
        pairs.append(pair)
        if not least[at] > check.margin:
            when = float(time[at])
            where = f"at {when:.2f} s of {timed.duration:.2f} s"
            raise refusal(timed.plan, check, number, pair, float(least[at]), where, when)
    return PlanClearance(clearance, tuple(pairs), len(least))


def _looked_at(timed: TimedPlan, within: float) -> tuple[Vector, Vector, NDArray[np.int64]]:
    """Times (m,), joint vectors (m, n) and the steps (m,) that they belong to."""
    whole, turned = timed.trajectory, timed.plan.turned
    parts = [_between(np.asarray(whole.time), np.asarray(whole.q))]
    for section in sections(timed, within):
        begin = timed.steps[section.first].begin
        parts.append(_between(begin + section.moves.time, turned(section.moves.stops)))
        if section.lines is not None and section.on_lines is not None:
            number = np.linspace(0, len(section.lines.time) - 1, len(section.on_lines))
            times = np.interp(number, np.arange(len(section.lines.time)), section.lines.time)
            parts.append(_between(begin + times, turned(section.on_lines)))
    time, q = (np.concatenate(arrays) for arrays in zip(*parts))
    ends = np.array([step.end for step in timed.steps])
    step = np.minimum(np.searchsorted(ends, time, side="left"), len(ends) - 1)
    # Each step has its own end, steps that take no time too.
    lasts = [step.last for step in timed.steps]
    time = np.concatenate([time, ends])
    q = np.concatenate([q, np.asarray(whole.q)[lasts]])
    return time, q, np.concatenate([step, np.arange(len(ends))])


def _between(time: Vector, q: Vector) -> tuple[Vector, Vector]:
    """Joints (k, n) at times (k,), with the straight ways between them filled in."""
    ways = [straight_way(*ends) for ends in itertools.pairwise(q)]
    times = [
        np.linspace(start, end, len(way))
        for (start, end), way in zip(itertools.pairwise(time), ways)
    ]
    # A trajectory of one sample has no ways.
    return np.concatenate([time[:1], *times]), np.concatenate([q[:1], *ways])
