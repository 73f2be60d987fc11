"""Options that several commands share."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Annotated

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray

from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS, NiryoModel
from niryo_jax.structure.axes import joint_kinds

Vector = NDArray[np.float64]


class RobotName(StrEnum):
    """The arms of `niryo_jax.robots`."""

    NIRYO_ONE = "niryo_one"
    NIRYO_NED = "niryo_ned"
    NIRYO_NED2 = "niryo_ned2"

    @property
    def model(self) -> NiryoModel:
        """The arm's data."""
        return MODELS[self.value]


class TaskChoice(StrEnum):
    """What of a pose is bound (`niryo_jax.ik.task`)."""

    POSE = "pose"
    DIRECTION = "direction"
    POSITION = "position"


def _chosen(degrees: bool | None) -> bool:
    if degrees is None:
        raise typer.BadParameter("say which unit the angles are in: --degrees or --radians")
    return degrees


def numbers(text: str) -> list[float]:
    """Numbers as they are copied from anywhere: between spaces, commas, semicolons or brackets.

    Raises:
        typer.BadParameter: something else stands between them.
    """
    words = re.split(r"[\s,;\[\]()]+", text.replace("\N{MINUS SIGN}", "-"))
    found = list[float]()
    for word in filter(None, words):
        try:
            # Which Python would read over.
            found.append(float(word.replace("_", "no number")))
        except ValueError:
            raise typer.BadParameter(f"expected a number, got {word!r}") from None
    return found


def number_words(text: str) -> str:
    """A text as it is, once it is seen that there is nothing but numbers in it."""
    numbers(text)
    return text


def finite(name: str, values: list[float], count: int, what: str) -> Vector:
    """So many finite numbers.

    Raises:
        typer.BadParameter: there are more or fewer, or one that is not finite.
    """
    if len(values) != count or not np.all(np.isfinite(values)):
        given = " ".join(f"{value:.12g}" for value in values) or "none"
        raise typer.BadParameter(
            f"{name}: expected {count} finite {what}, got {len(values)}: {given}"
        )
    return np.array(values, dtype=np.float64)


NiryoOption = Annotated[RobotName, typer.Option("--robot", help="Which arm.")]
DegreesOption = Annotated[
    bool,
    typer.Option(
        "--degrees/--radians",
        # Required, yet without typer's own message, which would name only the first of the two.
        default_factory=lambda: None,
        callback=_chosen,
        show_default=False,
        help="Unit of all angles, given and shown; one of the two is required.",
    ),
]
TaskOption = Annotated[
    TaskChoice,
    typer.Option(
        "--task",
        help="What of the pose is bound: all of it, the position and the direction of the tool "
        "axis, or the position alone.",
    ),
]
ToolAxisOption = Annotated[
    tuple[str, str, str] | None,
    typer.Option(
        metavar="X Y Z",
        show_default=False,
        help="The tool axis of --task direction, in the tool frame; 0 0 1 unless given.",
    ),
]
HostOption = Annotated[
    str | None,
    typer.Option(
        metavar="HOST[:PORT]", help="The robot to drive; a simulated one where not given."
    ),
]
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Solve and show the plan; move nothing.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document: metres and radians, always.")
]


def joint_units(robot: Robot, degrees: bool) -> Vector:
    """(n,) the unit of each joint as it is given and shown: radians, or metres of a slide."""
    slides = np.array([kind == "prismatic" for kind in joint_kinds(robot.known_screws())])
    return np.where(slides, 1.0, np.deg2rad(1.0) if degrees else 1.0)


def joint_unit_name(robot: Robot, degrees: bool) -> str:
    """The unit of all joints of an arm, for people."""
    turn = unit_name(degrees)
    slides = "prismatic" in joint_kinds(robot.known_screws())
    return f"{turn}, slides in m" if slides else turn


def unit_name(degrees: bool) -> str:
    """The abbreviation of the unit of angles."""
    return "deg" if degrees else "rad"


def in_radians(angles: ArrayLike, degrees: bool) -> Vector:
    """Angles as given, in radians."""
    values = np.asarray(angles, dtype=np.float64)
    return np.deg2rad(values) if degrees else values


def in_unit(angles: ArrayLike, degrees: bool) -> Vector:
    """Angles in radians, in the unit to show."""
    values = np.asarray(angles, dtype=np.float64)
    return np.rad2deg(values) if degrees else values
