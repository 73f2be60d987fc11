"""Ellipsoids of position errors."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.lanes.batching import as_floating
from niryo_jax.lanes.matrices import product
from niryo_jax.tolerances import DEPENDENT_ROW
from niryo_jax.uncertainty.checks import check_covariance
from niryo_jax.uncertainty.normal import radius_of


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Ellipsoid:
    """Where a position error is with a stated probability, as far as it is normal.

    Attributes:
        half_axes: (..., 3) metres, largest first; 0 along a direction without error.
        directions: (..., 3, 3) unit vectors in its columns, in the order of the half axes, in the
            frame of the covariance. The largest entry of each is positive. Where two half axes
            agree the directions between them are free, and their derivatives are given as 0.
        probability: of the error being inside; None for half axes of one standard deviation,
            which hold 19.9 %; static.
    """

    half_axes: jax.Array
    directions: jax.Array
    probability: float | None = dataclasses.field(metadata={"static": True})


def position_ellipsoid(covariance: ArrayLike, probability: float | None = None) -> Ellipsoid:
    """The ellipsoid x^T C^-1 x <= chi2 of a normal position error x of covariance C.

    Args:
        covariance: (..., 3, 3), m^2.
        probability: between 0 and 1: chi2 is the quantile of the chi-square distribution with
            three degrees of freedom. None for chi2 = 1, half axes of one standard deviation.

    Raises:
        ValueError: a covariance that is not symmetric, positive semidefinite and finite, a
            probability that is not between 0 and 1. TypeError: no numbers.
    """
    covariance = as_floating("covariance", covariance)
    check_covariance("covariance", covariance, 3)
    return ellipsoid_of(covariance, probability)


def ellipsoid_of(covariance: jax.Array, probability: float | None) -> Ellipsoid:
    """`position_ellipsoid` of a covariance that is one."""
    radius = 1.0 if probability is None else radius_of(probability)
    half_axes, directions = _axes(covariance)
    return Ellipsoid(radius * half_axes, directions, probability)


@jax.jit
def _axes(covariance: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Half axes of one standard deviation, largest first, and their directions."""
    values, vectors = _eigen(covariance)
    values, vectors = values[..., ::-1], vectors[..., ::-1]
    largest = jnp.argmax(jnp.abs(vectors), axis=-2, keepdims=True)
    sign = jnp.sign(jnp.take_along_axis(vectors, largest, axis=-2))
    return positive_root(values), vectors * sign


def positive_root(x: jax.Array) -> jax.Array:
    """The square root of the positive part; its derivative is given as 0 where there is none."""
    some = x > 0
    return jnp.where(some, jnp.sqrt(jnp.where(some, x, 1.0)), 0.0)


@jax.custom_jvp
def _eigen(matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    values, vectors = jnp.linalg.eigh(matrix)
    return values, vectors


@_eigen.defjvp
def _eigen_jvp(
    primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[tuple[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]:
    # dL = diag(V^T dA V), dV = V F with F_ij = (V^T dA V)_ij / (l_j - l_i), which has no value
    # where two eigenvalues agree.
    values, vectors = _eigen(*primals)
    transposed = jnp.swapaxes(vectors, -1, -2)
    rate = tangents[0]
    rate = 0.5 * (rate + jnp.swapaxes(rate, -1, -2))
    turned = product(product(transposed, rate), vectors)
    gaps = values[..., None, :] - values[..., :, None]
    scale = jnp.max(jnp.abs(values), axis=-1)[..., None, None]
    apart = jnp.abs(gaps) > DEPENDENT_ROW.of(values.dtype) * scale
    share = jnp.where(apart, turned / jnp.where(apart, gaps, 1.0), 0.0)
    rates = jnp.diagonal(turned, axis1=-2, axis2=-1), product(vectors, share)
    return (values, vectors), rates
