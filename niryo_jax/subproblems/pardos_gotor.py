"""Pardos-Gotor subproblems 1 to 5: translations, two parallel axes, a rotation to a half-plane.

Definitions: Pardos-Gotor, *Screw Theory in Robotics* (2022), chapter on canonical inverse
kinematics; the formulas here are derived from them. A translation is a screw with omega = 0 and
|v| = 1, and its joint value is in metres.
"""

from __future__ import annotations

import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import as_floating, compiled
from niryo_jax.subproblems.axes import angle_about, axis_of, off_axis, rotate, scale_of, wrap
from niryo_jax.subproblems.circles import circles_in_a_plane
from niryo_jax.subproblems.result import Solved, SubproblemSolutions, answer, solve
from niryo_jax.subproblems.turns import are_parallel, listed, turns_through
from niryo_jax.tolerances import SUBPROBLEM_PARALLEL


@compiled
def pardos_gotor_1(screw: ArrayLike, p: ArrayLike, k: ArrayLike) -> SubproblemSolutions:
    """Translate a point to another: exp([S] t) p = p + t v = k.

    Args:
        screw: (..., 6) translation (omega = 0, |v| = 1).
        p, k: (..., 3) points, metres.

    Returns:
        One slot, one joint, metres. `NONE` where k - p is not along v; t is then that of the point
        of the line nearest to k.

    Source: t = v . (k - p).
    """
    return solve(pardos_gotor_1_lanes, ("screw", screw, (6,)), ("p", p, (3,)), ("k", k, (3,)))


@compiled
def pardos_gotor_2(
    screw_1: ArrayLike, screw_2: ArrayLike, p: ArrayLike, k: ArrayLike
) -> SubproblemSolutions:
    """Translate a point to another along two directions: p + t2 v2 + t1 v1 = k.

    Args:
        screw_1, screw_2: (..., 6) translations (omega = 0, |v| = 1).
        p, k: (..., 3) points, metres.

    Returns:
        One slot, two joints (t1, t2), metres. `INFINITE` where the directions are parallel and the
        point is on their line (t2 = 0); `NONE` where k - p is not in the plane of the directions,
        with the nearest point of the plane.

    Source: with d = k - p and n = v1 x v2, t1 = (d x v2) . n / n^2 and t2 = (v1 x d) . n / n^2.
    """
    return solve(
        pardos_gotor_2_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
    )


@compiled
def pardos_gotor_3(
    screw: ArrayLike, p: ArrayLike, k: ArrayLike, distance: ArrayLike
) -> SubproblemSolutions:
    """Translate a point to a distance from another: |p + t v - k| = distance.

    Args:
        screw: (..., 6) translation (omega = 0, |v| = 1).
        p, k: (..., 3) points, metres.
        distance: (...,) metres; negative distances have no solution.

    Returns:
        Two slots, one joint, metres. `TANGENT` where the distance is that of k from the line, in
        the first slot; `NONE` where it is less.

    Source: t = v . (k - p) -+ sqrt(distance^2 - h^2) with h the distance of k from the line.
    """
    return solve(
        pardos_gotor_3_lanes,
        ("screw", screw, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
        ("distance", as_floating("distance", distance)[..., None], (1,)),
    )


@compiled
def pardos_gotor_4(
    screw_1: ArrayLike, screw_2: ArrayLike, p: ArrayLike, k: ArrayLike
) -> SubproblemSolutions:
    """Rotate a point to another about two parallel axes: exp([S1] t1) exp([S2] t2) p = k.

    Args:
        screw_1, screw_2: (..., 6) rotation axes of equal or opposite directions.
        p, k: (..., 3) points, metres.

    Returns:
        Two slots, two joints (t1, t2). `TANGENT` where the circles touch, in the first slot;
        `INFINITE` where p lies on axis 2 or k on axis 1 (the free angle is 0) or the axes coincide
        (t2 = 0; t1 + t2 is determined for equal directions, t1 - t2 for opposite ones). `NONE`
        where p and k are at different heights or the circles do not meet. Axes that are not
        parallel give `NONE`: see `pardos_gotor_6`.

    Source: two circles in a plane; c = exp([S2] t2) p = exp(-[S1] t1) k is where they cross.
    """
    return solve(
        pardos_gotor_4_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
    )


@compiled
def pardos_gotor_5(screw: ArrayLike, p: ArrayLike, k: ArrayLike) -> SubproblemSolutions:
    """Rotate a point into the plane through the axis and another point.

    Args:
        screw: (..., 6) rotation axis (zero pitch, |omega| = 1).
        p, k: (..., 3) points, metres.

    Returns:
        Two slots, one joint: first the angle that turns p into the half of the plane that holds k,
        then the angle for the opposite half, pi away. `INFINITE` where p or k lies on the axis,
        with angle 0. The residual is the distance of the turned point from the plane.

    Source: the angle of Todorovic et al., eq. 4, between the parts of p and k at right angles to
    the axis.
    """
    return solve(pardos_gotor_5_lanes, ("screw", screw, (6,)), ("p", p, (3,)), ("k", k, (3,)))


def pardos_gotor_1_lanes(screw: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`pardos_gotor_1` on lanes."""
    away, v, scale = k - p, screw[3:], scale_of(p, k)
    t = v @ away
    residual = lanes.norm(away - t * v)
    solved = residual <= scale.residual
    return answer([[t]], [solved], [residual], tangent=np.False_, infinite=np.False_)


def pardos_gotor_2_lanes(screw_1: Lanes, screw_2: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`pardos_gotor_2` on lanes."""
    away, v1, v2, scale = k - p, screw_1[3:], screw_2[3:], scale_of(p, k)
    normal = lanes.cross(v1, v2)
    square, sine = normal @ normal, SUBPROBLEM_PARALLEL.of(scale.dtype)
    parallel = square <= sine * sine
    square = lanes.select(parallel, 1.0, square)
    t1 = (lanes.cross(away, v2) @ normal) / square
    t2 = (lanes.cross(v1, away) @ normal) / square
    t1, t2 = lanes.select(parallel, v1 @ away, t1), lanes.select(parallel, 0.0, t2)
    residual = lanes.norm(away - t1 * v1 - t2 * v2)
    solved = residual <= scale.residual
    return answer([[t1, t2]], [solved], [residual], tangent=np.False_, infinite=parallel)


def pardos_gotor_3_lanes(screw: Lanes, p: Lanes, k: Lanes, distance: Lanes) -> Solved:
    """`pardos_gotor_3` on lanes; `distance` has shape (1,)."""
    away, v, delta, scale = k - p, screw[3:], distance[0], scale_of(p, k, distance)
    foot = v @ away
    height = lanes.norm(away - foot * v)
    overlap = delta - height
    tangent = overlap <= scale.coincidence
    half = lanes.sqrt(lanes.select(tangent, 0.0, overlap * (delta + height)))
    angles, residual = [], []
    for t in (foot - half, foot + half):
        angles.append([t])
        residual.append(abs(lanes.norm(away - t * v) - delta))
    near, far = (missed <= scale.residual for missed in residual)
    return answer(angles, [near, far & ~tangent], residual, tangent=tangent, infinite=np.False_)


def pardos_gotor_4_lanes(screw_1: Lanes, screw_2: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`pardos_gotor_4` on lanes."""
    first, second = axis_of(screw_1), axis_of(screw_2)
    scale = scale_of(p, k, first.point, second.point)
    parallel = are_parallel(first, second, scale)
    crossing = circles_in_a_plane(first, second, p, k)
    return listed(turns_through(first, second, p, k, crossing, parallel, scale), scale)


def pardos_gotor_5_lanes(screw: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`pardos_gotor_5` on lanes."""
    axis, scale = axis_of(screw), scale_of(p, k, axis_of(screw).point)
    u, v = off_axis(axis, p)[0], off_axis(axis, k)[0]
    radius = lanes.norm(v)
    on_axis = (lanes.norm(u) <= scale.coincidence) | (radius <= scale.coincidence)
    side = lanes.cross(axis.direction, v) * (1.0 / lanes.select(on_axis, 1.0, radius))
    towards = lanes.select(on_axis, 0.0, wrap(angle_about(axis, p, k)))
    away = wrap(towards + np.pi)
    residual = [abs(side @ (rotate(axis, t, p) - axis.point)) for t in (towards, away)]
    near, far = (missed <= scale.residual for missed in residual)
    return answer(
        [[towards], [away]], [near, far & ~on_axis], residual, tangent=np.False_, infinite=on_axis
    )
