"""From joint vectors that solvers found to `IKSolutions`: turns, duplicates, order, status."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.ik.newton import NewtonResult
from niryo_jax.ik.solutions import (
    SLOTS,
    IKSolutions,
    IKStatus,
    Obstacle,
    Singularity,
    are_within_limits,
    less_turns,
    limit_margin,
    wrap_into_limits,
)
from niryo_jax.ik.target import Target
from niryo_jax.tolerances import SAME_SOLUTION


@functools.partial(jax.jit, static_argnames="periodic")
def collect(
    newton: NewtonResult,
    target: Target,
    limits: tuple[jax.Array, jax.Array],
    periodic: tuple[bool, ...],
    obstacle: jax.Array | None = None,
) -> IKSolutions:
    """The best `SLOTS` of the joint vectors (..., m, n) that Newton-Raphson found.

    Args:
        newton: what was found, with leading shape (..., m).
        target: the poses.
        limits: lower and upper (n,).
        periodic: n flags, True for a joint that returns to its place after 2 pi.
        obstacle: (...,) an `Obstacle` that is proved; none where not given.
    """
    lower, upper = limits
    q = wrap_into_limits(newton.q, lower, upper, periodic)
    converged = newton.converged & target.valid[..., None]
    found = converged & ~duplicates(q, converged, periodic)
    worth = jnp.where(found, limit_margin(q, lower, upper), -jnp.inf)
    order = jnp.argsort(-worth, axis=-1, stable=True)[..., :SLOTS]
    missing = SLOTS - order.shape[-1]

    def ranked(x: jax.Array, empty: float) -> jax.Array:
        axis = order.ndim - 1
        index = order.reshape(order.shape + (1,) * (x.ndim - order.ndim))
        pad = [(0, 0)] * x.ndim
        pad[axis] = (0, missing)
        best_first = jnp.take_along_axis(x, index, axis=axis)
        return jnp.pad(best_first, pad, constant_values=empty)

    found = ranked(found, False)
    q = ranked(q, 0.0)
    position_error, rotation_error = (
        ranked(error, jnp.inf) for error in (newton.position_error, newton.rotation_error)
    )
    return finish(
        jnp.where(found[..., None], q, 0.0),
        found,
        found & are_within_limits(q, lower, upper),
        tuple(jnp.where(found, error, jnp.inf) for error in (position_error, rotation_error)),
        jnp.full(found.shape, -1, jnp.int32),
        jnp.full(found.shape, Singularity.NONE, jnp.int32),
        target,
        limits,
        jnp.full_like(target.valid, Obstacle.NONE, jnp.int32) if obstacle is None else obstacle,
        jnp.zeros_like(target.valid),
        periodic,
    )


def finish(
    q: jax.Array,
    found: jax.Array,
    within: jax.Array,
    errors: tuple[jax.Array, ...],
    label: jax.Array,
    singularity: jax.Array,
    target: Target,
    limits: tuple[jax.Array, jax.Array],
    obstacle: jax.Array,
    complete: jax.Array,
    periodic: tuple[bool, ...],
) -> IKSolutions:
    """`IKSolutions` of slots in their order, with the status of each pose."""
    count = jnp.sum(found, axis=-1, dtype=jnp.int32)
    status = jnp.select(
        [
            ~target.valid,
            jnp.any(within, axis=-1),
            count > 0,
            obstacle != Obstacle.NONE,
        ],
        [
            jnp.int32(IKStatus.INVALID_POSE),
            jnp.int32(IKStatus.SOLVED),
            jnp.int32(IKStatus.OUTSIDE_LIMITS),
            jnp.int32(IKStatus.UNREACHABLE),
        ],
        jnp.int32(IKStatus.UNDECIDED),
    )
    return IKSolutions(
        q=q,
        found=found,
        within_limits=within,
        position_error=errors[0],
        rotation_error=errors[1],
        label=label,
        singularity=singularity,
        status=status,
        obstacle=jnp.where(status == IKStatus.UNREACHABLE, obstacle, Obstacle.NONE),
        complete=complete & target.valid,
        count=count,
        pose_distance=target.distance,
        lower=limits[0],
        upper=limits[1],
        periodic=periodic,
    )


def duplicates(q: jax.Array, converged: jax.Array, periodic: tuple[bool, ...]) -> jax.Array:
    """(..., m): whether a joint vector is the same as one before it, up to whole turns."""
    apart = jnp.abs(less_turns(q[..., :, None, :] - q[..., None, :, :], periodic))
    same = jnp.all(apart < SAME_SOLUTION.of(q.dtype), axis=-1) & converged[..., None, :]
    before = jnp.tri(q.shape[-2], k=-1, dtype=bool)
    return jnp.any(same & before, axis=-1) & converged


def limits_of(lower: ArrayLike, upper: ArrayLike, dtype: jnp.dtype) -> tuple[jax.Array, jax.Array]:
    """The joint limits in the dtype of the computation."""
    return jnp.asarray(lower, dtype), jnp.asarray(upper, dtype)
