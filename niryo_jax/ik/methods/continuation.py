"""Inverse kinematics of an arm that is nearly of a family that can be solved completely.

The axes of a calibrated arm miss each other by micrometres or more and are not quite parallel, so
no closed form fits it. The nearest arm that has the exact structure is solved completely, and each
of its solutions is carried over to the true arm by Newton-Raphson.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.execution.padding import in_chunks
from niryo_jax.ik.methods.complete import solve_complete
from niryo_jax.ik.methods.newton_answer import answer_of_newton
from niryo_jax.ik.newton.newton_raphson import newton_raphson
from niryo_jax.ik.results.assemble import assemble
from niryo_jax.ik.results.limits import limits_of, without_whole_turns
from niryo_jax.ik.results.ranking import Answer
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.target import make_target
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.lie import se3
from niryo_jax.robot import Robot
from niryo_jax.structure.offset_wrist import nearly_offset_wrist_axes, offset_wrist_arm
from niryo_jax.tolerances import AXES_NEARLY_MEET, AXES_NEARLY_PARALLEL

_SHIFT = 5.0
_OTHERS = 16


def nominal(robot: Robot) -> Robot | None:
    """The arm nearest to `robot` of which axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet.

    Axes 1 and 2, and 4 and 5, are moved to meet half-way between; axis 3 is made parallel to axis
    2, through the point of it nearest to where 4 and 5 meet. All else stays as it is.

    Args:
        robot: a concrete arm.

    Returns:
        A robot with float64 geometry whose `offset_wrist` is known; None where
        `structure.nearly_offset_wrist_axes` is.

    Raises:
        TypeError: a traced robot.
    """
    near = nearly_offset_wrist_axes(robot.known_screws())
    if near is None:
        return None
    arm = Robot.from_axes(
        *near,
        np.asarray(robot.home, np.float64),
        lower=robot.lower,
        upper=robot.upper,
        joint_names=robot.joint_names,
        name=f"{robot.name}, nominal",
    )
    return arm if arm.offset_wrist is not None else None


def solve_by_continuation(robot: Robot, pose: ArrayLike) -> IKSolutions:
    """Joint vectors of an arm that is nearly an offset-wrist arm, from those of its nominal arm.

    The guesses from which Newton-Raphson solves the true arm are the nominal arm's solutions for
    the pose, and those for seven poses around it, a few times as far away as the arms differ: two
    solutions that merge on the nominal arm before they do on the true arm are apart at one of
    these. The answer is still not proved `complete`: at the edge of reach, and where solutions
    nearly merge, one may be lost (about one pose in a thousand of arms that differ by 0.3 mm).

    Args:
        robot: a concrete arm for which `nominal` finds an arm.
        pose: (..., 4, 4) targets in the space frame, metres; projected to SE(3) first.

    Returns:
        `IKSolutions` with 16 slots. The status is UNDECIDED where nothing is found.

    Raises:
        ValueError: a wrong shape, or an arm that is not nearly of the family.
        TypeError: a traced robot.
    """
    near = nominal(robot)
    if near is None:
        raise ValueError(
            "continuation needs six revolute joints of which axes 1 and 2 nearly meet, 2 and 3 are "
            f"nearly parallel, 4 and 5 nearly meet (within {AXES_NEARLY_MEET} m and "
            f"{AXES_NEARLY_PARALLEL} rad); {robot.name} is not such an arm:\n{robot.describe()}"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    shifts = se3.exp(jnp.asarray(_shifts(robot, near), pose.dtype))
    limits = limits_of(robot.lower, robot.upper, pose.dtype)
    periodic = (True,) * robot.joints
    target = make_target(pose)

    def answers(poses: jax.Array) -> Answer:
        start = solve_complete(near, jax.lax.stop_gradient(poses)[:, None] @ shifts)
        newton = newton_raphson(robot, poses[:, None], _guesses(start.q, start.found))
        return answer_of_newton(newton, limits, periodic)

    return assemble(in_chunks(answers, target.pose), target, limits, periodic)


def _shifts(robot: Robot, near: Robot) -> np.ndarray:
    """(8, 6) twists of the tool: none, and the corners of a simplex as large as the arms differ."""
    screws = near.known_screws()
    arm = offset_wrist_arm(screws)
    assert arm is not None
    reach = arm.wrist_range[1]
    change = screws - robot.known_screws()
    size = _SHIFT * max(np.linalg.norm(change[:, :3]), np.linalg.norm(change[:, 3:]) / reach)
    # The unit vectors of seven dimensions, seen along (1, ..., 1).
    corners = np.linalg.svd(np.eye(7) - 1 / 7)[0][:, :6] * np.sqrt(7 / 6)
    corners[:, 3:] *= reach
    return np.concatenate([np.zeros((1, 6)), size * corners])


@jax.jit
def _guesses(q: jax.Array, found: jax.Array) -> jax.Array:
    """(..., 32, n) guesses from the solutions (..., 8, 16, n) of the pose and of those around it.

    They are all of the pose itself, and those around it that are farthest from any of these.
    """
    own, others = q[..., 0, :, :], q[..., 1:, :, :]
    others = others.reshape(*own.shape[:-2], -1, own.shape[-1])
    exists = found[..., 1:, :].reshape(others.shape[:-1])
    apart = others[..., :, None, :] - own[..., None, :, :]
    apart = jnp.max(jnp.abs(without_whole_turns(apart, (True,) * own.shape[-1])), axis=-1)
    apart = jnp.min(jnp.where(found[..., 0, None, :], apart, 2 * jnp.pi), axis=-1)
    _, best = jax.lax.top_k(jnp.where(exists, apart, -1.0), _OTHERS)
    others = jnp.take_along_axis(others, best[..., None], axis=-2)
    exists = jnp.take_along_axis(exists, best, axis=-1)
    guesses = jnp.concatenate([own, others], axis=-2)
    exists = jnp.concatenate([found[..., 0, :], exists], axis=-1)
    # One that exists stands in for those that do not: it converges at once and counts once.
    one = jnp.argmax(exists, axis=-1)[..., None, None]
    return jnp.where(exists[..., None], guesses, jnp.take_along_axis(guesses, one, axis=-2))
