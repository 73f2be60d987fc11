"""The group SE(3) of rigid motions; twists and screws are (omega, v).

Every function takes any leading batch axes and follows the dtype of its input; lengths in metres,
angles in radians. Formulas: Lynch & Park, *Modern Robotics*, section 3.3.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, compiled, on_lanes
from niryo_jax.lie import so3


@compiled
def hat(twist: ArrayLike) -> jax.Array:
    """The matrix [V] of a twist: (..., 6) -> (..., 4, 4) (Lynch & Park, eq. 3.71)."""

    def matrix(t: Lanes) -> Lanes:
        return np.vstack([np.column_stack([lanes.hat(t[:3]), t[3:]]), _ROW * 0.0])

    return on_lanes(matrix, ("twist", twist, (6,)))


@compiled
def vee(matrix: ArrayLike) -> jax.Array:
    """The twist of a matrix of se(3), inverse of `hat`: (..., 4, 4) -> (..., 6)."""
    return on_lanes(
        lambda m: np.concatenate([lanes.vee(m[:3, :3]), m[:3, 3]]), ("matrix", matrix, (4, 4))
    )


@compiled
def from_rotation_and_position(rotation: ArrayLike, position: ArrayLike) -> jax.Array:
    """The pose [[R, p], [0, 1]]: (..., 3, 3), (..., 3) -> (..., 4, 4) (Lynch & Park, eq. 3.62)."""
    return on_lanes(assemble, ("rotation", rotation, (3, 3)), ("position", position, (3,)))


@compiled
def rotation_and_position(pose: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """R and p of a pose, undoing the above: (..., 4, 4) -> (..., 3, 3), (..., 3)."""
    rotation, position = on_lanes(split, ("pose", pose, (4, 4)))
    return rotation, position


@compiled
def inverse(pose: ArrayLike) -> jax.Array:
    """The inverse of a rigid motion: (..., 4, 4) -> (..., 4, 4) (Lynch & Park, eq. 3.64)."""
    return on_lanes(lambda m: assemble(*inverse_lanes(*split(m))), ("pose", pose, (4, 4)))


@compiled
def exp(twist: ArrayLike) -> jax.Array:
    """The motion along a twist for unit time: (..., 6) -> (..., 4, 4) (Lynch & Park, eq. 3.88)."""
    return on_lanes(lambda t: assemble(*exp_lanes(t)), ("twist", twist, (6,)))


@compiled
def log(pose: ArrayLike) -> jax.Array:
    """The twist with exp(twist) = pose and |omega| <= pi: (..., 4, 4) -> (..., 6) (eq. 3.91)."""
    return on_lanes(lambda m: log_lanes(*split(m)), ("pose", pose, (4, 4)))


@compiled
def adjoint(pose: ArrayLike) -> jax.Array:
    """Ad_T, which carries twists from frame b to frame a with T = T_ab: (..., 4, 4) -> (..., 6, 6).

    [[R, 0], [[p] R, R]] (Lynch & Park, definition 3.20).
    """

    def matrix(m: Lanes) -> Lanes:
        rotation, p = split(m)
        return np.block([[rotation, 0.0 * rotation], [lanes.hat(p) @ rotation, rotation]])

    return on_lanes(matrix, ("pose", pose, (4, 4)))


@compiled
def ad(twist: ArrayLike) -> jax.Array:
    """The small adjoint, ad_V W = [V, W] the Lie bracket: (..., 6) -> (..., 6, 6) (eq. 8.38)."""

    def matrix(t: Lanes) -> Lanes:
        w, v = lanes.hat(t[:3]), lanes.hat(t[3:])
        return np.block([[w, 0.0 * w], [v, w]])

    return on_lanes(matrix, ("twist", twist, (6,)))


@compiled
def project(matrix: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """The rigid motion nearest to a matrix, and the distance: (..., 4, 4) -> (..., 4, 4), (...,).

    The rotation block is projected by `so3.project`, the last row becomes (0, 0, 0, 1); the
    distance is the Frobenius norm of what changed.
    """

    def nearest(m: Lanes) -> tuple[Lanes, Lane]:
        rotation, distance = so3.project_lanes(m[:3, :3])
        row = m[3] - _ROW
        return assemble(rotation, m[:3, 3]), lanes.sqrt(distance * distance + row @ row)

    motion, distance = on_lanes(nearest, ("matrix", matrix, (4, 4)))
    return motion, distance


class ScrewAxis(NamedTuple):
    """A screw as a line with a pitch.

    Attributes:
        point: (..., 3) the point of the axis closest to the origin, metres; 0 for a translation.
        direction: (..., 3) unit vector; 0 for the zero twist.
        pitch: (...,) metres per radian; infinite for a translation.
        magnitude: (...,) rate about the axis, rad/s; m/s for a translation.
    """

    point: jax.Array
    direction: jax.Array
    pitch: jax.Array
    magnitude: jax.Array


@compiled
def screw_from_axis(point: ArrayLike, direction: ArrayLike, pitch: ArrayLike = 0.0) -> jax.Array:
    """The unit screw about a line: (..., 3), (..., 3), (...,) -> (..., 6) (Lynch & Park, eq. 3.81).

    `direction` need not be of unit length, but must not be zero. An infinite pitch is the
    translation along the direction. A negative pitch is a left-handed screw.
    """

    def screw(q: Lanes, s: Lanes, h: Lanes) -> Lanes:
        axis = s * (1.0 / lanes.norm(s))
        translation = abs(h[0]) >= jnp.inf
        finite = lanes.select(translation, 0.0, h[0])
        v = lanes.cross(q, axis) + finite * axis
        return lanes.lanes_of(
            [lanes.select(translation, 0.0, w) for w in axis]
            + [lanes.select(translation, w, x) for w, x in zip(axis, v)]
        )

    return on_lanes(
        screw,
        ("point", point, (3,)),
        ("direction", direction, (3,)),
        ("pitch", as_floating("pitch", pitch)[..., None], (1,)),
    )


@compiled
def axis_of_screw(screw: ArrayLike) -> ScrewAxis:
    """The line, pitch and magnitude of a screw or twist: (..., 6) -> `ScrewAxis` (eq. 3.82)."""

    def axis(s: Lanes) -> tuple[Lanes, Lanes, Lane, Lane]:
        unit, magnitude = unit_screw_lanes(s)
        w, v = unit[:3], unit[3:]
        turning = w @ w > 0.5
        direction = lanes.choose(turning, w, v)
        pitch = lanes.select(turning, w @ v, lanes.select(magnitude > 0.0, jnp.inf, 0.0))
        return lanes.cross(w, v), direction, pitch, magnitude

    return ScrewAxis(*on_lanes(axis, ("screw", screw, (6,))))


@compiled
def unit_screw(twist: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """The unit screw S and the magnitude t with S t = twist: (..., 6) -> (..., 6), (...,).

    |omega| = 1 and t in radians; |v| = 1 and t in metres where omega = 0 (Lynch & Park, definition
    3.24). For the zero twist the screw and every derivative at it are 0.
    """
    screw, magnitude = on_lanes(unit_screw_lanes, ("twist", twist, (6,)))
    return screw, magnitude


def unit_screw_lanes(twist: Lanes) -> tuple[Lanes, Lane]:
    """`unit_screw` on lanes."""
    axis, angle = so3.axis_angle_lanes(twist[:3])
    direction, distance = so3.axis_angle_lanes(twist[3:])
    turning = angle > 0.0
    linear = twist[3:] * (1.0 / lanes.select(turning, angle, 1.0))
    screw = np.concatenate([axis, lanes.choose(turning, linear, direction)])
    return screw, lanes.select(turning, angle, distance)


_ROW = lanes.lanes_of([0.0, 0.0, 0.0, 1.0])


def split(pose: Lanes) -> tuple[Lanes, Lanes]:
    """Rotation and position of a (4, 4) pose."""
    return pose[:3, :3], pose[:3, 3]


def assemble(rotation: Lanes, position: Lanes) -> Lanes:
    """The (4, 4) pose of a rotation and a position."""
    return np.vstack([np.column_stack([rotation, position]), _ROW])


def inverse_lanes(rotation: Lanes, position: Lanes) -> tuple[Lanes, Lanes]:
    """`inverse` on lanes."""
    return rotation.T, -(rotation.T @ position)


def adjoint_lanes(rotation: Lanes, position: Lanes, twist: Lanes) -> Lanes:
    """Ad_T V of a twist (6,): (R omega, R v + p x R omega) (Lynch & Park, definition 3.20)."""
    w = rotation @ twist[:3]
    return np.concatenate([w, rotation @ twist[3:] + lanes.cross(position, w)])


def inverse_adjoint_lanes(rotation: Lanes, position: Lanes, twist: Lanes) -> Lanes:
    """Ad_{T^-1} V of a twist (6,)."""
    w = twist[:3]
    return np.concatenate([rotation.T @ w, rotation.T @ (twist[3:] - lanes.cross(position, w))])


def exp_lanes(twist: Lanes) -> tuple[Lanes, Lanes]:
    """`exp` on lanes, for any twist."""
    w, v = twist[:3], twist[3:]
    a, b, c = so3.exp_coefficients(w @ w)
    wv = lanes.cross(w, v)
    rotation = lanes.identity(3) + a * lanes.hat(w) + b * so3.hat_squared(w)
    return rotation, v + b * wv + c * lanes.cross(w, wv)


def log_lanes(rotation: Lanes, position: Lanes) -> Lanes:
    """`log` on lanes."""
    w, square, cotangent = so3.log_parts(rotation)
    small = square < 0.25
    x = lanes.select(small, square, 0.0)
    series = Lane(_COTANGENT_SERIES[-1])
    for coefficient in reversed(_COTANGENT_SERIES[:-1]):
        series = coefficient + x * series
    d = lanes.select(small, series, (1.0 - cotangent) / lanes.select(small, 1.0, square))
    wp = lanes.cross(w, position)
    return np.concatenate([w, position - 0.5 * wp + d * lanes.cross(w, wp)])


# (1 - (t/2) cot(t/2)) / t^2 in powers of t^2: |B_2k| / (2k)!, the Bernoulli numbers.
_COTANGENT_SERIES = (
    1.0 / 12.0,
    1.0 / 720.0,
    1.0 / 30240.0,
    1.0 / 1209600.0,
    1.0 / 47900160.0,
    691.0 / 1307674368000.0,
    1.0 / 74724249600.0,
    3617.0 / 10670622842880000.0,
)
