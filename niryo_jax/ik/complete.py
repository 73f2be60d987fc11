"""Complete inverse kinematics of offset-wrist arms: every real solution, or a proof of none.

A fast pass (`sweep`) solves most poses; those whose solutions it cannot prove complete are solved
again, a chunk at a time, by subdivision with a proof (`subdivide`). Both are parts of one program.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.geometry import Geometry, on_robot
from niryo_jax.ik.arm import Arm, arm_from
from niryo_jax.ik.arrange import Slots, arrange
from niryo_jax.ik.batches import BLOCK, program_size
from niryo_jax.ik.collect import finish
from niryo_jax.ik.error import pose_errors
from niryo_jax.ik.implicit import implicit_rate, zero_tangent
from niryo_jax.ik.newton import refine
from niryo_jax.ik.reduction import (
    Circle,
    branch_label,
    circle_columns,
    is_out_of_reach,
    joint_angles,
    read_circle,
    wrist_circle,
)
from niryo_jax.ik.solutions import IKSolutions, Obstacle, Singularity, less_turns
from niryo_jax.ik.subdivide import (
    BRACKET,
    CROSSING,
    SELF_MOTION,
    TOUCHING,
    Roots,
    find_roots,
    posture_of,
    running_count,
)
from niryo_jax.ik.sweep import spherical, sweep
from niryo_jax.ik.target import Target, make_target
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.offset_wrist import Known, arm_numbers, concrete_numbers
from niryo_jax.robot import Robot, is_concrete
from niryo_jax.tolerances import (
    IK_POLISH,
    IK_POSITION,
    IK_ROTATION,
    REACH_ROUNDING,
    SAME_SOLUTION,
)

_CHUNK = 512
_AT_ONCE = 2048
_POLISHED = 128
_POLISHING = 5
_MOST = 16
_NEARLY = 100.0


class Answer(NamedTuple):
    """What the solver says of a batch of poses.

    Attributes:
        slots: the solutions.
        reach: (batch,) an `Obstacle`: whether every point of the wrist's circle is too far or near.
        proved: (batch,) whether the solutions are proved to be all.
    """

    slots: Slots
    reach: jax.Array
    proved: jax.Array


Limits = tuple[jax.Array, jax.Array]


def solve(
    geometry: Geometry, arm: Arm, target: jax.Array, valid: jax.Array, limits: Limits
) -> Answer:
    """All solutions of rigid motions (batch, 4, 4); `program_size` says which batches."""
    size = target.shape[0]
    block = min(size, BLOCK) if jax.default_backend() == "cpu" else size
    parts = jax.lax.map(
        lambda part: _sweep_block(geometry, arm, part[0], part[1], limits),
        (target.reshape(-1, block, 4, 4), valid.reshape(-1, block)),
    )
    answer, left = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), parts)

    def again(answer: Answer, rows: jax.Array, live: jax.Array) -> Answer:
        solve_again = _polish_chunk if arm.is_spherical else _subdivide_chunk
        part = solve_again(geometry, arm, target[rows], live, limits)
        where = jnp.where(live, rows, size)
        return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), answer, part)

    return for_each_chunk(left, min(_CHUNK, size), again, answer)


State = TypeVar("State")


def for_each_chunk(
    which: jax.Array,
    chunk: int,
    body: Callable[[State, jax.Array, jax.Array], State],
    state: State,
) -> State:
    """Run `body(state, rows, live)` on the chosen rows, so many at a time."""
    count = jnp.sum(which, dtype=jnp.int32)
    order = jnp.nonzero(which, size=which.shape[0], fill_value=0)[0].astype(jnp.int32)
    order = jnp.pad(order, (0, chunk))

    def step(carry: tuple[jax.Array, State]) -> tuple[jax.Array, State]:
        at, state = carry
        rows = jax.lax.dynamic_slice_in_dim(order, at, chunk)
        return at + chunk, body(state, rows, at + jnp.arange(chunk) < count)

    return jax.lax.while_loop(lambda carry: carry[0] < count, step, (jnp.int32(0), state))[1]


def _sweep_block(
    geometry: Geometry, arm: Arm, target: jax.Array, valid: jax.Array, limits: Limits
) -> tuple[Answer, jax.Array]:
    """The answers of the fast pass, and which poses it leaves open."""
    batch, dtype = target.shape[0], target.dtype
    circle = wrist_circle(arm, _goal(target))
    reach = _reach(circle, batch, dtype)
    find = spherical if arm.is_spherical else sweep
    candidates = find(arm, circle, batch, dtype)
    position, rotation = _misses(geometry, target, candidates.q)
    close = _closes(position, rotation)
    possible = candidates.exists & (valid & (reach == 0))
    found = possible & close
    slots = arrange(
        candidates.q,
        found,
        (position, rotation),
        candidates.label,
        candidates.singularity,
        limits,
    )
    proved = (reach > 0) | (candidates.proved & ~jnp.any(possible & ~close, axis=0))
    return Answer(slots, reach, proved), valid & ~proved


def _reach(circle: Circle, batch: int, dtype: np.dtype) -> jax.Array:
    far, near = is_out_of_reach(circle, REACH_ROUNDING.of(dtype))
    far, near = jnp.broadcast_to(far, (batch,)), jnp.broadcast_to(near, (batch,))
    codes = [jnp.int32(Obstacle.TOO_FAR), jnp.int32(Obstacle.TOO_NEAR)]
    return jnp.select([far, near], codes, jnp.int32(Obstacle.NONE))


def _subdivide_chunk(
    geometry: Geometry, arm: Arm, target: jax.Array, live: jax.Array, limits: Limits
) -> Answer:
    """The answers of the poses that the fast pass left open."""
    rows, dtype = target.shape[0], target.dtype
    circle = wrist_circle(arm, _goal(target))
    reach = _reach(circle, rows, dtype)
    columns = lanes.pack(circle_columns(circle), (rows,), dtype)
    roots = find_roots(arm, columns, live & (reach == 0))
    solved = _polish(
        geometry, target, _joint_vectors(geometry, arm, columns, target, roots), roots.pose
    )
    q, position, rotation = solved.q, solved.position, solved.rotation
    real = roots.pose < rows
    # A crossing's roots are met many times over; where two of them merge, only the best are alike.
    share = jnp.where(roots.kind == CROSSING, IK_POLISH.of(dtype) / IK_POSITION.of(dtype), 1.0)
    good = real & _closes(position, rotation, share)

    # A root that is proved to be there and whose joint vector does not close is a solution lost;
    # one that touches zero to rounding and nearly closes may be.
    near = _closes(position, rotation, _NEARLY)
    lost = real & ~good & ((roots.kind == BRACKET) | ((roots.kind == TOUCHING) & near))
    incomplete = jnp.zeros(rows, bool).at[jnp.where(lost, roots.pose, rows)].set(True, mode="drop")

    # Sorted by pose and by a number that equal joint vectors share, so that they are neighbours.
    owner = jnp.where(good, roots.pose, rows)
    order = _grouped(owner, _signature(q))
    owner, ordered = owner[order], q[order]
    kept = (owner < rows) & ~_repeats(ordered, owner)
    count, _ = running_count(kept)
    first = jnp.searchsorted(owner, jnp.arange(rows))
    before = jnp.where(first > 0, count[first - 1], 0)
    place = count - 1 - before[jnp.minimum(owner, rows - 1)]
    there = (jnp.where(kept & (place < _MOST), place, _MOST), owner)
    table = (
        jnp.full((_MOST, rows), -1, jnp.int32).at[there].set(order.astype(jnp.int32), mode="drop")
    )
    found, taken = table >= 0, jnp.maximum(table, 0)
    candidates = np.array([Lane(q[:, i][taken]) for i in range(q.shape[1])], dtype=object)
    crowded = jnp.zeros(rows, bool).at[jnp.where(kept & (place >= _MOST), owner, rows)]
    crowded = crowded.set(True, mode="drop")
    kind = roots.kind[taken]
    singularity = jnp.select(
        [kind == SELF_MOTION, kind == TOUCHING],
        [jnp.int32(Singularity.SELF_MOTION), jnp.int32(Singularity.MERGED)],
        jnp.int32(Singularity.NONE),
    )
    errors = position[taken], rotation[taken]
    slots = arrange(candidates, found, errors, solved.label[taken], singularity, limits)
    proved = (reach > 0) | (roots.complete & ~crowded & ~incomplete)
    return Answer(slots, reach, proved)


def _polish_chunk(
    geometry: Geometry, arm: Arm, target: jax.Array, live: jax.Array, limits: Limits
) -> Answer:
    """The answers of poses of an arm with a spherical wrist whose closed form is too rough."""
    rows, dtype = target.shape[0], target.dtype
    circle = wrist_circle(arm, _goal(target))
    candidates = spherical(arm, circle, rows, dtype)
    slots = candidates.exists.shape[0]
    pose = jnp.where(candidates.exists & live, jnp.arange(rows), rows).reshape(-1)
    q = jnp.stack([lane.array.reshape(-1) for lane in candidates.q], axis=-1)
    goal = jnp.broadcast_to(target, (slots, rows, 4, 4)).reshape(-1, 4, 4)
    label = candidates.label.reshape(-1)
    solved = Solved(q, *_misses(geometry, goal, lanes.unpack(q)), label)
    solved = _polish(geometry, target, solved, pose)
    q, position, rotation, label = (x.reshape(slots, rows, *x.shape[1:]) for x in solved)
    found = (pose < rows).reshape(slots, rows) & _closes(position, rotation)
    errors = position, rotation
    arranged = arrange(lanes.unpack(q), found, errors, label, candidates.singularity, limits)
    proved = ~jnp.any(candidates.exists & ~found, axis=0)
    return Answer(arranged, _reach(circle, rows, dtype), proved)


class Solved(NamedTuple):
    """Joint vectors (r, n), the metres and radians by which they miss, and their branches."""

    q: jax.Array
    position: jax.Array
    rotation: jax.Array
    label: jax.Array

    def replace(self, where: jax.Array, new: Solved) -> Solved:
        """With the rows `where` replaced; rows out of range are left out."""
        return Solved(*(x.at[where].set(y, mode="drop") for x, y in zip(self, new)))


def _joint_vectors(
    geometry: Geometry, arm: Arm, columns: jax.Array, target: jax.Array, roots: Roots
) -> Solved:
    """The joint vector of each root."""
    places, dtype = roots.pose.shape[0], target.dtype

    def some(state: Solved, at: jax.Array, live: jax.Array) -> Solved:
        pose = jnp.minimum(roots.pose[at], target.shape[0] - 1)
        circle = read_circle(columns[pose])
        found = posture_of(arm, circle, roots.intervals[at])
        q = lanes.map_lanes(lanes.store, joint_angles(arm, circle, found))
        misses = _misses(geometry, target[pose], q)
        where = jnp.where(live, at, places)
        label = branch_label(found, q[4])
        return state.replace(where, Solved(lanes.pack(q, at.shape, dtype), *misses, label))

    nothing = jnp.zeros((places, geometry.joints), dtype)
    far = jnp.full(places, jnp.inf, dtype)
    start = Solved(nothing, far, far, jnp.zeros(places, jnp.int32))
    filled = roots.pose < target.shape[0]
    return for_each_chunk(filled, min(_AT_ONCE, places), some, start)


def _goal(target: jax.Array) -> Lanes:
    """The entries of rigid motions (..., 4, 4), each contiguous in memory."""
    return lanes.map_lanes(lanes.store, lanes.unpack(target, 2))


def _misses(geometry: Geometry, target: jax.Array, q: Lanes) -> tuple[jax.Array, jax.Array]:
    position, rotation = pose_errors(geometry, _goal(target), q)
    return lanes.store(position).array, lanes.store(rotation).array


def _closes(position: jax.Array, rotation: jax.Array, share: jax.Array | float = 1.0) -> jax.Array:
    """Whether misses are within that share of what a solution may miss by."""
    dtype = position.dtype
    return (position < share * IK_POSITION.of(dtype)) & (rotation < share * IK_ROTATION.of(dtype))


def _signature(q: jax.Array) -> jax.Array:
    """A number between 0 and 1/2 for joint vectors (r, n), the same for whole turns."""
    total = jnp.zeros(q.shape[0], q.dtype)
    for joint, angle in enumerate(lanes.unpack(q)):
        # Nothing about these numbers matters but that no symmetry of an arm is one of theirs.
        total = total + math.cos(joint) * lanes.sincos(angle + (0.3 + 0.7 * joint))[0].array
    return 0.25 + 0.05 * total


def _grouped(owner: jax.Array, signature: jax.Array) -> jax.Array:
    """An order of the rows by owner, and for each by a number between 0 and 1/2."""
    # XLA on the CPU sorts lone integers ten times faster than floats or pairs: each row's number
    # goes with its key, so that a sort keeps what those before it have ordered.
    number = jnp.arange(owner.shape[0], dtype=jnp.int32)
    bits = owner.shape[0].bit_length()
    levels = 1 << (31 - bits)

    def sort(order: jax.Array, key: jax.Array) -> jax.Array:
        return order[jnp.sort((key[order] << bits) | number) & ((1 << bits) - 1)]

    # The number's second digit, its first, then the owner.
    high = (signature * levels).astype(jnp.int32)
    low = ((signature * levels - high) * levels).astype(jnp.int32)
    return functools.reduce(sort, (low, high, owner), number)


def _repeats(q: jax.Array, owner: jax.Array) -> jax.Array:
    """Whether a joint vector (r, n) of the same pose is equal to one of the three before it."""
    repeats = jnp.zeros(owner.shape, bool)
    for shift in (1, 2, 3):
        turn = jnp.abs(q[shift:] - q[:-shift])
        turn = jnp.minimum(turn, 2 * np.pi - turn)
        same = jnp.all(turn < SAME_SOLUTION.of(q.dtype), axis=1)
        same = same & (owner[shift:] == owner[:-shift])
        repeats = repeats | jnp.pad(same, (shift, 0))
    return repeats


def _polish(geometry: Geometry, target: jax.Array, solved: Solved, pose: jax.Array) -> Solved:
    """Newton's method on the full pose for the joint vectors that miss by more than rounding."""
    tolerance = IK_POLISH.of(solved.q.dtype)
    rough = (solved.position > tolerance) | (solved.rotation > tolerance)
    rough = rough & (pose < target.shape[0])

    def again(state: Solved, at: jax.Array, live: jax.Array) -> Solved:
        goal = target[jnp.minimum(pose[at], target.shape[0] - 1)]
        q = refine(geometry, goal, state.q[at], _POLISHING)
        q = less_turns(q, (True,) * geometry.joints)
        position, rotation = _misses(geometry, goal, lanes.unpack(q))
        better = live & (position + rotation < state.position[at] + state.rotation[at])
        where = jnp.where(better, at, pose.shape[0])
        return state.replace(where, Solved(q, position, rotation, state.label[at]))

    return for_each_chunk(rough, min(_POLISHED, pose.shape[0]), again, solved)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _answer(
    known: Known,
    geometry: Geometry,
    numbers: jax.Array,
    target: jax.Array,
    valid: jax.Array,
    limits: Limits,
) -> Answer:
    return solve(geometry, arm_from(known, list(numbers)), target, valid, limits)


@_answer.defjvp
def _answer_jvp(
    known: Known, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[Answer, Answer]:
    answer = _answer(known, *primals)
    geometry, _, target, _, _ = primals
    slots = answer.slots
    rates = implicit_rate(
        geometry,
        target[:, None],
        slots.q,
        slots.found,
        (tangents[0], tangents[2][:, None]),
    )
    zero = zero_tangent(answer)
    return answer, zero._replace(slots=zero.slots._replace(q=rates))


@on_robot
def _complete(
    geometry: Geometry,
    target: Target,
    numbers: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    known: Known,
) -> IKSolutions:
    batch = target.valid.shape
    flat = target.pose.reshape(-1, 4, 4), target.valid.reshape(-1)
    answer = _answer(known, geometry, numbers, *flat, (lower, upper))
    slots, reach, proved = jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), answer)
    none = proved & ~jnp.any(slots.found, axis=-1)
    obstacle = jnp.where(reach > 0, reach, jnp.where(none, Obstacle.NO_ROOT, Obstacle.NONE))
    return finish(
        slots.q,
        slots.found,
        slots.within,
        (slots.position_error, slots.rotation_error),
        slots.label,
        slots.singularity,
        target,
        (lower, upper),
        obstacle.astype(jnp.int32),
        proved,
        periodic=(True,) * 6,
    )


def solve_complete(robot: Robot, pose: ArrayLike) -> IKSolutions:
    """`inverse_kinematics` of an offset-wrist arm, by the complete method."""
    known = robot.offset_wrist
    if known is None:
        raise ValueError(
            "method 'complete' needs six revolute joints of which axes 1 and 2 meet, 2 and 3 are "
            f"parallel, 4 and 5 meet; {robot.name} is not known to be such an arm"
        )
    if robot.screws.ndim != 2:
        raise ValueError(
            f"robot: expected screws (6, 6), got {robot.screws.shape}; use jax.vmap for many robots"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    if is_concrete(robot.screws, robot.home):
        numbers = concrete_numbers(np.asarray(robot.screws), np.asarray(robot.home))
    else:
        numbers = arm_numbers(robot.screws, robot.home, jnp)
    free = np.array([i for i, number in enumerate(known) if number is None])
    arguments = [x.astype(pose.dtype) for x in (numbers[free], robot.lower, robot.upper)]
    batch, size = pose.shape[:-2], math.prod(pose.shape[:-2])
    padded = program_size(size)
    if (padded,) == batch:
        return _complete(robot, make_target(pose), *arguments, known=known)
    answer = _complete(robot, make_target(_padded(pose, padded)), *arguments, known=known)
    return _cut(answer, batch)


@functools.partial(jax.jit, static_argnums=1)
def _padded(pose: jax.Array, size: int) -> jax.Array:
    """The poses in one row, and zeros behind them."""
    pose = pose.reshape(-1, 4, 4)
    return jnp.pad(pose, ((0, size - len(pose)), (0, 0), (0, 0)))


@functools.partial(jax.jit, static_argnums=1)
def _cut(answer: IKSolutions, batch: tuple[int, ...]) -> IKSolutions:
    """The first answers of a row, in the shape of their poses."""
    return answer.map(lambda x: x[: math.prod(batch)].reshape(*batch, *x.shape[1:]))
