"""Complete inverse kinematics of offset-wrist arms: every real solution, or a proof of none.

A fast pass (`sweep`) solves most poses; those whose solutions it cannot prove complete are solved
again, a chunk at a time, by subdivision with a proof (`subdivide`). Both are parts of one program.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.geometry import Geometry, on_robot
from niryo_jax.ik.arm import Arm, arm_from
from niryo_jax.ik.arrange import Answer, Limits, arrange, in_slots
from niryo_jax.ik.batches import BLOCK, cut_rows, for_each_chunk, padded_rows, program_size
from niryo_jax.ik.circle import obstacle, wrist_circle
from niryo_jax.ik.collect import finish
from niryo_jax.ik.error import closes, misses
from niryo_jax.ik.implicit import implicit_rate, zero_tangent
from niryo_jax.ik.parallel import Spread, on_all_cores, on_each_device, spread_of
from niryo_jax.ik.second_pass import by_polish, by_subdivision
from niryo_jax.ik.solutions import IKSolutions, Obstacle, map_solutions
from niryo_jax.ik.sweep import spherical, sweep
from niryo_jax.ik.target import Target, make_target
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.offset_wrist import Known, arm_numbers, concrete_numbers
from niryo_jax.robot import Robot, is_concrete

_CHUNK = 512


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
        solve_again = by_polish if arm.is_spherical else by_subdivision
        part = solve_again(geometry, arm, target[rows], live, limits)
        where = jnp.where(live, rows, size)
        return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), answer, part)

    return for_each_chunk(left, min(_CHUNK, size), again, answer)


def _sweep_block(
    geometry: Geometry, arm: Arm, target: jax.Array, valid: jax.Array, limits: Limits
) -> tuple[Answer, jax.Array]:
    """The answers of the fast pass, and which poses it leaves open."""
    batch, dtype = target.shape[0], target.dtype
    circle = wrist_circle(arm, lanes.columns(target, 2))
    reach = obstacle(circle, batch, dtype)
    find = spherical if arm.is_spherical else sweep
    candidates = find(arm, circle, batch, dtype)
    errors = misses(geometry, target, candidates.q)
    position, rotation = (in_slots(error, candidates.exists.shape) for error in errors)
    close = closes(position, rotation)
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
    spread: Spread | None,
) -> IKSolutions:
    def answer(
        geometry: Geometry, numbers: jax.Array, limits: Limits, pose: jax.Array, valid: jax.Array
    ) -> Answer:
        return _answer(known, geometry, numbers, pose, valid, limits)

    answer = on_each_device(answer, spread, same=3)
    slots, reach, proved = answer(geometry, numbers, (lower, upper), target.pose, target.valid)
    none = proved & ~jnp.any(slots.found, axis=-1)
    why = jnp.where(reach > 0, reach, jnp.where(none, Obstacle.NO_ROOT, Obstacle.NONE))
    return finish(
        slots.q,
        slots.found,
        slots.within,
        (slots.position_error, slots.rotation_error),
        slots.label,
        slots.singularity,
        target,
        (lower, upper),
        why.astype(jnp.int32),
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

    batch = pose.shape[:-2]
    spread = spread_of(pose, len(batch))
    parts = spread.parts if spread else 1

    def solve(pose: jax.Array) -> IKSolutions:
        batch = pose.shape[:-2]
        padded = parts * program_size(-(-math.prod(batch) // parts))
        rows = pose if (padded,) == batch else padded_rows(pose, len(batch), padded)
        answer = _complete(robot, make_target(rows), *arguments, known=known, spread=spread)
        return answer if rows is pose else _cut(answer, batch)

    return on_all_cores(solve, [pose], batch, program_size, map_solutions)


@functools.partial(jax.jit, static_argnums=1)
def _cut(answer: IKSolutions, batch: tuple[int, ...]) -> IKSolutions:
    return answer.map(lambda x: cut_rows(x, batch))
