"""Signed distances between segments, half spaces and boxes, on lanes.

A segment is start + t vector with t in [0, 1]. The nearest points of two segments are the minimum
of a convex quadratic over a square: the minimum over a strip of it, and where that is outside, one
along the edge beyond it (Ericson, *Real-Time Collision Detection*, section 5.1.9).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import NamedTuple

import jax
import numpy as np
from jax import lax
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import compiled, on_lanes
from niryo_jax.tolerances import TINY


class Segment(NamedTuple):
    """A segment as lanes, metres.

    Attributes:
        start: (3,) lanes; vector: (3,) lanes, from there to the other end.
        inverse_square: 1 / |vector|^2; 0 of a segment that is a point.
    """

    start: Lanes
    vector: Lanes
    inverse_square: Lane


def segment(start: Lanes, vector: Lanes) -> Segment:
    """The segment from a point along a vector."""
    square = vector @ vector
    return Segment(start, vector, _quotient(Lane(1.0), square, square))


def moved(shape: Segment, rotation: Lanes, position: Lanes) -> Segment:
    """The segment that a rigid motion makes of one."""
    return Segment(rotation @ shape.start + position, rotation @ shape.vector, shape.inverse_square)


class HalfSpace(NamedTuple):
    """The points x with normal . x < offset, as lanes.

    Attributes:
        normal: (3,) unit vector; offset: metres.
    """

    normal: Lanes
    offset: Lane


class Box(NamedTuple):
    """A box as lanes, metres.

    Attributes:
        rotation: (3, 3) the directions of its edges in columns; centre: (3,).
        half: (3,) half the lengths of its edges.
    """

    rotation: Lanes
    centre: Lanes
    half: Lanes


def between_segments(first: Segment, second: Segment) -> Lane:
    """The distance between two segments.

    Its derivative is that at fixed nearest points, which is exact where the nearest points are
    unique (Danskin's theorem) and 0 where the segments cross.
    """
    apart = first.start - second.start
    # Of the second segment, and of what is between, the parts across the first: where segments are
    # nearly parallel no difference of squares could tell them from rounding.
    along = (first.vector @ second.vector) * first.inverse_square
    behind = (first.vector @ apart) * first.inverse_square
    across = second.vector - first.vector * along
    aside = apart - first.vector * behind
    square = across @ across
    t = _unit(_quotient(aside @ across, square, square))
    s = _unit(t * along - behind)
    t = _unit((second.vector @ (apart + first.vector * s)) * second.inverse_square)
    return lanes.norm(apart + first.vector * _fixed(s) - second.vector * _fixed(t))


@compiled
def segment_distance(
    start: ArrayLike, end: ArrayLike, other_start: ArrayLike, other_end: ArrayLike
) -> jax.Array:
    """The distance between two segments.

    Args:
        start, end, other_start, other_end: (..., 3) the ends of each, in one frame; a segment may
            be a point.

    Returns:
        (...,) distances, 0 where the segments meet. Of capsules it is that less their radii.

    Raises:
        ValueError: wrong shapes. TypeError: no arrays of real numbers.
    """

    def distance(start: Lanes, end: Lanes, other_start: Lanes, other_end: Lanes) -> Lane:
        return between_segments(
            segment(start, end - start), segment(other_start, other_end - other_start)
        )

    return on_lanes(
        distance,
        ("start", start, (3,)),
        ("end", end, (3,)),
        ("other_start", other_start, (3,)),
        ("other_end", other_end, (3,)),
    )


@compiled
def box_distance(
    start: ArrayLike, end: ArrayLike, pose: ArrayLike, half_size: ArrayLike
) -> jax.Array:
    """The signed distance between a segment and a box.

    Args:
        start, end: (..., 3) the ends of the segment.
        pose: (..., 4, 4) of the box: its centre and the directions of its edges.
        half_size: (..., 3) half the lengths of its edges.

    Returns:
        (...,) the distance of the nearest points; where they meet, less than 0 by the distance from
        the point of the segment that is deepest in the box to the nearest face.

    Raises:
        ValueError: wrong shapes. TypeError: no arrays of real numbers.
    """

    def distance(start: Lanes, end: Lanes, pose: Lanes, half: Lanes) -> Lane:
        return to_box(segment(start, end - start), Box(pose[:3, :3], pose[:3, 3], half))

    return on_lanes(
        distance,
        ("start", start, (3,)),
        ("end", end, (3,)),
        ("pose", pose, (4, 4)),
        ("half_size", half_size, (3,)),
    )


def to_half_space(shape: Segment, half_space: HalfSpace) -> Lane:
    """The signed distance of the end of a segment that is nearest to a half space, or deepest."""
    height = half_space.normal @ shape.start - half_space.offset
    return height + lanes.minimum(half_space.normal @ shape.vector, 0.0)


def to_box(shape: Segment, box: Box) -> Lane:
    """The signed distance between a segment and a box.

    Positive: the distance of the nearest points. Negative: of the point of the segment that is
    deepest in the box, the distance to the nearest face. It is the minimum along the segment of
    the signed distance of a point, which is continuous and convex.
    """
    start = box.rotation.T @ (shape.start - box.centre)
    vector = box.rotation.T @ shape.vector
    t = _fixed(_nearest_to_box(start, vector, box.half))
    outside = lanes.norm(_excess(start + vector * t, box.half))
    depth = _depth(start + vector * _deepest_in_box(start, vector, box.half), box.half)
    return lanes.select(depth > 0.0, outside, depth)


def _nearest_to_box(start: Lanes, vector: Lanes, half: Lanes) -> Lane:
    """Where a segment is nearest to the box |x_i| <= half_i.

    Half the rate of the squared distance rises along the segment, and is linear between the planes
    of the faces: its root lies between the last of these before it and the first behind it.
    """

    def rate(t: Lane) -> Lane:
        return vector @ _excess(start + vector * t, half)

    low, high = Lane(0.0), Lane(1.0)
    rate_low, rate_high = rate(low), rate(high)
    for x, v, h in zip(start, vector, half):
        for face in (h, -h):
            t = _unit(_ratio(face - x, v))
            at = rate(t)
            before, behind = (at <= 0.0) & (t >= low), (at >= 0.0) & (t <= high)
            low, rate_low = lanes.select(before, t, low), lanes.select(before, at, rate_low)
            high, rate_high = lanes.select(behind, t, high), lanes.select(behind, at, rate_high)
    rise = rate_high - rate_low
    share = _unit(_quotient(-rate_low, rise, rise))
    return low + share * (high - low)


def _deepest_in_box(start: Lanes, vector: Lanes, half: Lanes) -> Lane:
    """Where a segment is deepest in the box |x_i| <= half_i.

    The depth is a maximum of six linear functions, least at an end or where two of them cross. It
    is differentiable: how the least value changes depends on how the crossing moves.
    """
    above, below, least = Lane(0.0), Lane(1.0), _depth(start, half)
    for numerator, denominator in _crossings(start, vector, half):
        square = denominator * denominator
        t = _quotient(numerator, denominator, square)
        inside = (square > TINY) & (t >= 0.0) & (t <= 1.0)
        depth = _depth(start + vector * t, half)
        better = inside & (depth < least)
        least = lanes.select(better, depth, least)
        above = lanes.select(better, numerator, above)
        below = lanes.select(better, denominator, below)
    return above / below


def _crossings(start: Lanes, vector: Lanes, half: Lanes) -> Iterable[tuple[Lane, Lane]]:
    """The other end, and where two of the functions cross, as numerators and denominators."""
    yield Lane(1.0), Lane(1.0)
    for x, v in zip(start, vector):
        yield -x, v
    for i, j in itertools.combinations(range(3), 2):
        for a, b in itertools.product((1.0, -1.0), repeat=2):
            gap = (b * start[j] - half[j]) - (a * start[i] - half[i])
            yield gap, a * vector[i] - b * vector[j]


def _depth(point: Lanes, half: Lanes) -> Lane:
    """The largest distance of a point beyond the faces: negative inside."""
    x, y, z = (abs(coordinate) - h for coordinate, h in zip(point, half))
    return lanes.maximum(lanes.maximum(x, y), z)


def _excess(point: Lanes, half: Lanes) -> Lanes:
    """From the nearest point of the box to a point."""
    return np.array(
        [x - lanes.minimum(lanes.maximum(x, -h), h) for x, h in zip(point, half)], dtype=object
    )


def _unit(value: Lane) -> Lane:
    """The nearest number in [0, 1]."""
    return lanes.minimum(lanes.maximum(value, 0.0), 1.0)


def _fixed(value: Lane) -> Lane:
    """A number that derivatives take for constant."""
    return value if value.known else Lane(lax.stop_gradient(value.array))


def _quotient(numerator: Lane, denominator: Lane, square: Lane) -> Lane:
    """The quotient; 0 where a square that vanishes with the denominator does."""
    some = square > TINY
    return lanes.select(some, numerator / lanes.select(some, denominator, 1.0), 0.0)


def _ratio(numerator: Lane, denominator: Lane) -> Lane:
    """The quotient of lengths; 0 where the denominator vanishes."""
    return _quotient(numerator, denominator, denominator * denominator)
