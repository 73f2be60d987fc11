"""A path of a task that leaves joints to spare: each sample by the least change from the last."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.padding import padded_rows, program_size
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.methods.partial import extended_arm
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.least_change import drawn
from niryo_jax.ik.newton.newton_raphson import newton_raphson
from niryo_jax.ik.paths.words import beyond_limits, too_far
from niryo_jax.ik.results.limits import are_within_limits
from niryo_jax.ik.results.status import IKStatus
from niryo_jax.ik.target import make_target
from niryo_jax.ik.task import Task
from niryo_jax.robot import Robot
from niryo_jax.specialise import Geometry, specialised_for_any_tool
from niryo_jax.tolerances import DEPENDENT_ROW, OFF_TASK


def glide(
    robot: Robot, path: np.ndarray, start: np.ndarray, task: Task, largest_step: float
) -> tuple[np.ndarray, np.ndarray, str]:
    """`follow` of a task that leaves joints to spare.

    Args:
        robot: a concrete arm.
        path: (k, 4, 4) poses.
        start: (n,) radians.
        task: what of the poses is bound.
        largest_step: radians.

    Returns:
        (k, n) joint vectors and (k,) whether they do the task: up to the end. Why it ends.
    """
    count = len(path)
    limits = np.asarray(robot.lower, path.dtype), np.asarray(robot.upper, path.dtype)
    q, converged = _glided(robot, path, start, limits, task)
    steps = np.abs(np.diff(q, axis=0, prepend=start[None])).max(axis=1, initial=0.0)
    within = np.asarray(are_within_limits(jnp.asarray(q), *map(jnp.asarray, limits)))
    ok = np.logical_and.accumulate(converged & within & (steps <= largest_step))
    end = int(ok.sum())
    last = q[end - 1] if end else start
    q = np.where(ok[:, None], q, last)
    reason = "" if end == count else _reason(robot, path[end], last, end, task, largest_step)
    return q, ok, reason


def _glided(
    robot: Robot,
    path: np.ndarray,
    start: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    task: Task,
) -> tuple[np.ndarray, np.ndarray]:
    """Joint vectors (k, n) along poses (k, 4, 4), and whether they do the task."""
    count = len(path)
    # The last again, so that few different sizes are compiled.
    poses = padded_rows(jnp.asarray(path), 1, program_size(count), mode="edge")
    q = _chain(robot, make_target(poses).pose, start, *limits, task=task)[:count]
    free = np.isin(np.arange(robot.joints), extended_arm(robot, task).free)
    q = jnp.where(free, np.clip(start, *limits), q)
    newton = newton_raphson(robot, path, q, task=task.name, tool_axis=task.axis)
    return np.asarray(newton.q), np.asarray(newton.converged)


@specialised_for_any_tool
def _chain(
    geometry: Geometry,
    path: jax.Array,
    start: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    task: Task,
) -> jax.Array:
    """Joint vectors along a path, as far as it goes on; the last again behind its end."""
    dependent, off = DEPENDENT_ROW.of(start.dtype), OFF_TASK.of(start.dtype)

    def go_on(last: jax.Array, pose: jax.Array) -> tuple[jax.Array, jax.Array]:
        goal = lanes.unpack(pose[None], 2)
        q = drawn(geometry, goal, last, last, (lower, upper), task, dependent)
        return q, jnp.max(jnp.abs(rolled.bound_twist(geometry, goal, q, task)[0])) < off

    def step(
        state: tuple[jax.Array, jax.Array], pose: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
        last, alive = state
        q, reached = jax.lax.cond(alive, go_on, lambda last, _: (last, alive), last, pose)
        return (q, reached), q[:, 0]

    return jax.lax.scan(step, (start[:, None], jnp.array(True)), path)[1]


def _reason(
    robot: Robot, pose: np.ndarray, last: np.ndarray, end: int, task: Task, largest_step: float
) -> str:
    """Why a pose does not continue the path, in words."""
    answer = solve_multistart(robot, pose, task=task)
    if int(answer.status) in (IKStatus.INVALID_POSE, IKStatus.UNREACHABLE):
        return answer.message()
    unlimited = np.full(robot.joints, np.inf, pose.dtype)
    (q,), (converged,) = _glided(robot, pose[None], last, (-unlimited, unlimited), task)
    if not converged:
        return f"no solution near the last joint vector was found. {answer.message()}"
    if np.max(np.abs(q - last)) > largest_step:
        return too_far(robot, q - last, end, largest_step)
    if words := beyond_limits(robot, q):
        return f"{words} The joints to spare cannot make up for it."
    return "within the joint limits no solution near the last joint vector was found."
