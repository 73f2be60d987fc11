"""The rotation group SO(3).

Every function takes any leading batch axes and follows the dtype of its input. Exponential and
logarithm are exact and differentiable everywhere, the identity and the half turn included
(Lynch & Park, *Modern Robotics*, section 3.2.3).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import compiled, on_lanes

_POLAR_ITERATIONS = 40
_GENERIC = ((0.3, -0.8, 0.1), (0.5, 0.2, -0.6), (-0.1, 0.7, 0.9))
"""A direction in which a matrix without a unique nearest rotation is nudged to have one."""


@compiled
def hat(w: ArrayLike) -> jax.Array:
    """The skew-symmetric matrix [w]: (..., 3) -> (..., 3, 3) (Lynch & Park, eq. 3.30)."""
    return on_lanes(lanes.hat, ("w", w, (3,)))


@compiled
def vee(matrix: ArrayLike) -> jax.Array:
    """The vector of the skew-symmetric part, inverse of `hat`: (..., 3, 3) -> (..., 3)."""
    return on_lanes(lanes.vee, ("matrix", matrix, (3, 3)))


@compiled
def inverse(rotation: ArrayLike) -> jax.Array:
    """The inverse (transpose) of a rotation: (..., 3, 3) -> (..., 3, 3)."""
    return on_lanes(np.transpose, ("rotation", rotation, (3, 3)))


@compiled
def exp(w: ArrayLike) -> jax.Array:
    """The rotation by |w| radians about w: (..., 3) -> (..., 3, 3) (Lynch & Park, eq. 3.51)."""
    return on_lanes(exp_lanes, ("w", w, (3,)))


@compiled
def log(rotation: ArrayLike) -> jax.Array:
    """The rotation vector w with exp(w) = rotation and |w| <= pi: (..., 3, 3) -> (..., 3), radians.

    Computed through the unit quaternion, so that it keeps full accuracy from the identity up to
    the half turn, where w and -w are the same rotation and one of them is returned.
    The input is taken to be a rotation; see `project` where it may not be one.
    """
    return on_lanes(log_lanes, ("rotation", rotation, (3, 3)))


@compiled
def axis_angle(w: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """The unit axis and the angle of a rotation vector: (..., 3) -> (..., 3), (...,), radians.

    For w = 0 the axis and every derivative at it are 0 (Lynch & Park, section 3.2.3).
    """
    axis, angle = on_lanes(axis_angle_lanes, ("w", w, (3,)))
    return axis, angle


@compiled
def project(matrix: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """The rotation nearest to a matrix, and the distance to it: (..., 3, 3) -> (..., 3, 3), (...,).

    Nearest in the Frobenius norm, for every matrix, of negative determinant too: U diag(1, 1,
    det U V^T) V^T of the singular value decomposition (Kabsch). Where the nearest rotation is not
    unique, one of them. The derivative is that of the polar factor; 0 where it does not exist.
    """
    rotation, distance = on_lanes(project_lanes, ("matrix", matrix, (3, 3)))
    return rotation, distance


class ExpCoefficients(NamedTuple):
    """sin(t)/t, (1 - cos(t))/t^2 and (t - sin(t))/t^3 as functions of t^2."""

    sine: Lane
    cosine: Lane
    cubic: Lane


def exp_coefficients(square: Lane) -> ExpCoefficients:
    """The three coefficients of the exponentials, analytic in t^2, from a series below t = 1."""
    small = square < 1.0
    x = lanes.select(small, square, 0.0)
    series = [_series(x, k) for k in (1, 2, 3)]
    large = lanes.select(small, 1.0, square)
    angle = lanes.sqrt(large)
    sin, cos = lanes.sincos(angle)
    sine = sin / angle
    closed = (sine, (1.0 - cos) / large, (1.0 - sine) / large)
    return ExpCoefficients(*(lanes.select(small, s, c) for s, c in zip(series, closed)))


def _series(x: Lane, k: int) -> Lane:
    """Sum of (-x)^i / (2 i + k)! for 0 <= x <= 1, to the accuracy of float64."""
    terms = 9
    value = Lane(1.0)
    for i in reversed(range(1, terms)):
        value = 1.0 - x * value * (1.0 / ((2 * i + k - 1) * (2 * i + k)))
    return value * (1.0, 0.5, 1.0 / 6.0)[k - 1]


def exp_lanes(w: Lanes) -> Lanes:
    """`exp` on lanes."""
    a, b, _ = exp_coefficients(w @ w)
    return lanes.identity(3) + a * lanes.hat(w) + b * hat_squared(w)


def axis_angle_lanes(w: Lanes) -> tuple[Lanes, Lane]:
    """`axis_angle` on lanes, at any scale."""
    largest = lanes.maximum(abs(w[0]), lanes.maximum(abs(w[1]), abs(w[2])))
    some = largest > 0.0
    scale = Lane(jax.lax.stop_gradient(lanes.select(some, largest, 1.0).array))
    # A factor of 0, so that the zero vector has no derivative either.
    unit = w * lanes.select(some, 1.0 / scale, 0.0)
    length = lanes.norm(unit)
    return unit * (1.0 / lanes.select(some, length, 1.0)), length * scale


def hat_squared(w: Lanes) -> Lanes:
    """[w]^2 = w w^T - |w|^2 I."""
    return lanes.outer(w, w) - (w @ w) * lanes.identity(3)


def rotation_about(axis: Lanes, sin: Lane, cos: Lane) -> Lanes:
    """The rotation about a unit axis, from the sine and cosine of its angle.

    cos I + sin [w] + (1 - cos) w w^T; along a known unit axis the entries fold to 1, cos and sin.
    """
    rest = 1.0 - cos
    out = lanes.outer(axis, axis) * rest + sin * lanes.hat(axis)
    for i in range(3):
        square = axis[i] * axis[i]
        out[i, i] = Lane(1.0) if square.is_known(1.0) else cos + square * rest
    return out


def quaternion_lanes(rotation: Lanes) -> tuple[Lane, Lanes]:
    """The unit quaternion (scalar >= 0, vector) of a rotation (Shepperd's method).

    The largest of the four components is found first and divides the others, so no accuracy is
    lost anywhere and no square root is taken near zero.
    """
    r = rotation
    diagonal = (r[0, 0], r[1, 1], r[2, 2])
    squares = [1.0 + diagonal[0] + diagonal[1] + diagonal[2]]
    squares += [1.0 + 2.0 * d - (diagonal[0] + diagonal[1] + diagonal[2]) for d in diagonal]
    skew = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    candidates = (
        (squares[0], *skew),
        (skew[0], squares[1], xy, xz),
        (skew[1], xy, squares[2], yz),
        (skew[2], xz, yz, squares[3]),
    )
    best, chosen = squares[0], list(candidates[0])
    for square, candidate in zip(squares[1:], candidates[1:]):
        better = square > best
        best = lanes.select(better, square, best)
        chosen = [lanes.select(better, new, old) for new, old in zip(candidate, chosen)]
    scale = 0.5 / lanes.sqrt(best)
    scale = lanes.select(chosen[0] < 0.0, -scale, scale)
    return chosen[0] * scale, lanes.lanes_of([value * scale for value in chosen[1:]])


class LogLanes(NamedTuple):
    """A rotation vector, its angle squared, and (t/2) cot(t/2) of its angle t."""

    vector: Lanes
    square: Lane
    cotangent: Lane


def log_parts(rotation: Lanes) -> LogLanes:
    """`log` and its companions on lanes; cot(t/2) = w / |v| of the quaternion (w, v)."""
    scalar, vector = quaternion_lanes(rotation)
    square = vector @ vector
    small = square < 0.01
    # angle / |v| = 2 atan(|v| / w) / |v|: a series in (|v| / w)^2 where |v| is small.
    w = lanes.select(small, scalar, 1.0)
    x = lanes.select(small, square, 0.0) / (w * w)
    series = Lane(1.0 / 17.0)
    for k in (15, 13, 11, 9, 7, 5, 3, 1):
        series = 1.0 / k - x * series
    length = lanes.sqrt(lanes.select(small, 1.0, square))
    factor = lanes.select(small, 2.0 * series / w, 2.0 * lanes.atan2(length, scalar) / length)
    return LogLanes(vector * factor, factor * factor * square, 0.5 * factor * scalar)


def log_lanes(rotation: Lanes) -> Lanes:
    """`log` on lanes."""
    return log_parts(rotation).vector


ORTHONORMALISING = 3
"""So many steps of `orthonormalise_step_lanes` find the rotation nearest to a matrix within 0.02 of
one, to rounding; elsewhere roughly so."""


def orthonormalise_step_lanes(x: Lanes) -> Lanes:
    """A Newton-Schulz step X <- X (3 I - X^T X) / 2, without a division.

    Higham, *Functions of Matrices*, section 8.3.
    """
    return x @ (1.5 * lanes.identity(3) - 0.5 * (x.T @ x))


def project_lanes(matrix: Lanes) -> tuple[Lanes, Lane]:
    """`project` on lanes."""
    rotation = _nearest_rotation(matrix)
    difference = matrix - rotation
    return rotation, lanes.norm(difference.ravel())


def _nearest_rotation(matrix: Lanes) -> Lanes:
    shape = np.broadcast_shapes(*(np.shape(lane.value) for lane in matrix.ravel()))
    dtype = jnp.result_type(*(lane.value for lane in matrix.ravel()))
    return lanes.unpack(_polar(lanes.pack(matrix, shape, dtype)), 2)


@jax.custom_jvp
def _polar(matrix: jax.Array) -> jax.Array:
    """The nearest rotation, without any decision that rounding could turn over."""
    dtype = matrix.dtype
    eps = float(jnp.finfo(dtype).eps)
    # A common scale leaves the answer alone and keeps products from overflowing.
    largest = jnp.max(jnp.abs(matrix), axis=(-2, -1), keepdims=True)
    scaled = matrix / jnp.where(largest > 0, largest, 1.0)

    def start(m: Lanes) -> Lanes:
        generic = m + eps ** (1 / 3) * lanes.lanes_of(_GENERIC)
        x, y = _right_handed(m), _right_handed(generic)
        degenerate = x[0] @ lanes.cross(x[1], x[2]) < 50.0 * eps
        return lanes.choose(degenerate, y, x)

    def unfinished(carry: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        count, old, new = carry
        moved = jnp.max(jnp.abs(new - old), initial=0.0)
        return (count < _POLAR_ITERATIONS) & ~(moved < eps**0.5)

    def iterate(
        carry: tuple[jax.Array, jax.Array, jax.Array],
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        count, _, x = carry
        return count + 1, x, on_lanes(_polar_step, ("matrix", x, (3, 3)))

    x = on_lanes(start, ("matrix", scaled, (3, 3)))
    _, _, x = jax.lax.while_loop(unfinished, iterate, (jnp.int32(0), jnp.zeros_like(x), x))
    return on_lanes(lambda m: _polar_step(_polar_step(m)), ("matrix", x, (3, 3)))


def _right_handed(m: Lanes) -> Lanes:
    """A matrix with positive determinant whose polar factor is the rotation nearest to m.

    With m = U diag(s1, s2, s3) V^T and d = det(U V^T), the cofactors of m are
    d U diag(s2 s3, s1 s3, s1 s2) V^T, so m + cof(m) / s1 has the third value s3 + d s2, of the
    sign that U diag(1, 1, d) V^T needs.
    """
    gram = m.T @ m
    mean = (gram[0, 0] + gram[1, 1] + gram[2, 2]) * (1.0 / 3.0)
    rest = gram - mean * lanes.identity(3)
    spread = lanes.sqrt((rest.ravel() @ rest.ravel()) * (1.0 / 6.0))
    scale = 1.0 / lanes.select(spread > 0.0, spread, 1.0)
    unit = rest * scale
    third = lanes.acos(
        lanes.maximum(-1.0, lanes.minimum(0.5 * (unit[0] @ lanes.cross(unit[1], unit[2])), 1.0))
    ) * (1.0 / 3.0)
    s1 = lanes.sqrt(mean + 2.0 * spread * lanes.sincos(third)[1])
    return m + _cofactors(m) * (1.0 / lanes.select(s1 > 0.0, s1, 1.0))


def _cofactors(m: Lanes) -> Lanes:
    return np.stack([lanes.cross(m[1], m[2]), lanes.cross(m[2], m[0]), lanes.cross(m[0], m[1])])


def _polar_step(x: Lanes) -> Lanes:
    """A scaled step of Newton's iteration for the polar factor, (g X + X^-T / g) / 2.

    Higham, "Computing the polar decomposition - with applications" (1986).
    """
    cofactors = _cofactors(x)
    det = x[0] @ cofactors[0]
    inverse = cofactors * (1.0 / lanes.select(det > 0.0, det, 1.0))
    square = lanes.norm(inverse.ravel()) / lanes.norm(x.ravel())
    scale = lanes.sqrt(square)
    return 0.5 * (scale * x + inverse * (1.0 / lanes.select(scale > 0.0, scale, 1.0)))


@_polar.defjvp
def _polar_jvp(
    primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[jax.Array, jax.Array]:
    # R^T dR = [w] with (tr(S) I - S) w = vee(R^T dM - (R^T dM)^T), S = R^T M symmetric.
    rotation = _polar(primals[0])
    batch, dtype = rotation.shape[:-2], rotation.dtype
    r, m, dm = (lanes.unpack(array, 2) for array in (rotation, primals[0], tangents[0]))
    s = r.T @ m
    b = (s[0, 0] + s[1, 1] + s[2, 2]) * lanes.identity(3) - s
    x = 2.0 * lanes.vee(r.T @ dm)
    adjugate = np.stack([lanes.cross(b[1], b[2]), lanes.cross(b[2], b[0]), lanes.cross(b[0], b[1])])
    det = b[0] @ adjugate[0]
    unique = abs(det) > 0.0
    w = (adjugate.T @ x) * lanes.select(unique, 1.0 / lanes.select(unique, det, 1.0), 0.0)
    return rotation, lanes.pack(r @ lanes.hat(w), batch, dtype)
