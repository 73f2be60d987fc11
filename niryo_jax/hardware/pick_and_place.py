"""The pick-and-place of Todorovic et al. (2024), Table 2.1: its steps, solved and executed.

The poses are those of the tool frame, without the offset of a gripper, in the space frame. In steps
2 to 9 the gripper points down; the jaws of gripper 1 reach the table where the tool frame is 88 mm
above it. The start is the pose of the Niryo One at rest, which the Ned and the Ned2 cannot take
inside their limits: they start from their own.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import jax
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from niryo_jax.chain import forward_kinematics
from niryo_jax.hardware.errors import NiryoError
from niryo_jax.ik import inverse_kinematics
from niryo_jax.robot import Robot
from niryo_jax.robots import NIRYO_ONE

Vector = NDArray[np.float64]
Action = Literal["move", "grasp", "release"]

OBJECT_START = (0.148, -0.148, 0.0)
"""Where the object stands before step 1: on the table, below poses 2 and 3, metres."""

OBJECT_END = (0.148, 0.148, 0.0)
"""Where it stands after step 8: below poses 6 and 7, metres."""

FREE, CAREFUL = 70, 30
"""Percent of the largest speed: where the arm moves freely, and at the object or with it."""


class StepUnsolvable(NiryoError):
    """The pose of a step has no joint vector inside the limits of the arm; nothing was sent."""


@dataclasses.dataclass(frozen=True)
class Step:
    """One row of the table.

    Attributes:
        title: what the step does.
        action: "move" to `pose`, or "grasp" or "release" where the arm stands.
        pose: (4, 4) target of the tool frame, metres; None unless the step is a move.
        percent: speed of a move, percent of the largest.
    """

    title: str
    action: Action = "move"
    pose: Vector | None = None
    percent: int = FREE


def _pose(*rows: Sequence[float]) -> Vector:
    pose = np.array([*rows, (0.0, 0.0, 0.0, 1.0)])
    pose.setflags(write=False)
    return pose


def _pointing_down(x: float, y: float, z: float) -> Vector:
    return _pose((0, 0, 1, x), (0, 1, 0, y), (-1, 0, 0, z))


# As printed, to three decimals: R^T R misses the identity by 1.1e-3.
_START = _pose((0.540, 0, 0.841, 0.091039), (0, 1, 0, 0), (-0.841, 0, 0.540, 0.190529))
_ABOVE_OBJECT = _pointing_down(0.148, -0.148, 0.150)
_AT_OBJECT = _pointing_down(0.148, -0.148, 0.088)
_ABOVE_DESTINATION = _pointing_down(0.148, 0.148, 0.150)
_AT_DESTINATION = _pointing_down(0.148, 0.148, 0.088)

TABLE_2_1: tuple[Step, ...] = (
    Step("Starting position", pose=_START),
    Step("Approach above the object", pose=_ABOVE_OBJECT),
    Step("Descent to the object", pose=_AT_OBJECT, percent=CAREFUL),
    Step("Grip the object", "grasp"),
    Step("Lift the object", pose=_ABOVE_OBJECT, percent=CAREFUL),
    Step("Approach above the destination", pose=_ABOVE_DESTINATION, percent=CAREFUL),
    Step("Descent to the destination", pose=_AT_DESTINATION, percent=CAREFUL),
    Step("Release the object", "release"),
    Step("Ascent from the object", pose=_ABOVE_DESTINATION),
    Step("Return to the start", pose=_START),
)


AT_REST = (0.0, 0.3, -1.3, 0.0, 0.0, 0.0)
"""Joints at which the robots rest, radians; steps 1 and 10 have the pose of a Niryo One there."""


def steps_for(robot: Robot) -> tuple[Step, ...]:
    """The steps of Table 2.1 for an arm: as printed for the Niryo One.

    Any other Niryo starts from and returns to its own pose at rest; the poses at the object and at
    its destination are those of the table.
    """
    if robot.name == NIRYO_ONE.name:
        return TABLE_2_1
    rest = np.asarray(forward_kinematics(robot, np.array(AT_REST)), dtype=np.float64)
    return tuple(
        dataclasses.replace(step, pose=rest) if step.pose is _START else step for step in TABLE_2_1
    )


@dataclasses.dataclass(frozen=True)
class PlannedStep:
    """A step with the joints that carry it out.

    Attributes:
        step: the step.
        joints: (n,) joint angles at its end, radians.
        pose_distance: how far the pose as printed is from the rigid motion solved for (Frobenius
            norm); None unless the step is a move.
        position_error: metres by which forward kinematics of `joints` misses the target; likewise.
    """

    step: Step
    joints: Vector
    pose_distance: float | None = None
    position_error: float | None = None


@dataclasses.dataclass(frozen=True)
class Plan:
    """Steps solved for one arm.

    Attributes:
        robot: the arm.
        steps: in their order.
        gears: (n,) the shares by which its joints turn farther than they are told.
    """

    robot: Robot
    steps: tuple[PlannedStep, ...]
    gears: Vector

    def told(self, q: Vector) -> Vector:
        """(n,) what to tell the joints so that they turn to q."""
        return q / (1.0 + self.gears)

    def turned(self, q: Vector) -> Vector:
        """(n,) where the joints are when they say q."""
        return q * (1.0 + self.gears)


@dataclasses.dataclass(frozen=True)
class StepRecord:
    """What became of one step.

    Attributes:
        planned: the step as planned; its `joints` are those that were sent, gear errors aside.
        reached: (n,) joint angles read back from the arm, radians, gear errors aside.
        position_error: metres from the target to forward kinematics of `reached`; None unless the
            step is a move.
        seconds: how long the step took.
    """

    planned: PlannedStep
    reached: Vector
    position_error: float | None
    seconds: float


class Arm(Protocol):
    """What a plan needs of an arm; `NiryoArm` has it."""

    def set_speed(self, percent: int) -> None: ...
    def move_joints(self, q: ArrayLike) -> Vector: ...
    def joints(self) -> Vector: ...
    def wait(self, seconds: float) -> None: ...
    def grasp(self) -> None: ...
    def release(self) -> None: ...


def plan(
    robot: Robot,
    steps: Sequence[Step] = TABLE_2_1,
    *,
    q_start: ArrayLike | None = None,
    percent: int | None = None,
    gears: ArrayLike = 0.0,
) -> Plan:
    """Solve the distinct poses of the steps in one batch, and choose joints for each step.

    Of the solutions inside the limits each step takes the one nearest to the joints before it; a
    straight path between the two in joint space is then inside the limits too.

    Args:
        robot: the arm.
        steps: what to do.
        q_start: (n,) joint angles before the first step, radians; zeros where not given.
        percent: a speed for all moves, percent of the largest; that of each step where not given.
        gears: the shares by which joints turn farther than they are told, one number or (n,), as
            `niryo_jax.calibration.fit` finds them with its robot.

    Raises:
        StepUnsolvable: a pose without a solution inside the limits; the message says why.
    """
    if percent is not None:
        steps = [dataclasses.replace(step, percent=percent) for step in steps]
    distinct = {step.pose.tobytes(): step.pose for step in steps if step.pose is not None}
    index_of = {key: index for index, key in enumerate(distinct)}
    solutions = inverse_kinematics(robot, np.array(list(distinct.values())).reshape(-1, 4, 4))
    distance = np.asarray(solutions.pose_distance)
    nearest = jax.jit(solutions.nearest)

    joints = np.zeros(robot.joints) if q_start is None else np.asarray(q_start, dtype=np.float64)
    planned: list[PlannedStep] = []
    for number, step in enumerate(steps, start=1):
        if step.pose is None:
            planned.append(PlannedStep(step, joints))
            continue
        index = index_of[step.pose.tobytes()]
        q, ok = nearest(joints)
        if not ok[index]:
            reason = solutions.message(index)
            raise StepUnsolvable(f"step {number} ({step.title}) of {robot.name}: {reason}")
        joints = np.asarray(q[index], dtype=np.float64)
        error = position_error(robot, joints, step.pose)
        planned.append(PlannedStep(step, joints, float(distance[index]), error))
    return Plan(robot, tuple(planned), np.broadcast_to(np.asarray(gears, float), robot.joints))


def execute(
    plan: Plan,
    arm: Arm,
    on_step: Callable[[StepRecord], None] = lambda record: None,
    *,
    pause: float = 0.0,
) -> tuple[StepRecord, ...]:
    """Carry a plan out and record what the arm did.

    Args:
        plan: the steps, solved for this arm.
        arm: the arm, connected, calibrated, and with its tool.
        on_step: called with each record as it is made.
        pause: seconds that the arm rests after each step.

    Raises:
        NiryoError: what `NiryoArm` raises; the steps after are not carried out.
    """
    records: list[StepRecord] = []
    for planned in plan.steps:
        begin = time.monotonic()
        reached = plan.turned(_carry_out(planned, plan, arm))
        arm.wait(pause)
        seconds = time.monotonic() - begin
        pose = planned.step.pose
        error = None if pose is None else position_error(plan.robot, reached, pose)
        records.append(StepRecord(planned, reached, error, seconds))
        on_step(records[-1])
    return tuple(records)


def _carry_out(planned: PlannedStep, plan: Plan, arm: Arm) -> Vector:
    match planned.step.action:
        case "move":
            arm.set_speed(planned.step.percent)
            return arm.move_joints(plan.told(planned.joints))
        case "grasp":
            arm.grasp()
        case "release":
            arm.release()
    return arm.joints()


def position_error(robot: Robot, q: Vector, pose: Vector) -> float:
    """Metres from the position of a target (4, 4) to that of the tool frame at joints q (n,)."""
    reached = np.asarray(forward_kinematics(robot, q), dtype=np.float64)
    return float(np.linalg.norm(reached[:3, 3] - pose[:3, 3]))
