"""When a path of joint vectors is where, under limits of its joints and of the tool."""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_choice, check_fits
from niryo_jax.execution.compaction import at_once
from niryo_jax.execution.padding import cut_rows, padded_rows
from niryo_jax.jacobian import body_jacobian
from niryo_jax.lanes.matrices import product
from niryo_jax.motion.best_path import BestPath
from niryo_jax.motion.extremes import largest
from niryo_jax.motion.fastest import CHECKED, squared_rates
from niryo_jax.motion.limits import CartesianLimits, MotionLimits, as_arrays, check_limits_of
from niryo_jax.motion.pace import as_pace, pace_at
from niryo_jax.motion.path_checks import as_samples, check_arm, check_between, check_samples
from niryo_jax.motion.spline import Place, Spline, nodes_of, norm, place_at, root, spline_through
from niryo_jax.motion.time_scaling import quintic
from niryo_jax.motion.timed_path import Method, TimedPath
from niryo_jax.robot import Robot

INTERVALS = 4096
"""Between equally spaced nodes of a path, unless it has more than half as many samples."""

_FINER = CHECKED - 1
"""So many places of each interval are looked at."""

_ON_A_CORE, _ON_ACCELERATOR = 4, 256
"""Paths that are timed at a time: what is looked at takes megabytes a path."""

_LEAST = 1e-7
"""Where joints move by less than this share of the most, velocities do not bound the path."""


def retime(
    path: ArrayLike | BestPath,
    limits: MotionLimits,
    *,
    robot: Robot | None = None,
    cartesian: CartesianLimits | None = None,
    pace: ArrayLike | None = None,
    method: Method = "fastest",
    intervals: int | None = None,
) -> TimedPath:
    """When a path is where, so that it is done fast within limits, from rest to rest.

    The path is the cubic spline through its samples, parametrised by the length of the chords
    between them in joint space; the spline is twice continuously differentiable, and samples that
    repeat the one before are left out. Where the discrete optimum passes an acceleration within an
    interval, or a velocity in its middle, time is stretched by as much: so accelerations are within
    their limits everywhere to rounding, velocities to 0.01 %.

    Args:
        path: (..., k, n) joint vectors, radians (metres for prismatic joints), in the order of the
            path; or what `best_path` found.
        limits: of the joints. Jerk is bounded by the method "quintic" alone.
        robot: the arm; with it, a path that leaves its joint limits is refused.
        cartesian: limits of the tool, which need the arm.
        pace: (..., k - 1) the shares of all velocities, 0 to 1, that are allowed from each sample
            to the next, as `limits.scaled(share)` does along the whole path; 1 where not given.
        method: "fastest": time-optimal, with accelerations that jump (`motion.fastest`). "quintic":
            `quintic_time_scaling` along the whole path, in the shortest time that the limits allow:
            smooth, and longer.
        intervals: into how many the path is cut, 4 k or more; 4,096 where not given, or the first
            power of two that is at least 8 k.

    Returns:
        A `TimedPath`. Of joint vectors that are all the same the duration is 0. Differentiable.

    Raises:
        ValueError: wrong shapes, numbers that are not finite, a path that leaves the joint limits
            of the arm, or that `best_path` did not finish; limits of another number of joints,
            of the tool without an arm; a pace that is not in (0, 1]; an unknown method.
        TypeError: no arrays of numbers, no limits, no arm.
    """
    q = as_samples(path)
    count, n = q.shape[-2:]
    limits = as_arrays(check_limits_of(limits, n), q.dtype)
    check_choice("method", method, ("fastest", "quintic"))
    if intervals is None:
        intervals = max(INTERVALS, 1 << (8 * count - 1).bit_length())
    paths = math.prod(q.shape[:-2])
    numbers = 4 * paths + 12 * _FINER * min(paths, _ON_ACCELERATOR) * n
    most = check_fits("intervals", intervals, 4 * max(count, 2), numbers)
    check_arm(robot, cartesian, n)
    if robot is not None:
        check_samples(robot, q)
    batch = q.shape[:-2]
    allowed = None if pace is None else as_pace(pace, q)
    block = min(paths, at_once(_ON_A_CORE, _ON_ACCELERATOR)) if is_concrete(q) else paths
    # Few programs: as many samples as a power of two, the last of them repeated, and full blocks.
    size = max(2, 1 << (count - 1).bit_length())
    last = jnp.broadcast_to(q[..., -1:, :], (*batch, size - count, n))
    rows = jnp.concatenate([q, last], axis=-2)
    whole = -(-paths // max(block, 1)) * block
    rows = padded_rows(rows, len(batch), whole, mode="edge")
    if allowed is not None:
        ones = jnp.ones((*batch, size - count), q.dtype)
        allowed = jnp.concatenate([allowed, ones], axis=-1)
        allowed = padded_rows(allowed, len(batch), whole, mode="edge")
    timed: list[TimedPath] = []
    for first in range(0, max(len(rows), 1), max(block, 1)):
        spline = spline_through(rows[first : first + block])
        u, s = _shares(spline, most, method)
        place = _places(spline, s)
        if robot is not None:
            check_between(robot, rows[first : first + block], s, place.q, first, batch)
        fastest = _most_rate(limits, cartesian, place, _tool_rates(robot, cartesian, place))
        if allowed is not None:
            fastest = fastest * pace_at(
                rows[first : first + block], allowed[first : first + block], s
            )
        core = _fast if method == "fastest" else _smooth
        timed.append(core(spline, u, place, limits, fastest))
    return jax.tree.map(lambda *parts: cut_rows(jnp.concatenate(parts), batch), *timed)


_places = jax.jit(place_at)


@functools.partial(jax.jit, static_argnums=(1, 2))
def _shares(spline: Spline, intervals: int, method: Method) -> tuple[jax.Array, jax.Array]:
    """Shares (..., m) of the path, or of the duration of a quintic, and the places s there.

    They are at `_FINER` equal parts of each interval, and every piece of the spline has some.
    """
    knots = spline.knots if method == "fastest" else _quintic_inverse(spline.knots)
    nodes = nodes_of(knots, intervals)
    part = jnp.arange(_FINER, dtype=nodes.dtype) / _FINER
    parts = nodes[..., :-1, None] + part * (nodes[..., 1:] - nodes[..., :-1])[..., None]
    parts = parts.reshape(*nodes.shape[:-1], _FINER * intervals)
    u = jnp.concatenate([parts, nodes[..., -1:]], axis=-1)
    return u, u if method == "fastest" else quintic(u).s


def _quintic_inverse(s: jax.Array) -> jax.Array:
    """The share of the duration after which a quintic has done shares s, by bisection."""

    def halve(_: int, ends: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        early = quintic(middle).s < s
        return jnp.where(early, middle, low), jnp.where(early, high, middle)

    s = jax.lax.stop_gradient(s)
    low, _ = jax.lax.fori_loop(0, 48, halve, (jnp.zeros_like(s), jnp.ones_like(s)))
    return jnp.where(s < 1.0, low, 1.0)


def _tool_rates(
    robot: Robot | None, cartesian: CartesianLimits | None, place: Place
) -> tuple[jax.Array, jax.Array] | None:
    """What the tool turns and moves per change of s, (..., m) each."""
    if robot is None or cartesian is None:
        return None
    twist = product(body_jacobian(robot, place.q), place.slope[..., None])[..., 0]
    # In the tool frame the linear part is the velocity of the frame's origin.
    return norm(twist[..., :3]), norm(twist[..., 3:])


@jax.jit
def _most_rate(
    limits: MotionLimits,
    cartesian: CartesianLimits | None,
    place: Place,
    tool: tuple[jax.Array, jax.Array] | None,
) -> jax.Array:
    """The largest ds/dt that velocities allow, (..., m)."""
    share = largest(jnp.abs(place.slope) / limits.velocity)
    if tool is not None and cartesian is not None:
        for rate, bound in zip(tool, (cartesian.angular, cartesian.linear)):
            share = jnp.maximum(share, rate / bound)
    most = largest(share)[..., None]
    return 1.0 / jnp.maximum(share, jnp.where(most > 0, _LEAST * most, 1.0))


@jax.jit
def _fast(
    spline: Spline, s: jax.Array, place: Place, limits: MotionLimits, fastest: jax.Array
) -> TimedPath:
    """The method "fastest", of places s at `_FINER` parts of each interval."""
    s = s[..., ::_FINER]
    nodes, step = s.shape[-1], s[..., 1:] - s[..., :-1]
    # In float32, nodes may coincide.
    apart = step > 0
    safe = jnp.where(apart, step, 1.0)

    def within(array: jax.Array) -> jax.Array:
        """The places (..., intervals, CHECKED) of each interval, its ends included."""
        axis = array.ndim - (2 if array.ndim > fastest.ndim else 1)
        fine = jnp.moveaxis(array, axis, -1)
        start = fine[..., :-1].reshape(*fine.shape[:-1], nodes - 1, _FINER)
        both = jnp.concatenate([start, fine[..., _FINER::_FINER, None]], axis=-1)
        return jnp.moveaxis(both, (-2, -1), (axis, axis + 1))

    slope, bend = (within(x / limits.acceleration) for x in (place.slope, place.bend))
    x = squared_rates(slope, bend, fastest[..., ::_FINER] ** 2, step)
    before, after = x[..., :-1], x[..., 1:]
    part = jnp.linspace(0.0, 1.0, CHECKED, dtype=x.dtype)
    along = before[..., None] + part * (after - before)[..., None]
    u = jnp.where(apart, 0.5 * (after - before) / safe, 0.0)[..., None, None]
    pushed = _highest(slope * u + bend * along[..., None])
    beyond = largest(root(along) / within(fastest), 2)
    beyond = jnp.maximum(beyond, root(largest(pushed, 2)))
    # In the discrete optimum something is at its limit: stretched to that.
    rate = root(x) / jnp.where(beyond > 0, beyond, 1.0)[..., None]
    mean = 0.5 * (rate[..., 1:] + rate[..., :-1])
    moves = (spline.length > 0)[..., None] & (mean > 0)
    seconds = jnp.where(moves, step / jnp.where(moves, mean, 1.0), 0.0)
    time = jnp.concatenate([jnp.zeros_like(x[..., :1]), jnp.cumsum(seconds, axis=-1)], axis=-1)
    return TimedPath(spline, time, s, rate, "fastest")


def _highest(values: jax.Array) -> jax.Array:
    """The largest absolute value (..., n) of parabolas of values (..., 3, n) at equal steps.

    The acceleration of a joint is one in s: no knot of the spline lies within an interval.
    """
    start, middle, end = (values[..., i, :] for i in range(CHECKED))
    rise, bend = 0.5 * (end - start), start - 2.0 * middle + end
    # What bends by less than rounding is flat.
    turns = (jnp.abs(rise) < jnp.abs(bend)) & (jnp.abs(bend) > jnp.finfo(bend.dtype).eps)
    peak = middle - 0.5 * rise * jnp.where(turns, rise / jnp.where(turns, bend, 1.0), 0.0)
    ends = jnp.maximum(jnp.abs(start), jnp.abs(end))
    return jnp.maximum(jnp.maximum(ends, jnp.abs(middle)), jnp.abs(peak))


@jax.jit
def _smooth(
    spline: Spline, u: jax.Array, place: Place, limits: MotionLimits, fastest: jax.Array
) -> TimedPath:
    """The method "quintic", of places at shares u of its duration."""
    law = quintic(u)
    first, second = law.rate[..., None], law.acceleration[..., None]
    third = (60.0 - 360.0 * u * (1.0 - u))[..., None]
    pushed = place.slope * second + place.bend * first**2
    duration = jnp.maximum(
        largest(law.rate / fastest), root(largest(jnp.abs(pushed) / limits.acceleration, 2))
    )
    if limits.jerk is not None:
        jolt = place.slope * third + 3.0 * place.bend * first * second + place.third * first**3
        cube = largest(jnp.abs(jolt) / limits.jerk, 2)
        duration = jnp.maximum(
            duration, jnp.where(cube > 0, jnp.cbrt(jnp.where(cube > 0, cube, 1.0)), 0.0)
        )
    duration = jnp.where(spline.length > 0, duration, 0.0)
    ends = jnp.stack([jnp.zeros_like(duration), jnp.ones_like(duration)], axis=-1)
    return TimedPath(spline, ends * duration[..., None], ends, jnp.zeros_like(ends), "quintic")
