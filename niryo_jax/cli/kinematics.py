"""`niryo-jax fk` and `ik`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer

from niryo_jax.chain import forward_kinematics
from niryo_jax.cli.choice import ArmOption, BaseOption, TipOption, load_arm
from niryo_jax.cli.clearances import Looked
from niryo_jax.cli.console import busy, note_rounding, show_lines, show_table, stderr
from niryo_jax.cli.explain import explain as explain_branches
from niryo_jax.cli.explain import explained_table
from niryo_jax.cli.options import (
    DegreesOption,
    JsonOption,
    TaskChoice,
    TaskOption,
    ToolAxisOption,
    Vector,
    finite,
    in_unit,
    joint_unit_name,
    joint_units,
    number_words,
    numbers,
    unit_name,
)
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.poses import read_pose
from niryo_jax.cli.shapes import (
    CollisionModelOption,
    CollisionOption,
    CollisionToolOption,
    MarginOption,
    TableOption,
    collision_check,
)
from niryo_jax.cli.tables import digits, solutions_table
from niryo_jax.collision import Distances, FreeStatus
from niryo_jax.ik import (
    IKSolutions,
    IKStatus,
    Singularity,
    inverse_kinematics,
    seeded_branches,
)
from niryo_jax.ik.task import BOUND
from niryo_jax.lie.rpy import rpy_from_pose
from niryo_jax.robot import Robot


def fk(
    q: Annotated[
        list[str],
        typer.Argument(
            parser=number_words,
            metavar="Q",
            help="The joint angles, joint 1 first; metres for joints that slide. "
            "Between spaces or commas.",
        ),
    ],
    degrees: DegreesOption,
    robot: ArmOption = "niryo_one",
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """Forward kinematics: the pose of the tool frame at joint angles Q."""
    values = numbers(" ".join(q))
    arm = load_arm(robot, base, tip)
    joints = finite("Q", values, arm.joints, "angles") * joint_units(arm, degrees)
    pose = np.asarray(forward_kinematics(arm, joints))
    if not np.all(np.isfinite(pose)):
        raise typer.BadParameter(f"Q: expected angles that have a sine, got {values}")
    within = bool(np.all((arm.lower <= joints) & (joints <= arm.upper)))
    x, y, z, *rpy = rpy_from_pose(pose)
    if as_json:
        document = {
            "robot": arm.name,
            "joints_rad": joints.tolist(),
            "pose": pose.tolist(),
            "position_m": [x, y, z],
            "roll_pitch_yaw_rad": rpy,
            "within_limits": within,
        }
        print_json(document)
        return
    show_lines(
        f"position (m)          {digits((x, y, z))}",
        f"roll pitch yaw ({unit_name(degrees)})  {digits(in_unit(rpy, degrees))}",
        "pose (m)",
        *("  ".join(f"{value:15.12f}" for value in row) for row in pose + 0.0),
        "`niryo-jax ik` takes these numbers: X Y Z --rpy R P Y, or --matrix of the pose in quotes.",
    )
    if not within:
        stderr().print("note: these joint angles are outside the limits of the arm")


def ik(
    degrees: DegreesOption,
    position: Annotated[
        list[str] | None,
        typer.Argument(
            parser=number_words, metavar="X Y Z", help="Position of the tool frame, metres."
        ),
    ] = None,
    rpy: Annotated[
        tuple[str, str, str] | None,
        typer.Option(metavar="R P Y", help="Roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."),
    ] = None,
    matrix: Annotated[
        str | None,
        typer.Option(help='The pose as 16 or 12 numbers row by row: "0 0 1 0.148; ...".'),
    ] = None,
    pose_file: Annotated[
        Path | None,
        typer.Option(help="A file with the 4 x 4 matrix, .json or .npy; - for JSON on stdin."),
    ] = None,
    in_millimetres: Annotated[
        bool, typer.Option("--millimetres", help="The position is given in millimetres.")
    ] = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Show what the published method makes of it.")
    ] = False,
    task: TaskOption = TaskChoice.POSE,
    tool_axis: ToolAxisOption = None,
    collision: CollisionOption = False,
    table: TableOption = None,
    margin: MarginOption = None,
    collision_model: CollisionModelOption = None,
    collision_tool: CollisionToolOption = None,
    robot: ArmOption = "niryo_one",
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """Inverse kinematics: the joint angles that bring the tool frame to a pose, or a part of it."""
    axis = _tool_axis(task, tool_axis)
    if explain and task is not TaskChoice.POSE:
        raise typer.BadParameter("--explain goes with --task pose, which the published method does")
    pose = read_pose(
        position,
        rpy,
        matrix,
        pose_file,
        degrees=degrees,
        millimetres=in_millimetres,
        only_position=task is TaskChoice.POSITION,
    )
    arm = load_arm(robot, base, tip)
    check = collision_check(
        arm, collision, table, margin, collision_model, collision_tool, base, tip
    )
    try:
        with busy("Solving"):
            # As numpy, of which single numbers are taken without a program for each.
            solutions = jax.device_get(
                inverse_kinematics(arm, jax.device_put(pose), task=task.value, tool_axis=axis)
            )
            branches = explain_branches(seeded_branches(arm, pose), solutions) if explain else []
            looked = None if check is None else Looked.at(check, arm, solutions)
    except ValueError as error:
        raise Failure(str(error), ExitCode.USAGE) from error
    status = IKStatus(int(solutions.status))
    distance = float(solutions.pose_distance)
    message = solutions.message()
    document: dict[str, object] = {
        "robot": arm.name,
        "status": status.name,
        "message": message,
        "complete": bool(solutions.complete),
        "task": task.value,
        "bound": BOUND[task.value][1],
    }
    if task is TaskChoice.DIRECTION:
        document["tool_axis"] = axis.tolist()
    if status is IKStatus.INVALID_POSE:
        raise Failure(message, ExitCode.USAGE, document)
    document |= {"pose": pose.tolist(), "pose_distance": distance}
    document |= {"free_joints": [arm.joint_names[joint] for joint in solutions.free]}
    document |= {"solutions": _as_documents(solutions)}
    if looked is not None:
        looked.add_to(document)
    if explain:
        document["branches"] = [branch.as_document() for branch in branches]
    if not as_json:
        _show(arm, solutions, degrees, None if looked is None else looked.apart)
        if explain:
            show_table(explained_table(branches))
        note_rounding(distance)
    if status is not IKStatus.SOLVED:
        raise Failure(message, ExitCode.NO_SOLUTION, document)
    if looked is not None and looked.status is not FreeStatus.FREE:
        raise Failure(looked.free.message(), ExitCode.COLLISION, document)
    if as_json:
        print_json(document)
    else:
        show_lines(message, *([] if looked is None else [looked.said()]))


def _tool_axis(task: TaskChoice, given: tuple[str, str, str] | None) -> Vector:
    """The tool axis of a task.

    Raises:
        typer.BadParameter: it has no direction, or the task does not ask for one.
    """
    if given is None:
        return np.array([0.0, 0.0, 1.0])
    if task is not TaskChoice.DIRECTION:
        raise typer.BadParameter(f"--tool-axis goes with --task direction, got --task {task.value}")
    axis = finite("--tool-axis X Y Z", numbers(" ".join(given)), 3, "numbers")
    if not np.any(axis):
        raise typer.BadParameter("--tool-axis X Y Z: expected a direction, got 0 0 0")
    return axis


def _show(
    arm: Robot, solutions: IKSolutions, degrees: bool, apart: Distances | None = None
) -> None:
    """The solutions as a table, and with all their digits."""
    if solutions.count == 0:
        return
    show_table(solutions_table(arm, solutions, degrees, apart))
    if solutions.task != "pose":
        known = "all that there are" if solutions.complete else "some of those that there may be"
        show_lines(f"Bound: {BOUND[solutions.task][1]}. These solutions are {known}.")
    if solutions.free:
        names = ", ".join(arm.joint_names[joint] for joint in solutions.free)
        show_lines(f"Of no matter, and halfway in the range: {names}.")
    vector = "np.deg2rad([...])" if degrees else "[...]"
    show_lines(
        f"All digits ({joint_unit_name(arm, degrees)}), for `niryo-jax fk ... "
        f"{'--degrees' if degrees else '--radians'}` and `arm.move_joints({vector})`:"
    )
    for slot in np.flatnonzero(solutions.found):
        joints = digits(solutions.q[slot] / joint_units(arm, degrees))
        show_lines(f"{slot + 1:3d}  {joints}")


def _as_documents(solutions: IKSolutions) -> list[dict[str, object]]:
    return [
        {
            "joints_rad": np.asarray(solutions.q[slot]).tolist(),
            "within_limits": bool(solutions.within_limits[slot]),
            "position_error_m": float(solutions.position_error[slot]),
            "rotation_error_rad": (
                None if solutions.task == "position" else float(solutions.rotation_error[slot])
            ),
            "label": int(solutions.label[slot]),
            "singularity": Singularity(int(solutions.singularity[slot])).name,
        }
        for slot in np.flatnonzero(np.asarray(solutions.found))
    ]
