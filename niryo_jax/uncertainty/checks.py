"""What of the arguments of this package is looked at, where its numbers are known."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_finite, is_known, shown
from niryo_jax.tolerances import COVARIANCE


def check_covariance(name: str, value: Any, joints: int | None = None) -> None:
    """Raise a ValueError unless it is (..., n, n), finite, symmetric and positive semidefinite."""
    n = "n" if joints is None else joints
    square = value.ndim >= 2 and value.shape[-1] == value.shape[-2]
    if not square or joints not in (None, value.shape[-1]):
        raise ValueError(f"{name}: expected shape (..., {n}, {n}), got {tuple(value.shape)}")
    if not is_known(value) or value.size == 0:
        return
    check_finite(name, value)
    rounding = COVARIANCE.of(value.dtype)
    matrix = np.asarray(value, np.float64)
    scale = np.max(np.abs(matrix), axis=(-1, -2), keepdims=True)
    apart = np.abs(matrix - np.swapaxes(matrix, -1, -2))
    if np.any(apart > rounding * scale):
        raise ValueError(
            f"{name}: expected a symmetric matrix, got entries that differ by {np.max(apart):.3g}"
        )
    # Far faster than eigenvalues, which only the message has.
    lifted = matrix / np.where(scale > 0, scale, 1.0) + rounding * np.eye(matrix.shape[-1])
    try:
        np.linalg.cholesky(lifted)
    except np.linalg.LinAlgError:
        least = np.min(np.linalg.eigvalsh(matrix))
        raise ValueError(
            f"{name}: expected a positive semidefinite matrix, got the eigenvalue {least:.3g}"
        ) from None


def check_key(name: str, value: Any) -> None:
    """Raise a TypeError unless it is one key of `jax.random`, or what one is made of."""
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key):
        one = value.ndim == 0
    else:
        array = isinstance(value, (jax.Array, np.ndarray))
        one = array and value.dtype == np.uint32 and value.ndim == 1
    if not one:
        raise TypeError(f"{name}: expected one key of jax.random, got {shown(value)}")


def check_not_negative(name: str, value: Any) -> None:
    """Raise a ValueError where a number is known and negative, or not finite."""
    if is_concrete(value):
        check_finite(name, value)
        if np.any(np.asarray(value) < 0):
            raise ValueError(f"{name}: expected 0 or more, got {value}")
