"""`niryo-jax stack`: four stacked blocks into a layout, by a simulated worn arm or a real one."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from niryo_jax.calibration import fit, read_measurements
from niryo_jax.cli.console import busy, show_lines, show_table, stderr
from niryo_jax.cli.driving import driven, plan_document
from niryo_jax.cli.options import DryRunOption, HostOption, JsonOption
from niryo_jax.cli.outcome import Failure, print_json
from niryo_jax.cli.tables import new_table, plan_table
from niryo_jax.hardware import NiryoArm, pyniryo_version
from niryo_jax.hardware.pick_and_place import Plan, StepRecord, execute, plan
from niryo_jax.hardware.stacking import PAUSE, TOOL, Layout, Placed, steps_for
from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS
from niryo_jax.studies import PARAMETERS, StackingStudy, block_stacking


def stack(
    host: HostOption = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="What was measured of the robot (docs/calibration.md): its joint offsets and gear "
            "errors are estimated, and corrected."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the simulated arm's wear.")] = 0,
    measurements: Annotated[
        int, typer.Option(min=2, max=200, help="Poses measured of the simulated arm.")
    ] = 30,
    stack_at: Annotated[
        tuple[float, float], typer.Option(metavar="X Y", help="Where the stack is, mm.")
    ] = (150.0, -150.0),
    target_at: Annotated[
        tuple[float, float], typer.Option(metavar="X Y", help="The layout's middle, mm.")
    ] = (150.0, 150.0),
    dry_run: DryRunOption = False,
    robot: Annotated[str, typer.Option(help=f"The arm: one of {', '.join(MODELS)}.")] = "niryo_one",
    as_json: JsonOption = False,
) -> None:
    """Move four stacked blocks into a layout of two by two with 1 mm to spare.

    Without --host a simulated worn arm does it, is calibrated, and does it again: what that gains
    is shown. It moves faster than a robot.
    """
    model = MODELS.get(robot)
    if model is None:
        raise typer.BadParameter(f"--robot: expected one of {', '.join(MODELS)}, got {robot!r}")
    if calibration is not None and host is None and not dry_run:
        raise typer.BadParameter("--calibration is of a robot: give its --host, or --dry-run")
    (x, y), (u, v) = stack_at, target_at
    layout = Layout((x * 1e-3, y * 1e-3), (u * 1e-3, v * 1e-3))
    if host is None and not dry_run:
        pyniryo_version()
        with busy("A worn arm stacks, is calibrated, and stacks again"):
            study = block_stacking(seed, model=model, layout=layout, measurements=measurements)
        _show(study, as_json)
        return
    arm, gears = model.robot(), np.zeros(6)
    if calibration is not None:
        try:
            table = read_measurements(calibration, arm)
            found = fit(arm, table.q, table.measured, PARAMETERS, redundant="hold")
        except (ValueError, OSError) as error:
            raise typer.BadParameter(str(error)) from error
        stderr().print(found.message)
        arm, gears = found.robot, found.gears
    with busy("Solving all poses in one batch"):
        planned = plan(arm, steps_for(layout, model), gears=gears)
    if dry_run:
        if as_json:
            print_json(plan_document(planned))
        else:
            show_table(plan_table(planned))
    elif host is not None:
        _drive(planned, host, model.robot(), as_json)


def _drive(planned: Plan, host: str, robot: Robot, as_json: bool) -> None:
    stderr().print(f"Driving the {robot.name} at {host}; Ctrl-C ends after the move under way.")
    records = list[StepRecord]()

    def note(record: StepRecord) -> None:
        records.append(record)
        step = record.planned.step
        if step.action != "move":
            stderr().print(f"{len(records):4d}/{len(planned.steps)}  {step.title}")

    def carry_out(arm: NiryoArm) -> None:
        execute(planned, arm, note, pause=PAUSE)

    failure = driven(planned, host, robot, TOOL, records, nullcontext(), carry_out)
    document = plan_document(planned, host, records)
    if failure is not None:
        raise Failure(str(failure), failure.code, document)
    if as_json:
        print_json(document)


def _show(study: StackingStudy, as_json: bool) -> None:
    found = study.calibration
    if as_json:
        print_json(
            {
                "wear": {
                    "offsets_rad": np.asarray(study.wear.offsets).tolist(),
                    "gears": np.asarray(study.wear.gears).tolist(),
                },
                "calibration": dict(zip(found.names, found.values.tolist())),
                "before": [_block(x) for x in study.before],
                "after": [_block(x) for x in study.after],
            }
        )
        return
    shown = new_table("Blocks, as seen from their cells")
    lying = "turned (deg)", "in its cell"
    for head in ("block", "before (mm)", *lying, "after (mm)", *lying):
        shown.add_column(head, justify="right", no_wrap=True)
    for number, pair in enumerate(zip(study.before, study.after), start=1):
        shown.add_row(str(number), *(word for placed in pair for word in _words(placed)))
    show_table(shown)
    before, after = (sum(x.inside for x in part) for part in (study.before, study.after))
    show_lines(found.message)
    show_lines(f"In their cells: {before} of 4 before the calibration, {after} of 4 after it.")


def _words(placed: Placed) -> list[str]:
    x, y, z = placed.position * 1e3 + 0.0
    return [
        f"{x:.2f}, {y:.2f}, {z:.1f}",
        f"{np.rad2deg(placed.turn):.2f}",
        "yes" if placed.inside else "no",
    ]


def _block(placed: Placed) -> dict[str, object]:
    return {
        "position_m": placed.position.tolist(),
        "turn_rad": placed.turn,
        "inside": placed.inside,
    }
