"""The nearest pose on a line through the shoulder that an arm can reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.ik.methods.complete import solve_complete
from niryo_jax.ik.methods.partial import solve_partial
from niryo_jax.ik.results.status import IKStatus
from niryo_jax.ik.task import Task, TaskName, task_of
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.structure.offset_wrist import OffsetWristArm, offset_wrist_arm
from niryo_jax.tolerances import ANSWERED, REACH_EDGE

_COARSE = 64
_FINE = 16
_GROUPS = (4, 128)


def nearest_reachable(
    robot: Robot,
    pose: ArrayLike,
    *,
    within_limits: bool = True,
    task: TaskName = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
) -> tuple[jax.Array, jax.Array]:
    """Move poses that cannot be reached along the line to the shoulder until they can.

    The shoulder is the point where axes 1 and 2 meet. Along the line through it and the given
    position, as far as the arm is long to either side, 64 positions are tried; the one nearest to
    the given position that is reachable is then brought towards it up to the edge of what is
    reachable, to within 1e-9 m (1e-5 m in float32). For targets too near to the shoulder this
    leads outwards.

    Guaranteed: the pose returned was solved, and has the given rotation. Not guaranteed: that no
    pose with another rotation or off the line is nearer; nor that none on the line is, where what
    is reachable there is shorter than a step (1/32 of the arm's length; 15 mm for the
    Niryo One).

    With a `task`, a pose is reachable where what is bound of it is. Where the task leaves joints to
    spare that is what `inverse_kinematics` finds from many guesses: the edge is then where it finds
    nothing more, and may lie further out.

    Args:
        robot: an arm that the complete method of `inverse_kinematics` fits.
        pose: (..., 4, 4) targets in the space frame, metres.
        within_limits: whether the joint limits count.
        task: what of the pose is bound, as for `inverse_kinematics`.
        tool_axis: (3,) the axis that "direction" binds, in the tool frame.

    Returns:
        (..., 4, 4) poses, those that are reachable unchanged, and (...,) whether they are
        reachable. Where none was found, or the given one is not a rigid motion, it is returned.

    Raises:
        ValueError: a wrong shape, an arm that the method does not fit, an unknown task, a tool axis
            without direction.
        TypeError: traced arrays.
    """
    check_is_robot(robot)
    bound = task_of(task, tool_axis)
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    if not is_concrete(pose):
        raise TypeError(
            "pose: nearest_reachable expects concrete arrays, got traced ones; call it outside "
            "jax.jit"
        )
    arm = offset_wrist_arm(robot.known_screws())
    if arm is None:
        raise ValueError(
            "robot: nearest_reachable needs six revolute joints of which axes 1 and 2 meet, 2 and "
            f"3 are parallel, 4 and 5 meet; {robot.name} is not such an arm"
        )
    given = np.asarray(pose).reshape(-1, 4, 4)

    def solved(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _solved(robot, poses, within_limits, bound)

    ok, valid = solved(given)
    moved = given.copy()
    lost = np.flatnonzero(valid & ~ok)
    while len(lost):
        some, lost = lost[: _GROUPS[-1]], lost[_GROUPS[-1] :]
        moved[some], ok[some] = _brought_near(robot, arm, given[some], solved)
    batch = pose.shape[:-2]
    return jnp.asarray(moved.reshape(*batch, 4, 4)), jnp.asarray(ok.reshape(batch))


Solved = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Whether poses (..., 4, 4) are reachable, and whether they are rigid motions."""


def _solved(
    robot: Robot, poses: np.ndarray, within_limits: bool, task: Task
) -> tuple[np.ndarray, np.ndarray]:
    if task.name == "pose":
        answer = solve_complete(robot, poses)
    else:
        answer = solve_partial(robot, poses, task, None, ANSWERED)
    status, count = np.asarray(answer.status), np.asarray(answer.count)
    reachable = status == IKStatus.SOLVED if within_limits else count > 0
    return np.asarray(reachable), np.asarray(status != IKStatus.INVALID_POSE)


def _brought_near(
    robot: Robot, arm: OffsetWristArm, given: np.ndarray, solved: Solved
) -> tuple[np.ndarray, np.ndarray]:
    """The answer for a few poses (m, 4, 4) that are not reachable."""
    targets = len(given)
    # The batch is filled up, so that few different sizes are compiled.
    size = next(size for size in _GROUPS if size >= targets)
    padded = np.concatenate([given, np.zeros((size - targets, 4, 4), given.dtype)])
    outward = padded[:, :3, 3].astype(np.float64) - arm.shoulder
    radius = np.linalg.norm(outward, axis=1)
    at_shoulder = radius == 0
    outward[at_shoulder] = [1.0, 0.0, 0.0]
    outward /= np.where(at_shoulder, 1.0, radius)[:, None]

    def at(radii: np.ndarray) -> np.ndarray:
        """The poses (m, s, 4, 4) at signed distances (m, s) from the shoulder."""
        poses = np.repeat(padded[:, None], radii.shape[1], axis=1)
        poses[..., :3, 3] = arm.shoulder + radii[..., None] * outward[:, None]
        return poses

    def first(radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The first of distances (m, s) that is reachable, and whether any is."""
        good = solved(at(radii))[0]
        best = np.argmax(good, axis=1)[:, None]
        return np.take_along_axis(radii, best, axis=1)[:, 0], np.any(good, axis=1)

    longest = _longest(robot, arm)
    grid = np.broadcast_to(np.linspace(-longest, longest, _COARSE), (size, _COARSE))
    order = np.argsort(np.abs(grid - radius[:, None]), axis=1, kind="stable")
    inner, ok = first(np.take_along_axis(grid, order, axis=1))
    # What lies nearer to the given position was not reachable, and beyond `longest` nothing is.
    step = 2 * longest / (_COARSE - 1)
    outer = inner + np.clip(radius - inner, -step, step)
    share = np.arange(1, _FINE + 1) / _FINE
    while np.max(np.abs(outer - inner), where=ok, initial=0.0) > REACH_EDGE.of(given.dtype):
        width = (inner - outer) / _FINE
        radii, reached = first(outer[:, None] + (inner - outer)[:, None] * share)
        inner = np.where(reached, radii, inner)
        outer = inner - width
    pose = np.where(ok[:, None, None], at(inner[:, None])[:, 0], padded)
    return pose[:targets], ok[:targets]


def _longest(robot: Robot, arm: OffsetWristArm) -> float:
    """No position of the tool is farther from the shoulder, metres."""
    tool = np.asarray(robot.home, np.float64)[:3, 3]
    axis_6 = arm.wrist - arm.offset
    hand = np.linalg.norm(arm.offset) + np.linalg.norm(tool - axis_6)
    return float(arm.wrist_range[1] + hand)
