"""What can go wrong between a program and the robot; every message is one sentence to read.

None of these derives from OSError: pyniryo catches OSError inside its calls and would replace
them by an error that names neither the robot nor the call.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class NiryoError(Exception):
    """Base of every error raised by `niryo_jax.hardware`."""


class PyniryoMissing(NiryoError, ImportError):
    """pyniryo is not installed, does not import, or is a version this package does not know."""


class ArgumentRejected(NiryoError, ValueError):
    """An argument makes no sense; nothing was sent to the robot."""


class TargetRejected(ArgumentRejected):
    """A joint target is not six finite angles inside the limits; nothing was sent to the robot."""


class ToolMissing(NiryoError):
    """The robot reports no tool, or another tool than the one asked for."""


class ToolFailed(NiryoError):
    """The tool did not do what it was told, though the robot reported success."""


class ConnectionFailed(NiryoError):
    """No connection: unknown host, nobody answers, or nobody listens on the port."""


class RobotBusy(ConnectionFailed):
    """Another program is connected, or the arm is finishing a move of an earlier one."""


class NotANiryo(NiryoError):
    """Something answers, but not in the protocol of the Niryo systems that pyniryo drives."""


class WrongArm(NiryoError):
    """The robot says that it is another model than the one whose joints would be sent."""


class ConnectionLost(NiryoError):
    """The connection ended before the answer came, or a call was made after it had ended."""


class CallTimeout(NiryoError):
    """The robot did not answer in time; the connection has been closed."""


class CommandRefused(NiryoError):
    """The robot answered KO. The connection stays open.

    Attributes:
        reason: the robot's own words.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


class MotionNotReached(NiryoError):
    """The robot reported success and stands elsewhere. The connection stays open.

    Attributes:
        target: (6,) joints that were sent, radians.
        reached: (6,) joints read back, radians.
        difference: largest absolute difference between the two, radians.
    """

    def __init__(
        self, message: str, target: NDArray[np.float64], reached: NDArray[np.float64]
    ) -> None:
        super().__init__(message)
        self.target = target
        self.reached = reached
        self.difference = float(np.max(np.abs(reached - target)))


class MotionStopped(NiryoError):
    """`stop` ended a move on its way. The connection stays open.

    Attributes:
        target: (6,) joints that the move was for, radians.
        reached: (6,) joints where the arm stands, radians.
    """

    def __init__(
        self, message: str, target: NDArray[np.float64], reached: NDArray[np.float64]
    ) -> None:
        super().__init__(message)
        self.target = target
        self.reached = reached
