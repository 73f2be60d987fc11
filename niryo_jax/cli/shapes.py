"""Options that say what an arm may not touch, and the check that they make."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from niryo_jax.cli.console import busy
from niryo_jax.cli.outcome import ExitCode, Failure
from niryo_jax.collision import (
    CollisionCheck,
    CollisionModel,
    World,
    from_urdf,
    prune,
    shipped,
)
from niryo_jax.collision.niryo import axes_alike
from niryo_jax.robot import Robot
from niryo_jax.robots.urdf import from_urdf as robot_from_urdf

CollisionOption = Annotated[
    bool,
    typer.Option("--collision", help="Look at collisions of the arm with itself, and a table."),
]
TableOption = Annotated[
    float | None,
    typer.Option(metavar="Z", help="A table at this height, metres, in the base frame."),
]
MarginOption = Annotated[
    float | None,
    typer.Option(metavar="M", help="Metres by which all is to be apart; 0 unless given."),
]
CollisionModelOption = Annotated[
    Path | None,
    typer.Option(
        "--collision-model",
        metavar="URDF",
        help="A description whose collision elements are the arm's shape; for a Niryo, the shape "
        "that comes with the package unless given.",
    ),
]
CollisionToolOption = Annotated[
    str | None,
    typer.Option(
        "--collision-tool", metavar="TOOL", help="The tool on a Niryo, part of its shape."
    ),
]


def collision_check(
    robot: Robot,
    wanted: bool,
    table: float | None = None,
    margin: float | None = None,
    model: Path | None = None,
    tool: str | None = None,
    base: str | None = None,
    tip: str | None = None,
) -> CollisionCheck | None:
    """What the options ask for; None where collisions are not looked at.

    Raises:
        typer.BadParameter: options that go with --collision alone, or that make no sense.
        Failure: the arm has no shape, its file cannot be read, or what reads it is not installed.
    """
    given = {
        "--table": table,
        "--margin": margin,
        "--collision-model": model,
        "--collision-tool": tool,
    }
    if not wanted:
        for name, value in given.items():
            if value is not None:
                raise typer.BadParameter(f"{name} goes with --collision")
        return None
    if model is not None and tool is not None:
        raise typer.BadParameter("--collision-tool is of a Niryo's shape, not of a file's")
    try:
        world = None if table is None else World.table(table)
        shape = _shape(robot, tool) if model is None else _read(robot, model, base, tip)
        return CollisionCheck(shape, world, 0.0 if margin is None else margin)
    except ValueError as error:
        # The library's names of the arguments, as the options are called.
        said = str(error).replace("height: ", "--table: ").replace("margin: ", "--margin: ")
        raise typer.BadParameter(said.replace("tool: ", "--collision-tool: ")) from error


def _shape(robot: Robot, tool: str | None) -> CollisionModel:
    try:
        return shipped(robot, tool)
    except ValueError as error:
        if not str(error).startswith("robot: "):
            raise
        raise Failure(
            f"no shape of {robot.name} comes with the package; give one: --collision-model "
            "FILE.urdf, a description with collision elements",
            ExitCode.USAGE,
        ) from None


def _read(robot: Robot, file: Path, base: str | None, tip: str | None) -> CollisionModel:
    """The capsules of a description, without the pairs that always touch."""
    try:
        if not axes_alike(robot, robot_from_urdf(file, base, tip)):
            raise ValueError(f"its joints are not those of {robot.name}")
        model = from_urdf(file, base, tip)
        with busy("Finding the pairs of links that always touch"):
            return prune(robot, model).model
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    except (ValueError, OSError) as error:
        said = " ".join(str(error).removeprefix("path: ").split())
        raise Failure(f"--collision-model: {file}: {said}", ExitCode.USAGE) from error
