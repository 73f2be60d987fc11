"""What a simulated Niryo does on each command, and the words in which it refuses."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from niryo_jax.hardware import protocol
from niryo_jax.hardware.protocol import Request
from niryo_jax.hardware.simulated_arm import SimulatedArm
from niryo_jax.lie.rpy import pose_from_rpy, rpy_from_pose

_UNCALIBRATED = "Goal has been rejected : You need to calibrate the robot before sending a command"
_NO_PLAN = "Goal has been aborted : MoveIt failed to compute the plan."
_POSE_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")


class _Refused(Exception):
    """The command is answered KO with this message."""


@dataclasses.dataclass(frozen=True)
class Execution:
    """A command under way: its answer, and when it is due on the clock of `time.monotonic`."""

    answer: dict[str, object]
    due: float = 0.0


@dataclasses.dataclass(frozen=True)
class _Done:
    values: Sequence[object] = ()
    due: float = 0.0


class Commands:
    """The commands of the server of system 4.1.1 or 5.6.3, on a simulated arm.

    System 5.6.3 also knows HANDSHAKE and MOVE, takes positions as dictionaries, and answers OK to
    moves that it refuses.
    """

    def __init__(self, arm: SimulatedArm, *, modern: bool) -> None:
        self._arm = arm
        self._modern = modern
        self._handlers: dict[str, Callable[..., _Done]] = {
            "CALIBRATE": self._calibrate,
            "GET_LEARNING_MODE": lambda: _Done([str(arm.learning_mode)]),
            "SET_LEARNING_MODE": self._set_learning_mode,
            "SET_ARM_MAX_VELOCITY": self._set_velocity,
            "GET_HARDWARE_STATUS": self._hardware_status,
            "GET_JOINTS": lambda: _Done(arm.joints.tolist()),
            "GET_POSE": lambda: _Done(rpy_from_pose(arm.pose)),
            "MOVE_JOINTS": lambda *q: self._move(_numbers(q)),
            "MOVE_POSE": self._move_pose,
            "FORWARD_KINEMATICS": self._forward_kinematics,
            "INVERSE_KINEMATICS": self._inverse_kinematics,
            "UPDATE_TOOL": lambda: self._done(arm.detect_tool()),
            "GET_CURRENT_TOOL_ID": lambda: _Done([arm.tool.upper()]),
            "GRASP_WITH_TOOL": lambda: self._done(arm.grasp()),
            "RELEASE_WITH_TOOL": lambda: self._done(arm.release()),
            "CLOSE_GRIPPER": lambda *_: self._done(arm.grasp()),
            "OPEN_GRIPPER": lambda *_: self._done(arm.release()),
        }
        if modern:
            self._handlers["HANDSHAKE"] = self._handshake
            self._handlers["MOVE"] = self._move_to

    def execute(self, request: Request) -> Execution:
        """Carry out a command, or begin to, and give its answer."""
        handler = self._handlers.get(request.command)
        if handler is None:
            return self.refusal("", "Unknown command")
        try:
            done = handler(*request.params)
        except _Refused as refused:
            return self.refusal(request.command, str(refused))
        except (TypeError, ValueError, KeyError):
            return self.refusal(request.command, f"Invalid parameters: {list(request.params)}")
        return Execution(protocol.ok(request.command, done.values), done.due)

    def refusal(self, command: str, reason: str) -> Execution:
        """A KO answer, as this system writes it."""
        answer = protocol.ko(command, reason)
        return Execution({**answer, "payload_size": 0} if self._modern else answer)

    def _done(self, _: None) -> _Done:
        return _Done()

    def _handshake(self, _version: str) -> _Done:
        return _Done([{}])

    def _calibrate(self, _mode: str) -> _Done:
        self._arm.calibrated = True
        return _Done()

    def _set_learning_mode(self, enabled: str) -> _Done:
        self._arm.learning_mode = {"TRUE": True, "FALSE": False}[enabled]
        return _Done()

    def _set_velocity(self, percent: float) -> _Done:
        largest = 200 if self._modern else 100
        if not 1 <= percent <= largest:
            raise _Refused(f"Velocity percentage must be between 1 and {largest}, got {percent}")
        self._arm.velocity_percent = percent
        return _Done()

    def _hardware_status(self) -> _Done:
        needed = str(not self._arm.calibrated)
        names = [f"joint_{i + 1}" for i in range(6)]
        version = self._arm.model.name.removeprefix("niryo_")
        motors = [names, ["stepper"] * 6, [30.0] * 6, [12.0] * 6, [0] * 6]
        return _Done([40, version, "True", "", needed, "False", *motors])

    def _move(self, q: list[float]) -> _Done:
        arm = self._arm
        if not arm.calibrated:
            return self._refuse_move(_UNCALIBRATED)
        arm.learning_mode = False
        joint = arm.outside(q, decimals=3 if self._modern else None)
        if joint is not None:
            limits = (float(arm.lower[joint]), float(arm.upper[joint]))
            return self._refuse_move(
                f"Goal has been aborted : joint_{joint + 1} not in range {limits}"
            )
        return _Done(due=arm.move(q))

    def _move_pose(self, *params: Any) -> _Done:
        *values, frame = params
        if frame:
            raise _Refused(f"Frame {frame} does not exist")
        return self._move_to_pose(values)

    def _move_to(self, position: Mapping[str, Any], _linear: str) -> _Done:
        if position["obj_type"] == "JOINTS":
            return self._move(_joints_of(position))
        return self._move_to_pose([position[key] for key in _POSE_KEYS])

    def _move_to_pose(self, values: Sequence[Any]) -> _Done:
        pose = pose_from_rpy(_numbers(values))
        if not self._arm.calibrated:
            return self._refuse_move(_UNCALIBRATED)
        self._arm.learning_mode = False
        q = self._arm.solve(pose)
        return self._refuse_move(_NO_PLAN) if q is None else _Done(due=self._arm.move(q))

    def _refuse_move(self, reason: str) -> _Done:
        if self._modern:
            return _Done()
        raise _Refused(reason)

    def _forward_kinematics(self, *params: Any) -> _Done:
        if not self._modern:
            return _Done(rpy_from_pose(self._arm.pose_at(_numbers(params))))
        (position,) = params
        values = rpy_from_pose(self._arm.pose_at(_joints_of(position)))
        return _Done([dict(zip(_POSE_KEYS, values, strict=True))])

    def _inverse_kinematics(self, *params: Any) -> _Done:
        values = [params[0][key] for key in _POSE_KEYS] if self._modern else params
        q = self._arm.solve(pose_from_rpy(_numbers(values)))
        if q is None:
            raise _Refused(_NO_PLAN)
        if not self._modern:
            return _Done(q.tolist())
        position = {f"joint_{i}": angle for i, angle in enumerate(q.tolist())}
        return _Done([{**position, "metadata": {"version": 1}}])


def _numbers(values: Sequence[Any]) -> list[float]:
    if len(values) != 6:
        raise ValueError(f"expected 6 numbers, got {len(values)}")
    return [float(value) for value in values]


def _joints_of(position: Mapping[str, Any]) -> list[float]:
    return _numbers([value for key, value in position.items() if re.fullmatch(r"joint_\d", key)])
