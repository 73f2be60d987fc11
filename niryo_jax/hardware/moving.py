"""What moves a Niryo: one target after the other, or a timed trajectory, each verified."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import threading
import time
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from niryo_jax.chain import forward_kinematics
from niryo_jax.hardware import arguments
from niryo_jax.hardware.errors import (
    ArgumentRejected,
    CommandRefused,
    MotionNotReached,
    MotionStopped,
    NiryoError,
    TargetRejected,
)
from niryo_jax.hardware.execution import (
    By,
    Execution,
    ExecutionAborted,
    ExecutionState,
    Progress,
    TimedJoints,
    plan,
)
from niryo_jax.hardware.link import ArmLink
from niryo_jax.hardware.status import why_it_stayed
from niryo_jax.hardware.targets import JointTargets, Vector
from niryo_jax.lie.rpy import pose_from_rpy
from niryo_jax.robot import Robot

# A move may take this many times its length over the joint speeds: the robot also accelerates,
# brakes and plans.
_SLACK = 3.0
_SETTLE_STEP = 0.05

# The robot's own speed, percent of the largest, until it is set: it does not tell it.
_DEFAULT_PERCENT = 100

# Threads that wait for an answer get in between two pieces of a move.
_YIELD = 0.005

_TRAJECTORY = "EXECUTE_TRAJECTORY_FROM_POSES_AND_JOINTS"

# How far the reported pose may be from that of the reported joints, which are rounded: metres and
# entries of the rotation. A tool is longer.
_SAME_POSE = 5e-3

_STATES: dict[type[Exception], ExecutionState] = {
    MotionStopped: ExecutionState.STOPPED,
    MotionNotReached: ExecutionState.DEVIATED,
    CommandRefused: ExecutionState.REFUSED,
}


class MovingArm(ArmLink):
    """An arm that can be sent somewhere; `NiryoArm` has its arguments and the rest of it.

    `connection` is what `ArmLink` takes besides.
    """

    def __init__(
        self,
        host: str,
        *,
        robot: Robot,
        tolerance: float,
        settle: float,
        piece: float | None,
        **connection: Any,
    ) -> None:
        super().__init__(host, robot=robot, **connection)
        self._robot = robot
        self._tolerance = arguments.positive("tolerance", tolerance)
        self._settle = arguments.seconds("settle", settle)
        self._piece = math.inf if piece is None else arguments.positive("piece", piece)
        self._targets = JointTargets(robot)
        self._percent = _DEFAULT_PERCENT
        self._stopped = threading.Event()

    def set_speed(self, percent: int) -> None:
        """Set the speed of later moves, as a whole percentage of the largest, 1 to 100.

        The robot keeps it from one program to the next and does not tell it: where it is not set,
        times are worked out for 100, its own after it was switched on.

        Raises:
            ArgumentRejected: not a whole number from 1 to 100; nothing was sent.
        """
        whole = arguments.percentage(percent)
        self._call("set_arm_max_velocity", whole)
        self._percent = whole

    def joints(self) -> Vector:
        """(6,) joint angles read from the robot, radians.

        In another thread than that of a move: those between two of its pieces.
        """
        return self._connected.joints(self._timeout)

    def pose(self) -> Vector:
        """(4, 4) pose that the robot reports, in the space frame, metres.

        It is the tool frame on system 4, and the tool centre point where the robot has that
        switched on (by default on system 5).
        """
        return pose_from_rpy(self._call("get_pose").to_list())

    def move_joints(self, q: ArrayLike) -> Vector:
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
            MotionNotReached: the robot reported success and stands elsewhere; the message says why,
                as far as the robot tells. Systems 5.0 to 5.6.3 answer so to moves that they refuse.
            MotionStopped: `stop` was called in another thread.
            CallTimeout, ConnectionLost: no answer in time; the arm may still be moving.
        """
        target = self._targets.check(q)
        self._stopped.clear()
        start = reached = self.joints()
        travel = self._travel(np.stack([start, target]))
        pieces = max(1, math.ceil(travel / self._piece))
        for share in np.linspace(0, 1, pieces + 1)[1:]:
            if self._stopped.is_set():
                raise MotionStopped("the move was stopped on its way", target, reached)
            waypoint = start + share * (target - start) if share < 1 else target
            limit = self._timeout + _SLACK * travel / pieces
            self._call("move_joints", *waypoint.tolist(), timeout=limit)
            reached = self._settled(waypoint, reached)
            time.sleep(_YIELD if pieces > 1 else 0.0)
        return reached

    def execute(
        self,
        trajectory: TimedJoints,
        *,
        by: By | None = None,
        within: float = 0.01,
        keep_time: bool = True,
        dry_run: bool = False,
        progress: Progress | None = None,
    ) -> Execution:
        """Carry out a timed joint trajectory from where the arm stands, and verify it on the way.

        All samples are checked before anything is sent. The robot takes no times: it is sent to
        stops, between which joints keep to the trajectory `within` so much, at the percentage of
        its speeds that the trajectory asks for, and not before its time. It accelerates and brakes
        as it does, so that it may be late, which `Execution.arrival` tells.

        With the robot's own command for several stops it goes through them without a halt, along
        straight lines of the tool; `piece` of the arm bounds for how long, so that `stop` takes
        effect, and joints are compared, where a piece ends. Where the robot has no such command, or
        reports poses of a tool centre point, which it then takes for those of the tool frame, each
        stop is a move of its own, at which the arm halts.

        The speed is that of before afterwards.

        Args:
            trajectory: joint angles `q` (k, 6), radians, at increasing times `time` (k,), seconds:
                a `motion.JointTrajectory`.
            by: "trajectory" for the robot's own command, "moves" for single moves; the first where
                it works if not given.
            within: radians by which joints may leave the trajectory between two stops.
            keep_time: whether to wait where the arm is early. A simulated robot that is sped up
                need not.
            dry_run: whether to return what would be done, with nothing sent. Needs no connection.
            progress: called with the number of stops done and of all, after each piece.

        Returns:
            An `Execution`: the stops, when and where the arm was at them.

        Raises:
            ArgumentRejected: no times and joints, or an unknown way.
            TargetRejected: a sample outside the limits, a speed above that of the robot, or a start
                elsewhere than where the arm stands. Nothing was sent.
            ExecutionAborted: the arm was stopped, stands elsewhere, was refused a move or is lost;
                `state` says which, and its cause is the error that `move_joints` would raise.
        """
        within = arguments.positive("within", within)
        if by not in (None, "trajectory", "moves"):
            raise ArgumentRejected(f"by: expected 'trajectory' or 'moves', got {by!r}")
        planned = plan(self._robot, self._targets, trajectory, within, by != "moves")
        if dry_run:
            return planned
        self._stopped.clear()
        start = self._check_start(planned)
        if by == "trajectory" or (by is None and self._reports_tool_frame(start)):
            try:
                return self._carry_out(planned, "trajectory", start, keep_time, progress)
            except ExecutionAborted as aborted:
                if by is not None or not _is_unknown(aborted.__cause__):
                    raise
        if by is None:
            planned = plan(self._robot, self._targets, trajectory, within, False)
        return self._carry_out(planned, "moves", start, keep_time, progress)

    def stop(self) -> None:
        """End the move that another thread has under way, after the piece that the arm is at.

        That thread gets `MotionStopped`. A move of one piece goes on to its end: see `piece`.
        """
        self._stopped.set()

    def _check_start(self, planned: Execution) -> Vector:
        """The joints (6,), which must be those of the first stop."""
        start = self.joints()
        off = np.abs(start - planned.stops[0])
        worst = int(np.argmax(off))
        if off[worst] > self._tolerance:
            raise TargetRejected(
                f"trajectory: {self._targets.names[worst]} begins at "
                f"{planned.stops[0, worst]:.4f} rad and stands at {start[worst]:.4f} rad; move the "
                "arm to the first sample before"
            )
        return start

    def _reports_tool_frame(self, joints: Vector) -> bool:
        """Whether poses that the robot reports, and takes, are those of the tool frame."""
        expected = np.asarray(forward_kinematics(self._robot, joints), dtype=np.float64)
        return bool(np.max(np.abs(self.pose() - expected)) < _SAME_POSE)

    def _carry_out(
        self,
        planned: Execution,
        by: By,
        reached: Vector,
        keep_time: bool,
        progress: Progress | None,
    ) -> Execution:
        """Send a plan, piece by piece."""
        stops, begin, before = planned.stops, time.monotonic(), self._percent
        read, at, arrival = [reached], [0], [0.0]
        try:
            for first, last in planned.pieces(self._piece if by == "trajectory" else 0.0):
                wait = begin + planned.time[first] - time.monotonic() if keep_time else 0.0
                if self._stopped.wait(max(wait, _YIELD)):
                    raise MotionStopped("the trajectory was stopped", stops[last], read[-1])
                self.set_speed(int(np.max(planned.percent[first:last])))
                self._send(by, stops[first : last + 1])
                read.append(self._settled(stops[last], read[-1]))
                at.append(last)
                arrival.append(time.monotonic() - begin)
                if progress is not None:
                    progress(last, len(stops) - 1)
        except NiryoError as error:
            state = _STATES.get(type(error), ExecutionState.LOST)
            words = f"{state.message}, after {at[-1]} of {len(stops) - 1} stops: {error}"
            raise ExecutionAborted(words, state, at[-1], read[-1]) from error
        finally:
            with contextlib.suppress(NiryoError):
                self.set_speed(before)
        return dataclasses.replace(
            planned,
            by=by,
            reached=np.array(read),
            reached_stop=np.array(at),
            arrival=np.array(arrival),
        )

    def _send(self, by: By, stops: Vector) -> None:
        """Let the arm go from the first of stops (k, 6), where it stands, to the last."""
        limit = self._timeout + _SLACK * self._travel(stops)
        if by == "moves":
            self._call("move_joints", *stops[-1].tolist(), timeout=limit)
            return
        rounded = np.round(stops, 6).tolist()
        self._connected.exchange(_TRAJECTORY, rounded, ["joint"], 0.0, timeout=limit)

    def _travel(self, path: Vector) -> float:
        """Seconds along joints (k, 6), one after the other, at the speed that is set."""
        return float(np.sum(self._targets.travel_times(path))) * 100 / self._percent

    def _settled(self, target: Vector, start: Vector) -> Vector:
        """The joints read back, once they are within the tolerance of a target (6,)."""
        deadline = time.monotonic() + self._settle
        while np.max(np.abs((reached := self.joints()) - target)) > self._tolerance:
            if time.monotonic() >= deadline:
                worst = int(np.argmax(np.abs(reached - target)))
                moved = np.max(np.abs(reached - start)) > self._tolerance
                why = why_it_stayed(self._connected, self._timeout)
                raise MotionNotReached(
                    f"the robot reported success, yet {self._targets.names[worst]} stands at "
                    f"{reached[worst]:.4f} rad instead of {target[worst]:.4f} rad, more than the "
                    f"tolerance of {self._tolerance:g} rad away: "
                    f"{'it was held up on its way; ' if moved else ''}{why}",
                    target,
                    reached,
                )
            time.sleep(_SETTLE_STEP)
        return reached


def _is_unknown(error: BaseException | None) -> bool:
    """Whether the robot does not know a command."""
    return isinstance(error, CommandRefused) and "unknown command" in error.reason.lower()
