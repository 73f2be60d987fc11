"""Joint limits and whole turns."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.tolerances import LIMIT_ROUNDING

Limits = tuple[jax.Array, jax.Array]
"""Lower and upper (n,)."""


def nearest_turn(
    q: jax.Array, target: jax.Array, lower: jax.Array, upper: jax.Array, periodic: tuple[bool, ...]
) -> jax.Array:
    """q shifted by whole turns to lie as near to `target` as the limits allow.

    A joint that no turn brings within its limits comes as near to `target` as a turn can.
    """
    turns = jnp.round((target - q) / (2 * jnp.pi))
    rounding = LIMIT_ROUNDING.of(q.dtype)
    most = jnp.floor((upper - q + rounding) / (2 * jnp.pi))
    least = jnp.ceil((lower - q - rounding) / (2 * jnp.pi))
    allowed = jnp.where(most >= least, jnp.clip(turns, least, most), turns)
    return q + jnp.where(jnp.array(periodic), 2 * jnp.pi * allowed, 0.0)


def wrap_into_limits(
    q: jax.Array, lower: jax.Array, upper: jax.Array, periodic: tuple[bool, ...]
) -> jax.Array:
    """Angles in (-pi, pi], or the turn nearest to that range which lies within the limits.

    Todorovic et al., eq. 2.
    """
    wrapped = q - 2 * jnp.pi * jnp.ceil((q - jnp.pi) / (2 * jnp.pi))
    # Rounding can leave the angle a hair outside on either side; zero turns is then the answer.
    wrapped = jnp.where(jnp.array(periodic), wrapped, q)
    inside = (wrapped >= lower) & (wrapped <= upper)
    turned = nearest_turn(wrapped, jnp.zeros_like(q), lower, upper, periodic)
    return jnp.where(inside, wrapped, turned)


def without_whole_turns(difference: jax.Array, periodic: tuple[bool, ...]) -> jax.Array:
    """Differences (..., n) of joint vectors less the whole turns in them."""
    turns = jnp.round(difference / (2 * jnp.pi))
    return difference - jnp.where(jnp.array(periodic), 2 * jnp.pi * turns, 0.0)


def limit_margin(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """(..., n) -> (...,): the least distance of a joint to a limit, negative outside, radians."""
    return jnp.min(jnp.minimum(q - lower, upper - q), axis=-1)


def are_within_limits(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """(..., n) -> (...,): whether every joint lies within its limits, up to rounding."""
    return limit_margin(q, lower, upper) >= -LIMIT_ROUNDING.of(q.dtype)


def limits_of(lower: ArrayLike, upper: ArrayLike, dtype: jnp.dtype) -> Limits:
    """The joint limits in the dtype of the computation."""
    return jnp.asarray(lower, dtype), jnp.asarray(upper, dtype)
