"""Commands about what the robot keeps and what is plugged into it: poses, pins, accessories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from niryo_jax.hardware.simulated.answers import RobotRefused, choice, numbers, of_type
from niryo_jax.hardware.simulated.motion import Handlers
from niryo_jax.hardware.simulated.positions import POSE_KEYS, POSE_METADATA

_OUTPUT, _INPUT = 0, 1
_MODES = {"OUTPUT": _OUTPUT, "INPUT": _INPUT}
_STATES = {"HIGH": 1, "LOW": 0}
_CONVEYORS = {"ID_1": -1, "ID_2": -2}


class Storage:
    """Saved poses and digital pins; a conveyor and a camera that are not there.

    Args:
        model: name of the arm, whose pins differ.
        modern: whether the system is 5.6.3, which takes and gives poses as dictionaries.
    """

    def __init__(self, model: str, *, modern: bool) -> None:
        self._modern = modern
        self._poses: dict[str, list[float]] = {}
        if model == "niryo_one":
            self._modes = {f"{port}{pin}": _INPUT for port in "12" for pin in "ABC"}
            self._modes |= {"SW1": _OUTPUT, "SW2": _OUTPUT}
        else:
            self._modes = {f"DI{i}": _INPUT for i in range(1, 6)}
            self._modes |= {f"DO{i}": _OUTPUT for i in range(1, 5)}
        self._states = dict.fromkeys(self._modes, 0)

    def handlers(self) -> Handlers:
        """Names of commands, how many parameters they take, and what they do."""
        return {
            "GET_POSE_SAVED": ((1,), self._saved),
            "SAVE_POSE": ((2, 7) if self._modern else (7,), self._save),
            "DELETE_POSE": ((1,), self._delete),
            "GET_SAVED_POSE_LIST": ((0,), lambda: [list(self._poses)]),
            "SET_PIN_MODE": ((2,), self._set_mode),
            "DIGITAL_WRITE": ((2,), self._write),
            "DIGITAL_READ": ((1,), self._read),
            "GET_DIGITAL_IO_STATE": ((0,), self._state),
            "SET_CONVEYOR": ((0,), lambda: ["NONE"]),
            "UNSET_CONVEYOR": ((1,), self._no_conveyor),
            "CONTROL_CONVEYOR": ((4,), lambda conveyor, *_: self._no_conveyor(conveyor)),
            "GET_CONNECTED_CONVEYORS_ID": ((0,), lambda: [[]]),
            "GET_IMAGE_COMPRESSED": ((0,), self._no_camera),
            "GET_IMAGE_PARAMETERS": ((0,), self._no_camera),
            "GET_CAMERA_INTRINSICS": ((0,), self._no_camera),
            "DETECT_OBJECT": ((3,), self._no_camera),
            "GET_TARGET_POSE_FROM_CAM": ((4,), self._no_camera),
            "MOVE_TO_OBJECT": ((4,), self._no_camera),
            "VISION_PICK": ((4, 5) if self._modern else (4,), self._no_camera),
        }

    def _saved(self, name: Any) -> Sequence[object]:
        pose = self._poses.get(of_type(name, str))
        if pose is None:
            raise RobotRefused(f"Error Code : -300\nMessage : Position {name[:80]} does not exist")
        if self._modern:
            return [{**dict(zip(POSE_KEYS, pose, strict=True)), "metadata": POSE_METADATA}]
        return pose

    def _save(self, name: Any, *params: Any) -> Sequence[object]:
        values = [params[0][key] for key in POSE_KEYS] if len(params) == 1 else params
        self._poses[of_type(name, str)] = numbers(values)
        return ()

    def _delete(self, name: Any) -> Sequence[object]:
        self._saved(name)
        del self._poses[name]
        return ()

    def _set_mode(self, pin: Any, mode: Any) -> Sequence[object]:
        chosen = choice(mode, _MODES)
        self._modes[self._pin(pin)] = chosen
        return ()

    def _write(self, pin: Any, state: Any) -> Sequence[object]:
        chosen = choice(state, _STATES)
        name = self._pin(pin)
        if self._modes[name] == _INPUT:
            raise RobotRefused(f"Error Code : -12\nMessage : {name} is an input")
        self._states[name] = chosen
        return ()

    def _read(self, pin: Any) -> Sequence[object]:
        return ["HIGH" if self._states[self._pin(pin)] else "LOW"]

    def _state(self) -> Sequence[object]:
        return [[name, self._modes[name], self._states[name]] for name in sorted(self._modes)]

    def _pin(self, pin: Any) -> str:
        if not isinstance(pin, str) or pin not in self._modes:
            raise RobotRefused(f"Error Code : -12\nMessage : Unknown pin {str(pin)[:80]}")
        return pin

    def _no_conveyor(self, conveyor: Any) -> Sequence[object]:
        choice(conveyor, _CONVEYORS)
        raise RobotRefused("Error Code : -151\nMessage : No conveyor found")

    def _no_camera(self, *_: Any) -> Sequence[object]:
        raise RobotRefused("No camera is connected: no image was received")
