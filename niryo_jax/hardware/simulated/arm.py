"""The state of a simulated Niryo: joints that move in time, a tool, and what it can grip."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from niryo_jax.chain import forward_kinematics
from niryo_jax.hardware.simulated.things import Things
from niryo_jax.hardware.simulated.wear import Wear, WornJoints
from niryo_jax.robots import NiryoModel

Vector = NDArray[np.float64]


class SimulatedArm:
    """Joints, tool and things. Thread-safe; angles in radians, lengths in metres, real seconds.

    Joints move at constant speed and arrive together: the slowest joint, at its largest speed
    times the velocity percentage times `time_scale`, decides how long a move takes. What the arm
    reports is what its encoders say; where it is worn its joints, and the tool, stand elsewhere.

    Attributes:
        calibrated, learning_mode, jog_mode, collision_detected: as the robot reports them.
        connected: whether the motors answer; a move is refused where they do not.
        tool_overloaded: whether the tool's motor refuses to work.
        tool: the tool detected last, "none" before.
        grasping: whether the tool is closed.
        tcp_enabled, tcp: whether poses are those of the tool centre point, and where it lies:
            (4, 4) in the tool frame.
    """

    def __init__(
        self, model: NiryoModel, *, time_scale: float, mounted_tool: str, wear: Wear
    ) -> None:
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
        self._worn = WornJoints(wear)
        self._things = Things()

    @property
    def joints(self) -> Vector:
        """(6,) joints at this moment, as the encoders say them."""
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
        """(4, 4) pose of the tool frame at this moment, as the encoders say it."""
        return self.pose_at(self.joints)

    @property
    def true_pose(self) -> Vector:
        """(4, 4) pose of the tool frame at this moment, where it is."""
        with self._lock:
            return self.pose_at(self._worn.at(self.joints))

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
            self._worn.move(path)
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
        """Close the tool; what is within reach of the tool centre point is held from now on."""
        with self._lock:
            if self.tool == "none" or self.grasping:
                return
            self.grasping = True
            self._things.grasp(self.true_pose, np.array(self.model.tools[self.tool]))

    def release(self) -> None:
        """Open the tool; what was held falls straight down, to the table (z = 0) or a block."""
        with self._lock:
            if self.tool == "none":
                return
            self._things.release(self.true_pose)
            self.grasping = False

    def place_things(self, poses: ArrayLike, size: Sequence[float]) -> None:
        """Put things of one size (3,), with the middles of their bases at poses (k, 4, 4), in
        the place of all before; out of the tool if held."""
        with self._lock:
            self._things.put(poses, size)

    @property
    def holding(self) -> bool:
        """Whether the tool holds a thing."""
        return self._things.holding

    @property
    def things(self) -> Vector:
        """(k, 4, 4) poses of the middles of their bases in the space frame."""
        with self._lock:
            return self._things.poses(self.true_pose)
