"""Moves of one joint from rest to rest, as short as its limits allow.

A move of length h under limits v, a and j of velocity, acceleration and jerk whose velocity peaks
at p takes A(p) seconds to speed up and as many to slow down, in which it goes p A(p); the rest of h
is done at the velocity p. So T = h / p + A(p), with the peak p = min(v, w) and w A(w) = h (Lynch &
Park, section 9.2.2.2 for the trapezoid; Biagiotti & Melchiorri, Trajectory Planning for Automatic
Machines and Robots, sections 3.2.2 and 3.4.1).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax.motion.limits import MotionLimits
from niryo_jax.motion.time_scaling import quintic

Profile = Literal["trapezoid", "quintic", "scurve"]


class Motion(NamedTuple):
    """Where a joint is on its way, and its rates.

    Attributes:
        s: (...) from 0 on, radians (metres).
        velocity, acceleration: (...) per second and per second squared.
    """

    s: jax.Array
    velocity: jax.Array
    acceleration: jax.Array


class Shape(NamedTuple):
    """A move in closed form; all of them (...), of one joint each.

    Attributes:
        length: h, 0 or more.
        duration: T, 0 where the length is.
        rise: seconds in which the acceleration rises, and as many in which it falls again.
        hold: seconds between, in which it is the largest.
        top: the largest acceleration.
    """

    length: jax.Array
    duration: jax.Array
    rise: jax.Array
    hold: jax.Array
    top: jax.Array


def shape_of(profile: Profile, length: jax.Array, limits: MotionLimits) -> Shape:
    """The shortest move of a profile: lengths (..., n) of joints with these limits."""
    moves = length > 0
    # A length in the place of none, so that roots have derivatives.
    h = jnp.where(moves, length, 1.0)
    v, a = jnp.broadcast_arrays(limits.velocity, limits.acceleration, h)[:2]
    j = limits.jerk
    if profile == "quintic":
        duration = jnp.maximum(15.0 / 8.0 * h / v, jnp.sqrt(10.0 / 3.0**0.5 * h / a))
        if j is not None:
            duration = jnp.maximum(duration, jnp.cbrt(60.0 * h / j))
        rise = hold = top = jnp.zeros_like(h)
    elif profile == "trapezoid" or j is None:
        peak = jnp.minimum(v, jnp.sqrt(h * a))
        rise, hold, top = jnp.zeros_like(h), peak / a, a
        duration = h / peak + hold
    else:
        j = jnp.broadcast_to(j, h.shape)
        # Speeding up to a^2 / j, the acceleration just comes to its limit; on the way there and
        # back, 2 a^3 / j^2 are done.
        bound = h > 2.0 * a**3 / j**2
        rest = jnp.where(bound, h, 4.0 * a**3 / j**2)
        unbounded = jnp.cbrt(h * h * j / 4.0)
        bounded = 0.5 * a * (jnp.sqrt((a / j) ** 2 + 4.0 * rest / a) - a / j)
        peak = jnp.minimum(v, jnp.where(bound, bounded, unbounded))
        rise = jnp.minimum(jnp.sqrt(peak / j), a / j)
        top = j * rise
        hold = jnp.maximum(peak / top - rise, 0.0)
        duration = h / peak + 2.0 * rise + hold
    parts = (length, duration, rise, hold, top)
    return Shape(*(jnp.where(moves, part, 0.0) for part in parts))


def at(profile: Profile, shape: Shape, t: jax.Array) -> Motion:
    """A move at times t (...), which broadcast; at rest before 0 and after its duration."""
    length, total = shape.length, shape.duration
    safe = jnp.where(total > 0, total, 1.0)
    inside = (t > 0) & (t < total)
    u = jnp.where(inside, t, 0.0)
    if profile == "quintic":
        share, rate, acceleration = quintic(u / safe)
        done = Motion(length * share, length * rate / safe, length * acceleration / safe**2)
    else:
        # The way back in time is that of the way there.
        late = u > 0.5 * total
        half = _speeding_up(shape, jnp.where(late, total - u, u))
        done = Motion(
            jnp.where(late, length - half.s, half.s),
            half.velocity,
            jnp.where(late, -half.acceleration, half.acceleration),
        )
    # Exact at both ends, whatever the rounding of what is between.
    s = jnp.where(inside, done.s, jnp.where(t > 0, length, 0.0))
    return Motion(s, *(jnp.where(inside, rate, 0.0) for rate in done[1:]))


def _speeding_up(shape: Shape, t: jax.Array) -> Motion:
    """The first half: the acceleration rises, is held, falls; then the velocity is held."""
    rise, hold, top = shape.rise, shape.hold, shape.top
    rises = rise > 0
    jerk = jnp.where(rises, top / jnp.where(rises, rise, 1.0), 0.0)
    s = velocity = jnp.zeros_like(t)
    acceleration = jnp.where(rises, 0.0, top)
    for start, seconds, third in (
        (jnp.zeros_like(rise), rise, jerk),
        (rise, hold, jnp.zeros_like(jerk)),
        (rise + hold, rise, -jerk),
    ):
        past = jnp.clip(t - start, 0.0, seconds)
        s = s + past * (velocity + past * (acceleration / 2.0 + past * third / 6.0))
        velocity = velocity + past * (acceleration + past * third / 2.0)
        acceleration = acceleration + past * third
    end = 2.0 * rise + hold
    return Motion(
        s + velocity * jnp.maximum(t - end, 0.0), velocity, jnp.where(t < end, acceleration, 0.0)
    )
