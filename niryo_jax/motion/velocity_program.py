"""The program of velocity inverse kinematics.

All is worked out in the tool frame, at the tool's origin, so that the frame a twist is named in
changes nothing but what it and the residual are written in.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import Motion
from niryo_jax.differential import VelocityFrame
from niryo_jax.execution.compaction import at_once
from niryo_jax.execution.padding import cut_rows, padded_rows
from niryo_jax.ik.task import Task
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batch_last import lanes_in, stacked
from niryo_jax.lanes.batching import on_joints
from niryo_jax.lie import se3
from niryo_jax.motion.bounded import (
    Problem,
    bounded_least_squares,
    free_least_squares,
    optimality,
)
from niryo_jax.motion.damping import damping_square, squared_smallest_value
from niryo_jax.motion.rate_box import Box, RateLimits, rate_box
from niryo_jax.motion.velocity_result import VelocityResult, VelocityStatus
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.tolerances import OPTIMAL_RATES, TWIST_REACHED

_ROWS, _ROWS_ON_ACCELERATOR = 512, 65_536
"""So many at a time: those that need the most steps keep the others of their chunk waiting."""


class Asked(NamedTuple):
    """What is asked of an arm at a joint vector; all with batch axes (...), which broadcast.

    Attributes:
        twist: (..., 6).
        damping, threshold: (...,).
        weights: (..., 6), null_motion: (..., n), or None.
        limits: None where there are none.
    """

    twist: jax.Array
    damping: jax.Array
    threshold: jax.Array
    weights: jax.Array | None = None
    null_motion: jax.Array | None = None
    limits: RateLimits | None = None


@specialised
def joint_rates_for(
    geometry: Geometry,
    q: jax.Array,
    asked: Asked,
    frame: VelocityFrame,
    task: Task,
    keep_direction: bool,
) -> VelocityResult:
    """The answer at joint vectors q (..., n)."""
    given = q, _as_vectors(asked)
    batch: tuple[Any, ...]
    batch = jnp.broadcast_shapes(*(x.shape[:-1] for x in jax.tree.leaves(given)))
    rows = math.prod(batch)
    chunk = max(1, min(at_once(_ROWS, _ROWS_ON_ACCELERATOR), rows))
    chunks = max(1, -(-rows // chunk))

    def parts(x: jax.Array) -> jax.Array:
        x = jnp.broadcast_to(x.astype(q.dtype), (*batch, x.shape[-1]))
        x = padded_rows(x, len(batch), chunks * chunk, mode="edge")
        return jnp.swapaxes(x.reshape(chunks, chunk, x.shape[-1]), 1, 2)

    def solve(part: tuple[jax.Array, Asked]) -> VelocityResult:
        answer = _solve(geometry, *part, frame, task, keep_direction)
        return jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), answer)

    cut = jax.tree.map(parts, given)
    if chunks == 1:
        answer = solve(jax.tree.map(lambda x: x[0], cut))
    else:
        answer = jax.tree.map(jnp.concatenate, jax.lax.map(solve, cut))
    return jax.tree.map(lambda x: cut_rows(x, batch), answer)


def _as_vectors(asked: Asked) -> Asked:
    """The same with an axis of one number behind what has none."""
    limits = asked.limits
    if limits is not None and limits.step is not None:
        limits = limits._replace(step=limits.step[..., None])
    damping, threshold = asked.damping[..., None], asked.threshold[..., None]
    return asked._replace(damping=damping, threshold=threshold, limits=limits)


def _solve(
    geometry: Geometry,
    q: jax.Array,
    asked: Asked,
    frame: VelocityFrame,
    task: Task,
    keep_direction: bool,
) -> VelocityResult:
    """The answer of arrays whose batch (r,) is the last axis."""
    finite = _are_numbers(q, asked)
    # What is not finite gets no rates; with other numbers in its place no derivative is NaN.
    q, asked = jax.tree.map(lambda x: jnp.where(finite, x, 1.0), (q, asked))
    tool, jacobian = _kinematics(geometry, q)
    problem, selection, weights, square = _problem(tool, jacobian, asked, frame, task)
    box = None if asked.limits is None else _box(q, asked.limits)
    x, scale, missed = _answer(problem, box, keep_direction)
    held = jnp.zeros(q.shape, bool) if box is None else (x <= box[0]) | (x >= box[1])
    saturated = held & finite
    short = lanes_in(problem.residual(x)) / weights
    residual = stacked(_in_frame(tool, selection.T @ short, frame), q[0])
    singular = lanes.sqrt(Lane(square)).array
    rate, residual, missed = (
        jnp.where(finite, value, otherwise)
        for value, otherwise in ((x, 0.0), (residual, jnp.inf), (missed, jnp.inf))
    )
    scale, singular, damping = (
        jnp.where(finite, value, 0.0)
        for value in (scale, singular, lanes.sqrt(Lane(problem.square)).array)
    )
    status = _status(finite, asked.twist, rate, residual, saturated, damping, missed)
    return VelocityResult(rate, residual, saturated, scale, singular, damping, missed, status)


def _status(
    finite: jax.Array,
    twist: jax.Array,
    rate: jax.Array,
    residual: jax.Array,
    saturated: jax.Array,
    damping: jax.Array,
    missed: jax.Array,
) -> jax.Array:
    def largest(x: jax.Array) -> jax.Array:
        return jnp.max(jnp.abs(x), axis=0)

    reached = largest(residual) <= TWIST_REACHED.of(twist.dtype) * (1.0 + largest(twist))
    optimal = missed <= OPTIMAL_RATES.of(twist.dtype) * (1.0 + largest(rate))
    of = VelocityStatus
    short = jnp.where(damping > 0, of.SINGULAR, of.IMPOSSIBLE)
    short = jnp.where(jnp.any(saturated, axis=0), of.LIMITED, short)
    status = jnp.where(optimal, jnp.where(reached, of.REACHED, short), of.UNDECIDED)
    return jnp.where(finite, status, of.INVALID).astype(jnp.int32)


def _are_numbers(q: jax.Array, asked: Asked) -> jax.Array:
    """(r,) whether all is finite, bounds and weights of them aside, which must be numbers."""
    limits = RateLimits() if asked.limits is None else asked.limits
    bounded = [x for x in (q, asked.twist, asked.null_motion, limits.previous) if x is not None]
    parts = [jnp.isfinite(x) for x in bounded] + [~jnp.isnan(x) for x in jax.tree.leaves(asked)]
    return functools.reduce(jnp.logical_and, [jnp.all(x, axis=0) for x in parts])


def _kinematics(geometry: Geometry, q: jax.Array) -> tuple[Motion, Lanes]:
    """The pose of the tool, and the (6, n) body Jacobian."""

    def numbers(q: Lanes) -> Lanes:
        tool, jacobian = pose_and_jacobian(geometry, q, "body", materialise=True)
        return np.concatenate([jacobian.ravel(), tool[0].ravel(), tool[1]])

    n = geometry.joints
    entries = lanes_in(on_joints(numbers, q, n, batch_last=True))
    return (entries[-12:-3].reshape(3, 3), entries[-3:]), entries[:-12].reshape(6, n)


def _problem(
    tool: Motion, jacobian: Lanes, asked: Asked, frame: VelocityFrame, task: Task
) -> tuple[Problem, Lanes, Lanes, jax.Array]:
    """What is to be least, without bounds; the rows that are bound (k, 6) and their weights; and
    the square of the smallest singular value."""
    across = task.across()
    chosen = np.zeros((len(across) + 3, 6))
    chosen[: len(across), :3], chosen[len(across) :, 3:] = across, np.eye(3)
    selection, weights = lanes.lanes_of(chosen), lanes.lanes_of(np.ones(len(chosen)))
    like = asked.twist[0]
    if asked.weights is not None:
        squares = lanes_in(asked.weights * asked.weights)
        weights = lanes.map_lanes(lanes.sqrt, lanes.lanes_of(chosen**2) @ squares)
    rows = lanes.materialised(weights[:, None] * (selection @ jacobian))
    matrix = stacked(rows, like)
    twist = _in_tool_frame(tool, lanes_in(asked.twist), frame)
    rhs = stacked(lanes.materialised(weights * (selection @ twist)), like)
    smallest = squared_smallest_value(matrix)
    square = damping_square(smallest, asked.damping[0], asked.threshold[0])
    zero = jnp.zeros_like(matrix[0])
    problem = Problem(matrix, rhs, square, zero, zero - jnp.inf, zero + jnp.inf)
    if asked.null_motion is not None:
        still = problem._replace(rhs=jnp.zeros_like(rhs), square=jnp.zeros_like(square))
        problem = problem._replace(
            centre=free_least_squares(still._replace(centre=asked.null_motion))
        )
    return problem, selection, weights, smallest


def _in_tool_frame(tool: Motion, twist: Lanes, frame: VelocityFrame) -> Lanes:
    """The body twist of one that is named in a frame."""
    rotation, position = tool
    if frame == "body":
        return twist
    if frame == "space":
        return se3.inverse_adjoint_lanes(rotation, position, twist)
    return np.concatenate([rotation.T @ twist[:3], rotation.T @ twist[3:]])


def _in_frame(tool: Motion, twist: Lanes, frame: VelocityFrame) -> Lanes:
    """A body twist as it is named in a frame."""
    rotation, position = tool
    if frame == "body":
        return twist
    if frame == "space":
        return se3.adjoint_lanes(rotation, position, twist)
    return np.concatenate([rotation @ twist[:3], rotation @ twist[3:]])


def _box(q: jax.Array, limits: RateLimits) -> Box:
    last_first = jax.tree.map(jnp.transpose, (q, limits))
    lower, upper = rate_box(*last_first)
    return lower.T, upper.T


def _answer(
    problem: Problem, box: Box | None, keep_direction: bool
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Joint rates (n, r), their scale (r,), and by how much they miss being the optimum (r,)."""
    one = jnp.ones_like(problem.square)
    if box is None or keep_direction:
        x = free_least_squares(problem)
        scaled = (x, one) if box is None else _scaled(x, box)
    else:
        problem = problem._replace(lower=box[0], upper=box[1])
        x = bounded_least_squares(problem)[0]
        scaled = x, one
    return *scaled, jax.lax.stop_gradient(optimality(problem, x))


def _scaled(x: jax.Array, box: Box) -> tuple[jax.Array, jax.Array]:
    """Joint rates, slowed all alike until they are within a box; and what is left of them.

    Where the box does not hold 0, they are drawn towards the least rates that it holds.
    """
    slowest = jnp.clip(0.0, *box)
    move = x - slowest
    # A joint at its limit that moves outward by rounding holds no others back.
    largest = jax.lax.stop_gradient(jnp.max(jnp.abs(move), axis=0))
    moves = jnp.abs(move) > TWIST_REACHED.of(x.dtype) * largest
    bound = jnp.where(move > 0, box[1], box[0])
    share = jnp.where(moves, (bound - slowest) / jnp.where(moves, move, 1.0), jnp.inf)
    scale = jnp.minimum(1.0, jnp.min(share, axis=0))
    slowed = jnp.where((share <= scale) & (scale < 1), bound, slowest + scale * move)
    return jnp.clip(slowed, *box), scale
