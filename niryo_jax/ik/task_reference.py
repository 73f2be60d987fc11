"""Which of the infinitely many solutions of a task stand for them: those nearest to a reference.

Joints that do not matter to the task take the reference's values, and the others come as near to it
as the task lets them (`niryo_jax.ik.newton.least_change`).
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp

from niryo_jax._jax import is_concrete
from niryo_jax.execution.padding import cut_rows, padded_rows, program_size
from niryo_jax.ik.newton.least_change import drawn_to
from niryo_jax.ik.newton.newton_raphson import NewtonResult, newton_raphson
from niryo_jax.ik.results.assemble import with_other_vectors
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import duplicates
from niryo_jax.ik.results.limits import are_within_limits, nearest_turn
from niryo_jax.ik.results.solutions import IKSolutions, with_free_joints_at
from niryo_jax.ik.results.status import Singularity
from niryo_jax.ik.target import make_target
from niryo_jax.ik.task import Task
from niryo_jax.robot import Robot
from niryo_jax.tolerances import DEPENDENT_ROW, SELF_MOTION

_OUTSIDE = 100.0


def near_task_reference(
    robot: Robot,
    pose: jax.Array,
    task: Task,
    endless: jax.Array | None,
    answer: IKSolutions,
    q_ref: jax.Array,
) -> IKSolutions:
    """The answer to a task, with solutions that are as near to joint vectors as may be.

    Args:
        robot: the arm.
        pose: (..., 4, 4) as they were given.
        task: what of them is bound.
        endless: (..., slots) the solutions that others of their self-motions may stand for; None
            where joints are to spare, so that any may.
        answer: to these poses.
        q_ref: (..., n) joint vectors, whose batch is that of the poses.
    """
    batch, n = answer.status.shape, answer.q.shape[-1]
    reference = jnp.broadcast_to(q_ref, (*batch, n)).astype(answer.q.dtype)
    answer = with_free_joints_at(answer, reference)
    wanted = answer.found if endless is None else endless & answer.found
    with_spare = endless is None  # Then one that was not found may be found from the reference.
    none = not with_spare and is_concrete(wanted, pose) and not bool(jnp.any(wanted))
    count = answer.status.size
    if none or count == 0:
        return answer

    def in_a_row(x: jax.Array) -> jax.Array:
        return x.reshape(count, *x.shape[len(batch) :])

    flat, poses, limits = answer.map(in_a_row), in_a_row(pose), (answer.lower, answer.upper)
    wish = jnp.clip(in_a_row(reference), *limits)
    newton = functools.partial(newton_raphson, robot, task=task.name, tool_axis=task.axis)
    starts = jnp.concatenate([flat.q, wish[:, None]], axis=1)
    starts = nearest_turn(starts, wish[:, None], *limits, answer.periodic)
    each = starts.shape[1]

    def in_rows(x: jax.Array) -> jax.Array:
        """One for each start; at the end so many more that few different sizes are compiled."""
        whole = jnp.broadcast_to(x, (count, each, *x.shape[2:]))
        return padded_rows(whole, 2, program_size(count * each), mode="edge")

    targets, wishes = in_rows(make_target(poses).pose[:, None]), in_rows(wish[:, None])
    dependent = (DEPENDENT_ROW if with_spare else SELF_MOTION).of(answer.q.dtype)
    drawn = drawn_to(robot, targets, in_rows(starts), wishes, limits, task, dependent)
    drawn = cut_rows(drawn, (count, each))
    flat = _replaced(flat, newton(poses[:, None], drawn), wish, in_a_row(wanted), with_spare)
    return flat.map(lambda x: x.reshape(*batch, *x.shape[1:]))


@functools.partial(jax.jit, static_argnames="with_spare")
def _replaced(
    answer: IKSolutions,
    new: NewtonResult,
    reference: jax.Array,
    wanted: jax.Array,
    with_spare: bool,
) -> IKSolutions:
    """The answers (rows,) with what was found from each slot, and from the reference, where that
    is nearer to it."""
    limits, periodic = (answer.lower, answer.upper), answer.periodic
    slots = answer.found.shape[-1]

    def score(q: jax.Array) -> jax.Array:
        q = nearest_turn(q, reference[:, None], *limits, periodic)
        outside = jnp.where(are_within_limits(q, *limits), 0.0, _OUTSIDE)
        return -outside - jnp.linalg.norm(q - reference[:, None], axis=-1)

    old = jnp.where(answer.found, score(answer.q), -jnp.inf)
    fresh = jnp.where(new.converged, score(new.q), -jnp.inf)
    # What was found from the reference stands for the self-motion that comes nearest to it.
    near = jnp.where(wanted, jnp.maximum(fresh[:, :slots], old), -jnp.inf)
    best = jnp.arange(slots) == jnp.argmax(near, axis=1)[:, None]
    candidate = wanted | (~jnp.any(answer.found, axis=1, keepdims=True) & with_spare)
    mine = best & candidate & (fresh[:, slots:] > fresh[:, :slots])

    def chosen(x: jax.Array) -> jax.Array:
        pick = mine.reshape(*mine.shape, *[1] * (x.ndim - 2))
        return jnp.where(pick, x[:, slots:], x[:, :slots])

    q, metres, radians, fresh = map(chosen, (new.q, new.position_error, new.rotation_error, fresh))
    better = candidate & (fresh > old)
    found = answer.found | better
    q = jnp.where(better[..., None], q, answer.q)
    if with_spare:
        # From many places of one curve the same is reached.
        found = found & ~duplicates(q, found, periodic)
    named = better & (answer.singularity == Singularity.NONE)
    vectors = JointVectors(
        q,
        found,
        jnp.where(better, metres, answer.position_error),
        jnp.where(better, radians, answer.rotation_error),
        answer.label,
        jnp.where(named, jnp.int32(Singularity.SELF_MOTION), answer.singularity),
    )
    return with_other_vectors(answer, vectors)
