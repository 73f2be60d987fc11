"""`niryo-jax robots` and `describe`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import ArrayLike

from niryo_jax.cli.console import stdout
from niryo_jax.cli.options import JsonOption
from niryo_jax.cli.outcome import ExitCode, Failure, print_json
from niryo_jax.cli.tables import new_table
from niryo_jax.robot import Robot
from niryo_jax.robots import catalogue
from niryo_jax.robots.urdf import from_urdf
from niryo_jax.structure import axes


def robots(as_json: JsonOption = False) -> None:
    """The arms that come with the package: joints, structure, and how they are solved."""
    arms = {name: catalogue.load(name) for name in catalogue.names()}
    if as_json:
        documents = [
            {"name": name, "joints": arm.joints, "kinds": _kinds(arm), "structure": _structure(arm)}
            for name, arm in arms.items()
        ]
        print_json({"robots": documents})
        return
    table = new_table("Robots; joints: R revolute, P prismatic, H helical")
    table.add_column("name", no_wrap=True)
    table.add_column("joints", justify="right")
    table.add_column("kinds", no_wrap=True)
    table.add_column("structure and inverse kinematics")
    for name, arm in arms.items():
        table.add_row(name, str(arm.joints), _kinds(arm), "\n".join(_structure(arm)))
    stdout().print(table)


def describe(
    arm: Annotated[
        str | None,
        typer.Argument(
            metavar="ROBOT-OR-URDF",
            help="A robot that `niryo-jax robots` lists, or a URDF file; niryo_one unless given.",
        ),
    ] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", metavar="ROBOT", help="The same as the argument.")
    ] = None,
    base: Annotated[
        str | None, typer.Option(help="URDF: the link that the chain starts at.")
    ] = None,
    tip: Annotated[str | None, typer.Option(help="URDF: the link that it ends at.")] = None,
    as_json: JsonOption = False,
) -> None:
    """An arm in words: joints, limits, home pose, and how its axes lie to each other."""
    if arm is not None and robot is not None:
        raise typer.BadParameter("name the robot once: as the argument, or with --robot")
    chosen = load_arm(arm or robot or "niryo_one", base, tip)
    if not as_json:
        stdout().print(chosen.describe(), markup=False)
        return
    document = {
        "robot": chosen.name,
        "joint_names": list(chosen.joint_names),
        "joint_kinds": list(axes.joint_kinds(chosen.known_screws())),
        "lower_rad": _finite_or_none(chosen.lower),
        "upper_rad": _finite_or_none(chosen.upper),
        "screws": np.asarray(chosen.screws).tolist(),
        "home": np.asarray(chosen.home).tolist(),
        "description": chosen.describe(),
    }
    print_json(document)


def load_arm(name: str, base: str | None, tip: str | None) -> Robot:
    """The arm of a name that `niryo-jax robots` lists, or of a URDF file."""
    if name in catalogue.names():
        if base is not None or tip is not None:
            raise typer.BadParameter("--base and --tip choose the chain of a URDF file")
        return catalogue.load(name)
    if not Path(name).is_file():
        known = ", ".join(catalogue.names())
        raise typer.BadParameter(
            f"ROBOT: {name!r} is neither a URDF file nor one of the robots {known}"
        )
    try:
        return from_urdf(Path(name), base, tip)
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    except (ValueError, OSError) as error:
        raise Failure(str(error), ExitCode.USAGE) from error


def _kinds(arm: Robot) -> str:
    """A letter for each joint."""
    return "".join(kind[0].upper() for kind in axes.joint_kinds(arm.known_screws()))


def _structure(arm: Robot) -> list[str]:
    """The family of an arm and what solves it: its description less joints, axes and tool."""
    lines = [line.strip() for line in arm.describe().splitlines()[1 + arm.joints :]]
    return [line for line in lines if not line.startswith(("axes ", "tool at home"))]


def _finite_or_none(limits: ArrayLike) -> list[float | None]:
    """Limits for JSON, which has no infinity: null where there is none."""
    return [float(x) if np.isfinite(x) else None for x in np.asarray(limits)]
