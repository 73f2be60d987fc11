"""Moves of single joints on lanes: how closed forms say how far a joint goes.

A turn is its cosine and sine, which most formulas give and need; a slide is its length.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.results.status import Singularity
from niryo_jax.lanes import Condition, Lane, Lanes
from niryo_jax.lie import so3
from niryo_jax.subproblems.axes import Axis, axis_of, off_axis
from niryo_jax.tolerances import VANISHING_LENGTH

Move = Lanes | Lane
"""(cos, sin) of a revolute joint, or the length of a prismatic one, metres."""


def line_of(screw: Lanes) -> Axis:
    """The axis of a revolute joint, kept (`lanes.materialise`)."""
    direction, point = axis_of(screw)
    return Axis(direction, lanes.materialised(point))


def nearest_points(first: Axis, second: Axis) -> tuple[Lanes, Lanes]:
    """The points at which two axes that are not parallel are nearest to each other."""
    (w1, r1), (w2, r2) = first, second
    cosine, between = w1 @ w2, r2 - r1
    ahead, back = w1 @ between, w2 @ between
    normal = lanes.cross(w1, w2)
    per = 1.0 / (normal @ normal)
    on_1 = r1 + ((ahead - cosine * back) * per) * w1
    on_2 = r2 + ((cosine * ahead - back) * per) * w2
    return lanes.materialised(on_1), lanes.materialised(on_2)


def meeting_point(first: Lanes, second: Lanes) -> Lanes:
    """The point midway between two axes, given as screws, that meet or nearly do."""
    on_1, on_2 = nearest_points(line_of(first), line_of(second))
    return lanes.materialised(0.5 * (on_1 + on_2))


def away_from(axis: Axis, point: Lanes) -> Lanes:
    """The vector from an axis to a point, at right angles to the axis."""
    return off_axis(axis, point)[0]


def turn_of(cos: Lane, sin: Lane) -> Lanes:
    """The turn along (cos, sin) of any length; none where both vanish."""
    square = cos * cos + sin * sin
    tiny = VANISHING_LENGTH.of(jnp.result_type(square.value)) ** 4
    some = square > tiny
    per = lanes.select(some, lanes.reciprocal_root(lanes.select(some, square, 1.0)), 0.0)
    return np.array([lanes.select(some, cos * per, 1.0), sin * per], dtype=object)


def turn_between(direction: Lanes, start: Lanes, end: Lanes) -> Lanes:
    """The turn about a direction that carries one vector to another of the same height."""
    # Next to the direction only what is left at right angles to it still tells the turn.
    u, v = (x - (direction @ x) * direction for x in (start, end))
    return turn_of(u @ v, direction @ lanes.cross(u, v))


def back(move: Move) -> Move:
    """The move that undoes another."""
    return -move if isinstance(move, Lane) else turn_back(move)


def turn_back(turn: Lanes) -> Lanes:
    """The turn that undoes another."""
    return np.array([turn[0], -turn[1]], dtype=object)


def after(first: Lanes, second: Lanes) -> Lanes:
    """The turn that is two turns, one after the other."""
    (c, s), (d, t) = first, second
    return np.array([c * d - s * t, s * d + c * t], dtype=object)


def materialised(move: Move) -> Move:
    """The same, computed once and kept (`lanes.materialise`)."""
    return lanes.materialise(move) if isinstance(move, Lane) else lanes.materialised(move)


def rotation(screw: Lanes, move: Move) -> Lanes:
    """(3, 3) how a joint turns directions."""
    if isinstance(move, Lane):
        return lanes.identity(3)
    return so3.rotation_about(screw[:3], move[1], move[0])


def carried(screw: Lanes, move: Move, point: Lanes) -> Lanes:
    """Where a joint moves a point: exp([S] q) p."""
    if isinstance(move, Lane):
        return point + move * screw[3:]
    centre = line_of(screw).point
    return turned(screw[:3], move, point - centre) + centre


def turned(direction: Lanes, turn: Lanes, vector: Lanes) -> Lanes:
    """A vector after a turn about a direction (Rodrigues' formula)."""
    along = (direction @ vector) * direction
    return along + turn[0] * (vector - along) + turn[1] * lanes.cross(direction, vector)


def joint_value(move: Move) -> Lane:
    """The joint variable: an angle in [-pi, pi], or metres."""
    return move if isinstance(move, Lane) else lanes.atan2(move[1], move[0])


class Roots(NamedTuple):
    """What is known of the roots of one or several equations.

    Attributes:
        exist: whether there are roots, to within what a polish can decide.
        double: whether two roots are one.
        free: whether every value is a root.
        near: whether there would be roots if the equation were off by what another equation's
            loose root makes of rounding.
        loose: whether rounding moves the roots by much more than itself.
        margin: how far two roots are from being one, and negative where there is none: the square
            of about the sine of half the angle between them.
    """

    exist: Condition
    double: Condition
    free: Condition
    near: Condition
    loose: Condition
    margin: Lane


_YES, _NO = np.bool_(True), np.bool_(False)

ONE_ROOT = Roots(exist=_YES, double=_NO, free=_NO, near=_YES, loose=_NO, margin=Lane(1.0))
"""Of a linear equation."""

Signs = Callable[[], Lane]
"""Each call gives the two signs of one more pair of roots, along an axis of its own."""

Solution = tuple[list[Move], list[tuple[Singularity, Roots]]]
"""The moves of all joints, the equations, and what it is called where two roots are one."""
