"""Ways of joints from stop to stop that are smooth where they meet, for `motion.retime`.

Where the tool comes to a line or leaves it, the joints go on along the line for a little, and then
along a polynomial of degree 7 that has the line's first three derivatives there: so the joints pass
through the end of the line itself, without a halt and without a corner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

SPACING = 4e-3
"""Radians (norm over the joints) between two samples of a free way."""

_BEND = 0.3
"""Radians within which a way turns away from a line: larger is faster and swings out farther."""

_FITTED, _DEGREE = 12, 5
"""Samples at the end of a line to which a polynomial is fitted, for its derivatives there."""

_GOES_ON, _SHARE = 10, 0.2
"""So many samples the joints go on along a line, for this share of the free way at most: by then
what a spline makes of the change of the fourth derivative has died away."""

_FINE = 4001


class End(NamedTuple):
    """How joints pass through an end of a free way, by a length along the way.

    Attributes:
        q: (n,) joint vector, radians.
        rates: (3, n) first to third derivatives by the length.
        spacing: of the samples of the line that it is the end of; 0 where it is no line's.
    """

    q: Vector
    rates: Vector
    spacing: float = 0.0

    def on(self, length: float) -> End:
        """The same so much farther along."""
        first, second, third = self.rates
        q = self.q + length * (first + length * (second / 2 + length * third / 6))
        slope, bend = first + length * (second + length * third / 2), second + length * third
        return End(q, np.stack([slope, bend, third]), self.spacing)

    def reversed(self) -> End:
        """The same, gone through backwards."""
        return End(self.q, self.rates * np.array([[-1.0], [1.0], [-1.0]]), self.spacing)


def towards(q: Vector, direction: Vector) -> End:
    """An end that is passed straight in a direction (n,)."""
    length = float(np.linalg.norm(direction))
    rates = np.zeros((3, len(q)))
    rates[0] = direction / (length if length > 0 else 1.0)
    return End(q, rates)


def end_of(line: Vector) -> End:
    """The end of a line of samples (k, n), k of 3 or more."""
    part = line[-_FITTED:]
    length = _lengths(part)
    share = length / length[-1] - 1.0
    powers = np.vander(share, min(_DEGREE + 1, len(part)), increasing=True)
    found = np.zeros((4, line.shape[1]))
    fitted = np.linalg.lstsq(powers, part, rcond=None)[0][:4]
    found[: len(fitted)] = fitted
    scale = np.array([[math.factorial(i) / length[-1] ** i] for i in (1, 2, 3)])
    return End(line[-1], found[1:] * scale, float(np.linalg.norm(line[-1] - line[-2])))


def free_way(start: End, end: End) -> Vector:
    """Joint vectors (k, n) from one end to the other, both included.

    Straight where neither end is that of a line.
    """
    whole = float(np.linalg.norm(end.q - start.q))
    out, begin = _going_on(start, whole)
    into, finish = _going_on(end.reversed(), whole)
    way = _polynomial(begin, finish.reversed(), whole)
    return np.concatenate([out, way, into[::-1]])


def _going_on(end: End, whole: float) -> tuple[Vector, End]:
    """Samples from an end on along its line, and where they lead, which is not one of them."""
    if end.spacing == 0:
        return end.q[None][:0], end
    count = min(_GOES_ON, int(_SHARE * whole / end.spacing))
    samples = [end.on(i * end.spacing).q for i in range(count)]
    return np.reshape(samples, (count, len(end.q))), end.on(count * end.spacing)


def _polynomial(start: End, end: End, whole: float) -> Vector:
    """Equally spaced samples (k, n) of the polynomial of degree 7 between two ends."""
    conditions = np.zeros((8, 8))
    for i in range(4):
        conditions[i, i] = math.factorial(i)
        conditions[4 + i, i:] = [math.perm(k, i) for k in range(i, 8)]
    given = [np.concatenate([x.q[None], x.rates * _scale(x, whole)]) for x in (start, end)]
    factors = np.linalg.solve(conditions, np.concatenate(given))
    u = np.linspace(0.0, 1.0, _FINE)

    def at(u: Vector) -> Vector:
        return np.vander(u, 8, increasing=True) @ factors

    length = _lengths(at(u))
    count = 1 + max(2, math.ceil(length[-1] / SPACING))
    way = at(np.interp(np.linspace(0.0, length[-1], count), length, u))
    way[0], way[-1] = start.q, end.q
    return way


def _scale(end: End, whole: float) -> Vector:
    """By how much derivatives by the parameter are larger than those by the length, (3, 1)."""
    length = min(_BEND, whole) if end.spacing else whole
    return np.array([[length], [length**2], [length**3]])


def _lengths(q: Vector) -> Vector:
    """(k,) how far samples (k, n) are along their chords."""
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
