"""`niryo-jax pick-and-place`: Table 2.1, solved and executed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from niryo_jax.cli.choice import ArmOption, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import busy, note_rounding, show_lines, show_table, stderr
from niryo_jax.cli.driving import clearance_document, clearance_words, driven, plan_document
from niryo_jax.cli.options import DryRunOption, HostOption, JsonOption
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.progress import StepProgress
from niryo_jax.cli.shapes import CollisionModelOption, MarginOption, TableOption, collision_check
from niryo_jax.cli.tables import millimetres, plan_table, records_table
from niryo_jax.cli.timed import (
    time_plan,
    timed_document,
    timed_records_table,
    timed_table,
    timed_words,
    trajectory_document,
)
from niryo_jax.collision import CollisionCheck
from niryo_jax.hardware import NiryoArm, SimulatedNiryo, pyniryo_version
from niryo_jax.hardware.pick_and_place import (
    OBJECT_START,
    TABLE_2_1,
    Plan,
    StepRecord,
    Vector,
    execute,
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
from niryo_jax.studies import TimedPlan, TimedRecord, check_timed, execute_timed

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
    timed: Annotated[
        bool,
        typer.Option("--timed", help="As one timed trajectory, at rest where the gripper acts."),
    ] = False,
    dwell: Annotated[
        float | None,
        typer.Option(
            min=0, help="Seconds that the arm rests at each grip of a --timed plan (else 1)."
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

    With --timed the steps are one trajectory within the speeds and accelerations of the joints.
    """
    if dwell is not None and not timed:
        raise typer.BadParameter("--dwell goes with --timed")
    if dwell is not None and not math.isfinite(dwell):
        raise typer.BadParameter(f"--dwell: expected a finite number of seconds, got {dwell:g}")
    if time_scale is not None and (host is not None or dry_run):
        raise typer.BadParameter("--time-scale is for the simulated robot, when it moves")
    arm = load_arm(robot, base, tip)
    model = MODELS.get(robot)
    if model is None and not dry_run:
        raise typer.BadParameter(
            f"--robot: {robot!r} is no Niryo arm ({', '.join(MODELS)}), which alone can be driven; "
            "--dry-run solves and shows the plan of any arm"
        )
    if model is None and timed:
        raise typer.BadParameter(
            f"--timed: accelerations are known of {', '.join(MODELS)} alone, not of {robot!r}"
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
    in_time = time_plan(planned, dwell) if timed else None
    clearance = None if check is None else _looked_at(planned, in_time, check)
    task = Task(planned, in_time, tool, check, clearance, keep_time=(time_scale or 1.0) <= 1.0)
    note_rounding(max(step.pose_distance or 0.0 for step in planned.steps))
    if dry_run:
        _show_plan(task, as_json)
    elif host is not None:
        stderr().print(
            f"Driving the {robot} at {host}: it is calibrated if it asks for that, opens "
            f"{tool} and carries out ten steps; Ctrl-C ends after the move under way."
        )
        _run(task, host, None, as_json)
    elif model is not None:
        with SimulatedNiryo(model, time_scale=time_scale or 1.0, tool=tool) as simulated:
            simulated.place_object(OBJECT_START)
            stderr().print(f"Driving a simulated {robot} at {simulated.address}")
            _run(task, simulated.address, simulated, as_json)


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


def _looked_at(planned: Plan, timed: TimedPlan | None, check: CollisionCheck) -> PlanClearance:
    """How clear the plan is, which is refused where it collides."""
    try:
        with busy("Looking along the ways of the plan"):
            return check_plan(planned, check) if timed is None else check_timed(timed, check)
    except StepCollides as error:
        found: dict[str, object] = {
            "step": error.step,
            "pair": list(error.pair),
            "distance_m": error.distance,
        }
        document = plan_document(planned)
        if timed is not None:
            found["time_s"] = error.time
            document = timed_document(timed)
        raise Failure(str(error), ExitCode.COLLISION, document | {"collision": found}) from error


@dataclasses.dataclass(frozen=True)
class Task:
    """What is to be done, and what is known of it before.

    Attributes:
        planned: the steps.
        timed: them as one trajectory, if that is asked for.
        tool: that must be on the arm.
        check, clearance: what the arm has to stay clear of, and how clear it is; None where that
            is not looked at.
        keep_time: whether the arm waits for the times of a trajectory.
    """

    planned: Plan
    timed: TimedPlan | None
    tool: str
    check: CollisionCheck | None
    clearance: PlanClearance | None
    keep_time: bool

    def approach(self, q: Vector) -> None:
        """Refuse the way from joints (n,) to the first step where it collides."""
        if self.check is not None:
            check_approach(self.planned, self.check, q)


def _show_plan(task: Task, as_json: bool) -> None:
    planned, timed = task.planned, task.timed
    if as_json:
        if timed is None:
            document = plan_document(planned)
        else:
            document = timed_document(timed) | trajectory_document(timed)
        print_json(document | {"clearance": clearance_document(task.clearance)})
        return
    show_table(plan_table(planned) if timed is None else timed_table(timed))
    if timed is not None:
        show_lines(timed_words(timed))
    if task.clearance is not None:
        show_lines(clearance_words(task.clearance, planned))


def _run(task: Task, host: str, simulated: SimulatedNiryo | None, as_json: bool) -> None:
    """Execute the plan and show what became of it, also where it ends early."""
    if task.timed is None:
        document, shown, failure = _in_steps(task, host, simulated)
    else:
        document, shown, failure = _in_time(task, task.timed, host, simulated)
    document["clearance"] = clearance_document(task.clearance)
    position = None if simulated is None else simulated.object_position
    document["object_position_m"] = None if position is None else position.tolist()
    if not as_json and shown is not None:
        show_table(shown)
        if position is not None:
            show_lines(f"The object is at ({millimetres(position)}) mm.")
    if failure is not None:
        raise Failure(str(failure), failure.code, document)
    if as_json:
        print_json(document)


_Outcome = tuple[dict[str, object], Table | None, Failure | None]
"""A document, a table of the steps that were done, and why not all were."""


def _in_steps(task: Task, host: str, simulated: SimulatedNiryo | None) -> _Outcome:
    planned = task.planned
    progress = StepProgress[StepRecord](planned, simulated)

    failure = _driven(task, host, progress, lambda arm: execute(planned, arm, progress.advance))
    done = progress.records
    shown = records_table(done) if done else None
    return plan_document(planned, host, done), shown, failure


def _in_time(task: Task, timed: TimedPlan, host: str, simulated: SimulatedNiryo | None) -> _Outcome:
    progress = StepProgress[TimedRecord](task.planned, simulated)

    def carry_out(arm: NiryoArm) -> None:
        execute_timed(timed, arm, progress.advance, keep_time=task.keep_time)

    failure = _driven(task, host, progress, carry_out)
    done = progress.records
    shown = timed_records_table(done) if done else None
    return timed_document(timed, host, done), shown, failure


def _driven(
    task: Task, host: str, progress: StepProgress[Any], carry_out: Callable[[NiryoArm], object]
) -> Failure | None:
    planned, records = task.planned, progress.records
    return driven(
        planned, host, planned.robot, task.tool, records, progress, carry_out, task.approach
    )
