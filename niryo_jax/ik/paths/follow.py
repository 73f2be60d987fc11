"""One branch of inverse kinematics followed along a path of poses, without a jump."""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_number
from niryo_jax.execution.padding import program_size
from niryo_jax.ik.methods.complete import solve_complete
from niryo_jax.ik.methods.partial import is_solved_completely, own_solutions
from niryo_jax.ik.paths.glide import glide
from niryo_jax.ik.paths.words import beyond_limits, too_far
from niryo_jax.ik.representative import is_endless, near_reference
from niryo_jax.ik.results.limits import limit_margin, without_whole_turns
from niryo_jax.ik.results.solutions import IKSolutions, map_solutions, with_free_joints_at
from niryo_jax.ik.results.status import Singularity
from niryo_jax.ik.task import Task, TaskName, task_of
from niryo_jax.ik.task_reference import near_task_reference
from niryo_jax.lanes.batching import as_floating
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.tolerances import BRANCHES_MEET, LIMIT_ROUNDING, PATH_SHARE

_FINER = 16
_FINER_ROUNDS = 20


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class JointPath:
    """Joint vectors along a path of poses, as far as one branch of solutions goes.

    Attributes:
        q: (k, n) radians; after the end of the branch, the last joint vector that is right
            (q_start where there is none).
        ok: (k,) True up to the end of the branch, False from there on.
        label: (k,) the label of the solution (`IKSolutions.label`), -1 where not ok, and of tasks
            with joints to spare. It changes where the path leads through a singularity to the other
            side.
        message: that the whole path was followed, or at which sample it ends and why; static.
    """

    q: jax.Array
    ok: jax.Array
    label: jax.Array
    message: str = dataclasses.field(metadata={"static": True})


def follow(
    robot: Robot,
    poses: ArrayLike,
    q_start: ArrayLike,
    *,
    largest_step: float = 0.5,
    task: TaskName = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
) -> JointPath:
    """Follow the branch of solutions that begins near a joint vector along a path of poses.

    All poses are solved completely first; then, sample by sample, the solution is chosen that is
    nearest to the last joint vector moved on by the last step, whole turns considered. The branch
    ends where this solution is outside the joint limits, or where there is none within
    `largest_step`: nothing ever jumps. It also ends where the solution continues another branch
    that has nowhere else to go, since its own has then vanished.

    A path that leads through a singularity is followed to the other side if its steps are small
    beside the distance of other solutions; right at it two branches cannot be told apart. At a
    sample where infinitely many solutions exist (`Singularity`) it is the one nearest to where the
    last step leads.

    With a `task` that has a complete answer all this holds of what is bound, and joints that do not
    matter stay where q_start has them. Where the task leaves joints to spare there are no branches:
    each sample is reached from the last by the change whose sum of squares is least, within the
    limits (a local minimum: what is free moves no more than it must; whether the whole path would
    be shorter, or go further, from another start or by larger changes at first is not looked at).
    The path ends where Newton's method from the last sample finds nothing; `label` is then -1.

    Args:
        robot: an arm that the complete method of `inverse_kinematics` fits; for a task, any.
        poses: (k, 4, 4) targets in the space frame, metres, in the order of the path.
        q_start: (n,) a joint vector near the first solution wanted, radians.
        largest_step: no joint moves by more than this between samples that are ok, nor from q_start
            to the first of them; radians.
        task: what of the poses is bound, as for `inverse_kinematics`: "pose", "direction" or
            "position".
        tool_axis: (3,) the axis that "direction" binds, in the tool frame.

    Returns:
        A `JointPath`. Nothing is raised for a pose that cannot be solved: `ok` and `message` tell.

    Raises:
        ValueError: a wrong shape, a joint vector that is not finite, a step not in (0, pi], an arm
            that the method does not fit, an unknown task, a tool axis without direction.
        TypeError: traced arrays: the message depends on their values.
    """
    check_is_robot(robot)
    bound = task_of(task, tool_axis)
    poses, start = as_floating("poses", poses), as_floating("q_start", q_start)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses: expected shape (k, 4, 4), got {poses.shape}")
    if start.shape != (robot.joints,):
        raise ValueError(f"q_start: expected shape ({robot.joints},), got {start.shape}")
    check_number("largest_step", largest_step, "radians in (0, pi]", lambda x: 0 < x <= math.pi)
    if not is_concrete(poses, start, *jax.tree.leaves(robot)):
        raise TypeError(
            "follow: expected concrete arrays, got traced ones; call it outside jax.jit"
        )
    path, start = np.asarray(poses), np.asarray(start, poses.dtype)
    if not np.all(np.isfinite(start)):
        raise ValueError(f"q_start: expected finite numbers, got {start}")

    count = len(path)
    if bound.name == "pose" or is_solved_completely(robot, bound):
        arm = _Arm(robot, bound, start)
        solutions, walk = _continued(arm, path, largest_step)
        walk = _Walk(*(x[:count] for x in walk))
        followed = int(np.sum(walk.ok))
        branch = _Branch(arm, path, solutions, walk, largest_step)
        reason = _reason(branch, followed) if followed < count else ""
    else:
        q, ok, reason = glide(robot, path, start, bound, largest_step)
        walk = _Walk(jnp.asarray(q), jnp.asarray(ok), jnp.full(count, -1, jnp.int32))
        followed = int(np.sum(ok))
    message = f"The whole path was followed, all {count} samples."
    if followed < count:
        message = f"The branch ends at sample {followed} of 0 to {count - 1}: {reason}"
    return JointPath(*walk, message)


class _Arm(NamedTuple):
    """An arm that has complete answers to a task, and what its path begins near."""

    robot: Robot
    task: Task
    start: np.ndarray

    def solve(self, poses: np.ndarray) -> IKSolutions:
        """All solutions; joints that do not matter are as at the start."""
        if self.task.name == "pose":
            return solve_complete(self.robot, poses)
        solutions = own_solutions(self.robot, jnp.asarray(poses), self.task)
        return with_free_joints_at(solutions, jnp.asarray(self.start))

    def near(self, pose: np.ndarray, one: IKSolutions, q: jax.Array) -> IKSolutions:
        """The solutions of one pose, of self-motions those nearest to q (n,)."""
        if self.task.name == "pose":
            return near_reference(self.robot, jnp.asarray(pose), one, q)
        endless = is_endless(one)
        return near_task_reference(self.robot, jnp.asarray(pose), self.task, endless, one, q)


def _continued(arm: _Arm, path: np.ndarray, largest_step: float) -> tuple[IKSolutions, _Walk]:
    """All solutions of a path, of self-motions those by which the branch goes on; and the walk."""
    start = arm.start
    solutions = arm.solve(_padded(path))
    walk = _walk(solutions, start, np.zeros_like(start), largest_step)
    for sample in np.nonzero(np.asarray(is_endless(solutions)).any(axis=-1))[0].tolist():
        if int(np.sum(walk.ok)) < sample:
            break
        before = np.concatenate([[start, start], walk.q[max(0, sample - 2) : sample]])[-2:]
        expected = jnp.asarray(2 * before[1] - before[0])
        one = map_solutions(operator.itemgetter(sample), solutions)
        one = arm.near(path[sample], one, expected)
        solutions = map_solutions(functools.partial(_with, sample), solutions, one)
        walk = _walk(solutions, start, np.zeros_like(start), largest_step)
    return solutions, walk


def _with(index: int, rows: jax.Array, row: jax.Array) -> jax.Array:
    return rows.at[index].set(row)


def _padded(path: np.ndarray) -> np.ndarray:
    """The path with poses that are none at its end, so that few different sizes are compiled."""
    count = len(path)
    return np.concatenate([path, np.zeros((program_size(count) - count, 4, 4), path.dtype)])


_State = tuple[jax.Array, ...]


class _Walk(NamedTuple):
    """What `JointPath` holds, before the message."""

    q: jax.Array
    ok: jax.Array
    label: jax.Array


@jax.jit
def _walk(
    solutions: IKSolutions, start: ArrayLike, moved: ArrayLike, largest_step: ArrayLike
) -> _Walk:
    """Walk along solutions (k, slots, n) from a joint vector (n,) whose last step was `moved`."""
    dtype, slots = solutions.q.dtype, solutions.q.shape[-2]
    start, moved = jnp.asarray(start, dtype), jnp.asarray(moved, dtype)
    largest_step = jnp.asarray(largest_step, dtype)
    apart = functools.partial(_apart, periodic=solutions.periodic)

    def step(carry: _State, sample: _State) -> tuple[_State, _Walk]:
        q, moved, others, lives, alive = carry
        candidates, found, label = sample
        there = q + without_whole_turns(candidates - q, solutions.periodic)
        away = jnp.max(jnp.abs(there - q), axis=-1)
        near = found & (away <= largest_step)
        off = jnp.max(jnp.abs(there - q - moved), axis=-1)
        slot = jnp.argmin(jnp.where(near, off, jnp.inf))
        chosen, number = there[slot], jnp.arange(slots)
        margin = limit_margin(chosen, solutions.lower, solutions.upper)
        within = margin >= -LIMIT_ROUNDING.of(dtype)
        # Of two branches that pass through one another each finds a solution; where the chosen one
        # is much nearer to another branch and all that this has, the branch followed has vanished.
        its_own = lives & (2 * apart(others, chosen) < away[slot])
        reachable = apart(others[:, None], candidates) <= largest_step
        elsewhere = jnp.any(reachable & found & (number != slot), axis=1)
        ok = alive & near[slot] & within & ~jnp.any(its_own & ~elsewhere)
        carry = (
            jnp.where(ok, chosen, q),
            chosen - q,
            candidates,
            found & (number != slot),
            ok,
        )
        return carry, _Walk(carry[0], ok, jnp.where(ok, label[slot], -1))

    first = (start, moved, jnp.zeros_like(solutions.q[0]), jnp.zeros(slots, bool), jnp.array(True))
    return jax.lax.scan(step, first, (solutions.q, solutions.found, solutions.label))[1]


def _apart(a: jax.Array, b: jax.Array, periodic: tuple[bool, ...]) -> jax.Array:
    """The largest joint difference of joint vectors (..., n), whole turns aside."""
    return jnp.max(jnp.abs(without_whole_turns(a - b, periodic)), axis=-1)


class _Branch(NamedTuple):
    """All that is known where a branch ends."""

    arm: _Arm
    path: np.ndarray
    solutions: IKSolutions
    walk: _Walk
    largest_step: float


def _reason(branch: _Branch, end: int) -> str:
    """Why sample `end` does not continue the branch, in words."""
    solutions, robot = branch.solutions, branch.arm.robot
    if int(solutions.count[end]) == 0:
        return solutions.message(end)
    before = np.asarray(branch.walk.q[max(0, end - 2) : end])
    q = before[-1] if end else branch.arm.start
    moved = before[-1] - before[0] if end else np.zeros_like(q)
    slot, change, near = _nearest(solutions, end, q, moved, branch.largest_step)
    if near:
        return beyond_limits(robot, q + change) or _between(branch, end, q, moved)
    words = too_far(robot, change, end, branch.largest_step)
    singularity = Singularity(int(solutions.singularity[end, slot]))
    if singularity is not Singularity.NONE:
        return f"{words} {singularity.message}"
    return f"{words} {_between(branch, end, q, moved)}" if end else words


def _nearest(
    solutions: IKSolutions, at: int, q: np.ndarray, moved: np.ndarray, largest_step: float
) -> tuple[int, np.ndarray, bool]:
    """The solution that is chosen at one sample, limits aside.

    Its slot, the change (n,) from q to it, and whether that is within the largest step; where none
    is, those of the solution nearest to q.
    """
    change = np.asarray(without_whole_turns(solutions.q[at] - q, solutions.periodic))
    away = np.where(solutions.found[at], np.abs(change).max(axis=-1), np.inf)
    near = away <= largest_step
    off = np.where(near, np.abs(change - moved).max(axis=-1), np.inf)
    slot = int(np.argmin(off if near.any() else away))
    return slot, change[slot], bool(near[slot])


def _between(branch: _Branch, end: int, q: np.ndarray, moved: np.ndarray) -> str:
    """What becomes of the branch between samples `end - 1` and `end`, in words.

    It is followed in ever smaller steps along poses between the two.
    """
    arm, largest_step = branch.arm, branch.largest_step
    place, width, other = 0.0, 1.0, math.inf
    for _ in range(_FINER_ROUNDS):
        width = min(width, 1.0 - place)
        fractions = place + width * np.arange(1, _FINER + 1) / _FINER
        solutions = arm.solve(_blend(branch.path[end - 1], branch.path[end], fractions))
        walk = _walk(solutions, q, moved * width / _FINER, largest_step)
        steps = int(np.sum(walk.ok))
        place += width * steps / _FINER
        if place >= 1.0 - 1e-12:
            return (
                "Between the two samples the branch goes on: the path is sampled too coarsely "
                "for this step."
            )
        if steps:
            trail = [q, *np.asarray(walk.q[:steps])]
            q, moved = trail[-1], (trail[-1] - trail[-2]) * _FINER / width
            apart = _apart(solutions.q[steps - 1], jnp.asarray(q), solutions.periodic)
            other = float(np.sort(np.where(solutions.found[steps - 1], apart, np.inf))[1])
        if steps == _FINER:
            width *= _FINER
            continue
        _, change, near = _nearest(solutions, steps, q, moved * width / _FINER, largest_step)
        if near and (words := beyond_limits(arm.robot, q + change)):
            return f"Between the two samples {words}"
        width /= _FINER
        if width < PATH_SHARE:
            break
    if other < BRANCHES_MEET:
        return (
            "Between the two samples the branch merges with another one and both end: "
            "the arm is singular there."
        )
    return "Between the two samples no solution near the branch was found."


def _blend(first: np.ndarray, second: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Rigid motions (m, 4, 4) on the way from one pose to another."""
    share = fractions[:, None, None].astype(first.dtype)
    poses = (1 - share) * first + share * second
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    poses[:, :3, :3] = left @ right
    return poses
