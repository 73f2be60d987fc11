"""A timed plan, and what became of it, as tables and for JSON documents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from niryo_jax.cli.console import busy
from niryo_jax.cli.driving import plan_document
from niryo_jax.cli.tables import angles, error_of, steps_table, target
from niryo_jax.hardware.pick_and_place import Plan
from niryo_jax.studies import TimedPlan, TimedRecord, timed_plan


def time_plan(planned: Plan, dwell: float | None) -> TimedPlan:
    """A plan in time, its rests as long as asked for."""
    with busy("Timing the ways of the plan"):
        return timed_plan(planned) if dwell is None else timed_plan(planned, dwell=dwell)


def timed_document(
    timed: TimedPlan, host: str | None = None, records: Sequence[TimedRecord] = ()
) -> dict[str, object]:
    """A timed plan, and what became of its steps, for a JSON document."""
    document = plan_document(timed.plan, host)
    steps = document["steps"]
    assert isinstance(steps, list)
    for step, when in zip(steps, timed.steps, strict=True):
        step |= {
            "begin_s": when.begin,
            "end_s": when.end,
            "way": when.way,
            "rests": when.rests,
        }
    for step, record in zip(steps, records, strict=False):
        step |= {
            "joints_read_rad": None if record.reached is None else record.reached.tolist(),
            "reached_error_m": record.position_error,
            "reached_s": record.end,
        }
    return document | {"steps_done": len(records), "duration_s": timed.duration}


def trajectory_document(timed: TimedPlan) -> dict[str, object]:
    """The samples of a timed plan, for a JSON document."""
    names = "time_s", "joints_rad", "velocities_rad_s", "accelerations_rad_s2"
    numbers = (np.asarray(x).tolist() for x in timed.trajectory)
    return {"trajectory": dict(zip(names, numbers))}


def timed_words(timed: TimedPlan) -> str:
    """How long a timed plan takes, as a sentence."""
    passed = [str(i) for i, step in enumerate(timed.steps, start=1) if not step.rests]
    through = f"; it does not halt at the ends of steps {', '.join(passed)}" if passed else ""
    return f"The trajectory takes {timed.duration:.2f} s{through}."


def timed_table(timed: TimedPlan) -> Table:
    """The steps of a timed plan before it is executed."""
    columns = "way", "speed", "begin\n(s)", "end\n(s)"
    table = steps_table("Plan in time", "joints at the end (deg)", *columns)
    for number, (planned, step) in enumerate(zip(timed.plan.steps, timed.steps), start=1):
        table.add_row(
            str(number),
            planned.step.title,
            target(planned),
            angles(planned.joints, degrees=True, width=7),
            step.way,
            f"{planned.step.percent} %" if step.way in ("free", "line") else "",
            f"{step.begin:.2f}",
            f"{step.end:.2f}",
        )
    return table


def timed_records_table(records: Sequence[TimedRecord]) -> Table:
    """The steps of a timed plan after it was executed."""
    columns = "error\n(mm)", "planned\n(s)", "was\n(s)"
    table = steps_table("Executed", "joints read back (deg)", *columns)
    for number, record in enumerate(records, start=1):
        table.add_row(
            str(number),
            record.planned.step.title,
            target(record.planned),
            "no halt" if record.reached is None else angles(record.reached, True, width=7),
            error_of(record.position_error),
            f"{record.timed.end:.2f}",
            "" if record.end is None else f"{record.end:.2f}",
        )
    return table
