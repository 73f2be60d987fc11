"""One Niryo arm, driven through pyniryo: checked targets, bounded calls, verified motion."""

from __future__ import annotations

import time

from niryo_jax.hardware import arguments
from niryo_jax.hardware.errors import CommandRefused, NotANiryo, ToolFailed, ToolMissing
from niryo_jax.hardware.moving import MovingArm
from niryo_jax.hardware.protocol import ProtocolError
from niryo_jax.hardware.status import HardwareStatus, as_bool, collision_detected
from niryo_jax.robot import Robot


class NiryoArm(MovingArm):
    """A connection to one Niryo arm; use it in a `with` statement.

    Entering connects, leaving closes the connection, whatever happened inside. Every call ends in
    time: with its answer, or with one of the errors of `niryo_jax.hardware`. After
    `CommandRefused`, `MotionNotReached`, `MotionStopped` and the errors about tools and arguments
    the connection stays open; after any other error, and after Ctrl-C, it is closed. Closing does
    not stop the arm: a move that is under way goes on to its end.

    The robot carries out one command after the other, so that nothing can be asked of it, nor the
    arm be stopped, while it carries out one. With `piece`, a move is sent in pieces: `stop` and the
    calls of other threads take effect between two of them, where the arm halts for a moment.

    Args:
        host: address of the robot, e.g. "10.10.10.10", or with its port, "127.0.0.1:40001".
        robot: the arm, e.g. `niryo_jax.robots.niryo_one()`; its limits are those enforced.
        port: port of the robot's server, where `host` names none; 40001 where not given.
        model: name of the model that may answer, e.g. "niryo_ned2", where it is not that of
            `robot`. A robot of another name than those of `robots.MODELS` is checked only so.
        connect_timeout: seconds for the connection, and again for its first answer. A host name
            is looked up before, in the operating system's own time.
        timeout: seconds for an answer, in addition to the duration of a move; and for the first
            answer, where an earlier program has left the robot in a move.
        calibration_timeout: seconds for a calibration.
        tolerance: radians by which a joint may miss its target. A few steps of the small servos of
            the Niryo One (5e-3 rad each), far above what the robot rounds away (5e-4 rad).
        settle: seconds that the joints are given to come within the tolerance after a move.
        piece: seconds that a piece of a move may take; each move is one piece where None.

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
        model: str | None = None,
        connect_timeout: float = 5.0,
        timeout: float = 20.0,
        calibration_timeout: float = 180.0,
        tolerance: float = 0.02,
        settle: float = 1.0,
        piece: float | None = None,
    ) -> None:
        super().__init__(
            host,
            robot=robot,
            port=port,
            model=model,
            connect_timeout=connect_timeout,
            timeout=timeout,
            tolerance=tolerance,
            settle=settle,
            piece=piece,
        )
        self._calibration_timeout = arguments.positive("calibration_timeout", calibration_timeout)

    def calibrate(self) -> None:
        """Calibrate the motors automatically; nothing happens where they are calibrated."""
        self._call("calibrate_auto", timeout=self._calibration_timeout)

    def status(self) -> HardwareStatus:
        """What the robot says of its hardware: its model, its motors, whether it is calibrated."""
        try:
            return self._connected.status(self._timeout)
        except ProtocolError as error:
            self.close()
            raise NotANiryo(f"{self._host} answered get_hardware_status: {error}") from error

    @property
    def needs_calibration(self) -> bool:
        """Whether the robot asks to be calibrated before it moves."""
        return self.status().needs_calibration

    @property
    def learning_mode(self) -> bool:
        """Whether the motors are off, so that the arm can be moved by hand.

        A move is not refused in learning mode: the robot switches it off and moves.
        """
        return as_bool(self._call("get_learning_mode"))

    @learning_mode.setter
    def learning_mode(self, enabled: bool) -> None:
        self._call("set_learning_mode", bool(enabled))

    @property
    def collision_detected(self) -> bool:
        """Whether the robot has detected a collision, and refuses moves until that is cleared.

        Systems from 5 on have this flag and keep it when programs end; system 4 has none: False.
        """
        return collision_detected(self._connected, self._timeout)

    def clear_collision(self) -> None:
        """Let the robot forget a collision. See first that nothing stands in its way.

        Raises:
            CommandRefused: the robot's system has no such flag.
        """
        self._connected.exchange("CLEAR_COLLISION_DETECTED", timeout=self._timeout)

    def use_tool(self, name: str | None = None) -> str:
        """Let the robot detect its tool, and return the tool's name, e.g. "gripper_1".

        Args:
            name: the tool that must be there; any tool, or none, where not given.

        Raises:
            ToolMissing: the robot reports another tool than `name`.
        """
        self._call("update_tool")
        found = self.tool
        if name is not None and found != str(name).lower():
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
            ToolFailed: the robot reported success, and its motors that they are overloaded.
        """
        self._actuate("grasp_with_tool")

    def release(self) -> None:
        """Open the gripper, or switch the pump or the magnet off. Raises as `grasp` does."""
        self._actuate("release_with_tool")

    def wait(self, seconds: float) -> None:
        """Do nothing for some seconds.

        Raises:
            ArgumentRejected: not a finite number of seconds, zero or more.
        """
        time.sleep(arguments.seconds("seconds", seconds))

    def _actuate(self, name: str) -> None:
        if self.tool == "none":
            raise ToolMissing(
                "the robot has detected no tool; attach it and call use_tool() before grasping or "
                "releasing"
            )
        self._call(name)
        try:
            status = self._connected.status(self._timeout)
        except (CommandRefused, ProtocolError):
            return  # It does not tell.
        if status.tool_fails:
            trouble = status.failing or status.message
            raise ToolFailed(f"the robot reported success of {name}, yet {trouble} fails")
