"""Complete inverse kinematics: every real solution, or a proof of none.

A fast pass solves most poses; those whose solutions it cannot prove complete, or not to rounding,
are solved again, a chunk at a time. Both are parts of one program; `scheme` says what they do.
"""

from __future__ import annotations

import functools
import math
import operator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.family import Plan
from niryo_jax.geometry import Geometry, on_robot
from niryo_jax.ik.arrange import Answer, Limits, Slots, arrange
from niryo_jax.ik.batches import BLOCK, cut_rows, for_each_chunk, padded_rows, program_size
from niryo_jax.ik.candidates import in_slots
from niryo_jax.ik.collect import finish
from niryo_jax.ik.error import closes, extent, may_close, misses
from niryo_jax.ik.human_arm import angle_of
from niryo_jax.ik.implicit import implicit_rate, zero_tangent
from niryo_jax.ik.parallel import Spread, on_all_cores, on_each_device, spread_of
from niryo_jax.ik.scheme import Goal, Scheme, scheme_of
from niryo_jax.ik.solutions import IKSolutions, Obstacle, map_solutions
from niryo_jax.ik.target import Target, make_target
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.offset_wrist import Known, arm_numbers, concrete_numbers, is_spherical
from niryo_jax.robot import Robot, is_concrete
from niryo_jax.tolerances import LIMIT_ROUNDING

_CHUNK = 512


def solve(scheme: Scheme, goal: Goal, valid: jax.Array, limits: Limits) -> Answer:
    """All solutions of a batch of goals; `program_size` says which batches."""
    size = goal.pose.shape[0]
    block = min(size, BLOCK) if jax.default_backend() == "cpu" else size
    blocks = jax.tree.map(lambda x: x.reshape(size // block, block, *x.shape[1:]), (goal, valid))
    parts = jax.lax.map(lambda part: _sweep_block(scheme, part[0], part[1], limits), blocks)
    answer, left = jax.tree.map(lambda x: x.reshape(size, *x.shape[2:]), parts)

    def again(answer: Answer, rows: jax.Array, live: jax.Array) -> Answer:
        part = scheme.again(jax.tree.map(lambda x: x[rows], goal), live, limits)
        where = jnp.where(live, rows, size)
        return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), answer, part)

    return for_each_chunk(left, min(_CHUNK, size), again, answer)


def _sweep_block(
    scheme: Scheme, goal: Goal, valid: jax.Array, limits: Limits
) -> tuple[Answer, jax.Array]:
    """The answers of the fast pass, and which poses it leaves open."""
    geometry = scheme.geometry(goal.locked)
    candidates, reach = scheme.candidates(geometry, goal)
    errors = misses(geometry, goal.pose, candidates.q)
    position, rotation = (in_slots(error, candidates.exists.shape) for error in errors)
    close = closes(position, rotation, size=extent(goal.pose))
    possible = candidates.exists & (valid & (reach == 0))
    slots = arrange(
        candidates.q,
        possible & close,
        (position, rotation),
        candidates.label,
        candidates.singularity,
        limits,
        scheme.periodic,
        scheme.slots,
    )
    lost = possible & ~close & may_close(geometry.joints, position, rotation)
    proved = (reach > 0) | (candidates.proved & ~jnp.any(lost, axis=0))
    return Answer(slots, reach, proved), valid & ~proved


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _answer(
    key: Known | Plan,
    geometry: Geometry,
    numbers: jax.Array,
    goal: Goal,
    valid: jax.Array,
    limits: Limits,
) -> Answer:
    return solve(scheme_of(key, geometry, numbers), goal, valid, limits)


@_answer.defjvp
def _answer_jvp(
    key: Known | Plan, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[Answer, Answer]:
    answer = _answer(key, *primals)
    whole, numbers, goal, _, _ = primals
    slots = answer.slots

    # One arm for each pose, and an axis for its slots.
    def arm(whole: Geometry, locked: jax.Array) -> Geometry:
        return scheme_of(key, whole, numbers).geometry(locked[:, None])

    geometry, its_tangent = jax.jvp(arm, (whole, goal.locked), (tangents[0], tangents[2].locked))
    by_angle = isinstance(key, Plan) and key.by_arm_angle
    rates = implicit_rate(
        geometry,
        goal.pose[:, None],
        slots.q,
        slots.found,
        (its_tangent, tangents[2].pose[:, None]),
        also=(angle_of, tangents[2].locked) if by_angle else None,
    )
    zero = zero_tangent(answer)
    return answer, zero._replace(slots=zero.slots._replace(q=rates))


@on_robot
def _complete(
    geometry: Geometry,
    target: Target,
    locked: jax.Array,
    numbers: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    key: Known | Plan,
    periodic: tuple[bool, ...],
    spread: Spread | None,
) -> IKSolutions:
    joint = key.locked if isinstance(key, Plan) else None

    def answer(
        geometry: Geometry, numbers: jax.Array, limits: Limits, goal: Goal, valid: jax.Array
    ) -> Answer:
        return _answer(key, geometry, numbers, goal, valid, limits)

    answer = on_each_device(answer, spread, same=3)
    usable = jnp.isfinite(locked)
    target = target._replace(valid=target.valid & jnp.all(usable, axis=-1))
    locked = jnp.where(usable, locked, 0.0)
    limits, goal = (lower, upper), Goal(target.pose, locked)
    free = limits if joint is None else (jnp.delete(lower, joint), jnp.delete(upper, joint))
    slots, reach, proved = answer(geometry, numbers, free, goal, target.valid)
    if joint is not None:
        slots = _with_joint(slots, joint, locked, limits)
    none = proved & ~jnp.any(slots.found, axis=-1)
    why = Obstacle.NO_SOLUTION if isinstance(key, Plan) else Obstacle.NO_ROOT
    return finish(
        slots.q,
        slots.found,
        slots.within,
        (slots.position_error, slots.rotation_error),
        slots.label,
        slots.singularity,
        target,
        limits,
        jnp.where(reach > 0, reach, jnp.where(none, why, Obstacle.NONE)).astype(jnp.int32),
        proved,
        periodic,
    )


def _with_joint(slots: Slots, joint: int, locked: jax.Array, limits: Limits) -> Slots:
    """The solutions with the value of the joint that was locked."""
    lower, upper = (limit[joint] for limit in limits)
    rounding = LIMIT_ROUNDING.of(locked.dtype)
    inside = (locked >= lower - rounding) & (locked <= upper + rounding)
    value = jnp.where(slots.found, locked, 0.0)[..., None]
    q = jnp.concatenate([slots.q[..., :joint], value, slots.q[..., joint:]], axis=-1)
    return slots._replace(q=q, within=slots.within & inside)


Locked = tuple[int, ArrayLike]
"""The index of a joint and its value (...,)."""


def solve_complete(
    robot: Robot,
    pose: ArrayLike,
    locked: Locked | None = None,
    arm_angle: ArrayLike | None = None,
) -> IKSolutions:
    """`inverse_kinematics` by the complete method."""
    key = _key(robot, locked, arm_angle is not None)
    if robot.screws.ndim != 2:
        raise ValueError(
            f"robot: expected screws (n, 6), got {robot.screws.shape}; use jax.vmap for many robots"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    arguments = [x.astype(pose.dtype) for x in (_numbers(robot, key), robot.lower, robot.upper)]
    values = jnp.zeros((*pose.shape[:-2], 0), pose.dtype)
    periodic = key.periodic if isinstance(key, Plan) else (True,) * robot.joints
    if locked is not None:
        assert isinstance(key, Plan)
        periodic = (*periodic[: locked[0]], key.locked_turns, *periodic[locked[0] :])
    given = arm_angle if locked is None else locked[1]
    if given is not None:
        value = as_floating("arm_angle" if locked is None else "locked", given)
        batch = jnp.broadcast_shapes(pose.shape[:-2], value.shape)
        pose = jnp.broadcast_to(pose, (*batch, 4, 4))
        values = jnp.broadcast_to(value, batch).astype(pose.dtype)[..., None]

    batch = pose.shape[:-2]
    spread = spread_of(pose, len(batch))
    parts = spread.parts if spread else 1

    def solve(pose: jax.Array, values: jax.Array) -> IKSolutions:
        batch = pose.shape[:-2]
        padded = parts * program_size(-(-math.prod(batch) // parts))
        whole = (padded,) == batch
        rows = [x if whole else padded_rows(x, len(batch), padded) for x in (pose, values)]
        answer = _complete(
            robot,
            make_target(rows[0]),
            rows[1],
            *arguments,
            key=key,
            periodic=periodic,
            spread=spread,
        )
        return answer if whole else _cut(answer, batch)

    return on_all_cores(solve, [pose, values], batch, program_size, map_solutions)


def _key(robot: Robot, locked: Locked | None, by_arm_angle: bool) -> Known | Plan:
    """What is known of the arm while tracing, for the solver that fits it."""
    joint, known = None, robot.offset_wrist
    if locked is not None:
        if not isinstance(locked, tuple):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TypeError(f"locked: expected (joint index, value), got {locked!r}")
        if by_arm_angle:
            raise ValueError("locked, arm_angle: expected one of the two, got both")
        joint = operator.index(locked[0])
    fitting = [
        plan for plan in robot.plans if plan.locked == joint and plan.by_arm_angle == by_arm_angle
    ]
    if by_arm_angle and not fitting:
        raise ValueError(
            f"arm_angle: {robot.name} has none; expected seven joints of which axes 1, 2, 3 meet "
            "in one point and 5, 6, 7 in another"
        )
    # A closed form is sooner than the scan; that of a spherical wrist knows its branches by name.
    if known is not None and joint is None and (not fitting or is_spherical(known)):
        return known
    if fitting:
        return fitting[0]
    possible = [plan.locked for plan in robot.plans if plan.locked is not None]
    if joint is not None:
        raise ValueError(
            f"locked: joint {joint} of {robot.name} cannot be locked; those that can, so that the "
            f"others are solved in closed form: {possible or 'none'}"
        )
    if possible:
        raise ValueError(
            f"method 'complete' needs a joint of {robot.name} to be locked, one of {possible}"
        )
    raise ValueError(
        "method 'complete' needs an arm of which axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 "
        f"meet, or one that a closed form solves (docs/families.md); {robot.name} is neither"
    )


def _numbers(robot: Robot, key: Known | Plan) -> Any:
    """The numbers of an offset-wrist arm that are not known while tracing."""
    if isinstance(key, Plan):
        return np.zeros(0)
    if is_concrete(robot.screws, robot.home):
        numbers = concrete_numbers(np.asarray(robot.screws), np.asarray(robot.home))
    else:
        numbers = arm_numbers(robot.screws, robot.home, jnp)
    return numbers[np.array([i for i, number in enumerate(key) if number is None])]


@functools.partial(jax.jit, static_argnums=1)
def _cut(answer: IKSolutions, batch: tuple[int, ...]) -> IKSolutions:
    return answer.map(lambda x: cut_rows(x, batch))
