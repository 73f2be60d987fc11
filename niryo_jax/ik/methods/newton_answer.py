"""What Newton-Raphson found from many guesses, as an answer: different ones, best first."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp

from niryo_jax.ik.newton.newton_raphson import NewtonResult
from niryo_jax.ik.newton.pose_error import nearest_taken
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import duplicates
from niryo_jax.ik.results.limits import Limits
from niryo_jax.ik.results.ranking import Answer, rank
from niryo_jax.ik.results.solutions import SLOTS
from niryo_jax.ik.results.status import UnreachableReason


@functools.partial(jax.jit, static_argnames="periodic")
def answer_of_newton(
    newton: NewtonResult,
    limits: Limits,
    periodic: tuple[bool, ...],
    tolerance: jax.Array | None = None,
) -> Answer:
    """The best `SLOTS` of joint vectors (..., m, n); nothing is proved.

    With a `tolerance` (metres and radians), for arms of fewer joints than are bound, what comes
    nearest to a pose takes it if it misses by less.
    """
    q, converged = newton.q, newton.converged
    if tolerance is not None:
        errors = newton.position_error, newton.rotation_error
        usable = jnp.isfinite(newton.position_error)
        converged, _ = nearest_taken(usable, converged, *errors, tolerance)
    vectors = JointVectors.unlabelled(
        q,
        converged & ~duplicates(q, converged, periodic),
        newton.position_error,
        newton.rotation_error,
    )
    batch = converged.shape[:-1]
    unknown = jnp.full(batch, UnreachableReason.NONE, jnp.int32)
    return Answer(rank(vectors, limits, periodic, SLOTS), unknown, jnp.zeros(batch, bool))
