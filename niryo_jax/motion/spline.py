"""Cubic splines through joint vectors: twice continuously differentiable paths."""

from __future__ import annotations

import functools
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.tolerances import SAME_WAYPOINT


class Spline(NamedTuple):
    """A path q(s) for s in [0, 1], the share of the length of the chords between its knots.

    Attributes:
        knots: (..., k) rising; 1 from the last knot on.
        q: (..., k, n) joint vectors at the knots.
        bend: (..., k, n) the second derivative there, between which it is linear.
        length: (...,) of all chords, radians (metres); 0 where there is no way to go.
    """

    knots: jax.Array
    q: jax.Array
    bend: jax.Array
    length: jax.Array


class Place(NamedTuple):
    """Where a path is at some s, and its derivatives by s; (..., m, n) each.

    Attributes:
        q, slope, bend, third: the path and its first three derivatives.
    """

    q: jax.Array
    slope: jax.Array
    bend: jax.Array
    third: jax.Array


@jax.jit
def spline_through(q: jax.Array) -> Spline:
    """The cubic spline through two or more joint vectors (..., k, n), by chord length.

    Its third derivative is continuous at the second knot and at the last but one ("not a knot": de
    Boor, A Practical Guide to Splines, chapter IV). So it is a straight line through two knots and
    a parabola through three. A joint vector that is the one before it again is no knot.
    """
    q, last = _without_repeats(q)
    knots, length = chord_shares(q)
    # Rounding does not keep the end from being 1.
    here = jnp.arange(q.shape[-2])
    knots = jnp.where(here >= last[..., None], 1.0, knots)
    return Spline(knots, q, _bends(knots, q, last), length)


def chord_shares(q: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Where joint vectors (..., k, n) are on the chords between them, (..., k) shares of their
    length, and that length (...,)."""
    chords = norm(q[..., 1:, :] - q[..., :-1, :])
    length = jnp.sum(chords, axis=-1)
    share = chords / jnp.where(length > 0, length, 1.0)[..., None]
    none = jnp.zeros_like(share[..., :1])
    return jnp.concatenate([none, jnp.cumsum(share, axis=-1)], axis=-1), length


def place_at(spline: Spline, s: jax.Array) -> Place:
    """A path at shares (..., m) of its length, held within [0, 1]."""
    knots, q, bend = spline.knots, spline.q, spline.bend
    s = jnp.clip(jnp.broadcast_to(s, (*knots.shape[:-1], s.shape[-1])), 0.0, 1.0)
    # All that is known of an interval in one row: one look-up for each place.
    pieces = [knots[..., None], q, bend]
    table = jnp.concatenate(
        [x[..., i : x.shape[-2] - 1 + i, :] for i in (0, 1) for x in pieces], -1
    )
    # From the left, so that the end belongs to an interval of some length.
    row = jnp.clip(before(knots, s, "left"), 0, table.shape[-2] - 1)
    n = q.shape[-1]
    start, q0, m0, end, q1, m1 = jnp.split(
        looked_up(table, row), np.cumsum([1, n, n, 1, n]).tolist(), axis=-1
    )
    start, end = start[..., 0], end[..., 0]
    h = end - start
    moves = h > 0
    h = jnp.where(moves, h, 1.0)[..., None]
    v = jnp.where(moves, jnp.clip(s - start, 0.0, end - start), 0.0)[..., None] / h
    u = 1.0 - v
    m0, m1 = (m * h * h for m in (m0, m1))
    return Place(
        u * q0 + v * q1 - u * v * ((1.0 + u) * m0 + (1.0 + v) * m1) / 6.0,
        (q1 - q0 - (3.0 * u * u - 1.0) * m0 / 6.0 + (3.0 * v * v - 1.0) * m1 / 6.0) / h,
        (u * m0 + v * m1) / h**2,
        (m1 - m0) / h**3,
    )


def nodes_of(knots: jax.Array, count: int) -> jax.Array:
    """Rising numbers (..., count + 1) from 0 to 1, among which are all knots (..., k).

    Half of them are shared out by length, the other half equally among the intervals of the knots,
    which rise to 1 and are repeated from there on. That needs a count of 2 k or more.
    """
    last = jnp.sum(knots < 1.0, axis=-1, keepdims=True)
    place = jnp.minimum(jnp.arange(knots.shape[-1]), last) / jnp.maximum(last, 1)
    share = jnp.where(last > 0, 0.5 * (knots + place.astype(knots.dtype)), 1.0)
    at = jnp.linspace(0.0, 1.0, count + 1, dtype=knots.dtype)
    row = jnp.clip(before(share, jnp.broadcast_to(at, (*share.shape[:-1], count + 1)), "left"), 0)
    row = jnp.minimum(row, knots.shape[-1] - 2)
    table = jnp.stack([share[..., :-1], share[..., 1:], knots[..., :-1], knots[..., 1:]], axis=-1)
    low, high, start, end = jnp.moveaxis(looked_up(table, row), -1, 0)
    done = (at - low) / jnp.where(high > low, high - low, 1.0)
    inside = start + jnp.clip(done, 0.0, 1.0) * (end - start)
    # The node that is nearest to a knot becomes it: no two knots are as near to one.
    nearest = jnp.round(share * count).astype(jnp.int32)
    nodes = jnp.put_along_axis(inside, nearest, knots, axis=-1, inplace=False)
    # A path of no length has its nodes anywhere.
    return jax.lax.stop_gradient(jnp.where(last > 0, nodes, at))


def looked_up(table: jax.Array, row: jax.Array) -> jax.Array:
    """Rows (..., m) of tables (..., k, n): (..., m, n)."""
    found = jax.vmap(lambda one, i: one[i])(
        table.reshape(-1, *table.shape[-2:]), row.reshape(-1, row.shape[-1])
    )
    return found.reshape(*row.shape, table.shape[-1])


def before(rising: jax.Array, values: jax.Array, side: Literal["left", "right"]) -> jax.Array:
    """The place (..., m) in rising numbers (..., k) before each value; -1 where there is none."""
    search = functools.partial(jnp.searchsorted, side=side)
    found = jax.vmap(search)(
        rising.reshape(-1, rising.shape[-1]), values.reshape(-1, values.shape[-1])
    )
    return found.reshape(values.shape) - 1


def root(square: jax.Array) -> jax.Array:
    """The square root, whose derivative at zero is zero."""
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def norm(vector: jax.Array) -> jax.Array:
    """The length of vectors (..., n), whose derivative at zero is zero."""
    return root(jnp.sum(vector * vector, axis=-1))


def _without_repeats(q: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Joint vectors that differ in front, the last of them up to the end; and the place of that."""
    steps = norm(q[..., 1:, :] - q[..., :-1, :])
    whole = jnp.sum(steps, axis=-1, keepdims=True)
    new = steps > SAME_WAYPOINT.of(q.dtype) * whole
    keep = jnp.concatenate([jnp.ones_like(new[..., :1]), new], axis=-1)
    order = jnp.argsort(~keep, axis=-1, stable=True)
    last = jnp.sum(new, axis=-1)
    order = jnp.take_along_axis(
        order, jnp.minimum(jnp.arange(q.shape[-2]), last[..., None]), axis=-1
    )
    return jnp.take_along_axis(q, order[..., None], axis=-2), last


def _bends(knots: jax.Array, q: jax.Array, last: jax.Array) -> jax.Array:
    """Second derivatives (..., k, n) at knots, of which `last` (...,) is the last."""
    count = q.shape[-2]
    if count == 2:
        return jnp.zeros_like(q)
    h = knots[..., 1:] - knots[..., :-1]
    safe = jnp.where(h > 0, h, 1.0)[..., None]
    slope = (q[..., 1:, :] - q[..., :-1, :]) / safe
    before, after = h[..., :-1], h[..., 1:]
    # One row for each knot but the first and the last of the array.
    here = jnp.arange(1, count - 1)
    end = last[..., None]
    inner = here < end
    first, final = here == 1, here == end - 1
    only = first & final
    ratio = jnp.where(inner, before, 1.0) / jnp.where(inner, after, 1.0)
    # The bends at both ends are those that the next two knots make linear.
    diagonal = (
        2.0 * (before + after)
        + jnp.where(first & ~only, before * (1.0 + ratio), 0.0)
        + jnp.where(final & ~only, after * (1.0 + 1.0 / ratio), 0.0)
        + jnp.where(only, before + after, 0.0)
    )
    upper = jnp.where(final, 0.0, after - jnp.where(first, before * ratio, 0.0))
    lower = jnp.where(first, 0.0, before - jnp.where(final, after / ratio, 0.0))
    diagonal = jnp.where(inner, diagonal, 1.0)
    upper, lower = (jnp.where(inner, x, 0.0) for x in (upper, lower))
    right = jnp.where(inner[..., None], 6.0 * (slope[..., 1:, :] - slope[..., :-1, :]), 0.0)
    m = _tridiagonal(lower, diagonal, upper, right)
    # Back to all knots.
    none = jnp.zeros_like(q[..., :1, :])
    m = jnp.concatenate([none, m, none], axis=-2)

    def beyond(near: jax.Array, far: jax.Array, h0: jax.Array, h1: jax.Array) -> jax.Array:
        """The bend at an end from those of the next two knots, h0 and h0 + h1 away."""
        share = (h0 / jnp.where(h1 > 0, h1, 1.0))[..., None]
        return near + share * (near - far)

    many, three = (last > 2)[..., None], (last == 2)[..., None]
    start = jnp.where(many, beyond(m[..., 1, :], m[..., 2, :], h[..., 0], h[..., 1]), 0.0)
    start = jnp.where(three, m[..., 1, :], start)

    def picked(array: jax.Array, back: int) -> jax.Array:
        index = jnp.maximum(last - back, 0)[..., None]
        return jnp.take_along_axis(array, index[..., None], axis=-2)[..., 0, :]

    widths = h[..., None]
    h0, h1 = (picked(widths, back)[..., 0] for back in (1, 2))
    finish = jnp.where(many, beyond(picked(m, 1), picked(m, 2), h0, h1), 0.0)
    finish = jnp.where(three, m[..., 1, :], finish)
    here = jnp.arange(count)[:, None]
    m = jnp.where(here == 0, start[..., None, :], m)
    return jnp.where(here == last[..., None, None], finish[..., None, :], m)


def _tridiagonal(
    lower: jax.Array, diagonal: jax.Array, upper: jax.Array, right: jax.Array
) -> jax.Array:
    """The solution (..., k, n) of rows lower x_-1 + diagonal x + upper x_+1 = right."""
    *batch, count, n = right.shape
    lower, diagonal, upper = (x.reshape(-1, count) for x in (lower, diagonal, upper))
    solve = jax.vmap(jax.lax.linalg.tridiagonal_solve)
    return solve(lower, diagonal, upper, right.reshape(-1, count, n)).reshape(*batch, count, n)
