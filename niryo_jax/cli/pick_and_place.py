"""`niryo-jax pick-and-place`: Table 2.1, solved and executed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from niryo_jax.cli.choice import ArmOption, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import busy, note_rounding, show_lines, show_table, stderr
from niryo_jax.cli.driving import clearance_document, clearance_words, driven, plan_document
from niryo_jax.cli.options import DryRunOption, HostOption, JsonOption
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.progress import StepProgress
from niryo_jax.cli.shapes import CollisionModelOption, MarginOption, TableOption, collision_check
from niryo_jax.cli.tables import millimetres, plan_table, records_table
from niryo_jax.collision import CollisionCheck
from niryo_jax.hardware import NiryoArm, SimulatedNiryo, pyniryo_version
from niryo_jax.hardware.pick_and_place import (
    OBJECT_START,
    TABLE_2_1,
    Plan,
    Vector,
    plan,
    steps_for,
)
from niryo_jax.hardware.plan_clearance import (
    PlanClearance,
    StepCollides,
    check_approach,
    check_plan,
)
from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS, NiryoModel

_TABLE = OBJECT_START[2]
"""The height of the table on which the object stands, metres."""


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
    table: TableOption = None,
    margin: MarginOption = None,
    collision_model: CollisionModelOption = None,
    unchecked: Annotated[
        bool,
        typer.Option("--no-collision-check", help="Do not look whether anything is hit."),
    ] = False,
    robot: ArmOption = "niryo_one",
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """Solve the ten-step pick-and-place of the paper's Table 2.1 and let a robot execute it.

    Without --host a simulated robot does it, driven by pyniryo over the robot's own protocol. A Ned
    or a Ned2 starts from its own pose at rest. Before anything is sent it is checked that the arm,
    with its tool, hits neither itself nor the table, on which the object stands: at 0 unless given.
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
    asked = table, margin, collision_model
    check = _check(arm, model, unchecked, asked, tool, base, tip)
    if not dry_run:
        # What is missing, or not there, should not be told after seconds of compiling.
        pyniryo_version()
        if host is not None:
            with NiryoArm(host, robot=arm):
                pass
    with busy("Solving the five poses in one batch"):
        planned = plan(arm, TABLE_2_1 if model is None else steps_for(arm), percent=speed)
    clearance = None if check is None else _looked_at(planned, check)
    note_rounding(max(step.pose_distance or 0.0 for step in planned.steps))
    if dry_run:
        if as_json:
            print_json(plan_document(planned) | {"clearance": clearance_document(clearance)})
        else:
            show_table(plan_table(planned))
            if clearance is not None:
                show_lines(clearance_words(clearance, planned))
    elif host is not None:
        stderr().print(
            f"Driving the {robot} at {host}: it is calibrated if it asks for that, opens "
            f"{tool} and carries out ten steps; Ctrl-C ends after the move under way."
        )
        _run(planned, host, tool, None, as_json, check, clearance)
    elif model is not None:
        with SimulatedNiryo(model, time_scale=time_scale or 1.0, tool=tool) as simulated:
            simulated.place_object(OBJECT_START)
            stderr().print(f"Driving a simulated {robot} at {simulated.address}")
            _run(planned, simulated.address, tool, simulated, as_json, check, clearance)


def _check(
    arm: Robot,
    model: NiryoModel | None,
    unchecked: bool,
    asked: tuple[float | None, float | None, Path | None],
    tool: str,
    base: str | None,
    tip: str | None,
) -> CollisionCheck | None:
    """What the arm has to stay clear of; None, and a word of it, where no shape is known.

    Args:
        arm: that carries the plan out.
        model: what is known of it, if it is a Niryo.
        unchecked: whether nothing is to be looked at.
        asked: the table, the margin and the description that were given.
        tool: on a Niryo.
        base, tip: of the description.
    """
    table, margin, file = asked
    given = any(value is not None for value in asked)
    if unchecked:
        if given:
            raise typer.BadParameter(
                "--no-collision-check goes without --table, --margin and --collision-model"
            )
        return None
    if model is None and not given:
        stderr().print(
            f"note: collisions are not looked at, for no shape of {arm.name} comes with the "
            "package; --collision-model FILE.urdf gives one"
        )
        return None
    height = _TABLE if table is None else table
    on_niryo = tool if file is None and model is not None else None
    return collision_check(arm, True, height, margin, file, on_niryo, base, tip)


def _looked_at(planned: Plan, check: CollisionCheck) -> PlanClearance:
    """How clear the plan is, which is refused where it collides."""
    try:
        with busy("Looking along the ways of the plan"):
            return check_plan(planned, check)
    except StepCollides as error:
        found = {"step": error.step, "pair": list(error.pair), "distance_m": error.distance}
        document = plan_document(planned) | {"collision": found}
        raise Failure(str(error), ExitCode.COLLISION, document) from error


def _run(
    planned: Plan,
    host: str,
    tool: str,
    simulated: SimulatedNiryo | None,
    as_json: bool,
    check: CollisionCheck | None,
    clearance: PlanClearance | None,
) -> None:
    """Execute the plan and show what became of it, also where it ends early."""
    progress = StepProgress(planned, simulated)

    def approach(q: Vector) -> None:
        if check is not None:
            check_approach(planned, check, q)

    failure = driven(
        planned,
        host,
        planned.robot,
        tool,
        progress.records,
        progress.advance,
        progress,
        approach=approach,
    )
    document = plan_document(planned, host, progress.records)
    document["clearance"] = clearance_document(clearance)
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
