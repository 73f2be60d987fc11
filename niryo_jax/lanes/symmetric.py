"""Symmetric positive definite matrices of lanes: their factor, solves, the least eigenvalue."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.lanes.linalg import dot, norm
from niryo_jax.lanes.scalar import (
    Lane,
    Lanes,
    as_lane,
    lanes_of,
    materialise,
    materialised,
    minimum,
    select,
    sqrt,
)

_STEPS = 16
"""Of Laguerre's method. Each triples the digits of a single root; of one that stands for three, it
leaves two fifths of the error."""


class Factor(NamedTuple):
    """A = L D L^T.

    Attributes:
        lower: (n, n) the part of L below its diagonal of ones.
        reciprocals: (n,) 1 / D; 0 for a pivot that is not positive.
    """

    lower: Lanes
    reciprocals: Lanes


def factor(matrix: Lanes) -> Factor:
    """The factor of a symmetric matrix (n, n), whose lower half is read."""
    n = len(matrix)
    lower, reciprocals = lanes_of(np.zeros((n, n))), lanes_of(np.zeros(n))
    for j in range(n):
        scaled = lanes_of(np.zeros(j))
        pivot = matrix[j, j]
        for i in range(j):
            # Of the row so far: L times D, and then L.
            scaled[i] = materialise(matrix[j, i] - dot(lower[i, :i], scaled[:i]))
            lower[j, i] = materialise(scaled[i] * reciprocals[i])
            pivot = pivot - lower[j, i] * scaled[i]
        positive = pivot > 0
        reciprocals[j] = materialise(select(positive, 1.0 / select(positive, pivot, 1.0), 0.0))
    return Factor(lower, reciprocals)


def solved(factor: Factor, rhs: Lanes) -> Lanes:
    """x with A x = rhs (n,)."""
    lower, reciprocals = factor
    x = rhs.copy()
    for i in range(len(x)):
        x[i] = materialise(x[i] - dot(lower[i, :i], x[:i]), by=reciprocals[i])
    for i in reversed(range(len(x))):
        rest = x[i] * reciprocals[i] - dot(lower[i + 1 :, i], x[i + 1 :])
        x[i] = materialise(rest, by=reciprocals[i])
    return x


def tridiagonal(matrix: Lanes) -> tuple[Lanes, Lanes]:
    """The diagonal (n,) and the squares beside it (n - 1,) of a tridiagonal matrix that has the
    eigenvalues of a symmetric one (n, n), by Householder's reflections."""
    a, n = matrix.copy(), len(matrix)
    squares = lanes_of(np.zeros(max(n - 1, 0)))
    for j in range(n - 1):
        v, rest = a[j + 1 :, j].copy(), a[j + 1 :, j + 1 :]
        squares[j] = materialise(v @ v)
        if j == n - 2:
            break
        v[0] = materialise(v[0] + select(v[0] < 0, -1.0, 1.0) * norm(v))
        square = v @ v
        some = square > 0
        per = materialise(select(some, 2.0 / select(some, square, 1.0), 0.0))
        w = materialised(per * (rest @ v))
        w = materialised(w - (0.5 * per * (v @ w)) * v)
        a[j + 1 :, j + 1 :] = materialised(rest - v[:, None] * w[None] - w[:, None] * v[None])
    return np.diag(a), squares


def least_eigenvalue(matrix: Lanes) -> Lane:
    """The least eigenvalue of a positive semidefinite matrix (n, n), n >= 1.

    Laguerre's method on the characteristic polynomial p: from the left of all roots, which all are
    real, it goes to the least of them and never past it. In error by rounding of the largest.
    """
    n = len(matrix)
    trace = as_lane(np.diag(matrix).sum())
    some = trace > 0
    # Powers of a small matrix would be too small for a number.
    per = materialise(select(some, 1.0 / select(some, trace, 1.0), 0.0))
    diagonal, squares = tridiagonal(materialised(matrix * per))
    most = functools.reduce(minimum, diagonal)

    def step(_: int, start: jax.Array) -> jax.Array:
        at = Lane(start)
        # p, its derivative and half its second, of the leading parts of the matrix.
        before, now = lanes_of([0.0, 0.0, 0.0]), lanes_of([1.0, 0.0, 0.0])
        for i in range(n):
            after = (diagonal[i] - at) * now
            after[1:] = after[1:] - now[:-1]
            before, now = now, materialised(after - squares[i - 1] * before if i else after)
        p, slope, bend = now
        root = sqrt((n - 1.0) * ((n - 1.0) * slope * slope - (2.0 * n) * p * bend))
        under = root - slope
        # Left of all roots the three have these signs; elsewhere rounding is all there is.
        left = (p > 0) & (slope < 0) & (under > 0)
        return minimum(at + select(left, n * p / select(left, under, 1.0), 0.0), most).array

    return trace * Lane(jax.lax.fori_loop(0, _STEPS, step, jnp.zeros_like(trace.array)))
