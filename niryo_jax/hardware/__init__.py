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
    NiryoError,
    NotANiryo,
    PyniryoMissing,
    RobotBusy,
    TargetRejected,
    ToolMissing,
)
from niryo_jax.hardware.faults import Fault, FaultKind
from niryo_jax.hardware.simulator import SimulatedNiryo

__all__ = [
    "ArgumentRejected",
    "CallTimeout",
    "CommandRefused",
    "ConnectionFailed",
    "ConnectionLost",
    "Fault",
    "FaultKind",
    "MotionNotReached",
    "NiryoArm",
    "NiryoError",
    "NotANiryo",
    "PyniryoInfo",
    "PyniryoMissing",
    "RobotBusy",
    "SimulatedNiryo",
    "TargetRejected",
    "ToolMissing",
    "pyniryo_version",
]
