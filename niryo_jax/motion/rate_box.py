"""The joint rates that limits leave: limits of rates, of accelerations, of positions a step on."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

Box = tuple[jax.Array, jax.Array]
"""The least and the greatest rates."""


class RateLimits(NamedTuple):
    """What limits joint rates; batch axes broadcast, None where there is no such limit.

    Attributes:
        rate: (..., n) the fastest, rad/s (m/s for prismatic joints).
        acceleration: (..., n) by how much a rate may change in a second.
        previous: (..., n) the rates before; with `acceleration`.
        step: (...,) seconds that the rates are kept; with `acceleration` or limits of positions.
        lower, upper: (n,) limits of positions.
    """

    rate: jax.Array | None = None
    acceleration: jax.Array | None = None
    previous: jax.Array | None = None
    step: jax.Array | None = None
    lower: jax.Array | None = None
    upper: jax.Array | None = None


def rate_box(q: jax.Array, limits: RateLimits) -> Box:
    """The least and the greatest rates at joint vectors q (..., n), both (..., n); step (..., 1).

    Limits of rates always hold, those of accelerations as far as these let them, and those of
    positions as far as both let them. A joint inside its limits so stays inside, and one outside
    goes back as fast as it may.
    """
    rate, acceleration, previous, step, lower, upper = limits
    box = jnp.full_like(q, -jnp.inf), jnp.full_like(q, jnp.inf)
    if rate is not None:
        box = _within(-rate, rate, box)
    if acceleration is not None and previous is not None and step is not None:
        change = acceleration * step
        box = _within(previous - change, previous + change, box)
    if lower is not None and upper is not None and step is not None:
        box = _within(
            -_towards(q - lower, step, acceleration), _towards(upper - q, step, acceleration), box
        )
    return box


def _within(least: jax.Array, most: jax.Array, box: Box) -> Box:
    """An interval, moved into another where it does not meet it."""
    return jnp.clip(least, *box), jnp.clip(most, *box)


def _towards(room: jax.Array, step: jax.Array, acceleration: jax.Array | None) -> jax.Array:
    """The fastest rate towards a limit that is so far away.

    Without limits of acceleration it is there a step on. With them v step + v^2 / (2 acceleration)
    is the room, the second for braking afterwards; v - acceleration step then satisfies the same
    for what is left of the room, so that the limit can be kept to the end.
    """
    # Neither an infinite room nor the root of a negative one has a derivative.
    limited = jnp.isfinite(room)
    room = jnp.where(limited, room, 1.0)
    rate = room / step
    if acceleration is not None:
        inside = room > 0
        # Without the difference of root and step, of which rounding is all that is left.
        root = jnp.sqrt(step * step + 2.0 * jnp.where(inside, room, 0.0) / acceleration)
        rate = jnp.where(inside, 2.0 * room / (root + step), rate)
    return jnp.where(limited, rate, jnp.inf)
