"""The joint vectors that do each sample of a path of poses: the rungs of a ladder."""

from __future__ import annotations

import dataclasses
import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import collision
from niryo_jax.collision import CollisionModel, World
from niryo_jax.ik import IKSolutions, inverse_kinematics
from niryo_jax.ik.methods.sampled import spread_sets
from niryo_jax.ik.representative import is_endless, near_reference
from niryo_jax.ik.results.solutions import map_solutions
from niryo_jax.jacobian import singular_values
from niryo_jax.lie import so3
from niryo_jax.robot import Robot

_LEAST_SINGULAR_VALUE = 1e-6


@dataclasses.dataclass(frozen=True)
class PathCost:
    """What makes one path dearer than another; the sum over its samples and steps of

    Attributes:
        travel: times the square of a joint's step, for all joints or (n,) for each.
        limits: times the square of each joint's distance from the middle of its range, in halves of
            the range (Liegeois, 1977).
        sensitivity: times the squared Frobenius norm of the pseudo-inverse of the Jacobian: how far
            joints move for a motion of the tool (metres and radians).
        clearance: times the square of what is missing to `comfort`, in units of it.
        comfort: metres of clearance beyond which more is worth nothing.
    """

    travel: float | tuple[float, ...] = 1.0
    limits: float = 0.0
    sensitivity: float = 0.0
    clearance: float = 0.0
    comfort: float = 0.05


class Obstacles(NamedTuple):
    """What an arm must not touch: itself, a world, and how far it is to stay away (metres)."""

    model: CollisionModel
    world: World | None
    margin: float


class Candidates(NamedTuple):
    """The joint vectors of the samples of paths.

    Attributes:
        q: (paths, k, m, n); possible: (paths, k, m) which are there and within the limits.
        clear: (paths, k, m) whether they keep their distance from obstacles.
        price: (paths, k, m) what `PathCost` asks for each, but for the limits.
        solutions: what they were taken from, (paths, k), for what is said of a sample.
    """

    q: jax.Array
    possible: jax.Array
    clear: jax.Array
    price: jax.Array
    solutions: IKSolutions


def candidates(
    robot: Robot,
    poses: jax.Array,
    cost: PathCost,
    obstacles: Obstacles | None,
    tool_axis: np.ndarray | None,
    values: int,
) -> Candidates:
    """The joint vectors of poses (paths, k, 4, 4).

    Args:
        robot: the arm.
        poses: of the samples.
        cost: of a path.
        obstacles: what is not to be touched.
        tool_axis: about which the tool may turn, tool frame; None where it may not.
        values: how many turns of the tool, or ways to spend a joint, are looked at.
    """
    paths, count = poses.shape[:2]
    if robot.spare is None and tool_axis is None:
        solutions = _through_self_motions(robot, poses, inverse_kinematics(robot, poses))
    else:
        rolled = poses[:, :, None] if tool_axis is None else _rolled(poses, tool_axis, values)
        each = rolled.reshape(-1, 4, 4)
        if robot.spare is None:
            answer = inverse_kinematics(robot, each)
            solutions = answer.map(lambda x: x.reshape(paths, count, -1, *x.shape[1:]))
        else:
            answer = spread_sets(robot, each, values)
            solutions = answer.map(lambda x: x.reshape(paths, count, -1, *x.shape[2:]))
    is_sorted = solutions.status.ndim == 2
    q = solutions.q.reshape(paths, count, -1, robot.joints)
    possible = solutions.within_limits.reshape(paths, count, -1)
    # Those within the limits come first in an answer, but not in several side by side.
    q, possible = _first_of(q, possible, is_sorted)
    clear, price = jnp.ones_like(possible), jnp.zeros(possible.shape, q.dtype)
    if obstacles is not None:
        apart = collision.clearance(robot, obstacles.model, q, obstacles.world)
        clear = apart > obstacles.margin
        missing = jnp.maximum(1.0 - apart / cost.comfort, 0.0)
        price = price + (cost.clearance * missing * missing if cost.clearance else 0.0)
    if cost.sensitivity:
        least = jnp.maximum(singular_values(robot, q), _LEAST_SINGULAR_VALUE)
        price = price + cost.sensitivity * jnp.sum(1.0 / (least * least), axis=-1)
    return Candidates(q, possible, clear, price, solutions)


def _first_of(q: jax.Array, wanted: jax.Array, is_sorted: bool) -> tuple[jax.Array, jax.Array]:
    """The joint vectors (..., m, n) that are wanted (..., m), and as few others as may be."""
    most = int(jnp.max(jnp.sum(wanted, axis=-1)))
    keep = min(_as_many(most), wanted.shape[-1])
    if is_sorted:
        return q[..., :keep, :], wanted[..., :keep]
    order = jnp.argsort(~wanted, axis=-1, stable=True)[..., :keep]
    return jnp.take_along_axis(q, order[..., None], axis=-2), jnp.take_along_axis(wanted, order, -1)


def _as_many(count: int) -> int:
    """So many or more, of few different numbers, each of which is a program."""
    return max(4, 1 << (count - 1).bit_length()) if count else 1


def _rolled(poses: jax.Array, axis: np.ndarray, values: int) -> jax.Array:
    """(..., values, 4, 4) poses turned about an axis of the tool."""
    angle = 2 * np.pi * np.arange(values) / values
    turn = so3.exp(jnp.asarray(angle[:, None] * axis, poses.dtype))
    rotation = poses[..., None, :3, :3] @ turn
    many = jnp.broadcast_to(poses[..., None, :, :], (*poses.shape[:-2], values, 4, 4))
    return many.at[..., :3, :3].set(rotation)


def _through_self_motions(robot: Robot, poses: jax.Array, answer: IKSolutions) -> IKSolutions:
    """The answer to poses (paths, k, 4, 4), with such solutions of self-motions as are near to
    those of the sample before: any of infinitely many would do, and most of them are far away."""
    endless = np.asarray(jnp.any(is_endless(answer), axis=-1))
    for path, sample in np.argwhere(endless).tolist():
        beside = sample - 1 if sample else 1
        if not sample and endless[path, 1]:
            continue
        known = np.asarray(answer.q[path, beside])[np.asarray(answer.found[path, beside])]
        one = answer.map(operator.itemgetter((path, sample)))
        wanted = _nearest_to_each(robot, poses[path, sample], one, known, answer.q.shape[2])
        if wanted is not None:
            at = path, sample
            answer = map_solutions(lambda x, y, at=at: x.at[at].set(y), answer, wanted)
    return answer


def _nearest_to_each(
    robot: Robot, pose: jax.Array, one: IKSolutions, known: np.ndarray, slots: int
) -> IKSolutions | None:
    """Of one pose the solutions that are nearest to joint vectors (r, n), one for each."""
    if not len(known):
        return None
    references = jnp.asarray(np.resize(known, (slots, known.shape[1])))
    many = one.map(lambda x: jnp.broadcast_to(x, (slots, *x.shape)))
    many = near_reference(robot, jnp.broadcast_to(pose, (slots, 4, 4)), many, references)
    off = jnp.max(jnp.abs(many.q - references[:, None]), axis=-1)
    best = jnp.argmin(jnp.where(many.found, off, jnp.inf), axis=-1)[:, None]
    q = jnp.take_along_axis(many.q, best[..., None], axis=1)[:, 0]

    def chosen(x: jax.Array) -> jax.Array:
        return jnp.take_along_axis(x, best, axis=1)[:, 0]

    isolated = ~is_endless(one) & one.found
    within = jnp.where(isolated, one.within_limits, chosen(many.within_limits))
    first = jnp.argsort(~within, stable=True)
    return dataclasses.replace(
        one,
        q=jnp.where(isolated[:, None], one.q, q)[first],
        found=jnp.where(isolated, True, chosen(many.found))[first],
        within_limits=within[first],
    )
