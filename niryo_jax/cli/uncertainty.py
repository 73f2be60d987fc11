"""`niryo-jax uncertainty`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer
from rich.table import Table

from niryo_jax import uncertainty as un
from niryo_jax.chain import forward_kinematics
from niryo_jax.cli.choice import ArmOption, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import busy, show_lines, show_table
from niryo_jax.cli.options import (
    DegreesOption,
    JsonOption,
    finite,
    joint_unit_name,
    joint_units,
    number_words,
    numbers,
)
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.tables import millimetres, new_table
from niryo_jax.robot import Robot


def uncertainty(
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
    sigma: Annotated[
        str,
        typer.Option(
            help="Standard deviation of the joints' errors, in the unit of Q: "
            'one number for all, or one for each in quotes, "0.1 0.1 0.2 ...".'
        ),
    ],
    samples: Annotated[
        int | None, typer.Option(help="Draw so many errors too, and show what they make.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Of what is drawn.")] = 0,
    probability: Annotated[
        float, typer.Option(help="That the error is inside the ellipsoid shown.")
    ] = 0.95,
    figure: Annotated[Path | None, typer.Option(help="Write a figure: .png, .svg or .pdf.")] = None,
    robot: ArmOption = "niryo_one",
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """What errors of the joints make of the pose of the tool at joint angles Q."""
    values = numbers(" ".join(q))
    arm = load_arm(robot, base, tip)
    units = joint_units(arm, degrees)
    joints = finite("Q", values, arm.joints, "angles") * units
    deviations = _sigma(sigma, arm.joints) * units
    noise = un.Gaussian.independent(deviations)
    key = jax.random.key(seed)
    try:
        with busy("Working it out"):
            found = un.propagate(arm, joints, noise.covariance(joints))
            shape = found.ellipsoid(probability)
            alone = un.sensitivity(arm, joints, deviations)
            trials = None
            if samples is not None:
                trials = un.monte_carlo(arm, joints, noise, key, samples)
            if figure is not None:
                _draw(arm, joints, noise, key, probability, figure)
    except ValueError as error:
        raise Failure(str(error), ExitCode.USAGE) from error
    if as_json:
        print_json(_document(arm, joints, deviations, found, shape, alone, trials))
        return
    show_table(_joints_table(arm, alone, deviations / units, joint_unit_name(arm, degrees)))
    position = np.asarray(forward_kinematics(arm, joints))[:3, 3]
    show_lines(f"tool at (mm)                {millimetres(position)}")
    show_table(_whole_table(found, shape, trials, probability))
    if figure is not None:
        show_lines(f"wrote {figure}")


def _sigma(text: str, joints: int) -> np.ndarray:
    given = numbers(text)
    values = finite("--sigma", given * joints if len(given) == 1 else given, joints, "numbers")
    if np.any(values < 0):
        raise typer.BadParameter(f"--sigma: expected 0 or more, got {text!r}")
    return values


def _draw(
    arm: Robot,
    joints: np.ndarray,
    noise: un.Noise,
    key: jax.Array,
    probability: float,
    where: Path,
) -> None:
    # Imported here: matplotlib is asked for by nothing else.
    from niryo_jax.figures import save
    from niryo_jax.uncertainty.figures import error_figure

    try:
        save(error_figure(arm, joints, noise, key, probability=probability), where)
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    except OSError as error:
        raise Failure(f"cannot write {where}: {error.strerror or error}", ExitCode.USAGE) from error


def _joints_table(arm: Robot, alone: un.Sensitivity, sigma: np.ndarray, unit: str) -> Table:
    """What the error of each joint does alone."""
    table = new_table("Each joint alone, by one standard deviation")
    table.add_column("joint", no_wrap=True)
    heads = (f"sigma ({unit})", "tool moves (mm)", "tool turns (mrad)", "place")
    for head in heads:
        table.add_column(head, justify="right")
    ranking = np.asarray(alone.ranking).tolist()
    rows = zip(arm.joint_names, sigma, alone.millimetres.tolist(), alone.milliradians.tolist())
    for number, (name, deviation, moves, turns) in enumerate(rows):
        place = str(1 + ranking.index(number))
        table.add_row(name, f"{deviation:.6g}", f"{moves:.3f}", f"{turns:.3f}", place)
    return table


def _whole_table(
    found: un.Propagated, shape: un.Ellipsoid, trials: un.MonteCarlo | None, probability: float
) -> Table:
    """All joints together: by the formula, and as drawn."""
    table = new_table("All joints together, position of the tool (mm)")
    table.add_column("", no_wrap=True)
    table.add_column("first order", justify="right", no_wrap=True)
    rows: list[tuple[str, str]] = [
        ("rms about the mean", f"{1e3 * float(found.rms):.3f}"),
        ("half axes, one sigma", millimetres(found.ellipsoid().half_axes, 3)),
        (f"half axes, {100 * probability:g} %", millimetres(shape.half_axes, 3)),
        ("mean shift x, y, z", f"{millimetres(found.mean_shift, 4)} (second order)"),
    ]
    drawn = [""] * len(rows)
    if trials is not None:
        table.add_column(f"{trials.samples:,} draws", justify="right", no_wrap=True)
        about = float(np.sqrt(np.trace(trials.position_covariance)))
        drawn = [
            f"{1e3 * about:.3f}",
            millimetres(trials.ellipsoid().half_axes, 3),
            millimetres(trials.ellipsoid(probability).half_axes, 3),
            millimetres(trials.mean_shift, 4),
        ]
        rows += [("mean of the error's norm", "")]
        drawn += [f"{1e3 * float(trials.mean_norm):.3f}"]
        for level, value in zip(trials.levels, trials.percentiles.tolist()):
            rows.append((f"{level:g} % are below", ""))
            drawn.append(f"{1e3 * value:.3f}")
    for (name, value), other in zip(rows, drawn):
        table.add_row(name, value, *([other] if trials is not None else []))
    return table


def _document(
    arm: Robot,
    joints: np.ndarray,
    sigma: np.ndarray,
    found: un.Propagated,
    shape: un.Ellipsoid,
    alone: un.Sensitivity,
    trials: un.MonteCarlo | None,
) -> dict[str, object]:
    document: dict[str, object] = {
        "robot": arm.name,
        "joints_rad": joints.tolist(),
        "sigma_rad": sigma.tolist(),
        "frame": found.frame,
        "covariance": found.covariance.tolist(),
        "rms_m": float(found.rms),
        "mean_shift_m": found.mean_shift.tolist(),
        "half_axes_one_sigma_m": found.ellipsoid().half_axes.tolist(),
        "probability": shape.probability,
        "half_axes_m": shape.half_axes.tolist(),
        "directions": shape.directions.tolist(),
        "joints": [
            {"name": name, "position_m": position, "rotation_rad": rotation}
            for name, position, rotation in zip(
                arm.joint_names, alone.position.tolist(), alone.rotation.tolist()
            )
        ],
    }
    if trials is not None:
        document["draws"] = {
            "samples": trials.samples,
            "mean": trials.mean.tolist(),
            "covariance": trials.covariance.tolist(),
            "rms_m": float(trials.rms),
            "mean_norm_m": float(trials.mean_norm),
            "percentiles_m": {
                f"{level:g}": value
                for level, value in zip(trials.levels, trials.percentiles.tolist())
            },
        }
    return document
