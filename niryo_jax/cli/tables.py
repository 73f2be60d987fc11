"""What the commands show to people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from rich import box
from rich.table import Table

from niryo_jax.cli.options import in_unit, joint_unit_name, joint_units
from niryo_jax.collision import Distances
from niryo_jax.ik import IKSolutions
from niryo_jax.robot import Robot

if TYPE_CHECKING:
    from niryo_jax.hardware.pick_and_place import Plan, PlannedStep, StepRecord


def angles(q: ArrayLike, degrees: bool, width: int = 0) -> str:
    """Joint angles (n,) in radians, in the unit to show."""
    decimals = 2 if degrees else 4
    # Adding 0.0 turns the negative zero that rounding leaves into a positive one.
    rounded = np.round(in_unit(q, degrees), decimals) + 0.0
    return " ".join(f"{value:{width}.{decimals}f}" for value in rounded)


def millimetres(position: ArrayLike, decimals: int = 1) -> str:
    """A position (3,) in metres, as numbers of millimetres."""
    rounded = np.round(np.asarray(position) * 1e3, decimals) + 0.0
    return ", ".join(f"{value:.{decimals}f}" for value in rounded)


def digits(values: ArrayLike) -> str:
    """Numbers with all the digits that matter, to be copied: into a command, or between brackets.

    A picometre, or a millionth of a microradian, is below what any answer is accurate to.
    """
    shown = [0.0 if abs(x) < 5e-13 else x for x in np.asarray(values, dtype=np.float64)]
    return ", ".join(np.format_float_positional(x, precision=12, trim="0") for x in shown)


def solutions_table(
    robot: Robot, solutions: IKSolutions, degrees: bool, apart: Distances | None = None
) -> Table:
    """The solutions of one pose, best first; with their clearance where distances are given."""
    table = new_table(f"Solutions, joints in {joint_unit_name(robot, degrees)}")
    table.add_column("", justify="right")
    for name in robot.joint_names:
        table.add_column(name, justify="right")
    table.add_column("within limits")
    table.add_column("error (m)", justify="right")
    errors = [solutions.position_error]
    if solutions.task == "direction":
        table.add_column("axis off by (rad)", justify="right")
        errors.append(solutions.rotation_error)
    if apart is not None:
        table.add_column("clearance (mm)", justify="right")
        table.add_column("nearest", no_wrap=True)
    units = joint_units(robot, degrees)
    decimals = np.where(units == 1.0, 4, 2)
    for slot in np.flatnonzero(np.asarray(solutions.found)):
        shown = zip(np.asarray(solutions.q[slot]) / units, decimals)
        row = [f"{round(float(value), count) + 0.0:.{count}f}" for value, count in shown]
        within = "yes" if solutions.within_limits[slot] else "no"
        missed = (f"{float(error[slot]):.0e}" for error in errors)
        room = () if apart is None else _room(apart, int(slot))
        table.add_row(str(slot + 1), *row, within, *missed, *room)
    return table


def _room(apart: Distances, slot: int) -> tuple[str, str]:
    """The least distance of a solution, and between what."""
    if not apart.pairs:
        return "", ""
    least = float(np.min(apart.distance[slot]))
    return f"{1e3 * least + 0.0:.1f}", ", ".join(apart.nearest_pair(slot))


def plan_table(plan: Plan) -> Table:
    """The steps of a task before it is executed."""
    table = steps_table("Plan", "joints (deg)", "error\n(mm)", "speed")
    for number, planned in enumerate(plan.steps, start=1):
        table.add_row(
            str(number),
            planned.step.title,
            target(planned),
            angles(planned.joints, degrees=True, width=7),
            error_of(planned.position_error),
            f"{planned.step.percent} %" if planned.step.action == "move" else "",
        )
    return table


def records_table(records: Sequence[StepRecord]) -> Table:
    """The steps of a task after it was executed."""
    joints = "joints sent, below read back (deg)"
    table = steps_table("Executed", joints, "error\n(mm)", "time\n(s)")
    for number, record in enumerate(records, start=1):
        planned = record.planned
        sent = (
            angles(planned.joints, degrees=True, width=7) if planned.step.pose is not None else ""
        )
        table.add_row(
            str(number),
            planned.step.title,
            target(planned),
            f"{sent}\n{angles(record.reached, degrees=True, width=7)}".strip("\n"),
            error_of(record.position_error),
            f"{record.seconds:.2f}",
        )
    return table


def new_table(title: str) -> Table:
    """An empty table in the style of all."""
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)


def steps_table(title: str, joints: str, *others: str) -> Table:
    """An empty table of steps: number, title, target, a column for joints, and other ones."""
    table = new_table(title)
    table.add_column("", justify="right")
    table.add_column("step", max_width=18)
    table.add_column("target (mm)", justify="right", no_wrap=True)
    table.add_column(joints, no_wrap=True)
    for other in others:
        table.add_column(other, justify="right", no_wrap=True)
    return table


def target(planned: PlannedStep) -> str:
    """Where a step brings the tool, millimetres; nothing of a step that is no move."""
    return "" if planned.step.pose is None else millimetres(planned.step.pose[:3, 3], decimals=0)


def error_of(metres: float | None) -> str:
    """An error of a position, millimetres; nothing where there is none."""
    return "" if metres is None else f"{metres * 1e3:.3f}"
