"""The cheapest way through a ladder of joint vectors: one rung a sample, dynamic programming.

A rung holds the joint vectors that do a sample. A joint whose range is more than a turn has several
copies of each, whole turns apart; from one rung to the next the nearest turn is taken, so that the
copy follows from the one before it, and a limit that is met later rules out the copies it must.
(Bellman's principle; a ladder graph of inverse kinematics is that of Descartes planners.)
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.robot import Robot
from niryo_jax.tolerances import LIMIT_ROUNDING

_TURN = 2 * math.pi
_MOST_COPIES = 1024
_FEW = 16
_Arrays = tuple[jax.Array, ...]


@dataclasses.dataclass(frozen=True)
class Turns:
    """The whole turns that joints can make; static.

    Attributes:
        copies: for each joint how many copies of an angle may lie within its limits; 0 where turns
            do not matter (no limits), 1 where there is one, or none since the joint slides.
        periodic: whether the joint returns to its place after 2 pi.
    """

    copies: tuple[int, ...]
    periodic: tuple[bool, ...]

    @property
    def digits(self) -> np.ndarray:
        """(copies, n) which copy of each joint."""
        axes = [range(max(count, 1)) for count in self.copies]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))

    @property
    def strides(self) -> np.ndarray:
        """(n,) what a joint's digit counts for in the number of a copy."""
        counts = [max(count, 1) for count in self.copies]
        return np.array([math.prod(counts[i + 1 :]) for i in range(len(counts))])


def turns_of(robot: Robot, periodic: tuple[bool, ...]) -> Turns:
    """The turns of a concrete arm's joints.

    Raises:
        ValueError: limits so wide that more than a thousand copies of a joint vector lie in them.
    """
    copies = list[int]()
    for width, turns in zip(np.asarray(robot.upper) - np.asarray(robot.lower), periodic):
        if not turns:
            copies.append(1)
        elif math.isinf(width):
            copies.append(0)
        else:
            copies.append(max(1, math.ceil((width - LIMIT_ROUNDING.of(np.float64)) / _TURN)))
    count = math.prod(max(x, 1) for x in copies)
    if count > _MOST_COPIES:
        raise ValueError(
            f"robot: expected limits that hold at most {_MOST_COPIES} copies of a joint vector, "
            f"whole turns apart, got {count} in those of {robot.name}"
        )
    return Turns(tuple(copies), periodic)


class Rungs(NamedTuple):
    """What the ladder of one path, or of many (a leading axis), is made of.

    Attributes:
        q: (k, m, n) joint vectors, each joint at the lowest of its copies.
        usable: (k, m) whether they may be taken, limits aside.
        price: (k, m) what each costs.
        barred: (k - 1, m, m) steps, by where they end and where they begin, that may not be taken.
        first: (m, copies) what a copy costs to begin with; infinite where it may not.
        last: (m, copies) the same of where to end.
    """

    q: jax.Array
    usable: jax.Array
    price: jax.Array
    barred: jax.Array
    first: jax.Array
    last: jax.Array


class Prices(NamedTuple):
    """What is asked of a path.

    Attributes:
        travel: (n,) the price of the square of each joint's step.
        limits: the price of the square of a joint's distance from the middle of its range, in
            halves of it.
        largest_step: how far a joint may move from one rung to the next.
        lower, upper: (n,) the limits.
    """

    travel: jax.Array | np.ndarray
    limits: jax.Array | np.ndarray
    largest_step: jax.Array | np.ndarray
    lower: jax.Array | np.ndarray
    upper: jax.Array | np.ndarray


class Way(NamedTuple):
    """The cheapest way.

    Attributes:
        q: (k, n) joint vectors, up to the last rung that can be reached; the last one after it.
        place: (k,) which of the rung each is.
        reached: () how many rungs can be reached from the first, one after the other.
        cost: () what the way costs; infinite where it does not lead to the end.
    """

    q: jax.Array
    place: jax.Array
    reached: jax.Array
    cost: jax.Array


@functools.partial(jax.jit, static_argnames=("turns",))
def lowest_copies(q: jax.Array, lower: jax.Array | np.ndarray, turns: Turns) -> jax.Array:
    """Joint vectors (..., n), each joint at the lowest angle not below its limit."""
    slack = LIMIT_ROUNDING.of(q.dtype)
    wraps = np.array(turns.copies) * np.array(turns.periodic) > 0
    low = jnp.where(wraps, lower - slack, 0.0)
    return jnp.where(wraps, q - _TURN * jnp.floor((q - low) / _TURN), q)


@functools.partial(jax.jit, static_argnames=("turns",))
def cheapest(rungs: Rungs, prices: Prices, turns: Turns) -> Way:
    """The cheapest way along each of many ladders, (paths, ...)."""
    return jax.vmap(lambda rungs: _cheapest(rungs, prices, turns))(rungs)


def _cheapest(rungs: Rungs, prices: Prices, turns: Turns) -> Way:
    q, dtype = rungs.q, rungs.q.dtype
    count = q.shape[0]
    offsets = _TURN * jnp.asarray(turns.digits, dtype)
    offsets = jnp.where(np.array(turns.periodic), offsets, 0.0)
    copies = len(offsets)
    standing = _standing(rungs, offsets, prices)

    def step(value: jax.Array, rung: tuple[Any, ...]) -> tuple[jax.Array, tuple[jax.Array, ...]]:
        before, q, stands, barred, length = rung
        length = _lengths(before, q, prices, turns) if length is None else length
        length = jnp.where(barred, jnp.inf, length)
        if copies == 1:
            total, source = (length + value[:, 0])[..., None], None
        else:
            source = _sources(before, q, turns)
            begin = jnp.take_along_axis(value[None], jnp.maximum(source, 0), axis=-1)
            total = length[..., None] + jnp.where(source < 0, jnp.inf, begin)
        place = jnp.argmin(total, axis=1)
        least = jnp.min(total, axis=1) + stands
        copy = jnp.zeros_like(place)
        if source is not None:
            copy = jnp.take_along_axis(source, place[:, None], axis=1)[:, 0]
        return least, (least, place.astype(jnp.int32), copy.astype(jnp.int32))

    first = rungs.first + standing[0]
    # One loop over all steps is faster than many short ones, as long as it fits into the memory.
    lengths = _lengths(q[:-1], q[1:], prices, turns) if q.shape[1] <= _FEW else None
    parts = q[:-1], q[1:], standing[1:], rungs.barred, lengths
    _, (values, sources, from_copies) = jax.lax.scan(step, first, parts)
    values = jnp.concatenate([first[None], values])
    alive = jnp.any(jnp.isfinite(values), axis=(1, 2))
    reached = jnp.sum(jnp.cumprod(alive.astype(jnp.int32)))
    whole = values[-1] + rungs.last
    cost = jnp.min(whole)
    end = jnp.maximum(reached - 1, 0)
    ends = jnp.where(jnp.isfinite(cost) & (reached == count), whole, values[end])
    best = jnp.argmin(ends)

    def back(state: jax.Array, rung: _Arrays) -> tuple[jax.Array, jax.Array]:
        number, source, copy = rung
        at, its = state // copies, state % copies
        before = source[at, its] * copies + jnp.maximum(copy[at, its], 0)
        before = jnp.where(number > end, state, before)
        return before.astype(jnp.int32), before.astype(jnp.int32)

    numbers = jnp.arange(1, count)
    state = best.astype(jnp.int32)
    _, states = jax.lax.scan(back, state, (numbers, sources, from_copies), reverse=True)
    states = jnp.concatenate([states, state[None]])
    rung = jnp.minimum(jnp.arange(count), end)
    place = states // copies
    chosen = q[rung, place] + offsets[states % copies]
    return Way(chosen, place, reached, jnp.where(reached == count, cost, jnp.inf))


def _standing(rungs: Rungs, offsets: jax.Array, prices: Prices) -> jax.Array:
    """(k, m, copies) what it costs to stand at the copies, whose offsets are (copies, n); infinite
    outside the limits."""
    dtype, slack = rungs.q.dtype, LIMIT_ROUNDING.of(rungs.q.dtype)
    inside, off = jnp.ones((), bool), jnp.zeros((), dtype)
    q = jnp.moveaxis(rungs.q, -1, 0)
    for each, more, lower, upper in zip(q, offsets.T, prices.lower, prices.upper):
        each = each[..., None] + more
        inside = inside & (each >= lower - slack) & (each <= upper + slack)
        half = 0.5 * (upper - lower)
        bounded = jnp.isfinite(half) & (half > 0)
        share = (each - 0.5 * (upper + lower)) / jnp.where(bounded, half, 1.0)
        off = off + jnp.where(bounded, share * share, 0.0)
    total = rungs.price[..., None] + jnp.where(prices.limits > 0, prices.limits * off, 0.0)
    return jnp.where(inside & rungs.usable[..., None], total, jnp.inf)


def _lengths(before: jax.Array, after: jax.Array, prices: Prices, turns: Turns) -> jax.Array:
    """(..., m, m) the price of each step between rungs (..., m, n), by where it ends and where it
    begins; infinite where a joint moves too far."""
    total, farthest = jnp.zeros((), after.dtype), jnp.zeros((), after.dtype)
    before, after = (jnp.moveaxis(q, -1, 0) for q in (before, after))
    for joint, (count, periodic) in enumerate(zip(turns.copies, turns.periodic)):
        away = after[joint][..., :, None] - before[joint][..., None, :]
        if periodic and count != 1:
            away = away - _TURN * _turns_of(away)
        total = total + prices.travel[joint] * (away * away)
        farthest = jnp.maximum(farthest, jnp.abs(away))
    slack = LIMIT_ROUNDING.of(after.dtype)
    return jnp.where(farthest <= prices.largest_step + slack, total, jnp.inf)


def _sources(before: jax.Array, after: jax.Array, turns: Turns) -> jax.Array:
    """(m, m, copies) the copy that each copy comes from, by where a step ends and where it begins;
    -1 where there is none."""
    digits, strides = turns.digits, turns.strides
    shape = len(after), len(before), len(digits)
    number, outside = jnp.zeros(shape, jnp.int32), jnp.zeros(shape, bool)
    for joint, (count, periodic) in enumerate(zip(turns.copies, turns.periodic)):
        # A joint with one copy does not wrap: a turn is farther than any step.
        if periodic and count > 1:
            whole = _turns_of(after[:, None, joint] - before[None, :, joint])
            digit = digits[:, joint] + whole.astype(jnp.int32)[..., None]
            outside = outside | (digit < 0) | (digit >= count)
            number = number + int(strides[joint]) * digit
    return jnp.where(outside, -1, number)


def _turns_of(angle: jax.Array) -> jax.Array:
    """The nearest number of whole turns."""
    return jnp.floor(angle / _TURN + 0.5)
