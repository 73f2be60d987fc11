"""Derivatives of inverse kinematics by the implicit function theorem: one rule for every method.

Along F(q, geometry, target) = 0, the twist from tool to target, the derivative of F with respect to
q is -J_b, so J_b dq = dF at fixed q. The rule differentiates again, hence derivatives of any order.
It needs solutions alone, and not the program that found them.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.held import Held, held_row, held_value
from niryo_jax.ik.target import make_target
from niryo_jax.ik.task import Task
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import on_lanes
from niryo_jax.lie import se3
from niryo_jax.robot import Robot
from niryo_jax.specialise import Geometry, specialised, traced_geometry
from niryo_jax.tolerances import DEPENDENT_ROW


class RateMap(NamedTuple):
    """What rates of poses and of held values make of solutions: linear, so two arrays say it.

    Attributes:
        by_pose: (..., slots, n, 16) by the entries of the pose as it was given.
        by_held: (..., slots, n) by the value that is held; zeros where none is.
        distance: (..., 16) how the entries move the distance of the pose from a rigid motion.
    """

    by_pose: jax.Array
    by_held: jax.Array
    distance: jax.Array


@specialised
def rate_map(
    geometry: Geometry, pose: jax.Array, q: jax.Array, solved: jax.Array, held: Held
) -> RateMap:
    """The rates of solutions q (..., slots, n) of poses (..., 4, 4), which may be near SE(3).

    Zero where not `solved` (..., slots). At a singular configuration they are the least rates that
    follow the target in the directions in which the arm can move.
    """
    target = make_target(pose)
    twists, distance = on_lanes(
        _by_entries, ("pose", pose, (4, 4)), ("target", target.pose, (4, 4))
    )
    wide = (*q.shape[:-1], 6, 16)
    right = jnp.broadcast_to(twists.reshape(*pose.shape[:-2], 1, 6, 16), wide)
    right = jnp.pad(right, [(0, 0)] * (right.ndim - 2) + [(int(held is not None), 0), (0, 1)])
    if held is not None:
        right = right.at[..., 0, 16].set(1.0)
    rates = _least(_equations(geometry, q, held), jnp.where(solved[..., None, None], right, 0.0))
    return RateMap(rates[..., :16], rates[..., 16], distance)


def _by_entries(pose: Lanes, target: Lanes) -> tuple[Lanes, Lanes]:
    """The body twist (96,) of the nearest rigid motion, by each entry of a pose; the distance.

    With M = R S, S symmetric, R^T dM - dM^T R = S W + W S for the turn W of R, which is
    (tr(S) 1 - S) w = 2 vee(R^T dM) of its vector w.
    """
    rotation, _ = se3.split(target)
    stretch = rotation.T @ pose[:3, :3]
    matrix = lanes.trace(stretch) * lanes.identity(3) - 0.5 * (stretch + stretch.T)
    det = matrix[0] @ lanes.cross(matrix[1], matrix[2])
    inverse = lanes.materialised(lanes.adjugate(matrix) * (1.0 / det))
    away = pose - target
    far = lanes.norm(away.ravel())
    apart = far > 0.0
    per = lanes.select(apart, 1.0 / lanes.select(apart, far, 1.0), 0.0)
    columns, distance = [], []
    for row, column in np.ndindex(4, 4):
        unit = lanes.lanes_of(np.eye(16)[4 * row + column].reshape(4, 4))
        turn = inverse @ (2.0 * lanes.vee(rotation.T @ unit[:3, :3]))
        columns.append(np.concatenate([turn, rotation.T @ unit[:3, 3]]))
        distance.append(away[row, column] * per)
    return np.stack(columns, axis=1).ravel(), lanes.lanes_of(distance)


@jax.jit
def applied(rates: RateMap, pose: jax.Array, held: jax.Array | None) -> tuple[jax.Array, jax.Array]:
    """The rates of the solutions, and of the distance, for those of poses and of held values."""
    entries = pose.reshape(*pose.shape[:-2], 16)
    q = jnp.sum(rates.by_pose * entries[..., None, None, :], axis=-1)
    if held is not None:
        q = q + rates.by_held * held[..., None, None]
    return q, jnp.sum(rates.distance * entries, axis=-1)


def rate_by_geometry(
    robot: Robot,
    tangent: Robot,
    target: jax.Array,
    q: jax.Array,
    solved: jax.Array,
    held: Held,
) -> jax.Array:
    """The rates of solutions q (..., slots, n) for a rate of the robot, at fixed targets."""

    def at_fixed_joints(robot: Robot) -> jax.Array:
        return _at_fixed_joints(traced_geometry(robot, q.dtype), target, q, held)

    right = jax.jvp(at_fixed_joints, (robot,), (tangent,))[1][..., None]
    matrix = _equations(traced_geometry(robot, q.dtype), q, held)
    return _least(matrix, jnp.where(solved[..., None, None], right, 0.0))[..., 0]


def rate_of_geometry(
    geometry: Geometry,
    target: jax.Array,
    q: jax.Array,
    solved: jax.Array,
    tangents: tuple[Geometry, jax.Array],
    task: Task,
) -> jax.Array:
    """The rates of joint vectors (..., n), one a target, for those of the geometry and of targets
    (..., 4, 4) that are rigid motions."""
    q = q[..., None, :]
    if task.name != "pose":
        return _rate_of_bound(geometry, target, q, solved, tangents, task)
    moved = jax.jvp(
        lambda geometry: _at_fixed_joints(geometry, target, q, None), (geometry,), tangents[:1]
    )[1]
    twist = on_lanes(_twist_of, ("pose", target, (4, 4)), ("rate", tangents[1], (4, 4)))
    right = jnp.where(solved[..., None, None], moved + twist[..., None, :], 0.0)
    return _least(_equations(geometry, q, None), right[..., None])[..., 0, :, 0]


def _rate_of_bound(
    geometry: Geometry,
    target: jax.Array,
    q: jax.Array,
    solved: jax.Array,
    tangents: tuple[Geometry, jax.Array],
    task: Task,
) -> jax.Array:
    """`rate_of_geometry` of joint vectors (..., 1, n) that reach what a task binds."""
    batch, n = q.shape[:-2], geometry.joints
    rows = q.reshape(-1, n).T

    def twist(geometry: Geometry, target: jax.Array) -> tuple[jax.Array, jax.Array]:
        goal = lanes.unpack(target.reshape(-1, 4, 4), 2)
        return rolled.bound_twist(geometry, goal, rows, task)

    (_, jacobian), (right, _) = jax.jvp(twist, (geometry, target), tangents)
    right = jnp.where(solved.reshape(-1), right, 0.0)
    rates = _least(jnp.moveaxis(jacobian, -1, 0), right.T[..., None])
    return rates.reshape(*batch, n)


def _twist_of(target: Lanes, rate: Lanes) -> Lanes:
    """The body twist of a moving pose."""
    rotation, _ = se3.split(target)
    turning, moving = se3.split(rate)
    return np.concatenate([lanes.vee(rotation.T @ turning), rotation.T @ moving])


def _equations(geometry: Geometry, q: jax.Array, held: Held) -> jax.Array:
    """The body Jacobian (..., 6, n), below a row for what is held."""
    batch, n = q.shape[:-1], geometry.joints
    rows = q.reshape(-1, n)
    jacobian = rolled.pose_and_body_jacobian(geometry, rows.T)[2]
    if held is not None:
        jacobian = jnp.concatenate([held_row(geometry, rows, held)[None], jacobian])
    return jnp.moveaxis(jacobian, -1, 0).reshape(*batch, -1, n)


def _at_fixed_joints(geometry: Geometry, target: jax.Array, q: jax.Array, held: Held) -> jax.Array:
    """The body twists (..., slots, 6) from tool to target, before them what is held, negative."""
    batch, n = q.shape[:-1], geometry.joints
    rows = q.reshape(-1, n)
    goal = jnp.broadcast_to(target[..., None, :, :], (*batch, 4, 4)).reshape(-1, 4, 4)
    twist = rolled.near_twist(geometry, lanes.unpack(goal, 2), rows.T)[0]
    twist = twist.T.reshape(*batch, 6)
    if held is None:
        return twist
    return jnp.concatenate([-held_value(geometry, q, held)[..., None], twist], axis=-1)


def _least(matrix: jax.Array, right: jax.Array) -> jax.Array:
    """x (..., n, k) with matrix (..., m, n) @ x = right (..., m, k), of least norm or squares."""
    square = matrix.shape[-2] == matrix.shape[-1]
    return _solve_square(matrix, right) if square else _solve(matrix, right)


def _solve(matrix: jax.Array, right: jax.Array) -> jax.Array:
    batch, (m, n) = matrix.shape[:-2], matrix.shape[-2:]
    last = jnp.moveaxis(matrix.reshape(-1, m, n), 0, -1)
    inverse = rolled.pseudo_inverse(last, DEPENDENT_ROW.of(matrix.dtype))
    return _product(jnp.moveaxis(inverse, -1, 0).reshape(*batch, n, m), right)


def _product(a: jax.Array, b: jax.Array) -> jax.Array:
    return jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


# With as many joints as equations X = J^-1 B has the rate J^-1 (dB - dJ X), a second solve, which
# is a far smaller program than the derivative of the first.
_solve_square = jax.custom_jvp(_solve)


@_solve_square.defjvp
def _solve_square_jvp(
    primals: tuple[jax.Array, jax.Array], tangents: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, jax.Array]:
    matrix, right = primals
    x = _solve_square(matrix, right)
    return x, _solve_square(matrix, tangents[1] - _product(tangents[0], x))


Result = TypeVar("Result")


def zero_tangent(result: Result) -> Result:
    """The tangent of a result that does not change."""

    def zero(x: Any) -> Any:
        if jnp.issubdtype(jnp.result_type(x), jnp.floating):
            return jnp.zeros(jnp.shape(x), jnp.result_type(x))
        return np.zeros(jnp.shape(x), jax.dtypes.float0)

    return jax.tree.map(zero, result)
