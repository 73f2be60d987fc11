"""Shares of the velocities that are allowed along parts of a path."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import shown
from niryo_jax.lanes.batching import as_floating
from niryo_jax.motion.spline import before, chord_shares, looked_up
from niryo_jax.tolerances import SAME_WAYPOINT


def as_pace(pace: ArrayLike, q: jax.Array) -> jax.Array:
    """Shares (..., k - 1) for joint vectors (..., k, n).

    Raises:
        ValueError: a shape that does not broadcast to that, shares that are not in (0, 1].
        TypeError: no numbers.
    """
    given = as_floating("pace", pace).astype(q.dtype)
    expected = (*q.shape[:-2], q.shape[-2] - 1)
    try:
        shares = jnp.broadcast_to(given, expected)
    except ValueError:
        raise ValueError(
            f"pace: expected shape {expected}, one share for each sample but the last, "
            f"got {given.shape}"
        ) from None
    if is_concrete(shares):
        numbers = np.asarray(shares)
        if not np.all((numbers > 0) & (numbers <= 1)):
            raise ValueError(f"pace: expected shares in (0, 1], got {shown(pace)}")
    return shares


@jax.jit
def pace_at(q: jax.Array, pace: jax.Array, s: jax.Array) -> jax.Array:
    """Shares (..., m) at places s of paths through joint vectors (..., k, n), of which those from
    each to the next are `pace` (..., k - 1); at a sample the smaller of both."""
    knots, _ = chord_shares(q)
    near = SAME_WAYPOINT.of(s.dtype)
    sides = (before(knots, s - near, "left"), before(knots, s + near, "right"))
    table, last = pace[..., None], pace.shape[-1] - 1
    either = (looked_up(table, jnp.clip(row, 0, last))[..., 0] for row in sides)
    return jnp.minimum(*either)
