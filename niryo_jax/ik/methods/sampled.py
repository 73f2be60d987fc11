"""Inverse kinematics of arms with a joint to spare: complete sets for many ways to spend it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_fits
from niryo_jax.execution.padding import BLOCK, in_chunks, program_size
from niryo_jax.ik.methods.complete import solve_complete
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.representative import within_limits_along_curves
from niryo_jax.ik.results.assemble import assemble
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import duplicates
from niryo_jax.ik.results.limits import limits_of
from niryo_jax.ik.results.ranking import Answer, rank
from niryo_jax.ik.results.solutions import SLOTS, IKSolutions, map_solutions
from niryo_jax.ik.results.status import IKStatus, UnreachableReason
from niryo_jax.ik.target import make_target
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot


def solve_sampled(robot: Robot, pose: ArrayLike, samples: int = 16) -> IKSolutions:
    """The best of the complete sets for evenly spread arm angles, or values of a locked joint.

    An arm of seven joints reaches a pose in infinitely many ways, a curve or more of them. What is
    returned are the 16 solutions farthest within the limits out of those at `samples` arm angles;
    of an arm without arm angle, at as many values of `robot.spare.locked`, spread evenly over its
    limits (one turn where it has none).

    Where none of them is within the limits, others of the same curves stand for them that are
    (`niryo_jax.ik.representative`), and where there are none, those of multi-start. The last is not
    part of a caller's transformation.

    Args:
        robot: an arm of seven joints of which one can be locked.
        pose: (..., 4, 4) targets in the space frame, metres; projected to SE(3) first.
        samples: how many.

    Returns:
        `IKSolutions` with 16 slots. Never `complete`. Where nothing is found, the status is
        UNREACHABLE of an arm with an arm angle, and else UNDECIDED.

    Raises:
        ValueError: a wrong shape, an arm without such plans, fewer samples than one.
    """
    samples = check_fits("samples", samples, 1, BLOCK * SLOTS * robot.joints)
    plan = robot.spare
    if plan is None:
        raise ValueError(
            "method 'sampled' needs seven joints of which one can be locked, so that all solutions "
            f"of the others are found; {robot.name} is no such arm"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    limits = limits_of(robot.lower, robot.upper, pose.dtype)
    joint = plan.locked
    periodic = plan.periodic
    if joint is not None:
        periodic = (*periodic[:joint], plan.locked_turns, *periodic[joint:])

    target = make_target(pose)

    def answers(poses: jax.Array) -> Answer:
        sets = spread_sets(robot, poses, samples)
        nowhere = jnp.all(sets.status == IKStatus.UNREACHABLE, axis=1) & (joint is None)
        reason = jnp.where(nowhere, UnreachableReason.NO_SOLUTION, UnreachableReason.NONE)

        def pooled(x: jax.Array) -> jax.Array:
            return x.reshape(len(poses), -1, *x.shape[3:])

        q, found, metres, radians = map(
            pooled, (sets.q, sets.found, sets.position_error, sets.rotation_error)
        )
        found = found & ~duplicates(q, found, periodic)
        label = jnp.full(found.shape, -1, jnp.int32)
        vectors = JointVectors(q, found, metres, radians, label, pooled(sets.singularity))
        ranked = rank(vectors, limits, periodic, SLOTS)
        return Answer(ranked, reason.astype(jnp.int32), jnp.zeros_like(nowhere))

    answer = assemble(in_chunks(answers, target.pose), target, limits, periodic)
    return _with_guesses(robot, pose, within_limits_along_curves(robot, pose, answer))


def spread_sets(robot: Robot, pose: jax.Array, samples: int) -> IKSolutions:
    """The complete sets (m, samples) of poses (m, 4, 4) for evenly spread ways to spend the joint.

    Values of a joint are spread over its limits, or one turn where it has none.
    """
    plan = robot.spare
    assert plan is not None
    low, high = jnp.array([-np.pi, np.pi], pose.dtype)
    if plan.locked is not None:
        lower, upper = (x[plan.locked] for x in limits_of(robot.lower, robot.upper, pose.dtype))
        low = jnp.where(jnp.isfinite(lower), lower, low)
        high = jnp.where(jnp.isfinite(upper), upper, high)
    values = low + (high - low) * jnp.asarray((np.arange(samples) + 0.5) / samples, pose.dtype)
    if plan.locked is None:
        return solve_complete(robot, pose[:, None], arm_angle=values)
    return solve_complete(robot, pose[:, None], (plan.locked, values))


def _with_guesses(robot: Robot, pose: jax.Array, answer: IKSolutions) -> IKSolutions:
    """The answer, with that of multi-start for the poses that have none within the limits."""
    if not is_concrete(pose, *jax.tree.leaves(robot)):
        return answer
    batch = answer.status.shape
    left = np.isin(answer.status, (IKStatus.UNDECIDED, IKStatus.OUTSIDE_LIMITS)).reshape(-1)
    rows = np.nonzero(left)[0]
    if len(rows) == 0:
        return answer
    index = np.resize(rows, program_size(len(rows)))
    flat = answer.map(lambda x: x.reshape(-1, *x.shape[len(batch) :]))
    other = solve_multistart(robot, pose.reshape(-1, 4, 4)[index]).map(lambda x: x[: len(rows)])
    undecided = flat.status[rows] == IKStatus.UNDECIDED
    better = (other.status == IKStatus.SOLVED) | (undecided & (other.count > 0))
    rows, chosen = rows[np.asarray(better)], np.nonzero(better)[0]
    flat = map_solutions(lambda x, y: x.at[rows].set(y[chosen]), flat, other)
    return flat.map(lambda x: x.reshape(*batch, *x.shape[1:]))
