"""Newton-Raphson inverse kinematics from a guess, over any number of poses at once.

Algorithm 1 of Todorovic et al. (2024); Lynch & Park, *Modern Robotics*, section 6.2.2. The error is
the twist that carries the tool to the target in unit time; each step solves J dq = twist. The step
is damped in proportion to the error (Sugihara, 2011), which keeps it small near
singularities far from the answer and leaves convergence quadratic.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.arguments import check_choice, check_count, check_number
from niryo_jax.execution.compaction import at_once, running_count
from niryo_jax.execution.devices import BatchSharding, batch_sharding, on_all_cores, on_each_device
from niryo_jax.execution.padding import cut_rows, padded_rows, program_size
from niryo_jax.ik.newton.implicit import rate_of_geometry, zero_tangent
from niryo_jax.ik.newton.pose_error import Frame, miss
from niryo_jax.ik.target import Target, make_target
from niryo_jax.ik.task import Task, TaskName, task_of
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.tolerances import DEPENDENT_ROW, NEWTON_POSITION, NEWTON_ROTATION

_WIDTH = 512

_MOST_ITERATIONS = 2**31 - 1
"""They are counted in 32 bits."""


class NewtonResult(NamedTuple):
    """Where Newton-Raphson ended.

    Attributes:
        q: (..., n) joint vectors, not wrapped.
        converged: (...,) whether both errors are within their tolerances.
        iterations: (...,) the number of steps taken.
        position_error, rotation_error: (...,) metres and radians at q; infinite where q or the
            pose is not finite or the pose is no rigid motion.
    """

    q: jax.Array
    converged: jax.Array
    iterations: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array


@dataclasses.dataclass(frozen=True)
class _Options:
    frame: Frame
    position_tolerance: float | None
    rotation_tolerance: float | None
    max_iterations: int
    step_limit: float
    damping: float
    task: Task


def newton_raphson(
    robot: Robot,
    pose: ArrayLike,
    q0: ArrayLike,
    *,
    frame: Frame = "body",
    position_tolerance: float | None = None,
    rotation_tolerance: float | None = None,
    max_iterations: int = 30,
    step_limit: float = 0.7,
    damping: float = 0.1,
    task: TaskName = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
) -> NewtonResult:
    """Solve for the joint vector of a pose by Newton-Raphson from a guess.

    Args:
        robot: the arm.
        pose: (..., 4, 4) targets; projected to SE(3) first.
        q0: (..., n) guesses, radians. The batch axes of pose and q0 broadcast.
        frame: whether the error twist and the Jacobian are those of the tool ("body") or of the
            space frame ("space"). Both take the same steps where nothing is damped.
        position_tolerance: metres; 1e-11 in float64 and 2e-6 in float32 where not given.
        rotation_tolerance: radians; 1e-11 in float64 and 5e-6 in float32 where not given.
        max_iterations: the most steps to take.
        step_limit: the most that any joint moves in one step, radians (or metres).
        damping: factor of the error that damps the step; 0 for the pure method.
        task: what of the pose is bound: all of it, "direction" (the position and one axis of the
            tool), or "position"; of joints to spare, steps are the least.
        tool_axis: (3,) the axis that "direction" binds, in the tool frame.

    Returns:
        A `NewtonResult`. Every pose takes part in one program; those that have converged stay. A
        batch whose size is not known, of `jax.export`, is solved one pose after the other.
        Derivatives of q with respect to pose and robot are those of the implicit
        function theorem, where converged; with respect to q0 they are zero.

    Raises:
        ValueError: wrong shapes, an unknown frame, options that are not positive, an unknown task,
            one that is not "pose" in the space frame.
        TypeError: a traced tool_axis.
    """
    check_is_robot(robot)
    check_choice("frame", frame, ("body", "space"))
    max_iterations = check_count("max_iterations", max_iterations, 0, _MOST_ITERATIONS)
    step_limit = check_number("step_limit", step_limit, "a positive number", lambda x: x > 0)
    damping = check_number("damping", damping, "0 or more", lambda x: x >= 0)
    bound = task_of(task, tool_axis)
    if frame == "space" and bound.name != "pose":
        raise ValueError(f"frame: expected 'body' for task {task!r}, got 'space'")
    for name, tolerance in (
        ("position_tolerance", position_tolerance),
        ("rotation_tolerance", rotation_tolerance),
    ):
        if tolerance is not None:
            check_number(name, tolerance, "a positive number", lambda x: x > 0)
    options = _Options(
        frame, position_tolerance, rotation_tolerance, max_iterations, step_limit, damping, bound
    )
    pose, q0 = as_floating("pose", pose), as_floating("q0", q0)
    check_shape("pose", pose, (4, 4))
    check_shape("q0", q0, (robot.joints,))
    dtype = jnp.result_type(pose, q0)
    batch = broadcast_batch(("pose", pose, 2), ("q0", q0, 1))
    poses = jnp.broadcast_to(pose, (*batch, 4, 4)).astype(dtype)
    guesses = jnp.broadcast_to(q0, (*batch, robot.joints)).astype(dtype)

    sharding = batch_sharding(poses, len(batch))
    parts = sharding.parts if sharding else 1

    def solve(pose: jax.Array, q0: jax.Array) -> NewtonResult:
        batch = q0.shape[:-1]
        padded = parts * program_size(-(-math.prod(batch) // parts))
        if (padded,) == batch:
            return _newton_raphson(robot, make_target(pose), q0, options=options, sharding=sharding)
        # The last row again, since zeros would take all the steps that are allowed.
        rows, guesses = (padded_rows(x, len(batch), padded, mode="edge") for x in (pose, q0))
        target = make_target(rows)
        return _cut(
            _newton_raphson(robot, target, guesses, options=options, sharding=sharding), batch
        )

    return on_all_cores(solve, [poses, guesses], batch, program_size)


@functools.partial(jax.jit, static_argnums=1)
def _cut(result: NewtonResult, batch: tuple[int, ...]) -> NewtonResult:
    return jax.tree.map(lambda x: cut_rows(x, batch), result)


@specialised
def _newton_raphson(
    geometry: Geometry,
    target: Target,
    q0: jax.Array,
    options: _Options,
    sharding: BatchSharding | None,
) -> NewtonResult:
    solve = on_each_device(functools.partial(_solve, options), sharding, same=1)
    result = solve(geometry, target.pose, q0)
    usable = target.valid & jnp.isfinite(result.position_error + result.rotation_error)
    return result._replace(
        converged=result.converged & usable,
        position_error=jnp.where(usable, result.position_error, jnp.inf),
        rotation_error=jnp.where(usable, result.rotation_error, jnp.inf),
    )


class _State(NamedTuple):
    """Lanes that each work on one row of the batch, and take another when it is done.

    Attributes:
        row: (w,) the row that each lane works on; the batch's size or more where none is left.
        q: n of (w,) joint angles.
        steps: (w,) taken so far on this row.
        following: the first row that no lane has taken.
        answers: (size, n + 4) q, iterations, position error, rotation error, converged.
    """

    row: jax.Array
    q: list[jax.Array]
    steps: jax.Array
    following: jax.Array
    answers: jax.Array


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _solve(options: _Options, geometry: Geometry, target: jax.Array, q0: jax.Array) -> NewtonResult:
    """The results of rows (size, 4, 4) and (size, n)."""
    dtype, (size, n) = q0.dtype, q0.shape
    width = min(size, at_once(_WIDTH, size // 8))
    position_tolerance = options.position_tolerance or NEWTON_POSITION.of(dtype)
    rotation_tolerance = options.rotation_tolerance or NEWTON_ROTATION.of(dtype)

    def body(state: _State) -> _State:
        q = lanes.lanes_of([Lane(angle) for angle in state.q])
        goal = lanes.contiguous_lanes(target[jnp.minimum(state.row, size - 1)], 2)
        twist, jacobian, position_error, rotation_error = miss(
            geometry, goal, q, options.frame, options.task
        )
        jacobian, twist = lanes.materialised(jacobian), lanes.materialised(twist)
        converged = (position_error <= position_tolerance) & (rotation_error <= rotation_tolerance)
        done = converged | (state.steps >= options.max_iterations)
        flag = lanes.select(converged, 1.0, 0.0)
        steps = Lane(state.steps.astype(dtype))
        answer = lanes.lanes_of([*q, steps, position_error, rotation_error, flag])
        answers = state.answers.at[jnp.where(done, state.row, size)].set(
            lanes.pack(answer, (width,), dtype), mode="drop"
        )
        place, count = running_count(done)
        row = jnp.where(done, state.following + place - 1, state.row)
        fresh = lanes.contiguous_lanes(q0[jnp.minimum(row, size - 1)])
        moved = q + _step(options, jacobian, twist, dtype)
        return _State(
            row=row,
            q=[lanes.select(done, a, b).array for a, b in zip(fresh, moved)],
            steps=jnp.where(done, 0, state.steps + 1),
            following=state.following + count,
            answers=answers,
        )

    start = _State(
        row=jnp.arange(width),
        q=[q0[:width, i] for i in range(n)],
        steps=jnp.zeros(width, jnp.int32),
        following=jnp.asarray(width),
        answers=jnp.zeros((size, n + 4), dtype),
    )
    state = jax.lax.while_loop(lambda state: jnp.any(state.row < size), body, start)
    steps, position_error, rotation_error, converged = state.answers[:, n:].T
    return NewtonResult(
        q=state.answers[:, :n],
        converged=converged > 0.5,
        iterations=steps.astype(jnp.int32),
        position_error=position_error,
        rotation_error=rotation_error,
    )


def _step(options: _Options, jacobian: Lanes, twist: Lanes, dtype: np.dtype) -> Lanes:
    """The damped Newton step, scaled back to the step limit."""
    damping = lanes.materialise(lanes.norm(twist) * options.damping) if options.damping else 0.0
    dq = lanes.solve(jacobian, twist, damping, DEPENDENT_ROW.of(dtype))
    dq = lanes.materialised(dq)
    largest = Lane(0.0)
    for value in dq:
        largest = lanes.maximum(largest, abs(value))
    too_far = largest > options.step_limit
    scale = lanes.select(too_far, options.step_limit / lanes.select(too_far, largest, 1.0), 1.0)
    return dq * lanes.materialise(scale)


@_solve.defjvp
def _solve_jvp(
    options: _Options,
    primals: tuple[Geometry, jax.Array, jax.Array],
    tangents: tuple[Geometry, jax.Array, jax.Array],
) -> tuple[NewtonResult, NewtonResult]:
    geometry, target, _ = primals
    result = _solve(options, *primals)
    rates = rate_of_geometry(
        geometry, target, result.q, result.converged, tangents[:2], options.task
    )
    return result, zero_tangent(result)._replace(q=rates)
