"""`niryo-jax robots` and `describe`."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from niryo_jax.cli.choice import ARM, ArmArgument, BaseOption, TipOption, load_arm
from niryo_jax.cli.console import show_lines, show_table
from niryo_jax.cli.options import JsonOption
from niryo_jax.cli.outcome import json_number, print_json
from niryo_jax.cli.tables import new_table
from niryo_jax.robot import Robot
from niryo_jax.robots import catalogue
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
    show_table(table)


def describe(
    arm: ArmArgument = None,
    robot: Annotated[
        str | None, typer.Option("--robot", metavar=ARM, help="The same as the argument.")
    ] = None,
    base: BaseOption = None,
    tip: TipOption = None,
    as_json: JsonOption = False,
) -> None:
    """An arm in words: joints, limits, home pose, and how its axes lie to each other."""
    if arm is not None and robot is not None:
        raise typer.BadParameter("name the robot once: as the argument, or with --robot")
    given = robot if arm is None else arm
    chosen = load_arm("niryo_one" if given is None else given, base, tip)
    if not as_json:
        show_lines(chosen.describe())
        return
    document = {
        "robot": chosen.name,
        "joint_names": list(chosen.joint_names),
        "joint_kinds": list(axes.joint_kinds(chosen.known_screws())),
        "lower_rad": [json_number(x) for x in np.asarray(chosen.lower)],
        "upper_rad": [json_number(x) for x in np.asarray(chosen.upper)],
        "screws": np.asarray(chosen.screws).tolist(),
        "home": np.asarray(chosen.home).tolist(),
        "description": chosen.describe(),
    }
    print_json(document)


def _kinds(arm: Robot) -> str:
    """A letter for each joint."""
    return "".join(kind[0].upper() for kind in axes.joint_kinds(arm.known_screws()))


def _structure(arm: Robot) -> list[str]:
    """The family of an arm and what solves it: its description less joints, axes and tool."""
    lines = [line.strip() for line in arm.describe().splitlines()[1 + arm.joints :]]
    return [line for line in lines if not line.startswith(("axes ", "tool at home"))]
