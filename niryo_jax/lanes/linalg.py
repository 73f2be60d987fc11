"""Small linear algebra on lanes: 3-vectors, rotations, symmetric solves without LAPACK calls."""

from __future__ import annotations

import numpy as np

from niryo_jax.lanes.scalar import ZERO, Lane, Lanes, lanes_of, select, sqrt


def identity(size: int) -> Lanes:
    """The identity matrix."""
    return lanes_of(np.eye(size))


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


def cholesky(matrix: Lanes) -> Lanes:
    """The lower-triangular L with L L^T = matrix (symmetric, positive definite).

    Entries above the diagonal are known zeros; the diagonal holds the *reciprocals* of L's, which
    is what the solves need. A pivot that is not positive gives a zero there: its unknown
    drops out of the solution instead of becoming infinite.
    """
    size = len(matrix)
    lower = lanes_of(np.zeros((size, size)))
    for j in range(size):
        pivot = matrix[j, j] - lower[j, :j] @ lower[j, :j] if j else matrix[j, j]
        root = sqrt(pivot)
        positive = root > 0
        lower[j, j] = select(positive, 1.0 / select(positive, root, 1.0), 0.0)
        for i in range(j + 1, size):
            rest = matrix[i, j] - lower[i, :j] @ lower[j, :j] if j else matrix[i, j]
            lower[i, j] = rest * lower[j, j]
    return lower


def cholesky_solve(lower: Lanes, rhs: Lanes) -> Lanes:
    """x with L L^T x = rhs, L as `cholesky` returns it."""
    size = len(rhs)
    x = rhs.copy()
    for i in range(size):
        x[i] = (x[i] - lower[i, :i] @ x[:i] if i else x[i]) * lower[i, i]
    for i in reversed(range(size)):
        x[i] = (x[i] - lower[i + 1 :, i] @ x[i + 1 :] if i + 1 < size else x[i]) * lower[i, i]
    return x


def solve_spd(matrix: Lanes, rhs: Lanes) -> Lanes:
    """x with matrix x = rhs for a symmetric positive definite matrix."""
    return cholesky_solve(cholesky(matrix), rhs)
