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
from niryo_jax.execution.compaction import at_once
from niryo_jax.ik.general.elimination import eliminated, solved
from niryo_jax.ik.trig_polynomial import Polynomial, interpolated, nodes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batch_last import kept
from niryo_jax.lanes.matrices import product
from niryo_jax.lie import se3, so3
from niryo_jax.specialise import Geometry
from niryo_jax.structure.closure import COLUMNS, NODES, ClosureNumbers

_MINORS = 3 * COLUMNS * 6
_EQUATIONS = _MINORS + 8 * 2**4
_BLOCK = 64
"""The matrices at the nodes of so many poses stay in the cache of a core."""


class Equations(NamedTuple):
    """The equations of poses, or of roots.

    Attributes:
        minors: (3, 9, 6, rows) by (1, cos, sin) of the kept angle, by the columns of the
            elimination, and by equation.
        products: (8, 2, 2, 2, 2, rows) four that vanish and four coordinates, each by the half
            angles of kept, x, y and last.
    """

    minors: jax.Array
    products: jax.Array

    def in_rows(self) -> jax.Array:
        """All their numbers, (rows, 290)."""
        rows = self.minors.shape[-1]
        return jnp.concatenate([part.reshape(-1, rows) for part in self]).T

    @classmethod
    def from_rows(cls, table: jax.Array) -> Equations:
        """Those of `in_rows`."""
        rows, first, second = len(table), table.T[:_MINORS], table.T[_MINORS:]
        return cls(first.reshape(3, COLUMNS, 6, rows), second.reshape(8, 2, 2, 2, 2, rows))


def equations_and_polynomial(
    numbers: ClosureNumbers, geometry: Geometry, goal: jax.Array, live: jax.Array
) -> tuple[jax.Array, Polynomial]:
    """Of target poses (rows, 4, 4), of which the first are live: `Equations.in_rows`, and g. Of the
    others g is 1, which has no roots."""
    rows = len(goal)
    block = min(at_once(_BLOCK, rows), rows)
    blocks = -(-rows // block)

    def of_block(i: jax.Array, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        at = jnp.minimum(i * block + jnp.arange(block), rows - 1)
        target = lanes.contiguous_lanes(goal[at], 2)
        equations = _equations(numbers, target, geometry.at(at).home, block)
        tables, values = state
        put = jax.lax.dynamic_update_index_in_dim
        tables = put(tables, equations.in_rows(), i, 0)
        return tables, put(values, _at_nodes(numbers, equations.minors), i, 0)

    used = jnp.sum(live, dtype=jnp.int32)
    start = (
        jnp.zeros((blocks, block, _EQUATIONS), goal.dtype),
        jnp.zeros((blocks, NODES, block), goal.dtype),
    )
    tables, values = jax.lax.fori_loop(0, -(-used // block), of_block, start)
    values = jnp.moveaxis(values, 1, 0).reshape(NODES, -1)[:, :rows]
    tables = tables.reshape(-1, _EQUATIONS)[:rows]
    return tables, interpolated(jnp.where(live, values, 1.0))


def _equations(numbers: ClosureNumbers, goal: Lanes, home: Lanes, rows: int) -> Equations:
    """The equations of target poses, (4, 4) lanes over the rows, of a tool that is at `home`."""
    target = _target(numbers, goal, home, rows)
    products = product(numbers.tensor.reshape(128, 8).astype(target.dtype), target)
    products = kept(products).reshape(8, 2, 2, 2, 2, rows)
    table = products[:4]
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
    minors = kept(minors)
    size = jax.lax.rsqrt(jnp.sum(minors * minors, axis=(0, 1, 2)))
    return Equations(kept(minors[:, numbers.columns] * size), products)


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


def at_angle(minors: jax.Array, cos: jax.Array, sin: jax.Array) -> list[jax.Array]:
    """The six equations (9, ...) at an angle of the kept joint, from (3, 9, 6, ...)."""
    constant, of_cos, of_sin = jnp.swapaxes(minors, 1, 2)
    return [kept(a + cos * b + sin * c) for a, b, c in zip(constant, of_cos, of_sin)]


def null_basis(
    equations: list[jax.Array], places: jax.Array, least: float = 0.0
) -> tuple[jax.Array, jax.Array]:
    """What solves equations of which the first six columns are eliminated: (3, 3, 3, ...) by
    (1, cos, sin) of x, by those of y, for three free unknowns; and the product of the pivots, which
    are `least` at least. `places` says where the nine columns belong."""
    units, product = eliminated(equations, least)
    free = jnp.eye(3, dtype=product.dtype).reshape(3, 3, *[1] * product.ndim)
    free = jnp.broadcast_to(free, (3, 3, *product.shape))
    basis = kept(jnp.concatenate([-solved(units), free])[places])
    return basis.reshape(3, 3, 3, *product.shape), product


def half_angle_rows(basis: jax.Array) -> list[jax.Array]:
    """The six rows (6, ...) of what (cos, sin) of half the angle of x, times the free unknowns, is
    a zero of."""
    one, cos, sin = basis
    upper = jnp.concatenate([cos - one, sin], axis=1)
    lower = jnp.concatenate([sin, -(cos + one)], axis=1)
    return [*upper, *lower]


def smallest(dtype: np.dtype) -> float:
    """What stands for a pivot that is zero."""
    return float(jnp.finfo(dtype).tiny) ** 0.5


def _at_nodes(numbers: ClosureNumbers, minors: jax.Array) -> jax.Array:
    """(20, rows) g at the nodes."""
    cos, sin = nodes(minors.dtype)
    equations = at_angle(minors[..., None, :], cos[:, None], sin[:, None])
    flat = [row.reshape(COLUMNS, -1) for row in equations]
    basis, pivots = null_basis(flat, numbers.places)
    matrix = [kept(row) for row in half_angle_rows(basis)]
    _, determinant = eliminated(matrix, smallest(minors.dtype))
    return kept(pivots * pivots * determinant).reshape(len(cos), -1)
