"""One Niryo arm, driven through pyniryo: checked targets, bounded calls, verified motion."""

from __future__ import annotations

import math
import time
import warnings
from types import TracebackType
from typing import Any

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from niryo_jax.hardware._pyniryo import PyniryoClient, pyniryo_version
from niryo_jax.hardware.errors import (
    ArgumentRejected,
    ConnectionLost,
    MotionNotReached,
    ToolMissing,
)
from niryo_jax.hardware.protocol import PORT
from niryo_jax.hardware.targets import JointTargets
from niryo_jax.lie.rpy import pose_from_rpy
from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS

# A move may take this many times its length over the joint speeds: the robot also accelerates,
# brakes and plans.
_SLACK = 3.0
_SETTLE_STEP = 0.05


class NiryoArm:
    """A connection to one Niryo arm; use it in a `with` statement.

    Entering connects, leaving closes the connection, whatever happened inside. Every call ends in
    time: with its answer, or with one of the errors of `niryo_jax.hardware`. After
    `CommandRefused`, `MotionNotReached` and the errors about arguments the connection stays open;
    after any other error, and after Ctrl-C, it is closed. Closing does not stop the arm: a move
    that is under way goes on to its end.

    Args:
        host: address of the robot, e.g. "10.10.10.10", or with its port, "127.0.0.1:40001".
        robot: the arm, e.g. `niryo_jax.robots.niryo_one()`; its limits are those enforced.
        port: port of the robot's server, where `host` names none; 40001 where not given.
        connect_timeout: seconds for the connection, and again for each first answer. A host name
            is looked up before, in the operating system's own time.
        timeout: seconds for an answer, in addition to the duration of a move.
        calibration_timeout: seconds for a calibration.
        tolerance: radians by which a joint may miss its target. A few steps of the small servos of
            the Niryo One (5e-3 rad each), far above what the robot rounds away (5e-4 rad).
        settle: seconds that the joints are given to come within the tolerance after a move.

    Raises:
        ArgumentRejected: a robot without six joints, a malformed host or port, a time that is not
            positive.
    """

    def __init__(
        self,
        host: str,
        *,
        robot: Robot,
        port: int | None = None,
        connect_timeout: float = 5.0,
        timeout: float = 20.0,
        calibration_timeout: float = 180.0,
        tolerance: float = 0.02,
        settle: float = 1.0,
    ) -> None:
        positive = {
            "connect_timeout": connect_timeout,
            "timeout": timeout,
            "calibration_timeout": calibration_timeout,
            "tolerance": tolerance,
        }
        for name, value in positive.items():
            if not (math.isfinite(value) and value > 0):
                raise ArgumentRejected(f"{name}: expected a positive number, got {value!r}")
        _check_seconds("settle", settle)
        self._host, self._port = _split_host(host, port)
        self._targets = JointTargets(robot)
        self._robot_name = robot.name
        self._connect_timeout = connect_timeout
        self._timeout = timeout
        self._calibration_timeout = calibration_timeout
        self._tolerance = tolerance
        self._settle = settle
        # The robot does not tell its speed and keeps it from one client to the next, so the
        # slowest is assumed until it is set.
        self._percent = 1
        self._client: PyniryoClient | None = None

    def connect(self) -> None:
        """Connect, and see that a Niryo answers. Done by `with`.

        Warns where the installed pyniryo is not made for this robot.

        Raises:
            PyniryoMissing: pyniryo is not installed, not importable or not supported.
            ConnectionFailed: unknown host, no answer, connection refused.
            RobotBusy: the connection is accepted and nothing answers.
            NotANiryo: what answers does not speak the protocol.
        """
        info = pyniryo_version()
        if self._robot_name in MODELS and self._robot_name not in info.fits:
            warnings.warn(
                f"pyniryo {info.version} is made for {', '.join(info.fits)} with system "
                f"{info.systems}, not for {self._robot_name}; some commands may be unknown to it",
                stacklevel=3,
            )
        self.close()
        self._client = PyniryoClient(self._host, self._port, self._connect_timeout)

    def close(self) -> None:
        """Close the connection; again is allowed. A move that is under way goes on."""
        if self._client is not None:
            self._client.close()

    def __enter__(self) -> NiryoArm:
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def calibrate(self) -> None:
        """Calibrate the motors automatically; nothing happens where they are calibrated."""
        self._call("calibrate_auto", timeout=self._calibration_timeout)

    @property
    def needs_calibration(self) -> bool:
        """Whether the robot asks to be calibrated before it moves."""
        return _as_bool(self._call("need_calibration"))

    @property
    def learning_mode(self) -> bool:
        """Whether the motors are off, so that the arm can be moved by hand.

        A move is not refused in learning mode: the robot switches it off and moves.
        """
        return _as_bool(self._call("get_learning_mode"))

    @learning_mode.setter
    def learning_mode(self, enabled: bool) -> None:
        self._call("set_learning_mode", bool(enabled))

    def set_speed(self, percent: int) -> None:
        """Set the speed of later moves, as a whole percentage of the largest, 1 to 100.

        Raises:
            ArgumentRejected: not a whole number from 1 to 100; nothing was sent.
        """
        if not (1 <= percent <= 100 and percent == int(percent)):
            raise ArgumentRejected(f"percent: expected a whole number 1 to 100, got {percent!r}")
        self._call("set_arm_max_velocity", int(percent))
        self._percent = int(percent)

    def use_tool(self, name: str | None = None) -> str:
        """Let the robot detect its tool, and return the tool's name, e.g. "gripper_1".

        Args:
            name: the tool that must be there; any tool, or none, where not given.

        Raises:
            ToolMissing: the robot reports another tool than `name`.
        """
        self._call("update_tool")
        found = self.tool
        if name is not None and found != name.lower():
            raise ToolMissing(f"expected the tool {name!r}, the robot reports {found!r}")
        return found

    @property
    def tool(self) -> str:
        """The tool that the robot last detected, e.g. "gripper_1", or "none"."""
        return str(self._call("get_current_tool_id").name).lower()

    def grasp(self) -> None:
        """Close the gripper, or switch the pump or the magnet on.

        Raises:
            ToolMissing: no tool was detected; the robot would answer OK and do nothing.
        """
        self._actuate("grasp_with_tool")

    def release(self) -> None:
        """Open the gripper, or switch the pump or the magnet off.

        Raises:
            ToolMissing: no tool was detected; the robot would answer OK and do nothing.
        """
        self._actuate("release_with_tool")

    def wait(self, seconds: float) -> None:
        """Do nothing for some seconds.

        Raises:
            ArgumentRejected: not a finite number of seconds, zero or more.
        """
        _check_seconds("seconds", seconds)
        time.sleep(seconds)

    def joints(self) -> NDArray[np.float64]:
        """(6,) joint angles read from the robot, radians."""
        return self._connected().joints(self._timeout)

    def pose(self) -> NDArray[np.float64]:
        """(4, 4) pose that the robot reports, in the space frame, metres.

        It is the tool frame on system 4, and the tool centre point where the robot has that
        switched on (by default on system 5).
        """
        return pose_from_rpy(self._call("get_pose").to_list())

    def move_joints(self, q: ArrayLike) -> NDArray[np.float64]:
        """Move to the joint angles q and return those read back from the robot.

        A target inside the limits but within 1e-3 rad of one is drawn in to 1e-3 rad: the robots
        round, and refuse targets at the very edge. The robot switches learning mode off.

        Args:
            q: (6,) joint angles, radians.

        Returns:
            (6,) joint angles reached, radians.

        Raises:
            TargetRejected: not six finite angles inside the limits; nothing was sent.
            CommandRefused: the robot refused, e.g. because it is not calibrated.
            MotionNotReached: the robot reported success and stands elsewhere. Systems 5.0 to 5.6.3
                answer so to moves that they refuse.
            CallTimeout, ConnectionLost: no answer in time; the arm may still be moving.
        """
        target = self._targets.check(q)
        travel = self._targets.travel_time(self.joints(), target, self._percent)
        self._call("move_joints", *target.tolist(), timeout=self._timeout + _SLACK * travel)
        deadline = time.monotonic() + self._settle
        while np.max(np.abs((reached := self.joints()) - target)) > self._tolerance:
            if time.monotonic() >= deadline:
                raise self._not_reached(target, reached)
            time.sleep(_SETTLE_STEP)
        return reached

    def _not_reached(
        self, target: NDArray[np.float64], reached: NDArray[np.float64]
    ) -> MotionNotReached:
        worst = int(np.argmax(np.abs(reached - target)))
        return MotionNotReached(
            f"the robot reported success, yet {self._targets.names[worst]} stands at "
            f"{reached[worst]:.4f} rad instead of {target[worst]:.4f} rad, more than the tolerance "
            f"of {self._tolerance:g} rad away; the robot refused the move silently or was held up",
            target,
            reached,
        )

    def _actuate(self, name: str) -> None:
        if self.tool == "none":
            raise ToolMissing(
                "the robot has detected no tool; attach it and call use_tool() before grasping or "
                "releasing"
            )
        self._call(name)

    def _connected(self) -> PyniryoClient:
        if self._client is None:
            raise ConnectionLost(
                f"not connected to {self._host}:{self._port}; use the arm in a `with` statement, "
                "or call connect() first"
            )
        return self._client

    def _call(self, name: str, *args: object, timeout: float | None = None) -> Any:
        return self._connected().call(name, *args, timeout=timeout or self._timeout)


def _split_host(host: str, port: int | None) -> tuple[str, int]:
    name, colon, digits = host.partition(":")
    if colon and not digits.isdecimal():
        raise ArgumentRejected(f"host: expected a name, or name:port, got {host!r}")
    chosen = int(digits) if colon else PORT if port is None else port
    if not name or not 1 <= chosen <= 65535:
        raise ArgumentRejected(f"host: expected a name and a port 1 to 65535, got {host!r}, {port}")
    if port not in (None, chosen):
        raise ArgumentRejected(f"port: {port} contradicts host {host!r}")
    return name, chosen


def _check_seconds(name: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0):
        raise ArgumentRejected(f"{name}: expected zero or more seconds, got {value!r}")


def _as_bool(answer: object) -> bool:
    """Systems up to 5.6.3 with pyniryo 1.2 answer "True" and "False", both of them truthy."""
    return str(answer).lower() == "true"
