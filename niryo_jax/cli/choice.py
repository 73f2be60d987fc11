"""Which arm a command is about: one of the catalogue, or one of a URDF or MJCF file."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated
from xml.etree import ElementTree

import typer

from niryo_jax.cli.outcome import ExitCode, Failure
from niryo_jax.cli.streams import read_stdin
from niryo_jax.robot import Robot
from niryo_jax.robots import catalogue
from niryo_jax.robots.mjcf import from_mjcf
from niryo_jax.robots.urdf import from_urdf

_READERS: dict[str, Callable[..., Robot]] = {"robot": from_urdf, "mujoco": from_mjcf}
"""By the root element of a document."""


def _names(incomplete: str) -> list[str]:
    """The names of the catalogue that begin so; a shell adds its files where there are none."""
    return [name for name in catalogue.names() if name.startswith(incomplete)]


ARM = "ROBOT-OR-FILE"
ARM_HELP = "A robot that `niryo-jax robots` lists, or a URDF or MJCF file, or - for one on stdin."

ArmArgument = Annotated[
    str | None,
    typer.Argument(
        metavar=ARM,
        autocompletion=_names,
        show_default=False,
        help=f"{ARM_HELP} niryo_one unless given.",
    ),
]
ArmOption = Annotated[
    str, typer.Option("--robot", metavar=ARM, autocompletion=_names, help=ARM_HELP)
]
BaseOption = Annotated[
    str | None,
    typer.Option(metavar="LINK", help="Of a file: the link (or body) the chain starts at."),
]
TipOption = Annotated[
    str | None,
    typer.Option(metavar="LINK", help="Of a file: the link (or body, or site) it ends at."),
]


def load_arm(name: str, base: str | None = None, tip: str | None = None) -> Robot:
    """The arm of a name that `niryo-jax robots` lists, or of a URDF or MJCF file.

    Raises:
        typer.BadParameter: there is no such arm or file.
        Failure: the file cannot be read as an arm, or what reads it is not installed.
    """
    if name in catalogue.names():
        if base is not None or tip is not None:
            raise typer.BadParameter(
                "--base and --tip choose the chain of a URDF or MJCF file; "
                f"{name} is a robot of the catalogue"
            )
        return catalogue.load(name)
    pipe = name == "-" or (os.path.exists(name) and Path(name).is_fifo())
    if not pipe and not os.path.isfile(name):
        known = ", ".join(catalogue.names())
        kind = "is a directory, and " if os.path.isdir(name) else ""
        raise typer.BadParameter(
            f"ROBOT: {name!r} {kind}is neither a URDF or MJCF file nor one of the robots {known}"
        )
    try:
        content = read_stdin().encode() if name == "-" else Path(name).read_bytes()
        kind = _root_element(content)
        # A model may include files that lie beside it; MuJoCo knows one by how its name ends.
        as_file = not pipe and (kind == "robot" or name.endswith(".xml"))
        return _READERS[kind](Path(name) if as_file else content.decode(), base, tip)
    except ImportError as error:
        raise Failure(str(error), ExitCode.MISSING_EXTRA) from error
    except (ValueError, OSError) as error:
        where = "standard input" if name == "-" else name
        said = " ".join(str(error).removeprefix("path: ").split())
        raise Failure(f"ROBOT: {where}: {said}", ExitCode.USAGE) from error


def _root_element(content: bytes) -> str:
    """The name of a document's outermost element: "robot" of a URDF, "mujoco" of an MJCF model."""
    try:
        _, root = next(iter(ElementTree.iterparse(io.BytesIO(content), ["start"])))
    except ElementTree.ParseError as error:
        raise ValueError(f"expected a URDF or MJCF document; this is no XML: {error}") from error
    if root.tag not in _READERS:
        raise ValueError(f"expected a URDF (<robot>) or an MJCF model (<mujoco>), got <{root.tag}>")
    return root.tag
