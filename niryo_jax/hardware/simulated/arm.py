"""The state of a simulated Niryo: joints that move in time, a tool, and one object to grip."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from niryo_jax.chain import forward_kinematics
from niryo_jax.robots import NiryoModel

Vector = NDArray[np.float64]

# How far from the tool centre point an object may be and still be gripped, metres. The jaws of
# gripper 1 are about 20 mm long and 27 mm apart.
REACH = 0.03


class SimulatedArm:
    """Joints, tool and object. Thread-safe; angles in radians, lengths in metres, real seconds.

    Joints move at constant speed and arrive together: the slowest joint, at its largest speed
    times the velocity percentage times `time_scale`, decides how long a move takes.

    Attributes:
        calibrated, learning_mode, jog_mode, collision_detected: as the robot reports them.
        connected: whether the motors answer; a move is refused where they do not.
        tool_overloaded: whether the tool's motor refuses to work.
        tool: the tool detected last, "none" before.
        grasping: whether the tool is closed.
        tcp_enabled, tcp: whether poses are those of the tool centre point, and where it lies:
            (4, 4) in the tool frame.
    """

    def __init__(self, model: NiryoModel, *, time_scale: float, mounted_tool: str) -> None:
        self.model = model
        self.robot = model.robot()
        self.lower: Vector = np.asarray(self.robot.lower)
        self.upper: Vector = np.asarray(self.robot.upper)
        self.calibrated = False
        self.connected = True
        self.learning_mode = True
        self.jog_mode = False
        self.collision_detected = False
        self.velocity_percent = 100.0
        self.tool = "none"
        self.tool_overloaded = False
        self.grasping = False
        self.tcp_enabled = False
        self.tcp: Vector = np.eye(4)
        self._mounted_tool = mounted_tool
        self._max_velocity = np.array(model.max_velocity)
        self._time_scale = time_scale
        self._lock = threading.RLock()
        self._path = np.zeros((1, 6))
        self._times = np.array([time.monotonic()])
        self._object: Vector | None = None
        self._held = False

    @property
    def joints(self) -> Vector:
        """(6,) joints at this moment."""
        with self._lock:
            now = time.monotonic()
            if now >= self._times[-1]:
                return self._path[-1].copy()
            leg = int(np.searchsorted(self._times, now, side="right"))
            begin, end = self._times[leg - 1 : leg + 1]
            share = (now - begin) / (end - begin)
            return self._path[leg - 1] + share * (self._path[leg] - self._path[leg - 1])

    @property
    def pose(self) -> Vector:
        """(4, 4) pose of the tool frame at this moment."""
        return self.pose_at(self.joints)

    def pose_at(self, q: Sequence[float] | Vector) -> Vector:
        """(..., 4, 4) pose of the tool frame at joints q (..., 6)."""
        return np.array(forward_kinematics(self.robot, np.asarray(q)), dtype=np.float64)

    def move(self, q: Sequence[float] | Vector) -> float:
        """Set out for joints q (6,); the moment of arrival, on the clock of `time.monotonic`."""
        return self.follow(np.asarray(q, dtype=np.float64)[None])

    def follow(self, path: Vector) -> float:
        """Set out along joints (k, 6), one after the other; the moment of arrival."""
        with self._lock:
            path = np.concatenate([self.joints[None], path])
            speed = self._max_velocity * (self.velocity_percent / 100) * self._time_scale
            legs = np.max(np.abs(np.diff(path, axis=0)) / speed, axis=1)
            self._times = time.monotonic() + np.concatenate([[0.0], np.cumsum(legs)])
            self._path = path
            return float(self._times[-1])

    def outside(self, q: Sequence[float] | Vector, decimals: int | None = None) -> int | None:
        """Index of the first joint of q (6,) outside its limits, q rounded first where asked."""
        values = np.asarray(q) if decimals is None else np.round(q, decimals)
        bad = ~((self.lower <= values) & (values <= self.upper))
        return int(np.argmax(bad)) if np.any(bad) else None

    def detect_tool(self) -> None:
        """Find the mounted tool, as the robot does on UPDATE_TOOL."""
        self.tool = self._mounted_tool
        self.reset_tcp()

    def reset_tcp(self) -> None:
        """Put the tool centre point where the tool has it."""
        self.tcp = np.eye(4)
        self.tcp[:3, 3] = self.model.tools[self.tool]

    def grasp(self) -> None:
        """Close the tool; an object within reach of the tool centre point is held from now on."""
        with self._lock:
            if self.tool == "none" or self.grasping:
                return
            self.grasping = True
            if self._object is not None:
                pose = self.pose
                local = pose[:3, :3].T @ (self._object - pose[:3, 3])
                if np.linalg.norm(local - np.array(self.model.tools[self.tool])) <= REACH:
                    self._object, self._held = local, True

    def release(self) -> None:
        """Open the tool; an object that was held falls straight down to the table, z = 0."""
        with self._lock:
            if self.tool == "none":
                return
            position, self._held = self.object_position, False
            self.grasping = False
            if position is not None:
                self._object = position * (1.0, 1.0, 0.0)

    def place_object(self, position: Sequence[float] | Vector) -> None:
        """Put the one object at a position (3,) in the space frame, out of the tool if held."""
        with self._lock:
            self._object, self._held = np.array(position, dtype=np.float64), False

    @property
    def holding(self) -> bool:
        """Whether the object is held by the tool."""
        return self._held

    @property
    def object_position(self) -> Vector | None:
        """(3,) position of the object in the space frame; None where there is none."""
        with self._lock:
            if self._object is None:
                return None
            if not self._held:
                return self._object.copy()
            pose = self.pose
            return pose[:3, :3] @ self._object + pose[:3, 3]
