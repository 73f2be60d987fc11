"""Inverse kinematics of any open chain: Newton-Raphson from many guesses.

The guesses are the first points of a sequence that fills the box of the joint limits evenly (the
additive recurrence of Roberts, 2018): no seed, so the same pose always has the same answer. What is
found is certain; that there is nothing else is not, and with more starts less is missed.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.arguments import check_fits
from niryo_jax.execution.padding import BLOCK, in_chunks
from niryo_jax.ik.methods.newton_answer import answer_of_newton
from niryo_jax.ik.newton.newton_raphson import NewtonResult, newton_raphson
from niryo_jax.ik.representative import within_limits_along_curves
from niryo_jax.ik.results.assemble import assemble
from niryo_jax.ik.results.limits import limits_of, wrap_into_limits
from niryo_jax.ik.results.ranking import Answer
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import UnreachableReason
from niryo_jax.ik.target import make_target
from niryo_jax.ik.task import POSE, Task
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot
from niryo_jax.structure.axes import axis_point, joint_kinds, perpendicular_to
from niryo_jax.tolerances import ANSWERED, REACH_EDGE

_RETURNS = 3
"""How often joint vectors with joints to spare are brought back into the limits."""

_NUMBERS = 100
"""Newton-Raphson from one guess works on its Jacobian and the like."""

_STEP = 1.5
"""Far from any answer, longer steps than Newton-Raphson takes by default converge more often."""


def solve_multistart(
    robot: Robot,
    pose: ArrayLike,
    starts: int = 64,
    *,
    task: Task = POSE,
    tolerance: float = ANSWERED,
) -> IKSolutions:
    """Joint vectors that bring the tool of any open chain to a pose, from many guesses.

    A pose costs `starts` runs of Newton-Raphson, nearly all of 30 steps since some never converge:
    one to two milliseconds a pose on a CPU for six joints and 64 starts, at least ten times the
    complete method. Of six-joint arms in general position, 64 starts find more than 99 % of all
    solutions. Poses are solved a chunk at a time, so that memory stays bounded.

    Args:
        robot: a concrete arm of any number of revolute, prismatic or helical joints.
        pose: (..., 4, 4) targets in the space frame, metres; projected to SE(3) first.
        starts: how many guesses, spread evenly over the joint limits; an unlimited joint over one
            turn or, where it is prismatic, over [-1, 1] m.
        task: what of the pose is bound.
        tolerance: metres and radians by which an arm of fewer joints than are bound may miss.

    Returns:
        `IKSolutions` with 16 slots; the 16 farthest from the limits where more are found, as for
        an arm with more than six joints. Not `complete`; the status is UNDECIDED where nothing is
        found, but for positions farther away than all links in a row are long.

    Raises:
        ValueError: a wrong shape, or fewer starts than one.
        TypeError: a traced robot, whose kinds of joints are not known.
    """
    starts = check_fits("starts", starts, 1, BLOCK * _NUMBERS)
    screws = robot.known_screws()
    if screws.ndim != 2:
        raise ValueError(
            f"robot: expected screws (n, 6), got {screws.shape}; solve for one robot at a time"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    kinds = joint_kinds(screws)
    periodic = tuple(kind == "revolute" for kind in kinds)
    limits = limits_of(robot.lower, robot.upper, pose.dtype)
    guesses = _spread(additive_recurrence(starts, robot.joints), limits, kinds)

    target = make_target(pose)
    few = robot.joints < task.bound
    centre, reach = _longest_reach(screws, np.asarray(robot.home)[:3, 3], kinds)
    edge = REACH_EDGE.of(pose.dtype) * (1.0 + reach) + (tolerance if few else 0.0)

    def newton_from(guesses: jax.Array, poses: jax.Array) -> NewtonResult:
        return newton_raphson(
            robot,
            poses[:, None],
            guesses,
            step_limit=_STEP,
            task=task.name,
            tool_axis=task.axis,
        )

    def answers(poses: jax.Array) -> Answer:
        newton = newton_from(guesses, poses)
        # With joints to spare, those that leave their limits can be asked to stay.
        for _ in range(_RETURNS if robot.joints > task.bound else 0):
            q = wrap_into_limits(newton.q, *limits, periodic)
            newton = newton_from(jax.lax.stop_gradient(jnp.clip(q, *limits)), poses)
        nearest = jnp.asarray(tolerance, pose.dtype) if few else None
        answer = answer_of_newton(newton, limits, periodic, nearest)
        beyond = jnp.linalg.norm(poses[:, :3, 3] - centre, axis=-1) > reach + edge
        far = jnp.where(beyond, UnreachableReason.TOO_FAR, answer.unreachable)
        return answer._replace(unreachable=far.astype(jnp.int32), proved=answer.proved | beyond)

    answer = assemble(in_chunks(answers, target.pose), target, limits, periodic, task.name)
    spare = robot.joints > task.bound and task.name == POSE.name
    return within_limits_along_curves(robot, pose, answer) if spare else answer


def _longest_reach(
    screws: np.ndarray, tool: np.ndarray, kinds: tuple[str, ...]
) -> tuple[np.ndarray, float]:
    """A point of axis 1, and a distance from it that the tool's origin never exceeds.

    Each joint keeps the distances of what it moves from the points of its axis, so that from point
    to point of one axis after the other no more than the sum of their distances is bridged.
    """
    if set(kinds) != {"revolute"}:
        return np.zeros(3), np.inf
    centre = at = axis_point(screws[0])
    length = 0.0
    for screw in screws[1:]:
        away = perpendicular_to(screw, at)
        length, at = length + float(np.linalg.norm(away)), at - away
    return centre, length + float(np.linalg.norm(tool - at))


def additive_recurrence(count: int, dimensions: int) -> np.ndarray:
    """(count, dimensions) points that fill the unit cube evenly, however many are taken.

    M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences" (2018): the multiples,
    modulo 1, of the powers of 1 / g, where g > 1 is the root of g^(dimensions + 1) = g + 1.
    """
    g = 2.0
    for _ in range(64):
        g = (1.0 + g) ** (1.0 / (dimensions + 1))
    steps = g ** -np.arange(1.0, dimensions + 1)
    return (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0


def _spread(
    points: np.ndarray, limits: tuple[jax.Array, jax.Array], kinds: tuple[str, ...]
) -> jax.Array:
    """Points (m, n) of the unit cube, spread over the joint limits."""
    lower, upper = limits
    half = jnp.array([1.0 if kind == "prismatic" else np.pi for kind in kinds], lower.dtype)
    # A joint with one limit gets as much room on the other side as one without any.
    low = jnp.where(jnp.isfinite(upper), upper - 2 * half, -half)
    low = jnp.where(jnp.isfinite(lower), lower, low)
    high = jnp.where(jnp.isfinite(upper), upper, low + 2 * half)
    return low + (high - low) * jnp.asarray(points, lower.dtype)
