"""Jacobians of open chains, by formula and by autodiff, and measures of how well an arm can move.

Rows are (omega, v): a Jacobian maps joint rates to the twist of the tool
(Lynch & Park, *Modern Robotics*, chapter 5).
"""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.arguments import check_choice, check_positive
from niryo_jax.chain import Motion, compose, link_motions, tool_motion
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import on_joints, on_lanes
from niryo_jax.lanes.matrices import product
from niryo_jax.lie import se3
from niryo_jax.robot import Robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.tolerances import DEPENDENT_ROW

Part = Literal["all", "angular", "linear"]


def space_jacobian(robot: Robot, q: ArrayLike, *, batch_last: bool = False) -> jax.Array:
    """The Jacobian of the tool's twist in the space frame.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        batch_last: whether the batch axes come last, (n, ...) -> (6, n, ...), which is faster.

    Returns:
        (..., 6, n), column i = Ad(exp([S1] q1) ... exp([Si-1] qi-1)) Si (Lynch & Park, eq. 5.11).

    Raises:
        ValueError: q does not have n joints.
    """
    return _space_jacobian(robot, q, batch_last=batch_last)


@specialised
def _space_jacobian(geometry: Geometry, q: ArrayLike, batch_last: bool) -> jax.Array:
    return on_joints(
        lambda q: pose_and_jacobian(geometry, q, "space")[1],
        q,
        geometry.joints,
        batch_last=batch_last,
    )


def body_jacobian(robot: Robot, q: ArrayLike, *, batch_last: bool = False) -> jax.Array:
    """The Jacobian of the tool's twist in the tool frame, Ad(T^-1) of the space Jacobian.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        batch_last: whether the batch axes come last, (n, ...) -> (6, n, ...), which is faster.

    Returns:
        (..., 6, n) (Lynch & Park, eq. 5.18).

    Raises:
        ValueError: q does not have n joints.
    """
    return _body_jacobian(robot, q, batch_last=batch_last)


@specialised
def _body_jacobian(geometry: Geometry, q: ArrayLike, batch_last: bool) -> jax.Array:
    return on_joints(
        lambda q: pose_and_jacobian(geometry, q, "body")[1],
        q,
        geometry.joints,
        batch_last=batch_last,
    )


def autodiff_space_jacobian(robot: Robot, q: ArrayLike) -> jax.Array:
    """The space Jacobian by differentiating forward kinematics: dT/dqi T^-1 = [J_i].

    Args:
        robot: the arm.
        q: (..., n) joint vector.

    Returns:
        (..., 6, n), equal to `space_jacobian` up to rounding; an independent check on it.

    Raises:
        ValueError: q does not have n joints.
    """
    return _autodiff_space_jacobian(robot, q)


@specialised
def _autodiff_space_jacobian(geometry: Geometry, q: ArrayLike) -> jax.Array:
    n = geometry.joints

    def pose(q: jax.Array) -> jax.Array:
        return on_joints(lambda q: se3.assemble(*tool_motion(geometry, q)), q, n)

    q = jnp.asarray(q)
    value = pose(q)

    def column(direction: jax.Array) -> jax.Array:
        rate = jax.jvp(pose, (q,), (jnp.broadcast_to(direction, q.shape),))[1]
        return se3.vee(product(rate, se3.inverse(value)))

    return jnp.moveaxis(jax.vmap(column)(jnp.eye(n, dtype=value.dtype)), 0, -1)


def pose_and_jacobian(
    geometry: Geometry, q: Lanes, frame: Literal["space", "body"], *, materialise: bool = False
) -> tuple[Motion, Lanes]:
    """The pose of the tool and the (6, n) Jacobian in the frame asked for, on lanes."""
    motions = link_motions(geometry, q, materialise=materialise)
    tool = compose(motions[-1], se3.split(geometry.home))
    columns = [geometry.screws[0]]
    for screw, motion in zip(geometry.screws[1:], motions):
        columns.append(se3.adjoint_lanes(*motion, screw))
    if frame == "body":
        columns = [se3.inverse_adjoint_lanes(*tool, column) for column in columns]
    return tool, np.stack(columns, axis=1)


def manipulability(robot: Robot, q: ArrayLike, part: Part = "all") -> jax.Array:
    """Yoshikawa's measure: the volume of the ellipsoid of what the arm can do, 0 where singular.

    It is the product of the singular values: sqrt(det(J J^T)) where there are as many joints as
    rows or more. An arm with fewer joints cannot move in all directions that rows stand for, and
    sqrt(det(J J^T)) is 0 always; its ellipsoid has as many axes as it has joints, and its volume is
    sqrt(det(J^T J)). Where the rows of the arm's task alone move, as with a SCARA, this is
    Yoshikawa's measure of these rows.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        part: which rows of the body Jacobian: "angular", "linear", or "all".

    Returns:
        (...,) in metres^3 for "all" and "linear" with as many joints as rows or more; no unit for
        "angular". Of an arm with fewer joints, "all" has a sum of several units. Its
        derivative at a singular configuration, where it has a corner, is given as 0.

    Raises:
        ValueError: q does not have n joints; an unknown part.
    """
    jacobian = body_jacobian(robot, q)[..., _ROWS[_check_part(part)], :]
    wide = jacobian.shape[-2] <= jacobian.shape[-1]
    return _volume(jacobian if wide else jnp.swapaxes(jacobian, -1, -2))


@jax.custom_jvp
@jax.jit
def _volume(rows: jax.Array) -> jax.Array:
    return on_lanes(lanes.volume, ("rows", rows, rows.shape[-2:]))


@_volume.defjvp
def _volume_jvp(
    primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[jax.Array, jax.Array]:
    # d sqrt(det(A A^T)) = sqrt(det(A A^T)) <G, dA> with G the transpose of A^+; A = L Q gives
    # L^T G = Q.
    (rows,), (rate,) = primals, tangents
    count, columns = rows.shape[-2:]
    volume = _volume(rows)

    def transposed_inverse(rows: Lanes) -> Lanes:
        basis, lower, reciprocals = lanes.orthogonalise(rows, DEPENDENT_ROW.of(volume.dtype))
        out = basis.copy()
        for i in reversed(range(count)):
            for j in range(i + 1, count):
                out[i] = out[i] - lower[j, i] * out[j]
            out[i] = lanes.materialised(out[i] * reciprocals[i])
        return out

    inverse = on_lanes(transposed_inverse, ("rows", rows, (count, columns)))
    return volume, volume * jnp.sum(inverse * rate, axis=(-1, -2))


def singular_values(
    robot: Robot, q: ArrayLike, part: Part = "all", *, length: float = 1.0
) -> jax.Array:
    """The singular values of the body Jacobian, largest first: half axes of the ellipsoid.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        part: which rows: "angular", "linear", or "all".
        length: metres by which linear rows are divided, so that "all" compares like with like;
            the values depend on this choice of unit.

    Returns:
        (..., min(rows, n)).

    Raises:
        ValueError: q does not have n joints; an unknown part; a length that is not positive.
    """
    length = check_positive("length", length, "a positive number of metres")
    jacobian = body_jacobian(robot, q)
    scale = jnp.array([1.0] * 3 + [1.0 / length] * 3, jacobian.dtype)[:, None]
    rows = (jacobian * scale)[..., _ROWS[_check_part(part)], :]
    return jnp.linalg.svd(rows, compute_uv=False)


def free_direction(robot: Robot, q: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """The joint rates that move the tool least: a self-motion where the arm is singular.

    Args:
        robot: the arm.
        q: (..., n) joint vector, n >= 1.

    Returns:
        (..., n) unit joint rates, and (...,) the size of the body twist that they give; zero
        where the arm can move while its tool rests (rows in radians and metres, unscaled). Where
        several directions move it equally little one of them is returned, and derivatives are
        those with the others held fixed.

    Raises:
        ValueError: q does not have n joints.
    """
    jacobian = body_jacobian(robot, q)
    direction = _right_vectors(jacobian)[1][..., -1]
    square = jnp.sum(product(jacobian, direction[..., None])[..., 0] ** 2, axis=-1)
    moves = square > 0.0
    return direction, jnp.where(moves, jnp.sqrt(jnp.where(moves, square, 1.0)), 0.0)


@jax.custom_jvp
def _right_vectors(matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The n singular values (..., n) of a matrix (..., m, n), largest first and zeros after them,
    and (..., n, n) the right singular vectors in columns."""
    _, values, transposed = jnp.linalg.svd(matrix, full_matrices=True)
    n = matrix.shape[-1]
    values = jnp.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, n - values.shape[-1])])
    return values, jnp.swapaxes(transposed, -1, -2)


@_right_vectors.defjvp
def _right_vectors_jvp(
    primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[tuple[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]:
    # With A = M^T M and its values l = s^2, dV = V F, F_ij = (V^T dA V)_ij / (l_j - l_i), which has
    # no value where two agree.
    values, vectors = _right_vectors(*primals)
    image, rate = (product(part, vectors) for part in (primals[0], tangents[0]))
    half = product(jnp.swapaxes(image, -1, -2), rate)
    turned = half + jnp.swapaxes(half, -1, -2)
    one, other = values[..., None, :], values[..., :, None]
    apart = jnp.abs(one - other) > DEPENDENT_ROW.of(values.dtype) * values[..., :1, None]
    gap = jnp.where(apart, (one - other) * (one + other), 1.0)
    share = jnp.where(apart, turned / gap, 0.0)
    some = values > 0.0
    grown = jnp.diagonal(half, axis1=-2, axis2=-1)
    rates = jnp.where(some, grown / jnp.where(some, values, 1.0), 0.0), product(vectors, share)
    return (values, vectors), rates


def condition_number(
    robot: Robot, q: ArrayLike, part: Part = "all", *, length: float = 1.0
) -> jax.Array:
    """Largest over smallest singular value of the body Jacobian; infinite where singular.

    A smallest value that is rounding is zero: below 1e-14 of the largest, in float32 1e-6.
    Arguments, shapes and errors as `singular_values`; returns (...,).
    """
    values = singular_values(robot, q, part, length=length)
    largest, smallest = values[..., 0], values[..., -1]
    regular = smallest > DEPENDENT_ROW.of(values.dtype) * largest
    return jnp.where(regular, largest / jnp.where(regular, smallest, 1.0), jnp.inf)


_ROWS = {"all": slice(0, 6), "angular": slice(0, 3), "linear": slice(3, 6)}


def _check_part(part: Part) -> Part:
    check_choice("part", part, _ROWS)
    return part
