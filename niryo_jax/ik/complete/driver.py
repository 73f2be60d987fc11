"""Complete inverse kinematics of a batch: every real solution, or a proof of none.

A first pass solves most poses; those whose solutions it cannot prove complete, or not to rounding,
are solved again, a chunk at a time. Both are parts of one program. A small batch goes to the second
pass at once, which makes a smaller program.
"""

from __future__ import annotations

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.compaction import at_once, for_each_chunk
from niryo_jax.execution.devices import BatchSharding, on_each_device
from niryo_jax.execution.padding import BLOCK, is_small
from niryo_jax.ik.complete.algorithms import Algorithm, Goal, Structure, TwoPasses, algorithm_for
from niryo_jax.ik.newton.pose_error import extent, may_take_pose, pose_errors, within_tolerance
from niryo_jax.ik.results.assemble import assemble
from niryo_jax.ik.results.candidates import in_slots
from niryo_jax.ik.results.limits import Limits
from niryo_jax.ik.results.ranking import Answer, Ranked, rank_lanes
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import UnreachableReason
from niryo_jax.ik.target import make_target
from niryo_jax.lanes import Lanes
from niryo_jax.lie import se3
from niryo_jax.specialise import Geometry, specialised_for_any_tool
from niryo_jax.structure.closure import ByClosure
from niryo_jax.structure.conditions import are_revolute, is_offset_wrist, plan_fits
from niryo_jax.structure.families import ClosedFormPlan
from niryo_jax.structure.offset_wrist import KnownNumbers, arm_numbers, numbers_are_as_known
from niryo_jax.tolerances import LIMIT_ROUNDING

_CHUNK = 512

_SHARE_OPEN = 8
"""The first pass leaves at most about one pose in so many to the second."""


@specialised_for_any_tool
def complete_solutions(
    geometry: Geometry,
    pose: jax.Array,
    held: jax.Array,
    numbers: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    tolerance: jax.Array,
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
        tolerance: metres and radians by which an arm of fewer than six joints may miss a pose.
        structure: what is known of the arm.
        periodic: of all joints.
        sharding: how the rows are spread over devices.
    """
    joint = None if isinstance(structure, KnownNumbers) else structure.locked
    target = make_target(pose)
    usable = jnp.isfinite(held)
    target = target._replace(valid=target.valid & jnp.all(usable, axis=-1))
    sound = _has_structure(geometry, structure, pose.dtype)
    goal = Goal(target.pose, jnp.where(usable, held, 0.0))
    limits = lower, upper
    free = limits if joint is None else (jnp.delete(lower, joint), jnp.delete(upper, joint))

    def solve(
        geometry: Geometry,
        numbers: jax.Array,
        limits: Limits,
        sound: jax.Array,
        tolerance: jax.Array,
        goal: Goal,
        valid: jax.Array,
    ) -> Answer:
        rotation, position = se3.split(geometry.home)
        home = se3.assemble(lanes.identity(3), position)
        arm = Geometry(geometry.screws, home, geometry.kinds)
        algorithm = algorithm_for(structure, arm, numbers, tolerance)
        return solve_rows(algorithm, rotation, goal, valid, limits, sound)

    solve = on_each_device(solve, sharding, same=5)
    answer = solve(geometry, numbers, free, sound, tolerance, goal, target.valid)
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


def _has_structure(geometry: Geometry, structure: Structure, dtype: np.dtype) -> jax.Array:
    """Whether a traced arm is still what it was taken for while tracing; a concrete one is."""
    if "any" not in geometry.kinds:
        return jnp.asarray(True)
    screws = jnp.stack([jnp.asarray(x.value, dtype) for x in geometry.screws.ravel()])
    screws = screws.reshape(geometry.joints, 6)
    if isinstance(structure, ClosedFormPlan):
        return jnp.asarray(plan_fits(structure, screws, jnp))
    if isinstance(structure, ByClosure):
        return jnp.asarray(are_revolute(screws, jnp))
    numbers = arm_numbers(screws, jnp.zeros(3, dtype), jnp)
    return is_offset_wrist(screws, jnp) & numbers_are_as_known(structure, numbers)


def solve_rows(
    algorithm: Algorithm,
    rotation: Lanes,
    goal: Goal,
    valid: jax.Array,
    limits: Limits,
    sound: jax.Array,
) -> Answer:
    """All solutions of a batch of goals.

    Args:
        algorithm: of an arm whose tool frame is turned as the space frame is at home.
        rotation: how it is turned in truth.
        goal: what is asked for, of the true tool frame.
        valid: (rows,) which rows to solve.
        limits: of the joints.
        sound: whether the arm is what the algorithm takes it for; else nothing is proved.
    """
    size = goal.pose.shape[0]

    def untwisted(pose: jax.Array) -> Lanes:
        """The tool's rotation becomes a number of the poses, and is no number of the arm."""
        turned, place = se3.split(lanes.unpack(pose, 2))
        return lanes.materialised(se3.assemble(turned @ rotation.T, place))

    def second_pass(goal: Goal, live: jax.Array) -> Answer:
        pose = lanes.pack(untwisted(goal.pose), live.shape, goal.pose.dtype)
        return _if_sound(algorithm.second_pass(goal._replace(pose=pose), live, limits), sound)

    if is_small(size) or not isinstance(algorithm, TwoPasses):
        return second_pass(goal, valid)
    block = at_once(BLOCK, size)
    blocks = jax.tree.map(lambda x: x.reshape(size // block, block, *x.shape[1:]), (goal, valid))

    def first_pass(part: tuple[Goal, jax.Array]) -> tuple[Answer, jax.Array]:
        goal, valid = part
        answer = _first_pass(algorithm, untwisted(goal.pose), goal, valid, limits)
        answer = _if_sound(answer, sound)
        return answer, valid & ~answer.proved

    parts = jax.lax.map(first_pass, blocks)
    answer, left = jax.tree.map(lambda x: x.reshape(size, *x.shape[2:]), parts)

    def solve_again(answer: Answer, rows: jax.Array, live: jax.Array) -> Answer:
        part = second_pass(jax.tree.map(lambda x: x[rows], goal), live)
        where = jnp.where(live, rows, size)
        return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), answer, part)

    chunk = min(at_once(_CHUNK, size // _SHARE_OPEN), size)
    return for_each_chunk(left, chunk, solve_again, answer)


def _if_sound(answer: Answer, sound: jax.Array) -> Answer:
    """The answer, but for what it proves of an arm that is not what it was taken for."""
    none = jnp.int32(UnreachableReason.NONE)
    unreachable = jnp.where(sound, answer.unreachable, none)
    return Answer(answer.solutions, unreachable, answer.proved & sound)


def _first_pass(
    algorithm: TwoPasses, target: Lanes, goal: Goal, valid: jax.Array, limits: Limits
) -> Answer:
    """The answers of the first pass, which leaves open what it does not prove."""
    geometry = algorithm.free_arm(goal.held)
    candidates, unreachable = algorithm.first_pass(geometry, target, goal)
    errors = pose_errors(geometry, target, candidates.q)
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
        algorithm.sheets,
    )
    lost = candidates.exists & ~near
    lost = lost & may_take_pose(geometry.joints, position, rotation, algorithm.tolerance)
    # Written out and kept, since a reduction does not vectorise and the truth is read twice.
    some_lost = lanes.kept_truth(functools.reduce(operator.or_, lost), goal.pose.dtype)
    proved = ~reachable | (candidates.proved & ~(some_lost & valid))
    return Answer(ranked, unreachable, proved)


def _with_locked_joint(solutions: Ranked, joint: int, value: jax.Array, limits: Limits) -> Ranked:
    """The solutions with the value (rows, 1) of the joint that was locked."""
    lower, upper = (limit[joint] for limit in limits)
    rounding = LIMIT_ROUNDING.of(value.dtype)
    inside = (value >= lower - rounding) & (value <= upper + rounding)
    column = jnp.where(solutions.found, value, 0.0)[..., None]
    q = jnp.concatenate([solutions.q[..., :joint], column, solutions.q[..., joint:]], axis=-1)
    return solutions._replace(q=q, within=solutions.within & inside)
