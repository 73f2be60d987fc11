"""Complete inverse kinematics of a batch: every real solution, or a proof of none.

A first pass solves most poses; those whose solutions it cannot prove complete, or not to rounding,
are solved again, a chunk at a time. Both are parts of one program. A small batch goes to the second
pass at once, which makes a smaller program.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from niryo_jax.execution.compaction import at_once, for_each_chunk
from niryo_jax.execution.devices import BatchSharding, on_each_device
from niryo_jax.execution.padding import BLOCK, is_small
from niryo_jax.ik.complete.algorithms import Algorithm, Goal, Structure, algorithm_for
from niryo_jax.ik.newton.pose_error import extent, may_take_pose, pose_errors, within_tolerance
from niryo_jax.ik.results.assemble import assemble
from niryo_jax.ik.results.candidates import in_slots
from niryo_jax.ik.results.limits import Limits
from niryo_jax.ik.results.ranking import Answer, Ranked, rank_lanes
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import UnreachableReason
from niryo_jax.ik.target import make_target
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.structure.families import ClosedFormPlan
from niryo_jax.tolerances import LIMIT_ROUNDING

_CHUNK = 512

_SHARE_OPEN = 8
"""The first pass leaves at most about one pose in so many to the second."""


@specialised
def complete_solutions(
    geometry: Geometry,
    pose: jax.Array,
    held: jax.Array,
    numbers: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    structure: Structure,
    periodic: tuple[bool, ...],
    sharding: BatchSharding | None,
) -> IKSolutions:
    """All solutions of poses (rows, 4, 4); `program_size` says how many rows.

    Args:
        geometry: the arm.
        pose: the poses as they were given.
        held: (rows, 1) values of a locked joint or arm angles, or (rows, 0).
        numbers: those of an offset-wrist arm that are not known while tracing.
        lower, upper: (n,) joint limits.
        structure: what is known of the arm.
        periodic: of all joints.
        sharding: how the rows are spread over devices.
    """
    joint = structure.locked if isinstance(structure, ClosedFormPlan) else None
    target = make_target(pose)
    usable = jnp.isfinite(held)
    target = target._replace(valid=target.valid & jnp.all(usable, axis=-1))
    goal = Goal(target.pose, jnp.where(usable, held, 0.0))
    limits = lower, upper
    free = limits if joint is None else (jnp.delete(lower, joint), jnp.delete(upper, joint))

    def solve(
        geometry: Geometry, numbers: jax.Array, limits: Limits, goal: Goal, valid: jax.Array
    ) -> Answer:
        return solve_rows(algorithm_for(structure, geometry, numbers), goal, valid, limits)

    solve = on_each_device(solve, sharding, same=3)
    answer = solve(geometry, numbers, free, goal, target.valid)
    solutions = answer.solutions
    if joint is not None:
        solutions = _with_locked_joint(solutions, joint, goal.held, limits)
    none = answer.proved & ~jnp.any(solutions.found, axis=-1)
    closed = isinstance(structure, ClosedFormPlan)
    no_root = UnreachableReason.NO_SOLUTION if closed else UnreachableReason.NO_ROOT
    reason = jnp.where(none, no_root, UnreachableReason.NONE)
    told = answer.unreachable != UnreachableReason.NONE
    unreachable = jnp.where(told, answer.unreachable, reason).astype(jnp.int32)
    return assemble(Answer(solutions, unreachable, answer.proved), target, limits, periodic)


def solve_rows(algorithm: Algorithm, goal: Goal, valid: jax.Array, limits: Limits) -> Answer:
    """All solutions of a batch of goals."""
    size = goal.pose.shape[0]
    if is_small(size):
        return algorithm.second_pass(goal, valid, limits)
    block = at_once(BLOCK, size)
    blocks = jax.tree.map(lambda x: x.reshape(size // block, block, *x.shape[1:]), (goal, valid))
    parts = jax.lax.map(lambda part: _first_pass(algorithm, part[0], part[1], limits), blocks)
    answer, left = jax.tree.map(lambda x: x.reshape(size, *x.shape[2:]), parts)

    def solve_again(answer: Answer, rows: jax.Array, live: jax.Array) -> Answer:
        part = algorithm.second_pass(jax.tree.map(lambda x: x[rows], goal), live, limits)
        where = jnp.where(live, rows, size)
        return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), answer, part)

    chunk = min(at_once(_CHUNK, size // _SHARE_OPEN), size)
    return for_each_chunk(left, chunk, solve_again, answer)


def _first_pass(
    algorithm: Algorithm, goal: Goal, valid: jax.Array, limits: Limits
) -> tuple[Answer, jax.Array]:
    """The answers of the first pass, and which poses it leaves open."""
    geometry = algorithm.free_arm(goal.held)
    candidates, unreachable = algorithm.first_pass(geometry, goal)
    errors = pose_errors(geometry, goal.pose, candidates.q)
    position, rotation = (in_slots(error, candidates.exists.shape) for error in errors)
    near = within_tolerance(position, rotation, size=extent(goal.pose))
    reachable = unreachable == UnreachableReason.NONE
    possible = candidates.exists & (valid & reachable)
    ranked = rank_lanes(
        candidates.q,
        possible & near,
        (position, rotation),
        candidates.label,
        candidates.singularity,
        limits,
        algorithm.periodic,
        algorithm.slots,
    )
    lost = possible & ~near & may_take_pose(geometry.joints, position, rotation)
    proved = ~reachable | (candidates.proved & ~jnp.any(lost, axis=0))
    return Answer(ranked, unreachable, proved), valid & ~proved


def _with_locked_joint(solutions: Ranked, joint: int, value: jax.Array, limits: Limits) -> Ranked:
    """The solutions with the value (rows, 1) of the joint that was locked."""
    lower, upper = (limit[joint] for limit in limits)
    rounding = LIMIT_ROUNDING.of(value.dtype)
    inside = (value >= lower - rounding) & (value <= upper + rounding)
    column = jnp.where(solutions.found, value, 0.0)[..., None]
    q = jnp.concatenate([solutions.q[..., :joint], column, solutions.q[..., joint:]], axis=-1)
    return solutions._replace(q=q, within=solutions.within & inside)
