"""The fastest way along a given path: time-optimal path parametrisation by reachability.

With x = (ds/dt)^2 and u = d2s/dt2, limits of velocity bound x, and limits of acceleration are
|q' u + q'' x| <= a for each joint, linear in both. Between two nodes of s the u is constant, so
that x at the next is x + 2 du, with d the distance. Backwards from rest, the largest x at each node
from which the next can be done; forwards from rest, the largest u that stays below those (Pham &
Pham, A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis, 2018).
Rest is possible everywhere, so that nothing else bounds x from below.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax.motion.extremes import least
from niryo_jax.tolerances import ACCELERATION

CHECKED = 3
"""Places of an interval at which accelerations are bounded: both its ends and the middle."""

_HUGE = 1e15


class Rows(NamedTuple):
    """Bounds |p u + c x| <= 1 of intervals, of which x and u are those of the start.

    Attributes:
        p, c: (intervals, rows, paths), of which p is 0 or more.
    """

    p: jax.Array
    c: jax.Array


def squared_rates(slope: jax.Array, bend: jax.Array, most: jax.Array, step: jax.Array) -> jax.Array:
    """The largest x = (ds/dt)^2 at nodes of s, of which the first and the last are rest.

    Args:
        slope, bend: (..., intervals, CHECKED, n) first and second derivatives by s of each joint in
            units of its largest acceleration, at the start, the middle and the end of intervals.
        most: (..., intervals + 1) the largest x that velocities allow at the nodes.
        step: (..., intervals) between two nodes.

    Returns:
        (..., intervals + 1).
    """
    batch, intervals = slope.shape[:-3], slope.shape[-3]
    ahead = step[..., None] * jnp.linspace(0.0, 2.0, CHECKED, dtype=slope.dtype)
    ahead = ahead[..., None]
    p, c = slope + ahead * bend, bend
    rows = Rows(jnp.abs(p), jnp.where(p < 0, -c, c))
    # Along the path first, then the rows, paths last: one loop over all paths for each row.
    along = Rows(
        *(x.reshape(-1, intervals, CHECKED * x.shape[-1]).transpose(1, 2, 0) for x in rows)
    )
    one = 1.0 + ACCELERATION.of(slope.dtype)
    bounds = jnp.minimum(most, _HUGE).reshape(-1, intervals + 1).T
    twice = 2.0 * step.reshape(-1, intervals).T
    rest = jnp.zeros_like(bounds[0])

    def back(
        after: jax.Array, given: tuple[Rows, jax.Array, jax.Array]
    ) -> tuple[jax.Array, jax.Array]:
        rows, twice, bound = given
        here = jnp.minimum(bound, _largest_start(rows, after, twice))
        return here, here

    def forth(
        before: jax.Array, given: tuple[Rows, jax.Array, jax.Array]
    ) -> tuple[jax.Array, jax.Array]:
        rows, twice, after = given
        pushes = rows.p > 0
        room = (one - rows.c * before) / jnp.where(pushes, rows.p, 1.0)
        u = least(jnp.where(pushes, room, jnp.inf))
        here = jnp.maximum(jnp.minimum(before + twice * u, after), 0.0)
        return here, here

    _, possible = jax.lax.scan(back, rest, (along, twice, bounds[:-1]), reverse=True)
    possible = jnp.concatenate([possible[1:], rest[None]])
    _, x = jax.lax.scan(forth, rest, (along, twice, possible))
    return jnp.concatenate([rest[None], x]).T.reshape(*batch, intervals + 1)


def _largest_start(rows: Rows, after: jax.Array, step: jax.Array) -> jax.Array:
    """The largest x (paths,) from which some u keeps all rows and 0 <= x + step u <= after.

    Each row bounds u from below and from above by lines in x; there is a u where each bound from
    below is below each from above (Fourier and Motzkin). Multiplied out, nothing is divided by p.
    """
    next_p = step[None]
    p = jnp.concatenate([rows.p, next_p])
    c = jnp.concatenate([rows.c, jnp.ones_like(next_p)])
    ones = jnp.ones_like(rows.p)
    above = jnp.concatenate([ones, after[None]])
    below = jnp.concatenate([ones, jnp.zeros_like(next_p)])
    # [l, m]: the lower bound of row l is at most the upper bound of row m.
    factor = p[:, None] * c - p * c[:, None]
    right = p[:, None] * above + p * below[:, None]
    binds = factor > 0
    bound = jnp.where(binds, right / jnp.where(binds, factor, 1.0), jnp.inf)
    return least(bound.reshape(len(p) ** 2, *after.shape))
