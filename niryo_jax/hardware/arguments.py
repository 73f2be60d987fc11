"""Arguments of the adapter, checked before anything is sent."""

from __future__ import annotations

import math
from collections.abc import Sequence

from niryo_jax.hardware.errors import ArgumentRejected
from niryo_jax.hardware.protocol import PORT


def split_host(host: object, port: object) -> tuple[str, int]:
    """The name and the port in "name" or "name:port", and `port` where it is given.

    Raises:
        ArgumentRejected: neither of the two forms, no port, or two that contradict each other.
    """
    if not isinstance(host, str):
        raise ArgumentRejected(f"host: expected a name, or name:port, got {host!r}")
    if port is not None and (isinstance(port, bool) or not isinstance(port, int)):
        raise ArgumentRejected(f"port: expected a whole number, got {port!r}")
    name, colon, digits = host.strip().partition(":")
    if colon and not (digits.isascii() and digits.isdecimal()):
        raise ArgumentRejected(f"host: expected a name, or name:port, got {host!r}")
    chosen = int(digits[:6]) if colon else PORT if port is None else port
    if not name or not 1 <= chosen <= 65535:
        raise ArgumentRejected(f"host: expected a name and a port 1 to 65535, got {host!r}, {port}")
    if port not in (None, chosen):
        raise ArgumentRejected(f"port: {port} contradicts host {host!r}")
    return name, chosen


def positive(name: str, value: object) -> float:
    """A positive, finite number.

    Raises:
        ArgumentRejected: it is none.
    """
    number = _finite(value)
    if number is None or number <= 0:
        raise ArgumentRejected(f"{name}: expected a positive number, got {value!r}")
    return number


def seconds(name: str, value: object) -> float:
    """Zero or more seconds.

    Raises:
        ArgumentRejected: they are not.
    """
    number = _finite(value)
    if number is None or number < 0:
        raise ArgumentRejected(f"{name}: expected zero or more seconds, got {value!r}")
    return number


def percentage(value: object) -> int:
    """A whole number from 1 to 100.

    Raises:
        ArgumentRejected: it is none.
    """
    number = _finite(value)
    if number is None or not (1 <= number <= 100 and number == int(number)):
        raise ArgumentRejected(f"percent: expected a whole number 1 to 100, got {value!r}")
    return int(number)


def model_name(value: object, known: Sequence[str]) -> str:
    """The name of a model, with or without "niryo_"; of those not known, as the robot says it.

    Raises:
        ArgumentRejected: no name.
    """
    if not isinstance(value, str) or not value:
        raise ArgumentRejected(
            f"model: expected the name of a model, e.g. one of {', '.join(known)}, got {value!r}"
        )
    return f"niryo_{value}" if f"niryo_{value}" in known else value


def _finite(value: object) -> float | None:
    """A number, of numpy too, as a float; None for anything else."""
    if isinstance(value, (str, bytes, bool)):
        return None
    try:
        number = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None
