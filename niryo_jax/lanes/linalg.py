"""Small linear algebra on lanes: 3-vectors, and solves without LAPACK calls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from niryo_jax.lanes.scalar import (
    ZERO,
    Lane,
    Lanes,
    lanes_of,
    materialise,
    materialised,
    select,
    sqrt,
)


def identity(size: int) -> Lanes:
    """The identity matrix."""
    return lanes_of(np.eye(size))


def dot(a: Lanes, b: Lanes) -> Lane:
    """The inner product; 0 of empty vectors."""
    return a @ b if len(a) else ZERO


def cross(a: Lanes, b: Lanes) -> Lanes:
    """The cross product of two 3-vectors."""
    return np.array(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ],
        dtype=object,
    )


def trace(matrix: Lanes) -> Lane:
    """The trace of a 3x3 matrix."""
    return matrix[0, 0] + matrix[1, 1] + matrix[2, 2]


def adjugate(matrix: Lanes) -> Lanes:
    """The adjugate of a 3x3 matrix: its inverse times its determinant."""
    a, b, c = matrix
    return np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=1)


def hat(w: Lanes) -> Lanes:
    """The skew-symmetric matrix [w] with [w] x = w x x."""
    return np.array(
        [[ZERO, -w[2], w[1]], [w[2], ZERO, -w[0]], [-w[1], w[0], ZERO]],
        dtype=object,
    )


def vee(matrix: Lanes) -> Lanes:
    """The vector w of the skew-symmetric part of a 3x3 matrix."""
    return np.array(
        [
            0.5 * (matrix[2, 1] - matrix[1, 2]),
            0.5 * (matrix[0, 2] - matrix[2, 0]),
            0.5 * (matrix[1, 0] - matrix[0, 1]),
        ],
        dtype=object,
    )


def outer(a: Lanes, b: Lanes) -> Lanes:
    """The matrix a b^T."""
    return a[:, None] * b[None, :]


def norm(vector: Lanes) -> Lane:
    """The Euclidean norm; its derivative at the zero vector is given as 0."""
    return sqrt(vector @ vector)


class Orthogonal(NamedTuple):
    """rows = lower @ basis, with orthonormal basis vectors (modified Gram-Schmidt).

    Attributes:
        basis: (k, n); a row that depends on those before it has the zero vector.
        lower: (k, k) lower triangular.
        reciprocals: (k,) 1 / diagonal of lower; 0 for a dependent row.
    """

    basis: Lanes
    lower: Lanes
    reciprocals: Lanes


def orthogonalise(rows: Lanes, tolerance: float) -> Orthogonal:
    """Factor k rows of n lanes, k <= n, without squaring their condition number.

    A row of which less than the share `tolerance` is independent of those before it is dependent.
    """
    count = len(rows)
    basis, lower = materialised(rows), lanes_of(np.zeros((count, count)))
    reciprocals = lanes_of(np.zeros(count))
    for i in range(count):
        whole = norm(basis[i])
        for j in range(i):
            lower[i, j] = materialise(basis[i] @ basis[j])
            basis[i] = basis[i] - lower[i, j] * basis[j]
        rest = norm(basis[i])
        independent = rest > tolerance * whole
        reciprocals[i] = materialise(select(independent, 1.0 / select(independent, rest, 1.0), 0.0))
        lower[i, i] = rest
        basis[i] = materialised(basis[i] * reciprocals[i])
    return Orthogonal(basis, lower, reciprocals)


def volume(rows: Lanes) -> Lane:
    """sqrt(det(A A^T)) of k rows of n >= k lanes: the volume that the rows span."""
    diagonal = np.diag(orthogonalise(rows, 0.0).lower)
    out = diagonal[0]
    for length in diagonal[1:]:
        out = out * length
    return out


def solve(matrix: Lanes, rhs: Lanes, damping: Lane | float, tolerance: float) -> Lanes:
    """x with matrix @ x = rhs: of least norm for m <= n, by least squares for m > n.

    Args:
        matrix: (m, n), any shape.
        rhs: (m,).
        damping: d; each pivot r of the triangular factor is divided by as r / (r^2 + d^2), which
            keeps x small near a singularity and is the exact solution for d = 0.
        tolerance: a row (a column where m > n) that is independent of those before it by less than
            this share is left out: the others are solved for, and nothing becomes infinite.
    """
    m, n = matrix.shape
    wide = m <= n
    basis, lower, reciprocals = orthogonalise(matrix if wide else matrix.T, tolerance)
    lane = damping if isinstance(damping, Lane) else Lane(float(damping))
    if not lane.is_known(0.0):
        square = lane * lane
        for i, reciprocal in enumerate(reciprocals):
            reciprocals[i] = reciprocal / (1.0 + square * reciprocal * reciprocal)
    if wide:
        y = rhs.copy()
        for i in range(m):
            y[i] = materialise(
                (y[i] - dot(lower[i, :i], y[:i])) * reciprocals[i], by=reciprocals[i]
            )
        return basis.T @ y
    x = basis @ rhs
    for i in reversed(range(n)):
        rest = x[i] - dot(lower[i + 1 :, i], x[i + 1 :])
        x[i] = materialise(rest * reciprocals[i], by=reciprocals[i])
    return x
