"""`niryo-jax pick-and-place`: Table 2.1, solved and executed."""

from __future__ import annotations

from typing import Annotated

import typer

from niryo_jax.cli.choice import ArmOption, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import busy, note_rounding, show_lines, show_table, stderr
from niryo_jax.cli.driving import driven, plan_document
from niryo_jax.cli.options import DryRunOption, HostOption, JsonOption
from niryo_jax.cli.outcome import Failure, print_json
from niryo_jax.cli.progress import StepProgress
from niryo_jax.cli.tables import millimetres, plan_table, records_table
from niryo_jax.hardware import NiryoArm, SimulatedNiryo, pyniryo_version
from niryo_jax.hardware.pick_and_place import (
    OBJECT_START,
    TABLE_2_1,
    Plan,
    plan,
    steps_for,
)
from niryo_jax.robots import MODELS


def pick_and_place(
    host: HostOption = None,
    dry_run: DryRunOption = False,
    speed: Annotated[
        int | None,
        typer.Option(
            min=1, max=100, help="Percent of the largest speed, for all moves (else 70 and 30)."
        ),
    ] = None,
    tool: Annotated[str, typer.Option(help="The tool that must be on the arm.")] = "gripper_1",
    time_scale: Annotated[
        float | None,
        typer.Option(min=0.01, help="How many times faster the simulated robot moves (else 1)."),
    ] = None,
    robot: ArmOption = "niryo_one",
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """Solve the ten-step pick-and-place of the paper's Table 2.1 and let a robot execute it.

    Without --host a simulated robot does it, driven by pyniryo over the robot's own protocol. A Ned
    or a Ned2 starts from its own pose at rest.
    """
    if time_scale is not None and (host is not None or dry_run):
        raise typer.BadParameter("--time-scale is for the simulated robot, when it moves")
    arm = load_arm(robot, base, tip)
    model = MODELS.get(robot)
    if model is None and not dry_run:
        raise typer.BadParameter(
            f"--robot: {robot!r} is no Niryo arm ({', '.join(MODELS)}), which alone can be driven; "
            "--dry-run solves and shows the plan of any arm"
        )
    if model is not None and tool not in model.tools:
        known = ", ".join(model.tools)
        raise typer.BadParameter(f"--tool: {robot} has {known}; got {tool!r}")
    if not dry_run:
        # What is missing, or not there, should not be told after seconds of compiling.
        pyniryo_version()
        if host is not None:
            with NiryoArm(host, robot=arm):
                pass
    with busy("Solving the five poses in one batch"):
        planned = plan(arm, TABLE_2_1 if model is None else steps_for(arm), percent=speed)
    note_rounding(max(step.pose_distance or 0.0 for step in planned.steps))
    if dry_run:
        if as_json:
            print_json(plan_document(planned))
        else:
            show_table(plan_table(planned))
    elif host is not None:
        stderr().print(
            f"Driving the {robot} at {host}: it is calibrated if it asks for that, opens "
            f"{tool} and carries out ten steps; Ctrl-C ends after the move under way."
        )
        _run(planned, host, tool, None, as_json)
    elif model is not None:
        with SimulatedNiryo(model, time_scale=time_scale or 1.0, tool=tool) as simulated:
            simulated.place_object(OBJECT_START)
            stderr().print(f"Driving a simulated {robot} at {simulated.address}")
            _run(planned, simulated.address, tool, simulated, as_json)


def _run(
    planned: Plan, host: str, tool: str, simulated: SimulatedNiryo | None, as_json: bool
) -> None:
    """Execute the plan and show what became of it, also where it ends early."""
    progress = StepProgress(planned, simulated)
    failure = driven(
        planned, host, planned.robot, tool, progress.records, progress.advance, progress
    )
    document = plan_document(planned, host, progress.records)
    position = None if simulated is None else simulated.object_position
    document["object_position_m"] = None if position is None else position.tolist()
    if not as_json and progress.records:
        show_table(records_table(progress.records))
        if position is not None:
            show_lines(f"The object is at ({millimetres(position)}) mm.")
    if failure is not None:
        raise Failure(str(failure), failure.code, document)
    if as_json:
        print_json(document)
