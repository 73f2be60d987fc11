"""The canonical geometric subproblems that inverse kinematics is put together from.

Screws are (..., 6) rows (omega, v), points (..., 3), and a later factor acts first:
exp([S1] t1) exp([S2] t2) p = k. Every function solves a whole batch and returns all solutions in
fixed slots with a mask, a residual and a kind; where there is none, the angles are those of the
closest approach and the residual says how close.

Formulas: Todorovic et al. (2024), eqs. 3-29, after Paden and Kahan; Murray, Li & Sastry, section
3.3. Four of the paper's equations are misprinted; what is right is said where it is used.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import Edge, on_lanes
from niryo_jax.lie import so3
from niryo_jax.tolerances import SUBPROBLEM_COINCIDENCE, SUBPROBLEM_PARALLEL, SUBPROBLEM_RESIDUAL


class SubproblemKind(IntEnum):
    """What the set of solutions is."""

    NONE = 0
    FINITE = 1
    TANGENT = 2
    INFINITE = 3

    @property
    def message(self) -> str:
        """The meaning, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    SubproblemKind.NONE: "There is no solution; the angles are those of the closest approach.",
    SubproblemKind.FINITE: "Every solution is listed.",
    SubproblemKind.TANGENT: "Two solutions coincide; derivatives do not exist here.",
    SubproblemKind.INFINITE: "There are infinitely many solutions; one of them is listed.",
}


class SubproblemSolutions(NamedTuple):
    """All solutions of a subproblem.

    Attributes:
        angles: (..., slots, joints) radians in (-pi, pi].
        valid: (..., slots) whether the slot holds a solution.
        residual: (..., slots) metres by which the angles miss the condition.
        kind: (...,) a `SubproblemKind`.
    """

    angles: jax.Array
    valid: jax.Array
    residual: jax.Array
    kind: jax.Array


class Solved(NamedTuple):
    """`SubproblemSolutions` on lanes, with 1 and 0 for true and false."""

    angles: Lanes
    valid: Lanes
    residual: Lanes
    kind: Lane


@jax.jit
def paden_kahan_1(screw: ArrayLike, p: ArrayLike, k: ArrayLike) -> SubproblemSolutions:
    """Rotate a point to another: exp([S] t) p = k.

    Args:
        screw: (..., 6) rotation axis (zero pitch, |omega| = 1).
        p, k: (..., 3) points, metres.

    Returns:
        One slot, one joint. `INFINITE` where p = k on the axis; `NONE` where the points are not at
        the same height along the axis and distance from it.

    Source: Todorovic et al., eqs. 3-11. (Their "infinitely many where p = q" holds only for points
    on the axis.)
    """
    return _solve(paden_kahan_1_lanes, ("screw", screw, (6,)), ("p", p, (3,)), ("k", k, (3,)))


@jax.jit
def paden_kahan_2(
    screw_1: ArrayLike, screw_2: ArrayLike, p: ArrayLike, k: ArrayLike
) -> SubproblemSolutions:
    """Rotate a point to another about two axes in turn: exp([S1] t1) exp([S2] t2) p = k.

    Args:
        screw_1, screw_2: (..., 6) rotation axes that meet, are parallel, or coincide.
        p, k: (..., 3) points, metres.

    Returns:
        Two slots, two joints (t1, t2). `TANGENT` where the circles touch, in the first slot;
        `INFINITE` where p lies on axis 2 or k on axis 1 (the free angle is 0) or the axes coincide
        (t2 = 0; t1 + t2 is determined for equal directions, t1 - t2 for opposite ones).
        Axes that miss each other give `NONE`.

    Source: Todorovic et al., eqs. 12-25, with c = exp([S2] t2) p = exp(-[S1] t1) k (eq. 16 is
    printed with p and q exchanged), the intersection from [w1 -w2] xi = r2 - r1 (eq. 20 has the
    sign reversed), and eq. 14 for both senses of coincident axes. Parallel axes: two circles
    in a plane.
    """
    return _solve(
        paden_kahan_2_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
    )


@jax.jit
def paden_kahan_3(
    screw: ArrayLike, p: ArrayLike, k: ArrayLike, distance: ArrayLike
) -> SubproblemSolutions:
    """Rotate a point to a distance from another: |exp([S] t) p - k| = distance.

    Args:
        screw: (..., 6) rotation axis (zero pitch, |omega| = 1).
        p, k: (..., 3) points, metres.
        distance: (...,) metres; negative distances have no solution.

    Returns:
        Two slots, one joint. `TANGENT` where p, k and the axis are aligned, in the first slot;
        `INFINITE` where p or k lies on the axis and the distance fits.

    Source: Todorovic et al., eqs. 26-29, with delta'^2 = delta^2 - (w . (p - k))^2 (eq. 29 prints
    the absolute value instead of the square).
    """
    return _solve(
        paden_kahan_3_lanes,
        ("screw", screw, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
        ("distance", jnp.asarray(distance)[..., None], (1,)),
    )


def _solve(solver: Callable[..., Solved], *edges: Edge) -> SubproblemSolutions:
    angles, valid, residual, kind = on_lanes(lambda *args: tuple(solver(*args)), *edges)
    return SubproblemSolutions(angles, valid > 0.5, residual, kind.astype(jnp.int32))


class _Axis(NamedTuple):
    """A rotation axis as a unit direction and its point closest to the origin."""

    direction: Lanes
    point: Lanes


def _axis(screw: Lanes) -> _Axis:
    # r = w x v is the pseudo-inverse solution of v = -w x r (eq. 10).
    return _Axis(screw[:3], lanes.cross(screw[:3], screw[3:]))


def _off_axis(axis: _Axis, point: Lanes) -> tuple[Lanes, Lane]:
    """The part of point - r at right angles to the axis, and the height along the axis."""
    away = point - axis.point
    height = axis.direction @ away
    return away - height * axis.direction, height


def _angle_about(axis: _Axis, start: Lanes, end: Lanes) -> Lane:
    """The angle that turns `start` towards `end` about an axis (eq. 4)."""
    u, _ = _off_axis(axis, start)
    v, _ = _off_axis(axis, end)
    return lanes.atan2(axis.direction @ lanes.cross(u, v), u @ v)


def _rotate(axis: _Axis, angle: Lane, point: Lanes) -> Lanes:
    rotation = so3.rotation_about(axis.direction, *lanes.sincos(angle))
    return rotation @ (point - axis.point) + axis.point


def _wrap(angle: Lane) -> Lane:
    """The same angle in (-pi, pi], for an angle within (-3 pi, 3 pi)."""
    angle = lanes.select(angle > jnp.pi, angle - 2 * jnp.pi, angle)
    return lanes.select(angle > -jnp.pi, angle, angle + 2 * jnp.pi)


class _Scale(NamedTuple):
    """The tolerances of a problem, from the size of its lengths."""

    residual: Lane
    coincidence: Lane


def _scale(*vectors: Lanes) -> _Scale:
    size = Lane(0.0)
    for vector in vectors:
        size = size + abs(vector[0]) + abs(vector[1]) + abs(vector[2])
    dtype = jnp.result_type(size.value)
    return _Scale(size * SUBPROBLEM_RESIDUAL.of(dtype), size * SUBPROBLEM_COINCIDENCE.of(dtype))


def _flag(condition: lanes.Condition) -> Lane:
    return lanes.select(condition, 1.0, 0.0)


def _kind(solved: lanes.Condition, tangent: lanes.Condition, infinite: lanes.Condition) -> Lane:
    several = lanes.select(tangent, float(SubproblemKind.TANGENT), float(SubproblemKind.FINITE))
    several = lanes.select(infinite, float(SubproblemKind.INFINITE), several)
    return lanes.select(solved, several, float(SubproblemKind.NONE))


def paden_kahan_1_lanes(screw: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`paden_kahan_1` on lanes."""
    axis = _axis(screw)
    (u, height_p), (v, height_k) = _off_axis(axis, p), _off_axis(axis, k)
    scale = _scale(p, k, axis.point)
    radius_p, radius_k = lanes.norm(u), lanes.norm(v)
    rise, gap = height_p - height_k, radius_p - radius_k
    residual = lanes.sqrt(rise * rise + gap * gap)
    solved = residual <= scale.residual
    on_axis = (radius_p <= scale.coincidence) & (radius_k <= scale.coincidence)
    angle = lanes.select(on_axis, 0.0, _wrap(_angle_about(axis, p, k)))
    return Solved(
        np.array([[angle]], dtype=object),
        np.array([_flag(solved)], dtype=object),
        np.array([residual], dtype=object),
        _kind(solved, np.False_, on_axis),
    )


def paden_kahan_3_lanes(screw: Lanes, p: Lanes, k: Lanes, distance: Lanes) -> Solved:
    """`paden_kahan_3` on lanes; `distance` has shape (1,)."""
    axis, delta = _axis(screw), distance[0]
    (u, height_p), (v, height_k) = _off_axis(axis, p), _off_axis(axis, k)
    scale = _scale(p, k, axis.point, np.array([delta, Lane(0.0), Lane(0.0)], dtype=object))
    a, b, rise = lanes.norm(u), lanes.norm(v), height_p - height_k
    near, far = a - b, a + b
    nearest = lanes.sqrt(rise * rise + near * near)
    farthest = lanes.sqrt(rise * rise + far * far)
    residual = abs(lanes.minimum(lanes.maximum(delta, nearest), farthest) - delta)
    solved = residual <= scale.residual
    # 2 a b cos(phi) and 2 a b sin(phi) of the triangle with sides a, b, delta'; the product form
    # of the sine keeps its accuracy where the triangle is flat (eq. 28).
    square = delta * delta - rise * rise
    sine = lanes.sqrt((square - near * near) * (far * far - square))
    cosine = a * a + b * b - square
    straight = lanes.minimum(abs(delta - nearest), abs(farthest - delta)) <= scale.coincidence
    tangent = straight | (sine <= 0.0)
    phi = lanes.atan2(lanes.select(tangent, 0.0, sine), cosine)
    on_axis = (a <= scale.coincidence) | (b <= scale.coincidence)
    middle = _angle_about(axis, p, k)
    single = on_axis | tangent
    angles = [lanes.select(on_axis, 0.0, _wrap(middle + sign * phi)) for sign in (-1.0, 1.0)]
    return Solved(
        np.array([[angle] for angle in angles], dtype=object),
        np.array([_flag(solved), _flag(solved & ~single)], dtype=object),
        np.array([residual, residual], dtype=object),
        _kind(solved, tangent, on_axis),
    )


def paden_kahan_2_lanes(screw_1: Lanes, screw_2: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`paden_kahan_2` on lanes."""
    first, second = _axis(screw_1), _axis(screw_2)
    w1, w2 = first.direction, second.direction
    scale = _scale(p, k, first.point, second.point)
    between = second.point - first.point
    apart, _ = _off_axis(first, second.point)
    normal = lanes.cross(w1, w2)
    sine = SUBPROBLEM_PARALLEL.of(jnp.result_type(scale.residual.value))
    parallel = normal @ normal <= sine * sine
    coincident = parallel & (lanes.norm(apart) <= scale.coincidence)
    p_on_axis = lanes.norm(_off_axis(second, p)[0]) <= scale.coincidence
    k_on_axis = lanes.norm(_off_axis(first, k)[0]) <= scale.coincidence
    in_plane = _circles_in_a_plane(first, second, p, k)
    on_sphere = _circles_on_a_sphere(first, second, p, k, between, normal, parallel)
    middle = lanes.choose(parallel, in_plane.middle, on_sphere.middle)
    half = lanes.choose(parallel, in_plane.half, on_sphere.half)
    overlap = lanes.select(parallel, in_plane.overlap, on_sphere.overlap)
    tangent = overlap <= scale.coincidence
    half = lanes.choose(tangent, half * 0.0, half)
    # Where p or k does not move under its own rotation, the point between is known exactly.
    fixed = [
        lanes.choose(coincident | p_on_axis, p, lanes.choose(k_on_axis, k, c))
        for c in (middle - half, middle + half)
    ]
    infinite = coincident | p_on_axis | k_on_axis
    angles, residuals = [], []
    for c in fixed:
        t2 = lanes.select(coincident | p_on_axis, 0.0, _wrap(_angle_about(second, p, c)))
        t1 = lanes.select(k_on_axis & ~coincident, 0.0, _wrap(_angle_about(first, c, k)))
        angles.append([t1, t2])
        residuals.append(lanes.norm(_rotate(first, t1, _rotate(second, t2, p)) - k))
    solved = residuals[0] <= scale.residual
    both = (residuals[1] <= scale.residual) & ~(tangent | infinite)
    return Solved(
        np.array(angles, dtype=object),
        np.array([_flag(solved), _flag(both)], dtype=object),
        np.array(residuals, dtype=object),
        _kind(solved, tangent, infinite),
    )


class _Crossing(NamedTuple):
    """Where two circles cross: middle and half the difference of the two points.

    The overlap is a length, positive where the circles cross.
    """

    middle: Lanes
    half: Lanes
    overlap: Lane


def _circles_on_a_sphere(
    first: _Axis,
    second: _Axis,
    p: Lanes,
    k: Lanes,
    between: Lanes,
    normal: Lanes,
    parallel: lanes.Condition,
) -> _Crossing:
    """The circle of p about axis 2 and of k about axis 1, for axes that meet (eqs. 17-24)."""
    w1, w2 = first.direction, second.direction
    sine = lanes.select(parallel, 1.0, normal @ normal)
    center = first.point + ((lanes.cross(between, w2) @ normal) / sine) * w1
    u, v, cosine = p - center, k - center, w1 @ w2
    along_1, along_2 = w1 @ v, w2 @ u
    alpha = (along_1 - cosine * along_2) / sine
    beta = (along_2 - cosine * along_1) / sine
    flat = alpha * w1 + beta * w2
    rest = 0.5 * (u @ u + v @ v) - flat @ flat
    size = lanes.sqrt(u @ u)
    gamma = lanes.sqrt(rest / sine)
    overlap = rest / lanes.select(size > 0.0, size, 1.0)
    return _Crossing(center + flat, normal * gamma, overlap)


def _circles_in_a_plane(first: _Axis, second: _Axis, p: Lanes, k: Lanes) -> _Crossing:
    """The circle of p about axis 2 and of k about axis 1, for parallel axes."""
    (u, height), (v, _) = _off_axis(second, p), _off_axis(first, k)
    gap = first.point - second.point
    gap = gap - (second.direction @ gap) * second.direction
    square, a, b = gap @ gap, u @ u, v @ v
    distinct = square > 0.0
    square = lanes.select(distinct, square, 1.0)
    share = 0.5 * (a - b + square) / square
    rest = a / square - share * share
    height_of_crossing = lanes.sqrt(rest)
    center = second.point + height * second.direction
    length = lanes.sqrt(square)
    across = lanes.cross(second.direction, gap)
    return _Crossing(center + gap * share, across * height_of_crossing, rest * length)
