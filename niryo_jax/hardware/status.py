"""What the robot says of its hardware, and what of it explains why something did not happen."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Protocol

from niryo_jax.hardware.errors import CommandRefused
from niryo_jax.hardware.protocol import ProtocolError
from niryo_jax.robots import MODELS

# The bit of a servo's error register that says it is overloaded.
_OVERLOAD = 0x20
_JOINTS = 6


@dataclasses.dataclass(frozen=True)
class HardwareStatus:
    """The answer to GET_HARDWARE_STATUS.

    Attributes:
        model: which arm this is, e.g. "niryo_ned2"; None where the robot does not say.
        connected: whether the motors answer.
        message: what is wrong, in the robot's words; empty where nothing is.
        needs_calibration: whether it must be calibrated before it moves.
        calibrating: whether it is being calibrated.
        motors: names of the motors: those of the joints, then others, the tool's among them.
        errors: the error register of each motor, 0 where all is well.
    """

    model: str | None
    connected: bool
    message: str
    needs_calibration: bool
    calibrating: bool
    motors: tuple[str, ...]
    errors: tuple[int, ...]

    @property
    def failing(self) -> str:
        """The motors that report errors, as words; empty where none does."""
        numbered = zip(self.motors, self.errors, strict=False)
        return ", ".join(f"{name} (error {error})" for name, error in numbered if error)

    @property
    def tool_fails(self) -> bool:
        """Whether the tool's motor reports an error, or any motor that it is overloaded."""
        overloaded = any(error & _OVERLOAD for error in self.errors)
        return overloaded or any(self.errors[_JOINTS:]) or "overload" in self.message.lower()


def parse_status(values: Sequence[Any]) -> HardwareStatus:
    """The status in the values of an answer.

    Raises:
        ProtocolError: they are none.
    """
    try:
        _, version, connected, message, needed, running, motors, _, _, _, errors, *_ = values
        return HardwareStatus(
            model=_model(version),
            connected=as_bool(connected),
            message=str(message).strip("' "),
            needs_calibration=as_bool(needed),
            calibrating=as_bool(running),
            motors=tuple(str(name) for name in motors),
            errors=tuple(int(error) for error in errors),
        )
    except (TypeError, ValueError) as error:
        raise ProtocolError(f"not a hardware status: {str(values)[:80]}") from error


def as_bool(answer: object) -> bool:
    """Systems up to 5.6.3 answer "True" and "False", both of them truthy."""
    return str(answer).lower() == "true"


class Asks(Protocol):
    """What a diagnosis needs of a client."""

    def exchange(self, command: str, *params: object, timeout: float) -> tuple[Any, ...]: ...
    def status(self, timeout: float) -> HardwareStatus: ...


def why_it_stayed(client: Asks, timeout: float) -> str:
    """Why the robot did not move though it answered OK, in words, by asking it.

    The order is that of the robot's own checks. Where jog mode was on, it is switched off, which is
    the only way to learn that it was.

    Raises:
        NiryoError: a question is not answered.
    """
    try:
        status = client.status(timeout)
    except (CommandRefused, ProtocolError):
        return "it does not say why"
    trouble = "; ".join(words for words in (status.message, status.failing) if words)
    if not status.connected:
        return f"its motors are not connected ({trouble or 'it gives no reason'})"
    if status.needs_calibration:
        return "it is not calibrated: call calibrate() first"
    if status.calibrating:
        return "it is being calibrated"
    if collision_detected(client, timeout):
        return "it has detected a collision: clear the way, then call clear_collision()"
    if trouble:
        return f"it reports trouble with its motors ({trouble})"
    if _left_jog_mode(client, timeout):
        return "it was in jog mode, which is switched off now: send the move again"
    if as_bool(_first(client.exchange("GET_LEARNING_MODE", timeout=timeout))):
        return "it is in learning mode and does not leave it"
    return "the target lies outside the limits of its own system, or it finds no way there"


def collision_detected(client: Asks, timeout: float) -> bool:
    """Whether the robot has stopped for a collision; system 4 has no such flag."""
    try:
        return as_bool(_first(client.exchange("GET_COLLISION_DETECTED", timeout=timeout)))
    except CommandRefused:
        return False


def _left_jog_mode(client: Asks, timeout: float) -> bool:
    try:
        answer = client.exchange("SET_JOG_CONTROL", "FALSE", timeout=timeout)
    except CommandRefused:
        return False
    return "disabled" in str(answer).lower() and "already" not in str(answer).lower()


def _first(values: Sequence[Any]) -> object:
    return values[0] if values else None


def _model(version: object) -> str | None:
    """Older systems give numbers, which do not tell one arm from another."""
    if not isinstance(version, str) or not version or version.isdecimal():
        return None
    name = f"niryo_{version.removeprefix('niryo_')}"
    return name if name in MODELS else version
