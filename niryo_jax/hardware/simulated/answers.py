"""Refusals of the robot's server, and its checks of parameters, in its own words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from niryo_jax.hardware.protocol import Request

T = TypeVar("T")

BOOLEANS = {"TRUE": True, "FALSE": False}

PREFIX = "An error occured while executing the last command : "
"""What the server puts before refusals that do not come from its own checks of parameters."""


class ParameterRefused(Exception):
    """The server refuses the parameters of a command; its answer has no prefix."""


class RobotRefused(Exception):
    """What lies behind the server refuses a command; its answer has the prefix."""


def check_count(request: Request, counts: Sequence[int], *, modern: bool) -> None:
    """Refuse a request with another number of parameters than one of `counts`."""
    given = len(request.params)
    if given not in counts:
        expected = str(list(counts)) if modern else str(counts[0])
        function = f" __{request.command.lower()}" if modern else ""
        raise ParameterRefused(
            f"{expected} parameters expected but {given} given\nIn function{function}"
        )


def choice(value: object, choices: Mapping[str, T]) -> T:
    """What a word stands for."""
    if not isinstance(value, str) or value not in choices:
        raise ParameterRefused(
            f"Expected one of the following: {list(choices)}.\nGiven: {_shown(value)}"
        )
    return choices[value]


def numbers(values: Sequence[Any]) -> list[float]:
    """Finite floats."""
    try:
        floats = [float(value) for value in values]
    except ValueError:
        raise ParameterRefused(
            f"Expected the following type: float.\nGiven: {_shown(values)}"
        ) from None
    if not all(math.isfinite(value) for value in floats):
        raise RobotRefused("Out of range float values are not JSON compliant")
    return floats


def of_type(value: object, kind: type[T]) -> T:
    """A value of exactly one type."""
    if type(value) is not kind:
        raise ParameterRefused(
            f"Expected the following type: {kind.__name__}.\nGiven: {_shown(value)}"
        )
    return value


def _shown(value: object) -> str:
    return str(value)[:200]
