"""A plan carried out by a robot, and what became of it, also where it ends early."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Sized
from contextlib import AbstractContextManager

import numpy as np

from niryo_jax import interruption
from niryo_jax.cli.outcome import ExitCode, Failure, as_failure, json_number
from niryo_jax.hardware import NiryoArm, NiryoError
from niryo_jax.hardware.pick_and_place import Plan, PlannedStep, StepRecord, Vector
from niryo_jax.hardware.plan_clearance import PlanClearance
from niryo_jax.robot import Robot


def driven(
    planned: Plan,
    host: str,
    robot: Robot,
    tool: str,
    records: Sized,
    shown: AbstractContextManager[object],
    carry_out: Callable[[NiryoArm], object],
    approach: Callable[[Vector], None] = lambda q: None,
) -> Failure | None:
    """Carry a plan out; Ctrl-C ends it after the move under way.

    Args:
        planned: what is to be done.
        host: of the robot.
        robot: the nominal arm, whose limits are enforced.
        tool: that must be on the arm; it is opened first.
        records: of the steps that are done, to which `carry_out` adds.
        shown: entered while the steps are carried out.
        carry_out: lets the arm do all steps.
        approach: called with the joints (n,) where the arm stands before it is moved, radians;
            raises a NiryoError where it may not go from there to the first step.

    Returns:
        Why it ended early, or None.
    """
    interruption.raise_again()
    try:
        with NiryoArm(host, robot=robot) as arm:
            arm.calibrate()
            arm.use_tool(tool)
            approach(planned.turned(arm.joints()))
            arm.release()
            with shown:
                carry_out(arm)
    except NiryoError as error:
        return as_failure(error)
    except KeyboardInterrupt:
        return Failure(
            f"interrupted after {len(records)} of {len(planned.steps)} steps: nothing more is sent "
            "to the robot; a move that was under way goes on to its end",
            ExitCode.INTERRUPTED,
        )
    return None


def plan_document(
    planned: Plan, host: str | None = None, records: Sequence[StepRecord] = ()
) -> dict[str, object]:
    """A plan, and what became of its steps, for a JSON document."""
    steps = [
        _step_document(number, step, planned) for number, step in enumerate(planned.steps, start=1)
    ]
    for step, record in zip(steps, records, strict=False):
        step |= {
            "joints_read_rad": record.reached.tolist(),
            "reached_error_m": record.position_error,
            "seconds": record.seconds,
        }
    return {
        "robot": planned.robot.name,
        "host": host,
        "steps_done": len(records),
        "steps": steps,
    }


def _step_document(number: int, planned: PlannedStep, plan: Plan) -> dict[str, object]:
    """A step as planned; a gripper step has neither a target nor a speed."""
    step = planned.step
    document: dict[str, object] = {"step": number, "title": step.title, "action": step.action}
    if step.pose is not None:
        document |= {
            "speed_percent": step.percent,
            "target_pose": step.pose.tolist(),
            "target_position_m": step.pose[:3, 3].tolist(),
            "pose_distance": planned.pose_distance,
            "joints_sent_rad": plan.told(planned.joints).tolist(),
            "planned_error_m": planned.position_error,
        }
    return document


def clearance_document(found: PlanClearance | None) -> dict[str, object] | None:
    """How clear a plan is, for a JSON document; None where it was not looked at."""
    if found is None:
        return None
    steps = [json_number(x) for x in found.clearance]
    return {
        "least_m": steps[found.tightest],
        "step": found.tightest + 1,
        "pair": list(found.pairs[found.tightest]),
        "steps_m": steps,
        "samples": found.samples,
    }


def clearance_words(found: PlanClearance, planned: Plan) -> str:
    """The least clearance of a plan, as a sentence."""
    at = found.tightest
    least = found.clearance[at]
    if not np.isfinite(least):
        return "Nothing of the arm's shape is held against anything: the plan was not looked at."
    pair = " and ".join(found.pairs[at])
    title = planned.steps[at].step.title
    return f"Least clearance: {1e3 * least:.1f} mm, of {pair}, in step {at + 1} ({title})."
