"""Commands that move the arm, and those about poses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from niryo_jax.hardware.simulated import planning
from niryo_jax.hardware.simulated.answers import (
    BOOLEANS,
    ParameterRefused,
    RobotRefused,
    choice,
    numbers,
    of_type,
)
from niryo_jax.hardware.simulated.arm import SimulatedArm, Vector
from niryo_jax.hardware.simulated.positions import (
    POSE_KEYS,
    POSE_METADATA,
    joints_of,
    pose_in_frame,
    pose_of,
    six,
    waypoint,
)
from niryo_jax.lie.rpy import pose_from_rpy, rpy_from_pose

Handlers = dict[str, tuple[tuple[int, ...], Callable[..., Sequence[object]]]]

NO_PLAN = "MoveIt failed to compute the plan."
_AXES = {name: index for index, name in enumerate(("X", "Y", "Z", "ROLL", "PITCH", "YAW"))}

# The largest jog of a joint, of a coordinate and of an angle; radians and metres.
_JOG_JOINT, _JOG_SHIFT, _JOG_TURN = 0.3, 0.05, 0.2


class _Aborted(Exception):
    """A goal that was accepted and cannot be reached."""


class Motion:
    """Moves, as the server of system 4 or 5 carries them out: one after the other, each to its end.

    Args:
        arm: the arm.
        modern: whether the system is 5.6.3, which answers OK to moves that it refuses.
        wait: waits for some seconds.
    """

    def __init__(self, arm: SimulatedArm, *, modern: bool, wait: Callable[[float], None]) -> None:
        self._arm = arm
        self._modern = modern
        self._wait = wait

    def handlers(self) -> Handlers:
        """Names of commands, how many parameters they take, and what they do."""
        table: Handlers = {
            "GET_JOINTS": ((0,), lambda: self._arm.joints.tolist()),
            "GET_POSE": ((0,), lambda: rpy_from_pose(self._tcp_pose())),
            "GET_POSE_QUAT": ((0,), self._pose_quaternion),
            "MOVE_JOINTS": ((6,), lambda *q: self._to(lambda: self._joints(numbers(q)))),
            "MOVE_POSE": ((7,), self._move_pose),
            "MOVE_LINEAR_POSE": ((7,), self._move_linear_pose),
            "SHIFT_POSE": ((2, 3) if self._modern else (2,), self._shift),
            "SHIFT_LINEAR_POSE": ((2,), lambda axis, value: self._shift(axis, value, "TRUE")),
            "JOG_JOINTS": ((6,), self._jog_joints),
            "JOG_POSE": ((6,), self._jog_pose),
            "EXECUTE_TRAJECTORY_FROM_POSES": ((2,), self._execute_poses),
            "EXECUTE_TRAJECTORY_FROM_POSES_AND_JOINTS": ((3,), self._execute_mixed),
            "FORWARD_KINEMATICS": ((1 if self._modern else 6,), self._forward_kinematics),
            "INVERSE_KINEMATICS": ((1 if self._modern else 6,), self._inverse_kinematics),
        }
        if self._modern:
            table["MOVE"] = ((2,), self._move)
            table["JOG"] = ((1,), self._jog)
            table["EXECUTE_TRAJECTORY"] = ((2,), self._execute)
        return table

    def to_pose(self, pose: Vector, *, linear: bool = False) -> Sequence[object]:
        """Move to a pose (4, 4) of the tool centre point."""
        return self._to(lambda: self._pose(self._arm.joints, pose, linear))

    def pose_of(self, position: Any) -> Vector:
        """Pose (4, 4) of a position of system 5, joints or a pose, or of six numbers."""
        if isinstance(position, list):
            return pose_from_rpy(six(cast("list[Any]", position)))
        joints = joints_of(position)
        return pose_of(position) if joints is None else self._arm.pose_at(six(joints))

    def through(self, stops: Sequence[Vector]) -> Sequence[object]:
        """Move to the first pose (4, 4) of several, then along straight lines to the others."""

        def path() -> Vector:
            legs = [self._pose(self._arm.joints, stops[0], False)]
            for pose in stops[1:]:
                legs.append(self._pose(legs[-1][-1], pose, True))
            return np.concatenate(legs)

        return self._to(path)

    def _to(self, plan: Callable[[], Vector]) -> Sequence[object]:
        """Check whether the arm may move, in the robot's order, and move it along a path."""
        arm = self._arm
        checks = (
            (not arm.connected, "Motor connection problem, you can't send a command now"),
            (not arm.calibrated, "You need to calibrate the robot before sending a command"),
            (arm.jog_mode, "You need to deactivate jog controller to execute a new command"),
        )
        for fails, words in checks:
            if fails:
                return self._refuse(f"Goal has been rejected : {words}")
        if arm.collision_detected:
            return self._refuse("Goal has been aborted : Collision detected")
        arm.learning_mode = False
        try:
            path = plan()
        except _Aborted as aborted:
            return self._refuse(f"Goal has been aborted : {aborted}")
        self._wait(arm.follow(path) - time.monotonic())
        return ()

    def _refuse(self, reason: str) -> Sequence[object]:
        if self._modern:
            return ()
        raise RobotRefused(reason)

    def _joints(self, q: Sequence[float]) -> Vector:
        arm = self._arm
        joint = arm.outside(q, decimals=3 if self._modern else None)
        if joint is not None:
            limits = (float(arm.lower[joint]), float(arm.upper[joint]))
            raise _Aborted(f"joint_{joint + 1} not in range {limits}")
        return np.array([q])

    def _pose(self, start: Vector, pose: Vector, linear: bool) -> Vector:
        arm = self._arm
        flange = pose @ np.linalg.inv(arm.tcp) if arm.tcp_enabled else pose
        words = planning.outside_box(arm, flange)
        if words is not None:
            raise _Aborted(words)
        if linear:
            path = planning.along_line(arm, start, flange)
        else:
            q = planning.joints_for(arm, flange, start)
            path = None if q is None else q[None]
        if path is None:
            raise _Aborted(NO_PLAN)
        return path

    def _tcp_pose(self) -> Vector:
        return self._arm.pose @ self._arm.tcp if self._arm.tcp_enabled else self._arm.pose

    def _pose_quaternion(self) -> Sequence[object]:
        pose = self._tcp_pose()
        return [*pose[:3, 3].tolist(), *planning.quaternion(pose)]

    def _move_pose(self, *params: Any) -> Sequence[object]:
        return self.to_pose(pose_in_frame(params))

    def _move_linear_pose(self, *params: Any) -> Sequence[object]:
        return self.to_pose(pose_in_frame(params), linear=True)

    def _move(self, position: Any, linear: Any) -> Sequence[object]:
        straight = choice(linear, BOOLEANS)
        joints = joints_of(position)
        if joints is None:
            return self.to_pose(pose_of(position), linear=straight)
        if straight:
            raise ParameterRefused(
                "The robot can only do a linear move with a pose, not with joints"
            )
        if len(joints) != 6:
            return ()
        return self._to(lambda: self._joints(joints))

    def _shift(self, axis: Any, value: Any, linear: Any = "FALSE") -> Sequence[object]:
        index, (amount,) = choice(axis, _AXES), numbers([value])
        straight = choice(linear, BOOLEANS)

        def path() -> Vector:
            if not -1 <= amount <= 1:
                raise _Aborted("shift value can't be null and < -1 or > 1")
            values = rpy_from_pose(self._tcp_pose())
            values[index] += amount
            return self._pose(self._arm.joints, pose_from_rpy(values), straight)

        return self._to(path)

    def _jog(self, position: Any) -> Sequence[object]:
        joints = joints_of(position)
        if joints is not None:
            return self._jog_joints(*six(joints))
        return self._jog_pose(*(position[key] for key in POSE_KEYS))

    def _jog_joints(self, *params: Any) -> Sequence[object]:
        shift = np.clip(numbers(params), -_JOG_JOINT, _JOG_JOINT)
        self._enter_jog_mode()
        arm = self._arm
        arm.move(np.clip(arm.joints + shift, arm.lower, arm.upper))
        return ()

    def _jog_pose(self, *params: Any) -> Sequence[object]:
        values = numbers(params)
        shift = np.clip(values[:3], -_JOG_SHIFT, _JOG_SHIFT)
        turn = np.clip(values[3:], -_JOG_TURN, _JOG_TURN)
        self._enter_jog_mode()
        target = self._arm.pose
        target[:3, :3] = pose_from_rpy([0.0, 0.0, 0.0, *turn.tolist()])[:3, :3] @ target[:3, :3]
        target[:3, 3] += shift
        q = planning.joints_for(self._arm, target, self._arm.joints)
        if q is None:
            raise RobotRefused(
                "Error Code : -130\nMessage : Unable to find on invert kinematics for the target "
                "position"
            )
        self._arm.move(q)
        return ()

    def _enter_jog_mode(self) -> None:
        if not self._arm.calibrated:
            raise RobotRefused(
                "Error Code : -1\nMessage : Cannot send command cause Jog because calibration is "
                "not done"
            )
        self._arm.learning_mode = False
        self._arm.jog_mode = True

    def _execute_poses(self, poses: Any, smoothing: Any) -> Sequence[object]:
        of_type(smoothing, float)
        return self._through([waypoint(pose) for pose in of_type(poses, list)])

    def _execute_mixed(self, items: Any, kinds: Any, smoothing: Any) -> Sequence[object]:
        of_type(smoothing, float)
        words = {"joint": True, "joints": True, "pose": False}
        joints = [choice(kind, words) for kind in of_type(kinds, list)]
        rows = of_type(items, list)
        if len(joints) == 1:
            joints *= len(rows)
        if len(joints) != len(rows):
            raise RobotRefused(
                "Executes trajectory from poses and joints - List of waypoints (size "
                f"{len(rows)}) and list of type (size {len(joints)}) must be the same size."
            )
        stops = [
            self._arm.pose_at(six(row)) if is_joints else waypoint(row)
            for row, is_joints in zip(rows, joints, strict=True)
        ]
        return self._through(stops)

    def _execute(self, positions: Any, smoothing: Any) -> Sequence[object]:
        numbers([smoothing])
        return self._through([self.pose_of(position) for position in of_type(positions, list)])

    def _through(self, stops: Sequence[Vector]) -> Sequence[object]:
        # The robot says that it wants two points at least, and answers OK.
        return self.through(stops) if len(stops) > 1 else ()

    def _forward_kinematics(self, *params: Any) -> Sequence[object]:
        if not self._modern:
            values = rpy_from_pose(self._arm.pose_at(six(params)))
            return [[round(value, 3) for value in values]]
        values = rpy_from_pose(self._arm.pose_at(six(joints_of(params[0]) or [])))
        pose = dict(zip(POSE_KEYS, values, strict=True))
        return [{**pose, "metadata": POSE_METADATA}]

    def _inverse_kinematics(self, *params: Any) -> Sequence[object]:
        pose = pose_of(params[0]) if self._modern else pose_from_rpy(numbers(params))
        q = planning.joints_for(self._arm, pose, self._arm.joints)
        if q is None:
            raise RobotRefused("Failed to perform invert kinematic")
        if not self._modern:
            return [q.tolist()]
        position = {f"joint_{i}": angle for i, angle in enumerate(q.tolist())}
        return [{**position, "metadata": {"version": 1}}]
