"""A timed plan, carried out by an arm."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware import Execution, ExecutionAborted
from niryo_jax.hardware.execution import By, Progress, TimedJoints
from niryo_jax.hardware.pick_and_place import Arm, PlannedStep, position_error
from niryo_jax.studies.sections import WITHIN, sections
from niryo_jax.studies.timed_plan import TimedPlan, TimedStep

Vector = NDArray[np.float64]


class TimedArm(Arm, Protocol):
    """What a timed plan needs of an arm; `NiryoArm` has it."""

    def execute(
        self,
        trajectory: TimedJoints,
        *,
        by: By | None = ...,
        within: float = ...,
        keep_time: bool = ...,
        progress: Progress | None = ...,
    ) -> Execution: ...


@dataclasses.dataclass(frozen=True)
class TimedRecord:
    """What became of one step of a timed plan.

    Attributes:
        planned: the step as planned.
        timed: when it was to begin and to end.
        reached: (n,) joint angles read back at its end, radians, gear errors aside; None where the
            arm went on without a halt, so that nothing was read.
        position_error: metres from the target to forward kinematics of `reached`; None where
            nothing was read, and of a step that is no move.
        end: seconds from the start of the trajectory to when it was done; None where not read.
    """

    planned: PlannedStep
    timed: TimedStep
    reached: Vector | None
    position_error: float | None
    end: float | None

    @property
    def late(self) -> float | None:
        """Seconds by which it was done after its time; None where not read."""
        return None if self.end is None else self.end - self.timed.end


def execute_timed(
    timed: TimedPlan,
    arm: TimedArm,
    on_step: Callable[[TimedRecord], None] = lambda record: None,
    *,
    within: float = WITHIN,
    keep_time: bool = True,
    progress: Progress | None = None,
) -> tuple[TimedRecord, ...]:
    """Move an arm to the start of a timed plan, carry the plan out and record what the arm did.

    Each of its `sections` is one `NiryoArm.execute`; the gripper acts in between, and the arm
    rests until the time of the next motion. Where it is late, it goes on at once.

    Args:
        timed: the plan.
        arm: the arm, connected, calibrated, and with its tool; nothing in its way to the start
            (`plan_clearance.check_approach`).
        on_step: called with each record as it is made; those of one section together.
        within: radians by which joints may leave the trajectory between two stops.
        keep_time: whether to wait where the arm is early. A simulated robot that is sped up need
            not.
        progress: as of `NiryoArm.execute`, for each section.

    Raises:
        ExecutionAborted: a section ended on its way; says of which steps.
        NiryoError: what `NiryoArm` raises; nothing more is sent.
    """
    plan, records = timed.plan, list[TimedRecord]()

    def done(number: int, joints: Vector | None, end: float | None) -> None:
        planned = plan.steps[number]
        reached = None if joints is None else plan.turned(joints)
        pose = planned.step.pose
        error = None
        if reached is not None and pose is not None:
            error = position_error(plan.robot, reached, pose)
        records.append(TimedRecord(planned, timed.steps[number], reached, error, end))
        on_step(records[-1])

    section_of = {section.first: section for section in sections(timed, within)}
    arm.set_speed(plan.steps[0].step.percent)
    at = arm.move_joints(plan.told(plan.steps[0].joints))
    begin = time.monotonic()
    done(0, at, 0.0)
    while (number := len(records)) < len(timed.steps):
        section = section_of.get(number)
        if section is None:
            _act(arm, plan.steps[number].step.action)
            at = arm.joints()
            left = timed.steps[number].end - (time.monotonic() - begin)
            arm.wait(max(left, 0.0) if keep_time else 0.0)
            done(number, at, time.monotonic() - begin)
            continue
        try:
            execution = arm.execute(
                section.trajectory,
                by="moves" if section.lines is None else None,
                within=within,
                keep_time=keep_time,
                progress=progress,
            )
        except ExecutionAborted as error:
            raise _named(error, timed, number, section.last) from error.__cause__
        for passed in range(number, section.last):
            done(passed, None, None)
        done(section.last, execution.reached[-1], time.monotonic() - begin)
    return tuple(records)


def _act(arm: Arm, action: str) -> None:
    if action == "grasp":
        arm.grasp()
    elif action == "release":
        arm.release()


def _named(error: ExecutionAborted, timed: TimedPlan, first: int, last: int) -> ExecutionAborted:
    """The same with the steps that the arm was at."""
    title = timed.plan.steps[last].step.title
    which = f"step {last + 1}" if first == last else f"steps {first + 1} to {last + 1}"
    return ExecutionAborted(
        f"{which} ({title}): {error}", error.state, error.stops_done, error.reached
    )
