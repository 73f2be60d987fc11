"""`niryo-jax fk` and `ik`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer

from niryo_jax.chain import forward_kinematics
from niryo_jax.cli.console import busy, note_rounding, stderr, stdout
from niryo_jax.cli.explain import explain as explain_branches
from niryo_jax.cli.explain import explained_table
from niryo_jax.cli.options import (
    DegreesOption,
    JsonOption,
    RobotName,
    RobotOption,
    in_radians,
    number,
)
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.poses import read_pose
from niryo_jax.cli.tables import angles, millimetres, solutions_table, unit_name
from niryo_jax.ik import (
    IKSolutions,
    IKStatus,
    Singularity,
    inverse_kinematics,
    seeded_branches,
)
from niryo_jax.lie.rpy import rpy_from_pose
from niryo_jax.robot import Robot


def fk(
    q: Annotated[
        list[float],
        typer.Argument(parser=number, metavar="Q", help="The joint angles, joint 1 first."),
    ],
    degrees: DegreesOption,
    robot: RobotOption = RobotName.NIRYO_ONE,
    as_json: JsonOption = False,
) -> None:
    """Forward kinematics: the pose of the tool frame at joint angles Q."""
    arm = robot.model.robot()
    joints = in_radians(q, degrees)
    if len(q) != arm.joints or not np.all(np.isfinite(joints)):
        raise typer.BadParameter(f"Q: expected {arm.joints} finite angles, got {q}")
    pose = np.asarray(forward_kinematics(arm, joints))
    within = bool(np.all((arm.lower <= joints) & (joints <= arm.upper)))
    x, y, z, *rpy = rpy_from_pose(pose)
    if as_json:
        document = {
            "robot": robot.value,
            "joints_rad": joints.tolist(),
            "pose": pose.tolist(),
            "position_m": [x, y, z],
            "roll_pitch_yaw_rad": rpy,
            "within_limits": within,
        }
        print_json(document)
        return
    out = stdout()
    out.print(f"position        ({millimetres((x, y, z), decimals=3)}) mm")
    out.print(f"roll pitch yaw  ({', '.join(angles(rpy, degrees).split())}) {unit_name(degrees)}")
    out.print("pose            (metres)")
    for row in pose + 0.0:
        out.print("  ".join(f"{value:12.9f}" for value in row))
    if not within:
        stderr().print("note: these joint angles are outside the limits of the arm")


def ik(
    degrees: DegreesOption,
    position: Annotated[
        list[float] | None,
        typer.Argument(parser=number, metavar="X Y Z", help="Position of the tool frame, metres."),
    ] = None,
    rpy: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="R P Y", help="Roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."),
    ] = None,
    matrix: Annotated[
        str | None,
        typer.Option(help='The pose as 16 or 12 numbers row by row: "0 0 1 0.148; ...".'),
    ] = None,
    pose_file: Annotated[
        Path | None, typer.Option(help="A file with the 4 x 4 matrix, .json or .npy.")
    ] = None,
    in_millimetres: Annotated[
        bool, typer.Option("--millimetres", help="The position is given in millimetres.")
    ] = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Show what the published method makes of it.")
    ] = False,
    robot: RobotOption = RobotName.NIRYO_ONE,
    as_json: JsonOption = False,
) -> None:
    """Inverse kinematics: the joint angles that bring the tool frame to a pose."""
    arm = robot.model.robot()
    pose = read_pose(position, rpy, matrix, pose_file, degrees=degrees, millimetres=in_millimetres)
    with busy("Solving"):
        # As numpy, of which single numbers are taken without a program for each.
        solutions = jax.device_get(inverse_kinematics(arm, jax.device_put(pose)))
        branches = explain_branches(seeded_branches(arm, pose), solutions) if explain else []
    status = IKStatus(int(solutions.status))
    distance = float(solutions.pose_distance)
    message = solutions.message()
    document: dict[str, object] = {
        "robot": robot.value,
        "status": status.name,
        "message": message,
        "complete": bool(solutions.complete),
    }
    if status is IKStatus.INVALID_POSE:
        raise Failure(message, ExitCode.USAGE, document)
    document |= {"pose": pose.tolist(), "pose_distance": distance}
    document |= {"solutions": _as_documents(solutions)}
    if explain:
        document["branches"] = [branch.as_document() for branch in branches]
    if not as_json:
        _show(arm, solutions, degrees)
        if explain:
            stdout().print(explained_table(branches))
        note_rounding(distance)
    if status is not IKStatus.SOLVED:
        raise Failure(message, ExitCode.NO_SOLUTION, document)
    if as_json:
        print_json(document)
    else:
        stdout().print(message)


def _show(arm: Robot, solutions: IKSolutions, degrees: bool) -> None:
    if solutions.count > 0:
        stdout().print(solutions_table(arm, solutions, degrees))


def _as_documents(solutions: IKSolutions) -> list[dict[str, object]]:
    return [
        {
            "joints_rad": np.asarray(solutions.q[slot]).tolist(),
            "within_limits": bool(solutions.within_limits[slot]),
            "position_error_m": float(solutions.position_error[slot]),
            "rotation_error_rad": float(solutions.rotation_error[slot]),
            "label": int(solutions.label[slot]),
            "singularity": Singularity(int(solutions.singularity[slot])).name,
        }
        for slot in np.flatnonzero(np.asarray(solutions.found))
    ]
