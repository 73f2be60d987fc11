"""Equal time steps, as a controller takes them."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_fits, check_positive

_ROUNDING = 1e-6
"""A share of a step by which a duration may miss a whole number of steps."""


def every_step(step: Any, duration: jax.Array, numbers: int) -> jax.Array:
    """Times (k,) from 0 to the first whole step at or after the longest of durations (...).

    `numbers` is how many numbers a time takes of all that lasts so long.

    Raises:
        ValueError: a step that is not positive, more samples than memory has room for.
        TypeError: no number; durations that are traced.
    """
    seconds = check_positive("step", step, "a positive number of seconds")
    if not is_concrete(duration):
        raise TypeError("every: expected a concrete duration, got a traced one; use at(time)")
    longest = float(np.max(np.asarray(duration), initial=0.0))
    count = check_fits("samples", 1 + math.ceil(longest / seconds - _ROUNDING), 1, 4 * numbers)
    return jnp.asarray(seconds * np.arange(count), duration.dtype)
