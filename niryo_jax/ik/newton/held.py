"""What a caller holds of an arm with a joint to spare: one more equation for its joints."""

from __future__ import annotations

from typing import Literal

import jax
import jax.numpy as jnp

from niryo_jax.ik.closed_form.srs import angle_of
from niryo_jax.specialise import Geometry

Held = int | Literal["arm angle"] | None
"""What stays as it is: the index of a joint, the arm angle, or nothing."""


def held_value(geometry: Geometry, q: jax.Array, held: Held) -> jax.Array:
    """(..., n) -> (...,) the value of what is held."""
    return angle_of(geometry, q) if held == "arm angle" else q[..., held]


def held_row(geometry: Geometry, q: jax.Array, held: Held) -> jax.Array:
    """(r, n) -> (n, r) its derivative."""
    return jax.grad(lambda q: jnp.sum(held_value(geometry, q, held)))(q).T
