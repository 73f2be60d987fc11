"""Real trigonometric polynomials of degree 8: from values to coefficients, and roots on arcs.

On an arc, g times a positive number is a form of degree 16. It has at most as many roots there as
its 17 Bernstein coefficients have changes of sign, and as many but for an even number (Descartes'
rule; roots that are complex but lie next to the arc count). Coefficients within the noise are taken
for what makes most changes.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.lanes import Lane
from niryo_jax.lanes.matrices import product
from niryo_jax.structure.closure import NODES
from niryo_jax.tolerances import POLYNOMIAL_NOISE

DEGREE = 8
COEFFICIENTS = 2 * DEGREE + 1
FORM = 2 * DEGREE

UNBOUNDED = 2 * FORM
"""More roots than there can be."""


class Polynomial(NamedTuple):
    """g of poses, scaled such that its largest value at a node is 1.

    Attributes:
        coefficients: (17, rows) the constant, the real parts of c_1 ... c_8, the imaginary parts.
        noise: (rows,) the size of what is no polynomial of that degree in it.
    """

    coefficients: jax.Array
    noise: jax.Array

    @property
    def margin(self) -> jax.Array:
        """(rows,) how far a coefficient of a form may be from what is computed."""
        least = float(jnp.finfo(self.noise.dtype).eps) * 5
        return POLYNOMIAL_NOISE * jnp.maximum(self.noise, least)


def nodes(dtype: jax.typing.DTypeLike) -> tuple[jax.Array, jax.Array]:
    """Cosine and sine of the equidistant nodes, (20,)."""
    t = 2 * np.pi * np.arange(NODES) / NODES
    return jnp.asarray(np.cos(t), dtype), jnp.asarray(np.sin(t), dtype)


def interpolated(values: jax.Array) -> Polynomial:
    """g from its values (20, rows) at `nodes`; that there are more of them than it has coefficients
    tells the noise of them all."""
    usable = jnp.isfinite(values)
    largest = jnp.max(jnp.where(usable, jnp.abs(values), jnp.inf), axis=0)
    some = jnp.isfinite(largest) & (largest > 0)
    values = jnp.where(some, values / jnp.where(some, largest, 1.0), 0.0)
    transformed = product(jnp.asarray(_TRANSFORM, values.dtype), values)
    rest = transformed[COEFFICIENTS:]
    noise = jnp.where(some, jnp.max(jnp.abs(rest), axis=0), 1.0)
    coefficients = lanes.materialise(Lane(transformed[:COEFFICIENTS])).array
    return Polynomial(coefficients, noise)


def forms_on_arcs(polynomial: Polynomial, arcs: int, start: float = 0.0) -> jax.Array:
    """(17, arcs, rows) the coefficients of the form on each of so many equal arcs, the first of
    which begins at an angle."""
    coefficients = polynomial.coefficients
    matrix = jnp.asarray(_bernstein(arcs, start), coefficients.dtype).reshape(-1, COEFFICIENTS)
    forms = lanes.materialise(Lane(product(matrix, coefficients))).array
    return forms.reshape(COEFFICIENTS, arcs, coefficients.shape[1])


def most_roots(form: jax.Array, margin: jax.Array) -> tuple[jax.Array, jax.Array]:
    """How many roots forms (17, ...) have at most, and whether they are nothing but noise."""
    up, down = form > margin, form < -margin
    alike = (up[1:] & up[:-1]) | (down[1:] & down[:-1])
    most = jnp.sum(~alike, axis=0, dtype=jnp.int32)
    # The number of changes is even where the ends are alike, and odd where they are not.
    most = most - ((most + (up[0] != up[-1])) & 1)
    ends = (up[0] | down[0]) & (up[-1] | down[-1])
    return jnp.where(ends, most, UNBOUNDED), ~jnp.any(up | down, axis=0)


def _transform() -> np.ndarray:
    """(20, 20) from values at the nodes to c_0, the real parts, the imaginary parts, the rest."""
    t = 2 * np.pi * np.arange(NODES) / NODES
    k = np.arange(1, DEGREE + 1)
    cos, sin = np.cos(np.outer(k, t)), -np.sin(np.outer(k, t))
    rest = [np.cos((DEGREE + 1) * t), np.sin((DEGREE + 1) * t), np.cos((DEGREE + 2) * t)]
    return np.concatenate([np.ones((1, NODES)), cos, sin, rest]) / NODES


@functools.cache
def _bernstein(arcs: int, start: float) -> np.ndarray:
    """(17, arcs, 17) from coefficients to those of the form on each arc."""
    out = np.zeros((COEFFICIENTS, arcs, COEFFICIENTS))
    binomial = np.array([math.comb(FORM, i) for i in range(FORM + 1)])
    for arc in range(arcs):
        # e^(i t / 2) = (1 - s) e^(i low / 2) + s e^(i high / 2), up to a positive factor.
        ends = np.exp(0.5j * (start + 2 * np.pi / arcs * np.array([arc, arc + 1])))
        for k in range(DEGREE + 1):
            turned = _power(ends, DEGREE + k), _power(ends.conj(), DEGREE - k)
            column = np.convolve(*turned) / binomial
            if k == 0:
                out[:, arc, 0] = column.real
            else:
                out[:, arc, k], out[:, arc, DEGREE + k] = 2 * column.real, -2 * column.imag
    return out


def _power(ends: np.ndarray, count: int) -> np.ndarray:
    """The coefficients of (a + b)^count for the two ends (2,)."""
    a, b = ends
    return np.array([math.comb(count, j) * a ** (count - j) * b**j for j in range(count + 1)])


_TRANSFORM = _transform()
