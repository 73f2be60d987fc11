"""The equations of a pose, and the polynomial of one joint's angle whose roots its solutions are.

The eight numbers of `structure.closure` are linear in the half angles of four joints. Of the four
that vanish, the 2 x 2 minors in the half angle of one joint are six equations, linear in (1, cos,
sin) of the other three; at an angle of the kept joint they have a solution only where the
determinant g of a 6 x 6 matrix vanishes. g is a trigonometric polynomial of degree 8.

Letters and derivations: docs/theory/general-6r.md.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.trig_polynomial import Polynomial, interpolated, nodes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3, so3
from niryo_jax.structure.closure import COLUMNS, ClosureNumbers


class Equations(NamedTuple):
    """The equations of poses.

    Attributes:
        products: (128, rows) four that vanish and four coordinates, each by the half angles of
            kept, x, y and last.
        minors: (3, 9, 6, rows) by (1, cos, sin) of the kept angle, by the columns of the
            elimination, and by equation.
    """

    products: jax.Array
    minors: jax.Array


def equations_of(numbers: ClosureNumbers, goal: Lanes, home: Lanes, rows: int) -> Equations:
    """The equations of target poses, (4, 4) lanes over the rows, of a tool that is at `home`."""
    dtype = goal[0, 3].array.dtype
    products = numbers.tensor.reshape(128, 8).astype(dtype) @ _target(numbers, goal, home, rows)
    products = _kept(products)
    table = products.reshape(8, 2, 2, 2, 2, rows)[:4]
    first, second = np.triu_indices(4, 1)
    a, b = table[..., 0, :], table[..., 1, :]
    lefts, rights = (a[first], b[first]), (b[second], a[second])
    terms: np.ndarray[Any, Any] = np.zeros((3, 3, 3), dtype=object)
    for one in np.ndindex(2, 2, 2):
        for other in np.ndindex(2, 2, 2):
            left, right = (x[(slice(None), *one)] for x in lefts)
            term = left * rights[0][(slice(None), *other)]
            term = term - right * rights[1][(slice(None), *other)]
            index = tuple(i + j for i, j in zip(one, other))
            terms[index] = terms[index] + term
    for axis in range(3):
        squares, mixed, others = (np.take(terms, i, axis) for i in range(3))
        parts = 0.5 * (squares + others), 0.5 * (squares - others), 0.5 * mixed
        terms = np.stack(parts, axis)
    minors = jnp.stack(list(terms.ravel())).reshape(3, COLUMNS, 6, rows)
    minors = _kept(minors)
    size = jax.lax.rsqrt(jnp.sum(minors * minors, axis=(0, 1, 2)))
    return Equations(products, _kept(minors[:, numbers.columns] * size))


def _kept(array: jax.Array) -> jax.Array:
    return lanes.materialise(Lane(array)).array


def _target(numbers: ClosureNumbers, goal: Lanes, home: Lanes, rows: int) -> jax.Array:
    """(8, rows) the dual quaternions of target poses as motions from home, lengths of the arm."""
    rotation, position = se3.split(goal)
    home_rotation, home_position = se3.split(home)
    turn = lanes.materialised(rotation @ home_rotation.T)
    centre = lanes.unpack(numbers.centre)
    shift = position + turn @ (centre - home_position) - centre
    per = 1.0 / Lane(numbers.size)
    scalar, vector = so3.quaternion_lanes(turn)
    real = np.array([scalar, *vector], dtype=object)
    # What is off a unit quaternion by rounding alone would be noise of the polynomial.
    length = lanes.materialise(lanes.norm(real))
    real = lanes.materialised(real / length)
    dual = _half_product(shift * per, real)
    whole = [*real, *dual]
    dtype = shift[0].array.dtype
    return jnp.stack([jnp.broadcast_to(jnp.asarray(x.value, dtype), (rows,)) for x in whole])


def _half_product(vector: Lanes, turn: Lanes) -> Lanes:
    """(4,) half the quaternion product of a vector and a quaternion."""
    real = Lane(0.0) - vector @ turn[1:]
    rest = turn[0] * vector + lanes.cross(vector, turn[1:])
    return np.array([0.5 * part for part in (real, *rest)], dtype=object)


def at_angle(minors: Lanes, cos: Lane, sin: Lane) -> Lanes:
    """(6, 9) the equations at an angle of the kept joint, from (3, 9, 6)."""
    return (minors[0] + cos * minors[1] + sin * minors[2]).T


def null_basis(matrix: Lanes, places: jax.Array) -> tuple[Lane, Lanes]:
    """The product of the pivots of (6, 9) equations of which the first six columns are eliminated,
    and (3, 3, 3) what solves them: by (1, cos, sin) of x, by those of y, for three free unknowns.
    `places` says where the nine columns belong."""
    rows = [list(row) for row in matrix]
    product: Lane | None = None
    for k in range(6):
        _exchange(rows, k)
        product = rows[k][k] if product is None else product * rows[k][k]
        for i in range(k + 1, 6):
            share = rows[i][k] / rows[k][k]
            for j in range(k + 1, 9):
                rows[i][j] = rows[i][j] - share * rows[k][j]
    solved = np.empty((9, 3), dtype=object)
    solved[6:] = lanes.identity(3)
    for k in range(5, -1, -1):
        for c in range(3):
            rest = rows[k][6 + c]
            for j in range(k + 1, 6):
                rest = rest + rows[k][j] * solved[j, c]
            solved[k, c] = lanes.materialise(-rest / rows[k][k])
    assert product is not None
    like = solved[0, 0].array
    table = jnp.stack(
        [jnp.broadcast_to(x.array.astype(like.dtype), like.shape) for x in solved.flat]
    )
    table = _kept(table).reshape(9, 3, *like.shape)[places]
    entries = [Lane(table[i, j]) for i in range(9) for j in range(3)]
    return product, np.array(entries, dtype=object).reshape(3, 3, 3)


def _exchange(rows: list[list[Lane]], k: int) -> None:
    """Bring the largest of column k to row k, such that the determinant stays."""
    for i in range(k + 1, len(rows)):
        larger = abs(rows[i][k]) > abs(rows[k][k])
        for j in range(k, len(rows[k])):
            upper, lower = rows[k][j], rows[i][j]
            rows[k][j] = lanes.select(larger, lower, upper)
            rows[i][j] = lanes.select(larger, -upper, lower)


def half_angle_matrix(basis: Lanes) -> Lanes:
    """(6, 6) what (cos, sin) of half the angle of x, times the free unknowns, is a zero of."""
    one, cos, sin = basis
    return np.concatenate(
        [np.concatenate([cos - one, sin], 1), np.concatenate([sin, -(cos + one)], 1)]
    )


def determinant(matrix: Lanes) -> Lane:
    """Of (n, n), by elimination with exchange of rows."""
    rows = [list(row) for row in matrix]
    size = len(rows)
    out = Lane(1.0)
    for k in range(size):
        _exchange(rows, k)
        out = out * rows[k][k]
        for i in range(k + 1, size):
            share = rows[i][k] / lanes.select(abs(rows[k][k]) > 0.0, rows[k][k], 1.0)
            for j in range(k + 1, size):
                rows[i][j] = rows[i][j] - share * rows[k][j]
    return out


def polynomial(numbers: ClosureNumbers, equations: Equations) -> Polynomial:
    """g of poses."""
    cos, sin = nodes(equations.minors.dtype)
    minors = np.empty((3, COLUMNS, 6), dtype=object)
    for index in np.ndindex(3, COLUMNS, 6):
        minors[index] = Lane(equations.minors[index][None])
    pivots, basis = null_basis(at_angle(minors, cos, sin), numbers.places)
    return interpolated(_kept((pivots * pivots * determinant(half_angle_matrix(basis))).array))
