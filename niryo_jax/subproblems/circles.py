"""Where the circles cross on which a rotation carries a point."""

from __future__ import annotations

from typing import NamedTuple

from niryo_jax import lanes
from niryo_jax.lanes import Condition, Lane, Lanes
from niryo_jax.subproblems.axes import Axis, off_axis


class Crossing(NamedTuple):
    """Where two curves cross: middle and half the difference of the two points.

    The overlap is a length, positive where they cross, and rounding where they touch.
    """

    middle: Lanes
    half: Lanes
    overlap: Lane


def choose_crossing(condition: Condition, if_true: Crossing, if_false: Crossing) -> Crossing:
    """`lanes.select` of two crossings."""
    return Crossing(
        lanes.choose(condition, if_true.middle, if_false.middle),
        lanes.choose(condition, if_true.half, if_false.half),
        lanes.select(condition, if_true.overlap, if_false.overlap),
    )


def circles_on_a_sphere(
    first: Axis, second: Axis, p: Lanes, k: Lanes, parallel: Condition
) -> Crossing:
    """The circle of p about axis 2 and of k about axis 1, for axes that meet.

    Source: Todorovic et al., eqs. 17-24.
    """
    w1, w2 = first.direction, second.direction
    between, normal = second.point - first.point, lanes.cross(w1, w2)
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
    return Crossing(center + flat, normal * gamma, overlap)


def circles_in_a_plane(first: Axis, second: Axis, p: Lanes, k: Lanes) -> Crossing:
    """The circle of p about axis 2 and of k about axis 1, for parallel axes.

    Where they do not cross, the middle is on the line through their centres, in the direction in
    which they come closest: outside, or inside the larger one.
    """
    (u, height), (v, _) = off_axis(second, p), off_axis(first, k)
    return coplanar_circles(first, second, u @ u, v @ v, height)


def coplanar_circles(
    first: Axis, second: Axis, square_2: Lane, square_1: Lane, height: Lane
) -> Crossing:
    """Circles about two parallel axes, given the squares of their radii and the height of both.

    The height is that along axis 2, above the point of axis 2.
    """
    gap = first.point - second.point
    gap = gap - (second.direction @ gap) * second.direction
    square = gap @ gap
    distinct = square > 0.0
    square = lanes.select(distinct, square, 1.0)
    share = 0.5 * (square_2 - square_1 + square) / square
    across = lanes.sqrt(square_2 / square - share * share)
    center = second.point + height * second.direction
    length, radius_2, radius_1 = (lanes.sqrt(x) for x in (square, square_2, square_1))
    apart, inside = radius_1 + radius_2 - length, length - abs(radius_1 - radius_2)
    return Crossing(
        center + gap * share,
        lanes.cross(second.direction, gap) * across,
        lanes.minimum(apart, inside),
    )


def circle_and_plane(
    axis: Axis, point: Lanes, normal: Lanes, level: Lane, parallel: Condition
) -> Crossing:
    """The circle of a point about an axis and the plane normal . c = level.

    `parallel` says where the normal is along the axis. Where they do not cross, the middle is in
    the direction in which the circle comes closest to the plane.
    """
    u, _ = off_axis(axis, point)
    center, radius = point - u, lanes.norm(u)
    across = lanes.cross(axis.direction, normal)
    slope = lanes.cross(across, axis.direction)
    sine = lanes.select(parallel, 1.0, lanes.norm(across))
    along = (level - normal @ center) / sine
    half = lanes.sqrt((radius - along) * (radius + along))
    return Crossing(center + slope * (along / sine), across * (half / sine), radius - abs(along))
