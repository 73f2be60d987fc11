"""From a request to an answer: the commands of the server of system 4.1.1 or 5.6.3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from niryo_jax.hardware import protocol
from niryo_jax.hardware.protocol import Request
from niryo_jax.hardware.simulated.answers import (
    BOOLEANS,
    PREFIX,
    ParameterRefused,
    check_count,
    choice,
)
from niryo_jax.hardware.simulated.arm import SimulatedArm
from niryo_jax.hardware.simulated.motion import Handlers, Motion
from niryo_jax.hardware.simulated.storage import Storage
from niryo_jax.hardware.simulated.tools import Tools

_LONGEST_MESSAGE = 2000

_OUTDATED = (
    "You're using an outdated version of PyNiryo. The minimum client version is v1.2.0. To fully "
    "benefit from the server features it's advised to upgrade your PyNiryo library."
)
_NO_HANDSHAKE = (
    "\nNo handshake has been made between the client and the server. This error could be the cause "
    "of an incompatible versions of the server and the client"
)


class Interpreter:
    """The commands of one simulated robot.

    System 5.6.3 also knows HANDSHAKE, MOVE and the collision flag, takes positions as dictionaries,
    and answers OK to moves that it refuses.

    Args:
        arm: the arm.
        modern: whether the system is 5.6.3.
        wait: waits for some seconds; commands return when they have been carried out.
    """

    def __init__(self, arm: SimulatedArm, *, modern: bool, wait: Callable[[float], None]) -> None:
        self._arm = arm
        self._modern = modern
        self._shaken = False
        arm.tcp_enabled = modern
        motion = Motion(arm, modern=modern, wait=wait)
        self._handlers: Handlers = {
            "CALIBRATE": ((1,), self._calibrate),
            "GET_LEARNING_MODE": ((0,), lambda: [str(arm.learning_mode)]),
            "SET_LEARNING_MODE": ((1,), self._set_learning_mode),
            "SET_ARM_MAX_VELOCITY": ((1,), self._set_velocity),
            "SET_JOG_CONTROL": ((1,), self._set_jog_mode),
            "GET_HARDWARE_STATUS": ((0,), self._hardware_status),
            **motion.handlers(),
            **Tools(arm, motion, modern=modern).handlers(),
            **Storage(arm.model.name, modern=modern).handlers(),
        }
        if modern:
            self._handlers |= {
                "HANDSHAKE": ((1,), self._handshake),
                "GET_COLLISION_DETECTED": ((0,), lambda: [str(arm.collision_detected)]),
                "CLEAR_COLLISION_DETECTED": ((0,), self._clear_collision),
            }

    def execute(self, request: Request) -> dict[str, object]:
        """Carry out a command, and give its answer."""
        name = request.command.upper()
        known = self._handlers.get(name)
        if known is None:
            return self.refusal("", "Unknown command")
        counts, handler = known
        try:
            check_count(Request(name, request.params), counts, modern=self._modern)
            return protocol.ok(name, handler(*request.params))
        except (ParameterRefused, TypeError) as refused:
            return self.refusal(name, str(refused))
        except ConnectionAbortedError:
            raise
        except Exception as refused:
            # As the server does: whatever goes wrong behind it, it says so and goes on.
            return self.refusal(name, f"{PREFIX}{refused}")

    def refusal(self, command: str, reason: str) -> dict[str, object]:
        """A KO answer, as this system writes it."""
        message = reason[:_LONGEST_MESSAGE]
        if not self._modern:
            return protocol.ko(command, message)
        tail = "" if self._shaken else _NO_HANDSHAKE
        return {**protocol.ko(command, message + tail), "payload_size": 0}

    def _handshake(self, version: Any) -> Sequence[object]:
        self._shaken = True
        return [{"message": _OUTDATED} if version < "1.2.0" else {}]

    def _calibrate(self, mode: Any) -> Sequence[object]:
        choice(mode, {"MANUAL": None, "AUTO": None})
        self._arm.calibrated = True
        return ()

    def _set_learning_mode(self, enabled: Any) -> Sequence[object]:
        self._arm.learning_mode = choice(enabled, BOOLEANS)
        return [[1, ""]]

    def _set_velocity(self, percent: Any) -> Sequence[object]:
        if type(percent) not in (int, float) or not 0 < percent <= 100:
            raise ParameterRefused(
                f"Expected the following type: float/integer [1 -100].\nGiven: {str(percent)[:80]}"
            )
        self._arm.velocity_percent = float(percent)
        return ()

    def _set_jog_mode(self, enabled: Any) -> Sequence[object]:
        before, self._arm.jog_mode = self._arm.jog_mode, choice(enabled, BOOLEANS)
        if self._arm.jog_mode:
            return [[1, "Jog Controller - Enabled"]]
        return [[1, f"Jog Controller - {'' if before else 'Already '}Disabled"]]

    def _clear_collision(self) -> Sequence[object]:
        self._arm.collision_detected = False
        return ()

    def _hardware_status(self) -> Sequence[object]:
        arm = self._arm
        motors = [f"joint_{i + 1}" for i in range(6)]
        errors = [0] * 6
        if arm.tool != "none":
            motors.append("tool")
            errors.append(0x20 if arm.tool_overloaded else 0)
        count = len(motors)
        return [
            40,
            arm.model.name.removeprefix("niryo_"),
            str(arm.connected),
            "''" if arm.connected else "'Motor connection problem'",
            str(not arm.calibrated),
            "False",
            motors,
            ["stepper"] * count,
            [30.0] * count,
            [12.0] * count,
            errors,
        ]
