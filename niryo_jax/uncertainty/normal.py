"""Normal variates, a factor of their covariance, and how far from the middle a share of them is."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.arguments import check_number
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import on_lanes
from niryo_jax.tolerances import DEPENDENT_ROW


def standard_normal(key: ArrayLike, shape: tuple[int, ...], dtype: np.dtype) -> jax.Array:
    """Independent standard normal variates, two of each pair of uniform ones (Box & Muller, 1958).

    The sines of `lanes` make this several times faster than `jax.random.normal`, which inverts the
    error function.
    """
    total = math.prod(shape)
    u, v = jax.random.uniform(key, (2, (total + 1) // 2), dtype)
    # 1 - u is never 0.
    radius = lanes.materialise(Lane(jnp.sqrt(-2.0 * jnp.log1p(-u))))
    sin, cos = map(lanes.materialise, lanes.sincos(Lane(2.0 * np.pi * v)))
    pair = [(radius * part).array for part in (cos, sin)]
    return jnp.concatenate(pair)[:total].reshape(shape)


def factor(covariance: jax.Array) -> jax.Array:
    """(..., n, n) lower triangular L with L L^T = covariance, which may be semidefinite.

    What depends on the joints before it, to rounding, has a column of zeros; there and elsewhere
    derivatives are finite.
    """
    n = covariance.shape[-1]
    tolerance = DEPENDENT_ROW.of(covariance.dtype)

    def lower(matrix: Lanes) -> Lanes:
        out = lanes.lanes_of(np.zeros((n, n)))
        for j in range(n):
            rest = matrix[j, j] - lanes.dot(out[j, :j], out[j, :j])
            pivot = lanes.sqrt(lanes.select(rest > tolerance * matrix[j, j], rest, 0.0))
            some = pivot > 0.0
            reciprocal = lanes.select(some, 1.0 / lanes.select(some, pivot, 1.0), 0.0)
            out[j, j] = pivot
            for i in range(j + 1, n):
                out[i, j] = (matrix[i, j] - lanes.dot(out[i, :j], out[j, :j])) * reciprocal
        return out

    return on_lanes(lower, ("covariance", covariance, (n, n)))


def radius_of(probability: float) -> float:
    """The r within which a standard normal vector of three numbers is with a probability.

    r^2 is the quantile of the chi-square distribution with three degrees of freedom, whose
    distribution function is P(3/2, r^2 / 2) = erf(r / sqrt 2) - sqrt(2 / pi) r exp(-r^2 / 2).

    Raises:
        TypeError: no number. ValueError: one that is not between 0 and 1.
    """
    given = check_number(
        "probability", probability, "a probability between 0 and 1", lambda p: 0.0 < p < 1.0
    )
    # Newton's method from the steepest point, r = sqrt 2, comes nearer from one side at each step.
    r = math.sqrt(2.0)
    for _ in range(200):
        density = math.sqrt(2.0 / math.pi) * r * math.exp(-0.5 * r * r)
        above = math.erfc(r / math.sqrt(2.0)) + density
        step = (above - (1.0 - given)) / (density * r)
        r += step
        if abs(step) <= 1e-15 * r:
            break
    return r
