"""Kinematics in loops over the joints: programs that are small, for batches or parts that are.

Elsewhere a formula is written out joint by joint, which XLA turns into one fast loop over the
batch, and compiles for long. Here the joints are the loop, with the batch as the last axis.
"""

from __future__ import annotations

import functools
import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import Motion, joint_motion
from niryo_jax.ik.newton.pose_error import pose_difference, small_twist
from niryo_jax.ik.task import Task
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3
from niryo_jax.specialise import Geometry


class _Joint(NamedTuple):
    """What the loop reads of each joint: screws (n, 6) or (n, 6, r), and whether it slides (n,)."""

    screws: jax.Array
    slides: np.ndarray
    kind: str


def _joints_of(geometry: Geometry, dtype: np.dtype) -> _Joint:
    entries = [jnp.asarray(lane.value, dtype) for lane in geometry.screws.ravel()]
    shape = jnp.broadcast_shapes(*(x.shape for x in entries))
    entries = [jnp.broadcast_to(x, shape) for x in entries]
    screws = jnp.stack(entries).reshape(geometry.joints, 6, *shape)
    kinds = set(geometry.kinds)
    slides = np.array([kind == "prismatic" for kind in geometry.kinds])
    # The formula of a helical joint holds for revolute ones too.
    kind = kinds.pop() if len(kinds) == 1 else "any" if "any" in kinds else "helical"
    return _Joint(screws, slides, kind)


def _moved(joint: _Joint, geometry: Geometry, i: jax.Array, angle: jax.Array) -> tuple[Lanes, ...]:
    """The screw of joint i as lanes, and its motion."""
    screw = lanes.lanes_of([Lane(joint.screws[i][k]) for k in range(6)])
    one = Geometry(screw[None], geometry.home, (joint.kind,))
    rotation, position = joint_motion(one, 0, Lane(angle), materialise=True)
    if joint.slides.any() and not joint.slides.all():
        slides = jnp.asarray(joint.slides)[i]
        position = lanes.choose(slides, screw[3:] * Lane(angle), position)
        rotation = lanes.choose(slides, lanes.identity(3), rotation)
    return screw, rotation, position


def _stacked(parts: Lanes, like: jax.Array) -> jax.Array:
    return jnp.stack(
        [jnp.broadcast_to(jnp.asarray(x.value, like.dtype), like.shape) for x in parts]
    )


def pose_and_body_jacobian(geometry: Geometry, q: jax.Array) -> tuple[Lanes, Lanes, jax.Array]:
    """Rotation (3, 3) and position (3,) lanes of the tool, and the body Jacobian (6, n, r).

    Args:
        geometry: the arm, or one for each of the r rows.
        q: (n, r) joint vectors.
    """
    return _walk(geometry, q, jacobian=True)


def _walk(geometry: Geometry, q: jax.Array, jacobian: bool) -> tuple[Lanes, Lanes, jax.Array]:
    joint, n, row = _joints_of(geometry, q.dtype), geometry.joints, q[0]

    def step(i: jax.Array, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        motion, columns = state
        entries = lanes.lanes_of([Lane(motion[k]) for k in range(12)])
        rotation, position = entries[:9].reshape(3, 3), entries[9:]
        screw, turn, shift = _moved(joint, geometry, i, q[i])
        if jacobian:
            column = se3.adjoint_lanes(rotation, position, screw)
            columns = columns.at[:, i].set(_stacked(column, row))
        after = np.concatenate([(rotation @ turn).ravel(), rotation @ shift + position])
        return _stacked(after, row), columns

    start = _stacked(np.concatenate([lanes.identity(3).ravel(), lanes.lanes_of([0.0] * 3)]), row)
    columns = jnp.zeros((6, n if jacobian else 0, *row.shape), q.dtype)
    motion, columns = jax.lax.fori_loop(0, n, step, (start, columns))
    entries = lanes.lanes_of([Lane(motion[k]) for k in range(12)])
    rotation, position = entries[:9].reshape(3, 3), entries[9:]
    home_rotation, home = se3.split(geometry.home)
    rotation, position = rotation @ home_rotation, rotation @ home + position
    rotation, position = lanes.materialised(rotation), lanes.materialised(position)
    if jacobian:
        space = lanes.lanes_of([Lane(columns[k]) for k in range(6)])
        body = se3.inverse_adjoint_lanes(rotation, position, space)
        columns = _stacked(body, columns[0])
    return rotation, position, columns


Errors = tuple[jax.Array, jax.Array]
"""Metres and radians (r,)."""


def _errors(pose: Motion, goal: Lanes, like: jax.Array) -> Errors:
    metres, radians = pose_difference(pose, se3.split(goal))
    return jnp.broadcast_to(metres.array, like.shape), jnp.broadcast_to(radians.array, like.shape)


def pose_errors(geometry: Geometry, goal: Lanes, q: jax.Array) -> Errors:
    """By how much joint vectors (n, r) miss goals, (4, 4) lanes."""
    rotation, position, _ = _walk(geometry, q, jacobian=False)
    return _errors((rotation, position), goal, q[0])


def near_twist(
    geometry: Geometry, goal: Lanes, q: jax.Array
) -> tuple[jax.Array, jax.Array, Errors]:
    """`pose_error.small_twist` (6, r), the body Jacobian (6, n, r), and `pose_errors`."""
    rotation, position, jacobian = pose_and_body_jacobian(geometry, q)
    twist = small_twist((rotation, position), goal)
    return _stacked(twist, q[0]), jacobian, _errors((rotation, position), goal, q[0])


def bound_twist(
    geometry: Geometry, goal: Lanes, q: jax.Array, task: Task
) -> tuple[jax.Array, jax.Array]:
    """What a task binds (k, r) of the twist to goals that are all but reached, and of the Jacobian
    (k, n, r), in the frame of the goal, which the tool may be turned against.

    The cross product of two unit vectors has the same derivative as the turn between them.
    """
    rotation, position, jacobian = pose_and_body_jacobian(geometry, q)
    goal_rotation, goal_position = se3.split(goal)
    relative = lanes.materialised(goal_rotation.T @ rotation)
    across, axis = lanes.lanes_of(task.across()), lanes.lanes_of(task.axis)
    turn = across @ lanes.cross(relative @ axis, axis)
    twist = np.concatenate([turn, goal_rotation.T @ (goal_position - position)])
    columns = [lanes.lanes_of([Lane(x) for x in jacobian[:, i]]) for i in range(geometry.joints)]
    rows = [np.concatenate([across @ (relative @ x[:3]), relative @ x[3:]]) for x in columns]
    return _stacked(twist, q[0]), jnp.stack([_stacked(x, q[0]) for x in rows], axis=1)


def added(terms: jax.Array, axis: int) -> jax.Array:
    """The sum of a few terms along an axis, the first of them first.

    XLA's own order depends on the size of the batch, and so would the last bit of every answer.
    """
    parts = (jax.lax.index_in_dim(terms, i, axis, False) for i in range(terms.shape[axis]))
    return functools.reduce(operator.add, parts)


def pseudo_inverse(
    matrix: jax.Array,
    tolerance: float,
    damping: jax.Array | None = None,
    longest_first: bool = False,
) -> jax.Array:
    """(m, n, ...) -> (n, m, ...): what gives the least solution, by modified Gram-Schmidt.

    A row (a column where m > n) that is independent of those before it by less than the share
    `tolerance` is left out, and so is one that is nothing but rounding beside the longest: the
    others are solved for, and nothing becomes infinite. With a damping d (...,) each pivot r is
    divided by as r / (r^2 + d^2). With `longest_first` the rows are taken in the order of what is
    left of them: what is left out then is a combination of the others with small numbers, so that
    rounding in these does not grow in that.
    """
    m, n = matrix.shape[:2]
    if m > n:
        turned = pseudo_inverse(jnp.swapaxes(matrix, 0, 1), tolerance, damping, longest_first)
        return jnp.swapaxes(turned, 0, 1)
    batch = matrix.shape[2:]
    number = jnp.arange(m).reshape(m, *[1] * (len(batch) + 1))
    whole = added(matrix * matrix, 1)
    rounding = (16 * float(jnp.finfo(matrix.dtype).eps)) ** 2 * jnp.max(whole, axis=0)

    def step(i: jax.Array, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        rows, right, whole, inverse = state
        if longest_first:
            squares = jnp.where(number[:, 0] < i, -1.0, added(rows * rows, 1))
            pick = number == jnp.argmax(squares, axis=0)
            rows, right = (_exchanged(x, i, pick) for x in (rows, right))
            whole = _exchanged(whole[:, None], i, pick)[:, 0]
        row = rows[i]
        square = added(row * row, 0)
        independent = square > jnp.maximum(tolerance * tolerance * whole[i], rounding)
        per = jnp.where(independent, 1.0 / jnp.sqrt(jnp.where(independent, square, 1.0)), 0.0)
        unit, of_row = row * per, right[i] * per
        if damping is not None:
            of_row = of_row / (1.0 + (damping * per) ** 2)
        inverse = inverse + unit[:, None] * of_row[None]
        # What is left of the rows behind it has no part along it.
        part = jnp.where(number > i, added(rows * unit[None], 1)[:, None], 0.0)
        return rows - part * unit[None], right - part * of_row[None], whole, inverse

    eye = jnp.eye(m, dtype=matrix.dtype).reshape(m, m, *[1] * len(batch))
    none = jnp.zeros((n, m, *batch), matrix.dtype)
    start = matrix, jnp.broadcast_to(eye, (m, m, *batch)), whole, none
    return jax.lax.fori_loop(0, m, step, start)[-1]


def _exchanged(x: jax.Array, i: jax.Array, pick: jax.Array) -> jax.Array:
    """Row i of x (m, k, ...) exchanged with the one that is picked (m, 1, ...)."""
    picked = added(jnp.where(pick, x, 0.0), 0)
    return jnp.where(pick, x[i], x).at[i].set(picked)
