"""Whether a timed plan stays clear of the arm itself and of what stands around it.

Looked at along the trajectory, and along the ways between the stops that a Niryo is sent to: those
of its joints and those of its tool, whichever of its commands is used. What the gripper holds has
no shape here.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from niryo_jax.collision import CollisionCheck
from niryo_jax.execution.padding import filled_up
from niryo_jax.hardware.execution import Execution
from niryo_jax.hardware.plan_clearance import PlanClearance, of_steps, straight_way
from niryo_jax.motion import JointTrajectory
from niryo_jax.studies.sections import WITHIN, sections
from niryo_jax.studies.timed_plan import TimedPlan

Vector = NDArray[np.float64]

_ROWS = 4096
"""Joint vectors are looked at in multiples of this, so that programs are few."""


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
    found = check.distances(timed.plan.robot, filled_up(q, _ROWS))

    def place(at: int) -> tuple[str, float]:
        return f"at {time[at]:.2f} s of {timed.duration:.2f} s", float(time[at])

    return of_steps(timed.plan, check, found, step, place)


def _looked_at(timed: TimedPlan, within: float) -> tuple[Vector, Vector, NDArray[np.int64]]:
    """Times (m,), joint vectors (m, n) and the steps (m,) that they belong to."""
    time, q = (np.asarray(x) for x in timed.trajectory[:2])
    parts = [_between(time, q)]
    for section in sections(timed, within):
        begin, turned = timed.steps[section.first].begin, timed.plan.turned
        when = _Clock(section.trajectory, section.moves)
        ways = [straight_way(*ends) for ends in itertools.pairwise(section.moves.stops)]
        times = [when(leg, np.linspace(0.0, 1.0, len(way))) for leg, way in enumerate(ways)]
        parts.append((begin + np.concatenate(times), turned(np.concatenate(ways))))
        if section.lines is not None and section.on_lines is not None:
            when, legs = _Clock(section.trajectory, section.lines), len(section.lines.stops) - 1
            shares = np.linspace(0.0, 1.0, 1 + (len(section.on_lines) - 1) // legs)[1:]
            times = np.concatenate([when(leg, shares) for leg in range(legs)])
            parts.append(_between(begin + np.append(0.0, times), turned(section.on_lines)))
    ends = np.array([step.end for step in timed.steps])
    # Each step has its own end, steps that take no time too.
    parts.append((ends, q[[step.last for step in timed.steps]]))
    time, q = (np.concatenate(arrays) for arrays in zip(*parts))
    step = np.minimum(np.searchsorted(ends, time, side="left"), len(ends) - 1)
    step[-len(ends) :] = np.arange(len(ends))
    return time, q, step


def _between(time: Vector, q: Vector) -> tuple[Vector, Vector]:
    """Joints (k, n) at times (k,), with the straight ways between them filled in."""
    ways = [straight_way(*ends) for ends in itertools.pairwise(q)]
    both = zip(itertools.pairwise(time), ways)
    times = [np.linspace(start, end, len(way)) for (start, end), way in both]
    # A trajectory of one sample has no ways.
    return np.concatenate([time[:1], *times]), np.concatenate([q[:1], *ways])


class _Clock:
    """When a trajectory has done a share of the way between two of its stops."""

    def __init__(self, trajectory: JointTrajectory, sent: Execution) -> None:
        self._time, self._q = (np.asarray(x) for x in trajectory[:2])
        self._sent = sent

    def __call__(self, leg: int, share: Vector) -> Vector:
        stops, (start, end) = self._sent.stops[leg : leg + 2], self._sent.time[leg : leg + 2]
        inside = (start <= self._time) & (self._time <= end)
        way = stops[1] - stops[0]
        done = (self._q[inside] - stops[0]) @ way / (way @ way)
        return np.interp(share, np.maximum.accumulate(done), self._time[inside])
