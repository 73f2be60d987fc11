"""Derivatives of inverse kinematics by the implicit function theorem: one rule for every solver.

Along F(q, geometry, target) = 0, the twist from tool to target, the derivative of F with respect to
q is -J_b, so J_b dq = dF at fixed q. The rule differentiates again, hence derivatives of any order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.geometry import Geometry
from niryo_jax.ik.error import near_twist
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes.batching import on_joints, on_lanes
from niryo_jax.tolerances import DEPENDENT_ROW


def implicit_rate(
    geometry: Geometry,
    target: jax.Array,
    q: jax.Array,
    solved: jax.Array,
    tangents: tuple[Geometry, jax.Array],
    also: tuple[Callable[[Geometry, jax.Array], jax.Array], jax.Array] | None = None,
) -> jax.Array:
    """The rate of q (..., n) for rates of the geometry and of the target (..., 4, 4).

    Zero where not `solved` (...,). At a singular configuration it is the least rate that follows
    the target in the directions in which the arm can move. `also` is a function of geometry and q
    whose value (...,) is to have a rate of its own, for an arm with a joint to spare.
    """
    n = geometry.joints

    def twist(geometry: Geometry, target: jax.Array) -> jax.Array:
        return on_lanes(
            lambda target, q: near_twist(geometry, target, q)[0],
            ("pose", target, (4, 4)),
            ("q", q, (n,)),
        )

    _, rate = jax.jvp(twist, (geometry, target), tangents)
    jacobian = on_joints(lambda q: pose_and_jacobian(geometry, q, "body", stored=True)[1], q, n)
    if also is not None:
        function, wanted = also
        row = jax.grad(lambda q: jnp.sum(function(geometry, q)))(q)
        _, shift = jax.jvp(lambda geometry: function(geometry, q), (geometry,), tangents[:1])
        jacobian = jnp.concatenate([jacobian, row[..., None, :]], axis=-2)
        rate = jnp.concatenate([rate, (wanted - shift)[..., None]], axis=-1)
    solved = solved[..., None]
    solve = _solve_square if jacobian.shape[-1] == jacobian.shape[-2] else _solve
    return jnp.where(solved, solve(jacobian, jnp.where(solved, rate, 0.0)), 0.0)


def _solve(jacobian: jax.Array, rate: jax.Array) -> jax.Array:
    tolerance = DEPENDENT_ROW.of(rate.dtype)
    return on_lanes(
        lambda matrix, rhs: lanes.solve(matrix, rhs, 0.0, tolerance),
        ("jacobian", jacobian, jacobian.shape[-2:]),
        ("rate", rate, rate.shape[-1:]),
    )


# With as many joints as equations x = J^-1 b has the rate J^-1 (db - dJ x), a second solve, which
# is a far smaller program than the derivative of the first.
_solve_square = jax.custom_jvp(_solve)


@_solve_square.defjvp
def _solve_square_jvp(
    primals: tuple[jax.Array, jax.Array], tangents: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, jax.Array]:
    jacobian, rate = primals
    x = _solve_square(jacobian, rate)
    left = tangents[1] - jnp.sum(tangents[0] * x[..., None, :], axis=-1)
    return x, _solve_square(jacobian, left)


Result = TypeVar("Result")


def zero_tangent(result: Result) -> Result:
    """The tangent of a result that does not change."""
    return jax.tree.map(
        lambda x: (
            jnp.zeros(x.shape, x.dtype)
            if jnp.issubdtype(x.dtype, jnp.floating)
            else np.zeros(x.shape, jax.dtypes.float0)
        ),
        result,
    )
