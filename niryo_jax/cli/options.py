"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray

from niryo_jax.robots import MODELS, NiryoModel


class RobotName(StrEnum):
    """The arms of `niryo_jax.robots`."""

    NIRYO_ONE = "niryo_one"
    NIRYO_NED = "niryo_ned"
    NIRYO_NED2 = "niryo_ned2"

    @property
    def model(self) -> NiryoModel:
        """The arm's data."""
        return MODELS[self.value]


def _chosen(degrees: bool | None) -> bool:
    if degrees is None:
        raise typer.BadParameter("say which unit the angles are in: --degrees or --radians")
    return degrees


def number(text: str) -> float:
    """A number as an argument."""
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"expected a number, got {text!r}") from None


RobotOption = Annotated[RobotName, typer.Option("--robot", help="Which arm.")]
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
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document: metres and radians, always.")
]


def in_radians(angles: ArrayLike, degrees: bool) -> NDArray[np.float64]:
    """Angles as given, in radians."""
    values = np.asarray(angles, dtype=np.float64)
    return np.deg2rad(values) if degrees else values


def in_unit(angles: ArrayLike, degrees: bool) -> NDArray[np.float64]:
    """Angles in radians, in the unit to show."""
    values = np.asarray(angles, dtype=np.float64)
    return np.rad2deg(values) if degrees else values
