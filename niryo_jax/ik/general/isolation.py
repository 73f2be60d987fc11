"""The real roots of trigonometric polynomials of degree 8, with what proves that they are all.

Forms tell how many roots an arc has at most (`trig_polynomial`). One without roots is done with,
one with a single root holds a simple one, and others are halved (de Casteljau) until noise hides
what their halves hold. Then what is known is the number of roots of an arc further up: if as many
different solutions lie on it, they are all. The arcs of all polynomials wait on one stack, of which
every step takes the top.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.compaction import append, at_once, tally
from niryo_jax.ik.trig_polynomial import (
    COEFFICIENTS,
    DEGREE,
    FORM,
    UNBOUNDED,
    Polynomial,
    forms_on_arcs,
    most_roots,
)
from niryo_jax.lanes import Lane
from niryo_jax.lanes.batch_last import kept
from niryo_jax.lanes.matrices import product

ARCS = 32
START = 2 * np.pi / ARCS / 7
"""Where the first arc begins: no angle of whole degrees is the end of an arc, however often halved,
for at an end noise hides a root from the arcs on both sides."""
_WIDTH = 128
_HEAD = 6
_REFINEMENTS = 7
_MOST = 40
_DEEPEST = 28
_NARROWEST = 2 * np.pi / ARCS / 2 ** (_DEEPEST - 2)

_MIDDLE, _ROOT, _LOWER, _UPPER = range(4)
"""Where to begin on an arc: its middle, its root, and either root of two."""


class Roots(NamedTuple):
    """Roots of many polynomials in one list.

    Attributes:
        owner: (r,) whose each is; `rows` behind the last.
        near: (r, 3) the ends of an arc that holds it alone, if that is known, and where to begin.
        arc: (2, r) the ends of an arc that holds it.
        most: (r,) how many roots that arc has at most. It is 1 for a simple root.
        listed: (rows,) whether all roots of a polynomial are on arcs in the list.
        number: () how many there are.
    """

    owner: jax.Array
    near: jax.Array
    arc: jax.Array
    most: jax.Array
    listed: jax.Array
    number: jax.Array


class Effort(NamedTuple):
    """How far to go: numbers or arrays ().

    Attributes:
        share: how many arcs may be halved for one polynomial.
        narrowest: an arc that is narrower (radians) is not halved.
        hidden: the same of arcs of which less is known than of one further up.
        pair: the same of arcs with two roots at most.
    """

    share: jax.Array | int
    narrowest: jax.Array | float
    hidden: jax.Array | float
    pair: jax.Array | float


A_LITTLE = Effort(share=200, narrowest=3e-3, hidden=3e-3, pair=3e-3)
FAR = Effort(share=2000, narrowest=1e-8, hidden=1e-3, pair=1e-4)


class _State(NamedTuple):
    """Arcs that wait, arcs that are found, and what each polynomial has had of both.

    Attributes:
        arcs, size: rows (owner, low, high, bound, 17 coefficients), of which the first `size` wait.
            A bound is (low, high, most): the ends of the arc itself or of one further up, and how
            many roots that has at most.
        found, number: the same of rows (owner, low, high, bound, where to begin).
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
    coefficients, margin = polynomial.coefficients, polynomial.margin
    rows, dtype = coefficients.shape[1], coefficients.dtype
    first = forms_on_arcs(polynomial, ARCS, START)
    most, flat = most_roots(first, margin)
    width = min(at_once(_WIDTH, rows), ARCS * rows)
    # What one step finds may be more than a polynomial is given.
    room = _MOST * rows + 2 * width
    number = np.arange(ARCS, dtype=float)[:, None] * (2 * np.pi / ARCS)
    owner = jnp.broadcast_to(jnp.arange(rows, dtype=dtype), most.shape)
    low = jnp.broadcast_to(jnp.asarray(START + number, dtype), most.shape)
    high = low + jnp.asarray(2 * np.pi / ARCS, dtype)
    is_root = (most == 1) | flat
    head = jnp.stack([owner, low, high, low, high, most.astype(dtype)])
    begin = jnp.where(most == 1, _ROOT, _MIDDLE).astype(dtype)
    items = jnp.concatenate([head, begin[None]]).reshape(_HEAD + 1, -1).T
    found = jnp.full((room + 2 * width, _HEAD + 1), -1.0, dtype)
    found, count = append(found, jnp.int32(0), items, is_root.reshape(-1))
    capacity = ARCS * rows + width * (_DEEPEST + 1)
    arcs = jnp.zeros((capacity, _HEAD + COEFFICIENTS), dtype)
    table = jnp.concatenate([head, first]).reshape(_HEAD + COEFFICIENTS, -1).T
    arcs, size = append(arcs, jnp.int32(0), table, ~(is_root | (most == 0)).reshape(-1))
    spent = jnp.zeros(rows, jnp.int32)
    held = jnp.sum(is_root, axis=0, dtype=jnp.int32)
    state = _State(arcs, size, found, count, spent, held)
    state = jax.lax.while_loop(
        lambda state: state.size > 0,
        lambda state: _step(margin, width, effort, state),
        state,
    )
    found, live = state.found[:room], jnp.arange(room) < state.number
    owner = jnp.where(live, found[:, 0].astype(jnp.int32), rows)
    listed = (state.spent <= effort.share) & (state.held <= _MOST) & (state.number <= room)
    near = jnp.concatenate([found[:, 1:3], found[:, 6:]], axis=1)
    arc, most = found[:, 3:5].T, found[:, 5].astype(jnp.int32)
    return Roots(owner, near, arc, most, listed, state.number)


def _step(margin: jax.Array, width: int, effort: Effort, state: _State) -> _State:
    """Halve the top arcs; push what is still open."""
    start = jnp.maximum(state.size - width, 0)
    # What reads the stack itself must be done with it before it is written, or it is copied.
    items = kept(jax.lax.dynamic_slice_in_dim(state.arcs, start, width))
    live = start + jnp.arange(width) < state.size
    owner, low, high, bound = items[:, 0].astype(jnp.int32), items[:, 1], items[:, 2], items[:, 3:6]
    most = bound[:, 2].astype(jnp.int32)
    spent = tally(state.spent, owner, live)
    middle = 0.5 * (low + high)
    matrix = jnp.asarray(_HALVES, items.dtype).reshape(-1, COEFFICIENTS)
    forms = product(matrix, items[:, _HEAD:].T).reshape(2, COEFFICIENTS, width)
    # The middle of the form is shorter than its ends by the cosine of a quarter of the arc.
    per = 1.0 / jnp.cos(0.25 * (high - low))
    powers = jnp.cumprod(jnp.broadcast_to(per, (FORM, width)), axis=0)
    powers = jnp.concatenate([jnp.ones((1, width), items.dtype), powers])
    halves = (forms[0] * powers, low, middle), (forms[1] * powers[::-1], middle, high)
    judged = [most_roots(form, margin[owner]) for form, _, _ in halves]
    # The halves have no more roots than the whole, unless noise hides how many.
    own = (judged[0][0] + judged[1][0] <= most) | (most == UNBOUNDED)
    crowded = state.held[owner] > _MOST
    narrowest = jnp.where(own, effort.narrowest, effort.hidden)
    narrow = middle - low < jnp.maximum(narrowest, _NARROWEST)
    given_up = (spent[owner] > effort.share) | narrow | crowded
    open_still = (judged[0][0] > 1) | (judged[1][0] > 1)
    pair = (most == 2) & open_still & (~own | given_up | (middle - low < effort.pair))
    parts = list[jax.Array](), list[jax.Array](), list[jax.Array](), list[jax.Array]()
    for (form, a, b), (its, flat), begin in zip(halves, judged, (_LOWER, _UPPER)):
        is_root = (its == 1) & ~pair
        ends = flat | given_up
        begin = jnp.where(pair, begin, jnp.where(is_root, _ROOT, _MIDDLE)).astype(items.dtype)
        a, b = jnp.where(pair, low, a), jnp.where(pair, high, b)
        takes_own = ((own | is_root) & ~pair)[:, None]
        its_bound = jnp.where(takes_own, jnp.stack([a, b, its.astype(a.dtype)], axis=-1), bound)
        head = jnp.concatenate([jnp.stack([items[:, 0], a, b], axis=-1), its_bound], axis=1)
        parts[0].append(jnp.concatenate([head, begin[:, None]], axis=1))
        parts[1].append(live & ~crowded & (pair | is_root | (ends & (its > 0))))
        parts[2].append(jnp.concatenate([head, form.T], axis=1))
        parts[3].append(live & (its > 1) & ~ends & ~pair)
    new, is_root, rows, is_open = (jnp.concatenate(part) for part in parts)
    arcs, size = append(state.arcs, start, rows, is_open)
    found, number = append(state.found, state.number, new, is_root)
    held = tally(state.held, new[:, 0], is_root)
    return _State(arcs, size, found, number, spent, held)


def refined(polynomial: Polynomial, owner: jax.Array, near: jax.Array) -> jax.Array:
    """The root in each arc (r, 3) of `Roots.near`, or where there may be one, by Newton's method
    that stays in what is known to hold it. Of a pair the same method finds where g has its
    extremum, and the parabola there its roots."""
    c = lanes.contiguous_lanes(polynomial.coefficients.T[owner])
    low, high, begin = (lane.array for lane in lanes.contiguous_lanes(near))
    is_pair = begin >= _LOWER

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
    of_pair = jnp.where(begin == _LOWER, at - apart, at + apart)
    return jnp.where(is_pair, of_pair, jnp.where(begin == _ROOT, at, middle))


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


def _halves() -> np.ndarray:
    """(2, 17, 17) from the coefficients of a form to those on either half."""
    left = np.zeros((FORM + 1, FORM + 1))
    for i in range(FORM + 1):
        for j in range(i + 1):
            left[i, j] = math.comb(i, j) / 2**i
    return np.stack([left, left[::-1, ::-1]])


_HALVES = _halves()
