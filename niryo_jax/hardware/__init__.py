"""A real Niryo through pyniryo, and a simulated one that speaks the robot's protocol."""

from niryo_jax.hardware._pyniryo import PyniryoInfo, pyniryo_version
from niryo_jax.hardware.arm import NiryoArm
from niryo_jax.hardware.errors import (
    ArgumentRejected,
    CallTimeout,
    CommandRefused,
    ConnectionFailed,
    ConnectionLost,
    MotionNotReached,
    MotionStopped,
    NiryoError,
    NotANiryo,
    PyniryoMissing,
    RobotBusy,
    TargetRejected,
    ToolFailed,
    ToolMissing,
    WrongArm,
)
from niryo_jax.hardware.execution import Execution, ExecutionAborted, ExecutionState
from niryo_jax.hardware.faults import Fault, FaultKind
from niryo_jax.hardware.measuring import touch, visit
from niryo_jax.hardware.simulated.wear import Wear
from niryo_jax.hardware.simulator import SimulatedNiryo
from niryo_jax.hardware.status import HardwareStatus

__all__ = [
    "ArgumentRejected",
    "CallTimeout",
    "CommandRefused",
    "ConnectionFailed",
    "ConnectionLost",
    "Execution",
    "ExecutionAborted",
    "ExecutionState",
    "Fault",
    "FaultKind",
    "HardwareStatus",
    "MotionNotReached",
    "MotionStopped",
    "NiryoArm",
    "NiryoError",
    "NotANiryo",
    "PyniryoInfo",
    "PyniryoMissing",
    "RobotBusy",
    "SimulatedNiryo",
    "TargetRejected",
    "ToolFailed",
    "ToolMissing",
    "Wear",
    "WrongArm",
    "pyniryo_version",
    "touch",
    "visit",
]
