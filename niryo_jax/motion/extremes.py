"""The largest of many numbers, and its derivative, which is that of one of them.

That of `jnp.max` is shared among all that equal it. Where a compiler computes them again, with
another rounding, none does, and 0 is divided by 0.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def largest(values: jax.Array, axes: int = 1) -> jax.Array:
    """Over so many last axes."""
    return jnp.max(values, axis=tuple(range(-axes, 0)))


@largest.defjvp
def _largest_jvp(axes: int, given: Any, rates: Any) -> tuple[jax.Array, jax.Array]:
    (values,), (rate,) = given, rates
    flat, rate = (x.reshape(*x.shape[:-axes], math.prod(x.shape[-axes:])) for x in (values, rate))
    place = jnp.argmax(flat, axis=-1, keepdims=True)
    return largest(values, axes), jnp.take_along_axis(rate, place, axis=-1)[..., 0]


@jax.custom_jvp
def least(values: jax.Array) -> jax.Array:
    """Over the first axis."""
    return jnp.min(values, axis=0)


@least.defjvp
def _least_jvp(given: Any, rates: Any) -> tuple[jax.Array, jax.Array]:
    (values,), (rate,) = given, rates
    place = jnp.argmin(values, axis=0, keepdims=True)
    return least(values), jnp.take_along_axis(rate, place, axis=0)[0]
