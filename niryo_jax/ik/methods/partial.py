"""Inverse kinematics of a part of a pose: a position, or a position and the direction of an axis.

What is not bound is as if the tool had joints of its own: "direction" leaves a turn about the tool
axis, "position" three turns about axes that meet in the tool's origin. An arm that has as many
joints as the task binds is so made into one of six joints, whose solutions are those of the task.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.execution.padding import is_symbolic, one_by_one
from niryo_jax.ik.methods.complete import solve_complete
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.representative import is_endless
from niryo_jax.ik.results.assemble import with_other_vectors
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import duplicates
from niryo_jax.ik.results.limits import Limits, limits_of
from niryo_jax.ik.results.ranking import rank
from niryo_jax.ik.results.solutions import IKSolutions, map_solutions, with_free_joints_at
from niryo_jax.ik.results.status import Singularity
from niryo_jax.ik.target import make_reference
from niryo_jax.ik.task import Task
from niryo_jax.ik.task_reference import near_task_reference
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot
from niryo_jax.structure.axes import joint_kinds, perpendicular_to, sine_between
from niryo_jax.tolerances import ANSWERED, AXES_MEET, AXES_PARALLEL


class Extended(NamedTuple):
    """An arm whose joints are those of another that matter to a task, and those that it leaves.

    Attributes:
        robot: the arm.
        own: the indices, in the other arm, of its first joints.
        free: those of the joints that are left out, since no value of theirs matters.
    """

    robot: Robot
    own: tuple[int, ...]
    free: tuple[int, ...]


def solve_partial(
    robot: Robot,
    pose: ArrayLike,
    task: Task,
    complete: bool | None,
    tolerance: float,
    q_ref: ArrayLike | None = None,
) -> IKSolutions:
    """`inverse_kinematics` of a task other than "pose".

    Args:
        robot: a concrete arm.
        pose: (..., 4, 4) targets, of which the task binds a part.
        task: which part.
        complete: whether by the complete method; if it fits where None.
        tolerance: metres and radians by which an arm of fewer joints than are bound may miss.
        q_ref: (..., n) joint vectors that the solutions are to be near to, where they can choose.

    Raises:
        ValueError: a wrong shape, an arm that the complete method does not fit where it is asked
            for.
        TypeError: a traced robot.
    """
    extended = extended_arm(robot, task)
    fits = is_solved_completely(robot, task)
    if complete and not fits:
        raise ValueError(
            f"method 'complete' for task {task.name!r} needs an arm of which as many joints matter "
            f"as the task binds ({task.bound}) or fewer, and that a closed form solves with "
            f"those it leaves; {robot.name} is no such arm"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    reference = None if q_ref is None else make_reference(q_ref, pose, robot.joints)

    def solve(pose: jax.Array, *reference: jax.Array) -> IKSolutions:
        endless = None
        if not fits or complete is False:
            answer = solve_multistart(robot, pose, task=task, tolerance=tolerance)
            answer = _with_free_halfway(dataclasses.replace(answer, free=extended.free))
        else:
            own = own_solutions(robot, pose, task, tolerance)
            answer, endless = _with_free_named(own), is_endless(own)
        near = functools.partial(near_task_reference, robot, pose, task, endless)
        if reference:
            answer = near(answer, *reference)
        else:
            answer.remember(near)
        return answer

    if reference is None:
        return solve(pose)
    if is_symbolic(pose.shape[:-2]):
        return one_by_one(solve, [pose, reference], pose.shape[:-2], map_solutions)
    return solve(pose, reference)


def is_solved_completely(robot: Robot, task: Task) -> bool:
    """Whether as many joints of a concrete arm matter as are bound, or fewer, and a closed form
    fits."""
    arm = extended_arm(robot, task).robot
    return arm.joints <= 6 and (bool(arm.plans) or arm.offset_wrist is not None)


def own_solutions(
    robot: Robot, pose: jax.Array, task: Task, tolerance: float = ANSWERED
) -> IKSolutions:
    """All solutions of an arm that `is_solved_completely`, in its joints, singular as if those that
    do not matter were not there."""
    extended = extended_arm(robot, task)
    answer = solve_complete(extended.robot, pose, tolerance=tolerance)
    limits = limits_of(robot.lower, robot.upper, answer.q.dtype)
    return _of_own_joints(answer, extended.own, extended.free, task, limits)


def extended_arm(robot: Robot, task: Task) -> Extended:
    """The arm whose poses are answered as `task` asks for those of a concrete one."""
    screws = robot.known_screws()
    known = robot.__dict__.setdefault("_extended", {})
    if task not in known:
        known[task] = _extended_arm(robot, screws, task)
    return known[task]


def _extended_arm(robot: Robot, screws: np.ndarray, task: Task) -> Extended:
    home = np.asarray(robot.home)
    origin, rotation = home[:3, 3], home[:3, :3]
    axis = rotation @ np.array(task.axis)
    free = _free_joints(screws, origin, axis if task.name == "direction" else None)
    own = tuple(i for i in range(len(screws)) if i not in free)
    # Three axes of which, whatever the pose, no two come to lie along each other but by accident.
    axes = axis[None] if task.name == "direction" else rotation @ _ASKEW
    moments = np.cross(origin, axes)
    none = np.full(len(axes), np.inf)
    chosen = np.array(own, int)
    every = np.concatenate([screws[chosen], np.concatenate([axes, moments], axis=1)])
    if isinstance(robot.screws, jax.Array):
        # Axes in float32 are looked at as such.
        with jax.ensure_compile_time_eval():
            every = jnp.asarray(every, robot.screws.dtype)
    arm = Robot.from_screws(
        every,
        home,
        lower=np.concatenate([np.asarray(robot.lower)[chosen], -none]),
        upper=np.concatenate([np.asarray(robot.upper)[chosen], none]),
        name=robot.name,
    )
    return Extended(arm, own, free)


_ASKEW = np.linalg.qr(np.array([[0.9, 0.1, 0.4], [-0.3, 0.8, 0.2], [-0.2, -0.5, 0.7]]))[0].T
"""Rows: three directions at right angles to each other."""


def _free_joints(
    screws: np.ndarray, origin: np.ndarray, axis: np.ndarray | None
) -> tuple[int, ...]:
    """The joints at the end that neither move the tool's origin nor turn its axis (where given)."""
    meets, parallel = AXES_MEET.of(screws.dtype), AXES_PARALLEL.of(screws.dtype)
    found = list[int]()
    for i, kind in reversed(list(enumerate(joint_kinds(screws)))):
        still = kind == "revolute" and np.linalg.norm(perpendicular_to(screws[i], origin)) < meets
        if not still or (axis is not None and sine_between(screws[i, :3], axis) >= parallel):
            break
        found.insert(0, i)
    return tuple(found)


@functools.partial(jax.jit, static_argnums=(1, 2, 3))
def _of_own_joints(
    answer: IKSolutions, own: tuple[int, ...], free: tuple[int, ...], task: Task, limits: Limits
) -> IKSolutions:
    """The answer in the joints of an arm; those that do not matter are halfway in their range."""
    found, own_q, (lower, upper) = answer.found, answer.q[..., : len(own)], limits
    slots, turned = found.shape[-1], answer.rotation_error
    if task.name == "position":
        # The three turns that are left can be made in two ways.
        found = found & ~duplicates(own_q, found, answer.periodic[: len(own)])
        slots //= 2
        turned = jnp.zeros_like(answer.rotation_error)
    q = (
        jnp.broadcast_to(_halfway(limits), (*found.shape, len(lower)))
        .at[..., np.array(own, int)]
        .set(own_q)
    )
    periodic = list(answer.periodic[: len(own)])
    for joint in free:
        periodic.insert(joint, True)
    errors = answer.position_error, turned
    vectors = JointVectors(q, found, *errors, answer.label, answer.singularity)
    ranked = rank(vectors, limits, tuple(periodic), slots)
    return dataclasses.replace(
        answer,
        **ranked.as_fields(),
        count=jnp.sum(found, axis=-1, dtype=jnp.int32),
        lower=lower,
        upper=upper,
        periodic=tuple(periodic),
        task=task.name,
        free=free,
    )


def _halfway(limits: Limits) -> jax.Array:
    """(n,) the middle of each joint's range, or 0 where it has none."""
    lower, upper = limits
    bounded = jnp.isfinite(lower) & jnp.isfinite(upper)
    return jnp.clip(jnp.where(bounded, 0.5 * (lower + upper), 0.0), lower, upper)


@jax.jit
def _with_free_halfway(answer: IKSolutions) -> IKSolutions:
    """The different ones of solutions in which joints that do not matter were anywhere."""
    if not answer.free:
        return answer
    placed = with_free_joints_at(answer, _halfway((answer.lower, answer.upper)))
    found = placed.found & ~duplicates(placed.q, placed.found, placed.periodic)
    errors = placed.position_error, placed.rotation_error
    vectors = JointVectors(placed.q, found, *errors, placed.label, placed.singularity)
    return with_other_vectors(placed, vectors)


def _with_free_named(answer: IKSolutions) -> IKSolutions:
    """The answer, in which joints that do not matter are a reason for infinitely many solutions."""
    regular = answer.found & (answer.singularity == Singularity.NONE)
    named = jnp.where(regular, jnp.int32(Singularity.SELF_MOTION), answer.singularity)
    return dataclasses.replace(answer, singularity=named) if answer.free else answer
