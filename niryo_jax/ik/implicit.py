"""Derivatives of inverse kinematics by the implicit function theorem: one rule for every solver.

Along F(q, geometry, target) = log(T(q)^-1 target) = 0 the derivative of F with respect to q is
-J_b, so J_b dq = dF at fixed q. The rule differentiates again, hence derivatives of any order.
"""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.geometry import Geometry
from niryo_jax.ik.error import error_twist
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import on_lanes
from niryo_jax.tolerances import DEPENDENT_ROW


def implicit_rate(
    geometry: Geometry,
    target: jax.Array,
    q: jax.Array,
    solved: jax.Array,
    tangents: tuple[Geometry, jax.Array],
) -> jax.Array:
    """The rate of q (..., n) for rates of the geometry and of the target (..., 4, 4).

    Zero where not `solved` (...,). At a singular configuration it is the least rate that follows
    the target in the directions in which the arm can move.
    """
    n = geometry.joints

    def twist(geometry: Geometry, target: jax.Array) -> jax.Array:
        return on_lanes(
            lambda target, q: error_twist(geometry, target, q, "body")[0],
            ("pose", target, (4, 4)),
            ("q", q, (n,)),
        )

    _, rate = jax.jvp(twist, (geometry, target), tangents)
    solved = solved[..., None]

    def rates(q: Lanes, rate: Lanes) -> Lanes:
        jacobian = pose_and_jacobian(geometry, q, "body", stored=True)[1]
        return lanes.solve(jacobian, rate, 0.0, DEPENDENT_ROW.of(rate_dtype))

    rate_dtype = rate.dtype
    dq = on_lanes(rates, ("q", q, (n,)), ("rate", jnp.where(solved, rate, 0.0), (6,)))
    return jnp.where(solved, dq, 0.0)


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
