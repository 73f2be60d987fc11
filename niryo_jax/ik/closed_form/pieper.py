"""Three axes in general position that bring a point to another, in closed form on lanes.

exp(S1 q1) exp(S2 q2) exp(S3 q3) p = k. What joints 1 and 2 leave unchanged of k, its height along
axis 1 and its distance from the foot of the common perpendicular of axes 1 and 2, makes one
equation in q3 alone, quadratic in its cosine and sine (D. Pieper, 1968). Its four roots are where a
conic meets the unit circle: a conic of their pencil that is a pair of lines is found from a cubic,
and each line meets the circle twice.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.closed_form import joint_motion
from niryo_jax.ik.closed_form.joint_motion import (
    Move,
    Roots,
    Signs,
    away_from,
    line_of,
    turn_between,
)
from niryo_jax.ik.closed_form.trig_roots import sinusoid_root
from niryo_jax.lanes import Lane, Lanes

_TINY = 1e-30
_REFINEMENTS = 3
_LARGEST_STEP = 0.1


def place(screws: Lanes, p: Lanes, k: Lanes, signs: Signs) -> tuple[list[Move], Roots]:
    """The moves of three axes (3, 6), of which 1, 2 and 2, 3 are skew, that bring p to k."""
    first, second, third = (line_of(screw) for screw in screws)
    w1, w2 = first.direction, second.direction
    # The common perpendicular of axes 1 and 2, from o1 to o2 = o1 + d n.
    foot_1, foot_2 = joint_motion.nearest_points(first, second)
    gap = foot_2 - foot_1
    d = lanes.norm(gap)
    n = lanes.materialised(gap * (1.0 / d))
    m = lanes.materialised(lanes.cross(w2, n))
    cos_alpha, across = w1 @ w2, lanes.materialise(w1 @ m)
    goal = k - foot_1

    # Each number as a vector of its constant, cosine and sine in q3.
    x = away_from(third, p)
    y = lanes.cross(third.direction, x)
    parts = [lanes.materialised(part) for part in (p - x - foot_2, x, y)]
    f = parts[0]
    height = np.array([w2 @ part for part in parts], dtype=object)
    square = np.array([f @ f + x @ x, 2.0 * (f @ x), 2.0 * (f @ y)], dtype=object)
    constant = lanes.lanes_of([1.0, 0.0, 0.0])
    along_n = ((goal @ goal - d * d) * constant - square) * (0.5 / d)
    along_m = ((w1 @ goal) * constant - cos_alpha * height) * (1.0 / across)
    squares = [lanes.outer(v, v) for v in (along_n, along_m, height)]
    conic = squares[0] + squares[1] + squares[2]
    conic = conic - 0.5 * (lanes.outer(constant, square) + lanes.outer(square, constant))
    conic = lanes.materialised(conic)

    turn, roots = _on_circle(conic, signs)
    cos, sin = turn
    at = np.array([Lane(1.0), cos, sin], dtype=object)
    between = (along_n @ at) * n + (along_m @ at) * m + (height @ at) * w2
    between = lanes.materialised(between)
    before = parts[0] + cos * parts[1] + sin * parts[2]
    turn_2 = turn_between(w2, before, between)
    turn_1 = turn_between(w1, between + gap, goal)
    return [lanes.materialised(turn_1), lanes.materialised(turn_2), turn], roots


def _on_circle(conic: Lanes, signs: Signs) -> tuple[Lanes, Roots]:
    """Where (1, c, s) conic (1, c, s)^T = 0 on the unit circle, as a turn."""
    line_sign, sign = signs(), signs()
    size = Lane(0.0)
    for entry in conic.ravel():
        size = lanes.maximum(size, abs(entry))
    conic = lanes.materialised(conic * (1.0 / (size + _TINY)))
    pair = lanes.materialised(conic + _parameter(conic) * _CIRCLE)
    line = lanes.materialised(_line(pair, line_sign))
    turn, roots = sinusoid_root(line[1], line[2], line[0], sign, lanes.norm(line))
    return _refined(conic, turn), roots


_CIRCLE = lanes.lanes_of(np.diag([-1.0, 1.0, 1.0]))


def _parameter(conic: Lanes) -> Lane:
    """The t for which conic + t circle is a pair of real lines."""
    minors = lanes.adjugate(conic)
    b = conic[0, 0] - conic[1, 1] - conic[2, 2]
    c = minors[1, 1] + minors[2, 2] - minors[0, 0]
    e = conic[0] @ minors[:, 0]
    # t^3 - b t^2 - c t - e = 0; with t = s + b / 3: s^3 + p s + q = 0.
    p = lanes.materialise(-c - b * b * (1.0 / 3.0))
    q = lanes.materialise(-e - b * c * (1.0 / 3.0) - b * b * b * (2.0 / 27.0))
    third, half = p * (1.0 / 3.0), q * 0.5
    inside = half * half + third * third * third
    # Three real roots, by a third of an angle.
    length = lanes.sqrt(-third)
    angle = lanes.atan2(lanes.sqrt(-inside), -half) * (1.0 / 3.0)
    several = [
        2.0 * length * lanes.sincos(angle + 2.0 * np.pi / 3.0 * turn)[1] for turn in (0, 1, 2)
    ]
    # One, without cancellation.
    far = lanes.sqrt(inside)
    big = _cube_root(lanes.select(half > 0.0, -half - far, far - half))
    nonzero = abs(big) > _TINY
    one = lanes.select(nonzero, big - third / lanes.select(nonzero, big, 1.0), 0.0)
    roots = [
        lanes.materialise(lanes.select(inside > 0.0, one, root) + b * (1.0 / 3.0))
        for root in several
    ]

    # Of a singular matrix with eigenvalues 0, u and v this is u v: negative for real lines.
    best, least = roots[0], lanes.trace(lanes.adjugate(conic + roots[0] * _CIRCLE))
    for root in roots[1:]:
        product = lanes.trace(lanes.adjugate(conic + root * _CIRCLE))
        better = product < least
        best, least = lanes.select(better, root, best), lanes.select(better, product, least)
    best = lanes.materialise(best)
    for _ in range(2):
        value = ((best - b) * best - c) * best - e
        slope = (3.0 * best - 2.0 * b) * best - c
        steep = abs(slope) > 1e-6
        step = value / lanes.select(steep, slope, 1.0)
        best = lanes.materialise(lanes.select(steep, best - step, best))
    return best


def _cube_root(x: Lane) -> Lane:
    return Lane(jnp.cbrt(x.value))


def _line(pair: Lanes, sign: Lane) -> Lanes:
    """One of the two lines of a singular conic l m^T + m l^T, up to a factor.

    Its adjugate is -(l x m) (l x m)^T, up to a factor, and l m^T differs from the conic by the
    matrix of that cross product (Richter-Gebert, *Perspectives on Projective Geometry*, 11.3).
    """
    minors = lanes.adjugate(pair)
    point, most = minors[:, 0], -minors[0, 0]
    for i in (1, 2):
        larger = -minors[i, i] > most
        point = lanes.choose(larger, minors[:, i], point)
        most = lanes.select(larger, -minors[i, i], most)
    some = most > _TINY
    per = lanes.select(some, lanes.reciprocal_root(lanes.select(some, most, 1.0)), 0.0)
    rank_one = pair + lanes.hat(point * (per * sign))
    line, longest = rank_one[0], rank_one[0] @ rank_one[0]
    for row in rank_one[1:]:
        square = row @ row
        longer = square > longest
        line, longest = lanes.choose(longer, row, line), lanes.select(longer, square, longest)
    return line


def _refined(conic: Lanes, turn: Lanes) -> Lanes:
    """Newton's method on the circle."""
    turn = lanes.materialised(turn)
    for _ in range(_REFINEMENTS):
        cos, sin = turn
        row = conic @ np.array([Lane(1.0), cos, sin], dtype=object)
        value = row[0] + cos * row[1] + sin * row[2]
        slope = 2.0 * (cos * row[2] - sin * row[1])
        steep = abs(slope) > 1e-7
        step = -value / lanes.select(steep, slope, 1.0)
        step = lanes.maximum(lanes.minimum(step, _LARGEST_STEP), -_LARGEST_STEP)
        step = lanes.materialise(lanes.select(steep, step, 0.0))
        turn = lanes.materialised(joint_motion.turn_of(cos - sin * step, sin + cos * step))
    return turn
