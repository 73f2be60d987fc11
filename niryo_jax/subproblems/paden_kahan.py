"""Paden-Kahan subproblems 1 to 3: one rotation, two rotations, a rotation to a distance.

Formulas: Todorovic et al. (2024), eqs. 3-29, after Paden and Kahan; Murray, Li & Sastry, section
3.3. Four of the paper's equations are misprinted; what is right is said where it is used.
"""

from __future__ import annotations

import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import as_floating, compiled
from niryo_jax.subproblems.axes import angle_about, axis_of, off_axis, scale_of, wrap
from niryo_jax.subproblems.circles import (
    choose_crossing,
    circles_in_a_plane,
    circles_on_a_sphere,
)
from niryo_jax.subproblems.result import Solved, SubproblemSolutions, answer, solve
from niryo_jax.subproblems.turns import are_parallel, listed, turns_through


@compiled
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
    return solve(paden_kahan_1_lanes, ("screw", screw, (6,)), ("p", p, (3,)), ("k", k, (3,)))


@compiled
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
        Axes that miss each other give `NONE`: see `pardos_gotor_6`.

    Source: Todorovic et al., eqs. 12-25, with c = exp([S2] t2) p = exp(-[S1] t1) k (eq. 16 is
    printed with p and q exchanged), the intersection from [w1 -w2] xi = r2 - r1 (eq. 20 has the
    sign reversed), and eq. 14 for both senses of coincident axes. Parallel axes: two circles
    in a plane.
    """
    return solve(
        paden_kahan_2_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
    )


@compiled
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
    return solve(
        paden_kahan_3_lanes,
        ("screw", screw, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
        ("distance", as_floating("distance", distance)[..., None], (1,)),
    )


def paden_kahan_1_lanes(screw: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`paden_kahan_1` on lanes."""
    axis = axis_of(screw)
    (u, height_p), (v, height_k) = off_axis(axis, p), off_axis(axis, k)
    scale = scale_of(p, k, axis.point)
    radius_p, radius_k = lanes.norm(u), lanes.norm(v)
    rise, gap = height_p - height_k, radius_p - radius_k
    residual = lanes.sqrt(rise * rise + gap * gap)
    on_axis = (radius_p <= scale.coincidence) & (radius_k <= scale.coincidence)
    angle = lanes.select(on_axis, 0.0, wrap(angle_about(axis, p, k)))
    return answer(
        [[angle]],
        [residual <= scale.residual],
        [residual],
        tangent=np.False_,
        infinite=on_axis,
    )


def paden_kahan_2_lanes(screw_1: Lanes, screw_2: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`paden_kahan_2` on lanes."""
    first, second = axis_of(screw_1), axis_of(screw_2)
    scale = scale_of(p, k, first.point, second.point)
    parallel = are_parallel(first, second, scale)
    crossing = choose_crossing(
        parallel,
        circles_in_a_plane(first, second, p, k),
        circles_on_a_sphere(first, second, p, k, parallel),
    )
    return listed(turns_through(first, second, p, k, crossing, parallel, scale), scale)


def paden_kahan_3_lanes(screw: Lanes, p: Lanes, k: Lanes, distance: Lanes) -> Solved:
    """`paden_kahan_3` on lanes; `distance` has shape (1,)."""
    axis, delta = axis_of(screw), distance[0]
    (u, height_p), (v, height_k) = off_axis(axis, p), off_axis(axis, k)
    scale = scale_of(p, k, axis.point, distance)
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
    middle = angle_about(axis, p, k)
    return answer(
        [[lanes.select(on_axis, 0.0, wrap(middle + sign * phi))] for sign in (-1.0, 1.0)],
        [solved, solved & ~(on_axis | tangent)],
        [residual, residual],
        tangent=tangent,
        infinite=on_axis,
    )
