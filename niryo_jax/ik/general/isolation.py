"""The real roots of trigonometric polynomials of degree 8, with a proof that they are all.

On an arc, g times a positive number is a form of degree 16; where its 17 Bernstein coefficients
are all beyond the noise and have no change of sign there is no root, where they have one there is
exactly one, and where they have two there are two at most (Descartes' rule; those that are complex
but lie next to the arc count). An arc that is neither is halved (de Casteljau). Where noise hides
what lies on the halves of an arc with two at most, the arc itself is kept as a pair: two solutions
on it are all. The arcs of all polynomials wait on one stack, of which every step takes the top.
"""

from __future__ import annotations

import functools
import math
import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.compaction import append, at_once, tally
from niryo_jax.ik.general.polynomial import COEFFICIENTS, DEGREE, Polynomial
from niryo_jax.lanes import Lane
from niryo_jax.tolerances import POLYNOMIAL_NOISE

_ARCS = 32
_WIDTH = 64
_FORM = 2 * DEGREE
_HEAD = 4
_REFINEMENTS = 7
_MOST = 40
_DEEPEST = 28
_NARROWEST = 2 * np.pi / _ARCS / 2 ** (_DEEPEST - 2)


ANY, SIMPLE, PAIR = 0, 1, 2
"""What an arc holds: any number of roots, one that is simple, or two at most."""

_LOWER, _UPPER = PAIR, PAIR + 1


class Roots(NamedTuple):
    """Roots of many polynomials in one list.

    Attributes:
        owner: (r,) whose each is; `rows` behind the last.
        angle: (r,).
        arc: (2, r) the ends of the arc that it is known to lie on.
        kind: (r,) one of ANY, SIMPLE, PAIR: what lies on the arc. A pair is in the list twice.
        settled: (rows,) whether the roots of a polynomial are all in the list, and none of them on
            an arc that may hold any number.
        number: () how many there are.
    """

    owner: jax.Array
    angle: jax.Array
    arc: jax.Array
    kind: jax.Array
    settled: jax.Array
    number: jax.Array


class Effort(NamedTuple):
    """How far to go: numbers or arrays ().

    Attributes:
        share: how many arcs may be halved for one polynomial.
        narrowest: an arc that is narrower (radians) is not halved.
        pair: an arc that is narrower (radians), and has two roots at most, is a pair.
    """

    share: jax.Array | int
    narrowest: jax.Array | float
    pair: jax.Array | float


class _State(NamedTuple):
    """Arcs that wait, arcs that are found, and what each polynomial has had of both.

    Attributes:
        arcs, size: rows (owner, low, high, whether two roots are the most, 17 coefficients), of
            which the first `size` wait.
        found, number: the same of rows (owner, low, high, kind).
        spent: (rows,) how many arcs were halved for each; held: (rows,) how many were found.
    """

    arcs: jax.Array
    size: jax.Array
    found: jax.Array
    number: jax.Array
    spent: jax.Array
    held: jax.Array


def isolated(polynomial: Polynomial, effort: Effort) -> Roots:
    """The roots of polynomials (17, rows)."""
    coefficients, noise = polynomial
    rows, dtype = coefficients.shape[1], coefficients.dtype
    least = float(jnp.finfo(dtype).eps) * 5
    margin = POLYNOMIAL_NOISE * jnp.maximum(noise, least)
    first = jnp.asarray(_BERNSTEIN, dtype).reshape(-1, COEFFICIENTS) @ coefficients
    first = lanes.materialise(Lane(first)).array.reshape(_ARCS, COEFFICIENTS, rows)
    one, none, two, flat = _judged(jnp.moveaxis(first, 1, 0), margin)
    certain = none | one | flat
    width = min(at_once(_WIDTH, rows), _ARCS * rows)
    # What one step finds may be more than a polynomial is given.
    room = _MOST * rows + 4 * width
    number = np.arange(_ARCS, dtype=float)[:, None] * (2 * np.pi / _ARCS)
    owner = jnp.broadcast_to(jnp.arange(rows, dtype=dtype), certain.shape)
    low = jnp.broadcast_to(jnp.asarray(number, dtype), certain.shape)
    high = low + jnp.asarray(2 * np.pi / _ARCS, dtype)
    is_root = one | flat
    found = jnp.full((room, 4), -1.0, dtype)
    items = jnp.stack([owner, low, high, one.astype(dtype)], axis=-1).reshape(-1, 4)
    found, count = append(found, jnp.int32(0), items, is_root.reshape(-1))
    capacity = _ARCS * rows + width * _DEEPEST
    arcs = jnp.zeros((capacity, _HEAD + COEFFICIENTS), dtype)
    head = jnp.stack([owner, low, high, two.astype(dtype)])
    table = jnp.concatenate([head, jnp.moveaxis(first, 1, 0)]).reshape(_HEAD + COEFFICIENTS, -1).T
    arcs, size = append(arcs, jnp.int32(0), table, ~certain.reshape(-1))
    spent = jnp.zeros(rows, jnp.int32)
    held = jnp.sum(is_root, axis=0, dtype=jnp.int32)
    state = _State(arcs, size, found, count, spent, held)
    state = jax.lax.while_loop(
        lambda state: state.size > 0,
        lambda state: _step(margin, width, effort, state),
        state,
    )
    live = jnp.arange(room) < state.number
    owner = jnp.where(live, state.found[:, 0].astype(jnp.int32), rows)
    kind = state.found[:, 3].astype(jnp.int32)
    settled = (state.spent <= effort.share) & (state.held <= _MOST)
    settled = settled.at[jnp.where(kind == ANY, owner, rows)].set(False, mode="drop")
    angle = _refined(coefficients, owner, state.found)
    arc = state.found[:, 1:3].T
    return Roots(owner, angle, arc, jnp.minimum(kind, PAIR), settled, state.number)


def _judged(form: jax.Array, margin: jax.Array) -> tuple[jax.Array, ...]:
    """Whether forms (17, ...) have exactly one root, none, two at most, or nothing but noise."""
    up, down = form > margin, form < -margin
    certain = up | down
    doubtful = jnp.sum(~certain, axis=0, dtype=jnp.int32)
    # A doubtful coefficient is taken for either sign: it must not matter which.
    most = _number(~(up[1:] & up[:-1]) & ~(down[1:] & down[:-1]))
    ends = certain[0] & certain[-1]
    unlike = up[0] != up[-1]
    one = ends & unlike & (most <= 2)
    none = (doubtful == 0) & (most == 0)
    # The number of changes is even where the ends are alike.
    two = ends & ~unlike & (most <= 3)
    return one, none, two, doubtful == COEFFICIENTS


def _number(which: jax.Array) -> jax.Array:
    return jnp.sum(which, axis=0, dtype=jnp.int32)


def _step(margin: jax.Array, width: int, effort: Effort, state: _State) -> _State:
    """Halve the top arcs; push what is still open."""
    start = jnp.maximum(state.size - width, 0)
    items = jax.lax.dynamic_slice_in_dim(state.arcs, start, width)
    live = start + jnp.arange(width) < state.size
    owner, low, high = items[:, 0].astype(jnp.int32), items[:, 1], items[:, 2]
    two_at_most = items[:, 3] > 0.5
    spent = tally(state.spent, owner, live)
    middle = 0.5 * (low + high)
    narrow = middle - low < jnp.maximum(effort.narrowest, _NARROWEST)
    crowded = state.held[owner] > _MOST
    given_up = (spent[owner] > effort.share) | narrow | crowded
    matrix = jnp.asarray(_HALVES, items.dtype).reshape(-1, COEFFICIENTS)
    forms = (matrix @ items[:, _HEAD:].T).reshape(2, COEFFICIENTS, width)
    # The middle of the form is shorter than its ends by the cosine of a quarter of the arc.
    per = 1.0 / jnp.cos(0.25 * (high - low))
    powers = jnp.cumprod(jnp.broadcast_to(per, (_FORM, width)), axis=0)
    powers = jnp.concatenate([jnp.ones((1, width), items.dtype), powers])
    halves = (forms[0] * powers, low, middle), (forms[1] * powers[::-1], middle, high)
    judged = [_judged(form, margin[owner]) for form, _, _ in halves]
    # What an arc has at most, its halves have together; where that is not seen, it is noise.
    hidden = ~functools.reduce(operator.and_, (one | none | two for one, none, two, _ in judged))
    closed = functools.reduce(operator.and_, (one | none for one, none, _, _ in judged))
    pair = two_at_most & ~closed & (hidden | given_up | (middle - low < effort.pair))
    parts = list[jax.Array](), list[jax.Array](), list[jax.Array](), list[jax.Array]()
    for (form, a, b), (one, none, two, flat), kind in zip(halves, judged, (_LOWER, _UPPER)):
        ends = flat | given_up
        kind = jnp.where(pair, kind, jnp.where(one, SIMPLE, ANY)).astype(items.dtype)
        its_arc = jnp.where(pair, low, a), jnp.where(pair, high, b)
        parts[0].append(jnp.stack([items[:, 0], *its_arc, kind], axis=-1))
        parts[1].append(live & ~crowded & (pair | one | (ends & ~none)))
        head = jnp.stack([items[:, 0], a, b, two.astype(items.dtype)], axis=-1)
        parts[2].append(jnp.concatenate([head, form.T], axis=1))
        parts[3].append(live & ~one & ~none & ~ends & ~pair)
    new, is_root, rows, is_open = (jnp.concatenate(part) for part in parts)
    arcs, size = append(state.arcs, start, rows, is_open)
    found, number = append(state.found, state.number, new, is_root)
    held = tally(state.held, new[:, 0], is_root)
    return _State(arcs, size, found, number, spent, held)


def _refined(coefficients: jax.Array, owner: jax.Array, found: jax.Array) -> jax.Array:
    """The root in each arc, by Newton's method that stays in what is known to hold it. Of a pair
    the same method finds where g has its extremum, and the parabola there its roots."""
    row = jnp.minimum(owner, coefficients.shape[1] - 1)
    c = lanes.contiguous_lanes(coefficients.T[row])
    _, low, high, kind = (lane.array for lane in lanes.contiguous_lanes(found))
    is_pair = kind >= PAIR

    def of(at: jax.Array) -> tuple[jax.Array, jax.Array]:
        value, slope, bend = _derivatives(c, at)
        return jnp.where(is_pair, slope, value), jnp.where(is_pair, bend, slope)

    rising = of(low)[0] < 0

    def step(_: int, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        low, high, at = state
        value, slope = of(at)
        before = (value < 0) == rising
        low, high = jnp.where(before, at, low), jnp.where(before, high, at)
        new = at - value / jnp.where(slope == 0, 1.0, slope)
        # Where it has converged, rounding must not throw it out again.
        inside = (new >= low - slack) & (new <= high + slack) & (slope != 0)
        return low, high, jnp.where(inside, new, 0.5 * (low + high))

    middle, slack = 0.5 * (low + high), 1e-3 * (high - low)
    _, _, at = jax.lax.fori_loop(0, _REFINEMENTS, step, (low, high, middle))
    value, _, bend = _derivatives(c, at)
    square = -2.0 * value / jnp.where(bend == 0, 1.0, bend)
    apart = jnp.minimum(jnp.sqrt(jnp.maximum(square, 0.0)), 0.5 * (high - low))
    of_pair = jnp.where(kind == _LOWER, at - apart, at + apart)
    return jnp.where(is_pair, of_pair, jnp.where(kind == SIMPLE, at, middle))


def _derivatives(c: lanes.Lanes, angle: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """g and its first two derivatives at angles (r,)."""
    sin, cos = lanes.sincos(Lane(angle))
    sin, cos = lanes.materialise(sin), lanes.materialise(cos)
    value, slope, bend = c[0], Lane(0.0), Lane(0.0)
    of_k = cos, sin
    for k in range(1, DEGREE + 1):
        real, imaginary = 2.0 * c[k], 2.0 * c[DEGREE + k]
        term = real * of_k[0] - imaginary * of_k[1]
        value = value + term
        slope = slope - float(k) * (real * of_k[1] + imaginary * of_k[0])
        bend = bend - float(k * k) * term
        of_k = of_k[0] * cos - of_k[1] * sin, of_k[1] * cos + of_k[0] * sin
    return value.array, slope.array, bend.array


def _bernstein() -> np.ndarray:
    """(arcs, 17, 17) from coefficients to those of the form on each arc."""
    out = np.zeros((_ARCS, COEFFICIENTS, COEFFICIENTS))
    binomial = np.array([math.comb(_FORM, i) for i in range(_FORM + 1)])
    for arc in range(_ARCS):
        # e^(i t / 2) = (1 - s) e^(i low / 2) + s e^(i high / 2), up to a positive factor.
        ends = np.exp(0.5j * 2 * np.pi / _ARCS * np.array([arc, arc + 1]))
        for k in range(DEGREE + 1):
            turned = _power(ends, DEGREE + k), _power(ends.conj(), DEGREE - k)
            column = np.convolve(*turned) / binomial
            if k == 0:
                out[arc, :, 0] = column.real
            else:
                out[arc, :, k], out[arc, :, DEGREE + k] = 2 * column.real, -2 * column.imag
    return out


def _power(ends: np.ndarray, count: int) -> np.ndarray:
    """The coefficients of (a + b)^count for the two ends (2,)."""
    a, b = ends
    return np.array([math.comb(count, j) * a ** (count - j) * b**j for j in range(count + 1)])


def _halves() -> np.ndarray:
    """(2, 17, 17) from the coefficients of a form to those on either half."""
    left = np.zeros((_FORM + 1, _FORM + 1))
    for i in range(_FORM + 1):
        for j in range(i + 1):
            left[i, j] = math.comb(i, j) / 2**i
    return np.stack([left, left[::-1, ::-1]])


_BERNSTEIN = _bernstein()
_HALVES = _halves()
