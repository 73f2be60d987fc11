"""Inverse kinematics: the method that fits an arm, or the one that is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal, get_args, overload

from jax.typing import ArrayLike

from niryo_jax.arguments import check_choice, check_number
from niryo_jax.ik.methods.complete import Locked, solve_complete
from niryo_jax.ik.methods.continuation import solve_by_continuation
from niryo_jax.ik.methods.curves import STEP, solve_curves
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.methods.partial import solve_partial
from niryo_jax.ik.methods.sampled import solve_sampled
from niryo_jax.ik.methods.seeded import solve_seeded
from niryo_jax.ik.results.curves import SolutionCurves
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.task import TaskName, task_of
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.tolerances import ANSWERED

Method = Literal["complete", "continuation", "multistart", "sampled", "seeded"]


Redundancy = Literal["points", "curves"]


@overload
def inverse_kinematics(
    robot: Robot,
    pose: ArrayLike,
    method: Method | None = None,
    *,
    locked: Locked | None = None,
    arm_angle: ArrayLike | None = None,
    q_ref: ArrayLike | None = None,
    task: TaskName = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
    tolerance: float = ANSWERED,
    redundancy: Literal["points"] = "points",
) -> IKSolutions: ...


@overload
def inverse_kinematics(
    robot: Robot, pose: ArrayLike, *, redundancy: Literal["curves"], step: float = STEP
) -> SolutionCurves: ...


def inverse_kinematics(
    robot: Robot,
    pose: ArrayLike,
    method: Method | None = None,
    *,
    locked: Locked | None = None,
    arm_angle: ArrayLike | None = None,
    q_ref: ArrayLike | None = None,
    task: TaskName = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
    tolerance: float = ANSWERED,
    redundancy: Redundancy = "points",
    step: float | None = None,
) -> IKSolutions | SolutionCurves:
    """All joint vectors that bring the tool to a pose, for a batch of poses.

    Args:
        robot: the arm. A traced robot is solved as the concrete one that it was made from; the
            program looks whether its axes still lie as those did, and where they do not, nothing
            is called complete or unreachable.
        pose: (..., 4, 4) targets in the space frame, metres. Poses that are slightly off SE(3),
            as printed ones are, are projected to it and the distance is reported.
        method: how to solve; where not given, the first of these that fits the arm.
            "complete": every real solution, or a proof that there is none. By a scan with a proof
            where axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet
            (docs/theory/complete-ik.md); in closed form where the wrist is spherical, where three
            axes are parallel and for four joints of some kinds (docs/families.md); by the roots of
            one polynomial for all others of six revolute joints (docs/theory/general-6r.md).
            "sampled": for seven joints: the best of the complete sets for 16 arm angles, or values
            of one joint; where none is within the limits, others of the same curves that are.
            "multistart": Newton-Raphson from 64 guesses, for any open chain.
            "continuation": for arms that are nearly of the first kind (calibrated ones), if named:
            the complete sets of the nearest such arm, refined by Newton-Raphson on the true one.
            "seeded": Paden-Kahan guesses refined by Newton-Raphson, for arms of the first kind
            (Todorovic et al. 2024, algorithm 2): about 95 % of all solutions.
            `complete` of the answer is False except for the first.
        locked: for seven joints: the index of a joint and its value (...,), which broadcasts with
            the batch of poses; the answer is complete for these values. With a further axis of
            values it is a sampled family: pose[..., None, :, :] and values (k,).
        arm_angle: the same with the arm angle (...,) in place of a joint (`niryo_jax.arm_angle`),
            for seven joints of which axes 1, 2, 3 meet, and 5, 6, 7: what the arm can reach, it
            reaches with any. Where the arm is stretched or the wrist on axis 1 it binds nothing.
        q_ref: (..., n) joint vectors, radians, for the complete method and for tasks. Where the arm
            can move while the tool rests, the one of its infinitely many solutions that is nearest
            to q_ref stands for them (q_ref itself where it reaches the pose), whole turns
            considered. Where not given it is one within the joint limits, if there is one. Of a
            task, joints that do not matter take q_ref's values, as near as the limits allow; where
            there are joints to spare, solutions within the limits whose distance to q_ref is least
            among those about them (a local minimum, of the sum of squares) stand for all others.
        task: what of the pose is bound: "pose", all of it; "direction", the position and one axis
            of the tool; "position", the position alone. Where as many joints matter as the task
            binds (5 or 3), or fewer, and a closed form fits, the answer is complete. Joints that
            matter to neither (`IKSolutions.free`) are halfway in their range, unless q_ref says
            where, and the solution is a SELF_MOTION. Where there are more, it is a sample, by
            "multistart", and `complete` is False.
        tool_axis: (3,) the axis that "direction" binds, in the tool frame, of any length.
        tolerance: a pose that an arm of fewer joints than are bound can take to within this (metres
            and radians) is answered by the nearest pose that it can, and `position_error` and
            `rotation_error` say how far away that is. It is UNREACHABLE only where a closed form
            proves that no pose is that near.
        redundancy: "curves", for seven joints: all solutions that are found, as curves within the
            limits (`niryo_jax.SolutionCurves`), in place of the best 16 points of them. Takes the
            robot, the pose and the step alone, which are concrete.
        step: radians that no joint exceeds from one point of a curve to the next; 0.05 if not
            given.

    Returns:
        `IKSolutions` with a slot for each solution that there can be: 16 of an arm with a wrist
        offset and by the methods that are not complete, 8, 4, 2 or 1 where a closed form has no
        more. Nothing is raised for a pose that cannot be solved: `status` says why, so that good
        and bad poses can be mixed in one batch. A batch whose size is not known, of `jax.export`,
        is solved one pose after the other. Derivatives of q with respect to the pose are those
        of the implicit function theorem, of any order, in forward and reverse mode; by the complete
        method also those with respect to the geometry.

    Raises:
        ValueError: a wrong shape, an unknown method or task, an arm that the method does not fit, a
            joint that cannot be locked, a tool axis without direction, a negative tolerance.
        TypeError: a traced robot, for a method or a task that needs a concrete one.
    """
    check_choice("redundancy", redundancy, get_args(Redundancy))
    if redundancy == "curves":
        others = method, locked, arm_angle, q_ref
        if any(x is not None for x in others) or task != "pose":
            raise ValueError(
                "redundancy 'curves': expected no method, locked joint, arm angle, reference or "
                "task beside it; choose along the curves that it returns"
            )
        return solve_curves(robot, pose, STEP if step is None else step)
    if step is not None:
        raise ValueError(f"step: is for redundancy 'curves', got {redundancy!r}")
    bound = task_of(task, tool_axis)
    tolerance = check_number("tolerance", tolerance, "0 or more, metres and radians", _is_finite)
    chosen = locked is not None or arm_angle is not None
    if bound.name != "pose":
        if chosen or method not in (None, "complete", "multistart"):
            raise ValueError(
                f"task {task!r}: expected method 'complete' or 'multistart' and neither a locked "
                f"joint nor an arm angle; got method {method!r}"
            )
        by_closed_form = None if method is None else method == "complete"
        return solve_partial(robot, pose, bound, by_closed_form, tolerance, q_ref)
    if method is None:
        method = "complete" if chosen else method_for(robot)
    check_is_robot(robot)
    check_choice("method", method, _SOLVERS)
    if chosen:
        if method != "complete":
            raise ValueError(f"locked, arm_angle: are for method 'complete', got {method!r}")
        return solve_complete(robot, pose, locked, arm_angle, q_ref, tolerance)
    if method == "complete":
        return solve_complete(robot, pose, q_ref=q_ref, tolerance=tolerance)
    if q_ref is not None:
        raise ValueError(f"q_ref: expected method 'complete', got {method!r}")
    if method == "multistart":
        return solve_multistart(robot, pose, tolerance=tolerance)
    return _SOLVERS[method](robot, pose)


_SOLVERS: dict[Method, Callable[..., IKSolutions]] = {
    "complete": solve_complete,
    "continuation": solve_by_continuation,
    "multistart": solve_multistart,
    "sampled": solve_sampled,
    "seeded": solve_seeded,
}


def _is_finite(tolerance: float) -> bool:
    return 0.0 <= tolerance < math.inf


def method_for(robot: Robot) -> Method:
    """The method that `inverse_kinematics` takes where none is named."""
    check_is_robot(robot)
    if robot.plans and robot.spare is not None:
        return "sampled"
    if robot.offset_wrist is not None or robot.plans or robot.is_general:
        return "complete"
    return "multistart"
