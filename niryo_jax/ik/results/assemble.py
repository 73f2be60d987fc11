"""The last station: `IKSolutions` of an answer, with the status of each pose."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp

from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.limits import Limits
from niryo_jax.ik.results.ranking import Answer, rank
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import IKStatus, UnreachableReason
from niryo_jax.ik.target import Target
from niryo_jax.ik.task import TaskName


def assemble(
    answer: Answer,
    target: Target,
    limits: Limits,
    periodic: tuple[bool, ...],
    task: TaskName = "pose",
) -> IKSolutions:
    """`IKSolutions` of an answer to targets."""
    solutions = answer.solutions
    count = jnp.sum(solutions.found, axis=-1, dtype=jnp.int32)
    status = jnp.select(
        [
            ~target.valid,
            jnp.any(solutions.within, axis=-1),
            count > 0,
            answer.unreachable != UnreachableReason.NONE,
        ],
        [
            jnp.int32(IKStatus.INVALID_POSE),
            jnp.int32(IKStatus.SOLVED),
            jnp.int32(IKStatus.OUTSIDE_LIMITS),
            jnp.int32(IKStatus.UNREACHABLE),
        ],
        jnp.int32(IKStatus.UNDECIDED),
    )
    unreachable = status == IKStatus.UNREACHABLE
    return IKSolutions(
        **solutions.as_fields(),  # pyright: ignore[reportArgumentType]
        status=status,
        unreachable_reason=jnp.where(unreachable, answer.unreachable, UnreachableReason.NONE),
        complete=answer.proved & target.valid,
        count=count,
        pose_distance=target.distance,
        lower=limits[0],
        upper=limits[1],
        periodic=periodic,
        task=task,
    )


def with_other_vectors(answer: IKSolutions, vectors: JointVectors) -> IKSolutions:
    """The answer with other joint vectors in its slots, ranked again."""
    slots = answer.found.shape[-1]
    ranked = rank(vectors, (answer.lower, answer.upper), answer.periodic, slots)
    count = jnp.sum(ranked.found, axis=-1, dtype=jnp.int32)
    some = (count > 0) & (answer.status == IKStatus.UNDECIDED)
    status = jnp.where(some, jnp.int32(IKStatus.OUTSIDE_LIMITS), answer.status)
    within = jnp.any(ranked.within, axis=-1)
    return dataclasses.replace(
        answer,
        **ranked.as_fields(),  # pyright: ignore[reportArgumentType]
        count=count,
        status=jnp.where(within, jnp.int32(IKStatus.SOLVED), status),
    )
