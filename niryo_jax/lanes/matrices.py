"""Products of arrays of matrices, for what is not written on lanes."""

from __future__ import annotations

import jax
import jax.numpy as jnp


def product(a: jax.Array, b: jax.Array) -> jax.Array:
    """(..., m, k) times (..., k, n), in their precision: by default a GPU rounds factors in float32
    to ten bits."""
    return jnp.matmul(a, b, precision="highest")
