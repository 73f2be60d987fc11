"""`niryo-jax calibrate`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from niryo_jax.calibration import Calibration, fit, read_measurements
from niryo_jax.cli.choice import ArmOption, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import show_lines, show_table
from niryo_jax.cli.options import JsonOption
from niryo_jax.cli.outcome import print_json
from niryo_jax.cli.tables import new_table


class LossChoice(StrEnum):
    """The losses of `niryo_jax.calibration.fit`."""

    LINEAR = "linear"
    HUBER = "huber"
    TUKEY = "tukey"


def calibrate(
    file: Annotated[Path, typer.Argument(help="A table of measurements: docs/calibration.md.")],
    robot: ArmOption = "niryo_one",
    base: BaseOption = None,
    tip: TipOption = None,
    parameters: Annotated[
        str, typer.Option(help="What is estimated: some of screws,home,offsets,gears,base.")
    ] = "screws,home",
    hold: Annotated[
        list[str] | None, typer.Option(help="A parameter that is not; may be given repeatedly.")
    ] = None,
    loss: Annotated[
        LossChoice, typer.Option(help="huber or tukey where some measurements are wrong.")
    ] = LossChoice.LINEAR,
    sigma: Annotated[
        tuple[float, float],
        typer.Option(metavar="MM MRAD", help="Standard deviations of what was measured."),
    ] = (1.0, 1.0),
    keep_redundant: Annotated[
        bool, typer.Option(help="Hold what the measurements cannot tell, rather than refuse.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate what an arm is from what was measured of it: offsets, gears, axes, tool and base."""
    arm = load_arm(robot, base, tip)
    try:
        table = read_measurements(file, arm)
        found = fit(
            arm,
            table.q,
            table.measured,
            [word.strip() for word in parameters.split(",") if word.strip()],
            loss=loss.value,
            sigma=(sigma[0] * 1e-3, sigma[1] * 1e-3),
            hold=hold or (),
            redundant="hold" if keep_redundant else "refuse",
        )
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error)) from error
    if as_json:
        print_json(_document(found))
        return
    show_lines(found.message)
    show_lines("Turns in mrad, shifts in mm, gears in thousandths; ± one standard deviation:")
    shown = new_table("Parameters")
    for head in ("parameter", "value", "±"):
        shown.add_column(head, justify="left" if head == "parameter" else "right", no_wrap=True)
    for name, value, deviation in zip(found.names, found.values, found.deviations):
        shown.add_row(name, f"{value * 1e3:.4f}", f"{deviation * 1e3:.4f}")
    show_table(shown)


def _document(found: Calibration) -> dict[str, object]:
    """What another program needs of a fit: the arm, and how sure it is."""

    def left(name: str) -> dict[str, float | None] | None:
        residuals = getattr(found, name)
        if residuals is None:
            return None
        radians = residuals.radians
        return {"m": residuals.metres, "rad": None if np.isnan(radians) else radians}

    return {
        "robot": found.robot.name,
        "screws": np.asarray(found.robot.screws).tolist(),
        "home": np.asarray(found.robot.home).tolist(),
        "gears": found.gears.tolist(),
        "parameters": dict(zip(found.names, found.values.tolist())),
        "standard_deviations": dict(zip(found.names, found.deviations.tolist())),
        "residuals": {name: left(name) for name in ("before", "after", "held_out")},
        "not_told": list(found.combinations),
        "not_believed": found.doubted.tolist(),
        "settled": found.settled,
    }
