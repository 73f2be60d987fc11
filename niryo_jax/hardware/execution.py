"""A timed joint trajectory as stops that a Niryo is sent to, checked before anything is sent.

The robot takes no times: it moves from stop to stop at a percentage of its largest joint speeds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from niryo_jax.chain import forward_kinematics
from niryo_jax.codes import Code
from niryo_jax.execution.padding import filled_up
from niryo_jax.hardware.errors import ArgumentRejected, NiryoError, TargetRejected
from niryo_jax.hardware.targets import JointTargets, Vector
from niryo_jax.robot import Robot

By = Literal["trajectory", "moves"]

# What one frame of the protocol has room for, six numbers of a stop being 70 bytes.
MOST_STOPS = 400

# How far the tool may leave the straight lines that the robot draws between two stops, metres: at
# its origin and at a finger's length from it.
_STRAIGHT, _FINGER = 1e-3, 0.1

# Samples are looked at in multiples of so many, so that programs are few.
_ROWS = 256

# What rounding may add to a speed that is at its limit.
_SPEED_ROUNDING = 1e-6


class TimedJoints(Protocol):
    """What is executed: `motion.JointTrajectory` is one."""

    @property
    def time(self) -> ArrayLike: ...
    @property
    def q(self) -> ArrayLike: ...


class ExecutionState(Code):
    """Why a trajectory was not carried out to its end."""

    STOPPED = 1, "stopped by the program, the arm stands at a stop of the trajectory"
    DEVIATED = 2, "the arm stands elsewhere than the trajectory has it"
    REFUSED = 3, "the robot refused a move, the arm stands at a stop of the trajectory"
    LOST = 4, "no answer from the robot, the arm may still be moving"


class ExecutionAborted(NiryoError):
    """A trajectory ended on its way; nothing more was sent. Its cause is the error that ended it.

    Attributes:
        state: an `ExecutionState`.
        stops_done: how many of the stops were reached.
        reached: (6,) joints read back last, radians.
    """

    def __init__(
        self, message: str, state: ExecutionState, stops_done: int, reached: Vector
    ) -> None:
        super().__init__(message)
        self.state = state
        self.stops_done = stops_done
        self.reached = reached


@dataclasses.dataclass(frozen=True)
class Execution:
    """A trajectory as it is, or was, carried out.

    Attributes:
        stops: (w, 6) joint angles that the robot is sent to, radians; the first is the start.
        time: (w,) when the trajectory is there, seconds from its start.
        percent: (w - 1,) share of the largest joint speeds that each leg asks for, 1 to 100.
        by: "trajectory", the robot's own command for several stops, or "moves", one for each.
        reached: (r, 6) joint angles read back, radians; r = 0 for a dry run.
        reached_stop: (r,) numbers of the stops at which they were read.
        arrival: (r,) when that was, seconds from the start.
        deviation: radians, the largest difference of a joint from its stop, of those read.
    """

    stops: Vector
    time: Vector
    percent: NDArray[np.int64]
    by: By | None
    reached: Vector
    reached_stop: NDArray[np.int64]
    arrival: Vector

    @property
    def deviation(self) -> float:
        """Radians: see the class."""
        return float(np.max(np.abs(self.reached - self.stops[self.reached_stop]), initial=0.0))

    def pieces(self, seconds: float) -> list[tuple[int, int]]:
        """(first, last) stops of the pieces that one command is sent for, in order: each takes no
        longer than `seconds`, or is one leg, and fits into a frame."""
        last, pieces = 0, list[tuple[int, int]]()
        while last < len(self.stops) - 1:
            first = last
            within = np.searchsorted(self.time, self.time[first] + seconds, side="right") - 1
            last = int(np.clip(within, first + 1, first + MOST_STOPS))
            pieces.append((first, min(last, len(self.stops) - 1)))
        return pieces


def plan(
    robot: Robot, targets: JointTargets, trajectory: TimedJoints, within: float, straight: bool
) -> Execution:
    """The stops of a trajectory, with nothing reached yet.

    Args:
        robot: the arm.
        targets: its limits and speeds.
        trajectory: joint angles (k, 6) at times (k,) that increase.
        within: radians by which joints may leave the trajectory between two stops.
        straight: whether the tool goes in straight lines between the stops, so that it must not
            leave the trajectory by more than a millimetre there either.

    Raises:
        ArgumentRejected: wrong shapes, or times that do not increase.
        TargetRejected: a sample outside the limits, or a speed above the robot's.
    """
    time, q = _samples(trajectory)
    q = _inside(targets, time, q)
    _check_speed(targets, time, q)
    paths = [(q[:, None], within)]
    if straight:
        paths.append((_tool_points(robot, q), _STRAIGHT))
    chosen = _thinned(paths)
    stops, time = q[chosen], time[chosen] - time[0]
    share = 100 * targets.travel_times(stops) / np.diff(time)
    nothing = np.empty(0)
    return Execution(
        stops=stops,
        time=time,
        percent=np.clip(np.ceil(share - 1e-6), 1, 100).astype(np.int64),
        by=None,
        reached=np.empty((0, 6)),
        reached_stop=nothing.astype(np.int64),
        arrival=nothing,
    )


def _samples(trajectory: TimedJoints) -> tuple[Vector, Vector]:
    try:
        time = np.asarray(trajectory.time, dtype=np.float64)
        q = np.asarray(trajectory.q, dtype=np.float64)
    except (AttributeError, TypeError, ValueError):
        raise ArgumentRejected(
            "trajectory: expected times (k,) and joint angles (k, 6), as a JointTrajectory has "
            f"them, got {trajectory!r}"
        ) from None
    if time.ndim != 1 or q.shape != (len(time), 6) or len(time) < 2:
        raise ArgumentRejected(
            "trajectory: expected times (k,) and joint angles (k, 6) for k of 2 or more, got "
            f"shapes {time.shape} and {q.shape}"
        )
    late = np.flatnonzero(~(np.diff(time) > 0))
    if len(late) or not np.isfinite(time[-1]):
        at = int(late[0]) if len(late) else len(time) - 2
        raise ArgumentRejected(
            f"trajectory: expected times that increase, got {time[at]:g} s and then "
            f"{time[at + 1]:g} s at sample {at + 1}"
        )
    return time, q


def _inside(targets: JointTargets, time: Vector, q: Vector) -> Vector:
    inside = np.empty_like(q)
    for sample, joints in enumerate(q):
        try:
            inside[sample] = targets.check(joints)
        except TargetRejected as error:
            words = str(error).removeprefix("q: ")
            raise TargetRejected(
                f"trajectory: sample {sample} at {time[sample]:.4g} s: {words}"
            ) from None
    return inside


def _check_speed(targets: JointTargets, time: Vector, q: Vector) -> None:
    share = targets.travel_times(q) / np.diff(time)
    worst = int(np.argmax(share))
    if share[worst] > 1 + _SPEED_ROUNDING:
        rates = np.abs(q[worst + 1] - q[worst]) / (time[worst + 1] - time[worst])
        joint = int(np.argmax(rates / targets.speed))
        raise TargetRejected(
            f"trajectory: {targets.names[joint]} turns at {rates[joint]:.4g} rad/s at "
            f"{time[worst]:.4g} s, faster than the {targets.speed[joint]:g} rad/s of the robot; "
            f"give it {share[worst]:.3g} times the duration, or retime it"
        )


def _tool_points(robot: Robot, q: Vector) -> Vector:
    """(k, 3, 3) the tool's origin, and points a finger's length along two of its axes."""
    pose = np.asarray(forward_kinematics(robot, filled_up(q, _ROWS)), dtype=np.float64)[: len(q)]
    arms = np.stack([np.zeros((3, 1)), *(_FINGER * np.eye(3)[:, [i]] for i in (0, 1))])
    return pose[:, None, :3, 3] + (pose[:, None, :3, :3] @ arms)[..., 0]


def _thinned(paths: Sequence[tuple[Vector, float]]) -> NDArray[np.int64]:
    """Numbers of the samples to keep, so that paths (k, points, d) are within a distance (largest
    coordinate) of the straight lines between them."""
    last = len(paths[0][0]) - 1
    kept = [0]

    def reaches(end: int) -> bool:
        return all(_is_straight(path[kept[-1] : end + 1], off) for path, off in paths)

    while (begin := kept[-1]) < last:
        # Doubled while it goes, halved between what goes and what does not.
        good, step = begin + 1, 2
        while good < last and reaches(min(begin + step, last)):
            good, step = min(begin + step, last), 2 * step
        bad = min(begin + step, last + 1)
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if reaches(middle) else (good, middle)
        kept.append(good)
    return np.array(kept)


def _is_straight(path: Vector, off: float) -> bool:
    way = path[-1] - path[0]
    aside = path - path[0]
    share = np.sum(aside * way, axis=-1) / np.maximum(np.sum(way * way, axis=-1), 1e-300)
    return bool(np.all(np.abs(aside - np.clip(share, 0, 1)[..., None] * way) <= off))


Progress = Callable[[int, int], object]
"""Called with how many stops are done, and how many there are."""
