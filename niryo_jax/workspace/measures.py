"""What the complete solution set of a pose says of it: reached or not, how often, and how well."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import Compiled, is_concrete
from niryo_jax.arguments import check_choice, check_positive, shown
from niryo_jax.collision import CollisionCheck
from niryo_jax.execution.compaction import for_each_chunk, tally
from niryo_jax.execution.devices import on_all_cores
from niryo_jax.execution.padding import cut_rows, padded_rows
from niryo_jax.ik import Method, inverse_kinematics
from niryo_jax.ik.results.limits import limit_margin
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes.batching import as_floating, check_shape, on_joints
from niryo_jax.lanes.singular import singular_values
from niryo_jax.programs import PROGRAMS
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised

_POSTURES = 512
_FEW_POSES = 256
_POSES = 4096


_State = tuple[jax.Array, jax.Array]
"""The best measures of poses so far, and how many of their solutions count."""


class PoseMeasures(NamedTuple):
    """What can be said of poses; each measure is that of the best solution within the limits.

    Attributes:
        solutions: (...,) number of solutions within the joint limits, free of collisions where
            these are looked at.
        colliding: (...,) number of solutions within the joint limits that collide.
        solutions_unlimited: (...,) number of solutions, whatever the limits and collisions.
        complete: (...,) whether it is proved that there are no others.
        manipulability: (...,) the product of the singular values of the Jacobian: Yoshikawa's
            sqrt(det(J J^T)) for six joints and more, m^3; greatest.
        limit_margin: (...,) distance of the joint nearest to one of its limits, radians; greatest.
        singular_value: (...,) smallest singular value of the body Jacobian, whose linear rows are
            divided by a length; greatest.
        position_noise: (...,) metres per radian: RMS position error for independent joint errors,
            to first order sqrt(trace(J_v J_v^T)); least.

    The last four are those of solutions that are counted in `solutions`, NaN where there is none.
    """

    solutions: jax.Array
    colliding: jax.Array
    solutions_unlimited: jax.Array
    complete: jax.Array
    manipulability: jax.Array
    limit_margin: jax.Array
    singular_value: jax.Array
    position_noise: jax.Array


def pose_measures(
    robot: Robot,
    pose: ArrayLike,
    *,
    method: Method | None = None,
    length: float = 1.0,
    collisions: CollisionCheck | None = None,
) -> PoseMeasures:
    """How often and how well an arm reaches poses.

    Args:
        robot: the arm.
        pose: (..., 4, 4) targets in the space frame, metres.
        method: as in `inverse_kinematics`.
        length: metres by which the linear rows of the Jacobian are divided for `singular_value`.
        collisions: what a solution has to stay clear of to count.

    Returns:
        `PoseMeasures` (...,); no solutions for a pose that is not a rigid motion.

    Raises:
        ValueError: a wrong shape, a length that is not positive, a limit that is not a number, and
            all that `inverse_kinematics` refuses.
        TypeError: a traced robot, no collision check.
    """
    check_robot(robot)
    check_length(length)
    check_collisions(robot, collisions)
    if method is not None:
        check_choice("method", method, get_args(Method))
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))

    def compiled() -> Compiled:
        options = {"method": method, "length": length, "collisions": collisions}
        return Compiled(functools.partial(measure, robot, **options), {})

    def program(part: jax.Array) -> PoseMeasures:
        key = measure, robot, method, length, collisions
        return PROGRAMS.run(key, compiled, is_concrete(part), part)

    def solve(pose: jax.Array) -> PoseMeasures:
        batch = pose.shape[:-2]
        rows = padded_rows(pose, len(batch), _padded(math.prod(batch)))
        parts = [program(part) for part in jnp.split(rows, max(1, len(rows) // _POSES))]
        return jax.tree.map(lambda *x: cut_rows(jnp.concatenate(x), batch), *parts)

    return on_all_cores(solve, [pose], pose.shape[:-2], _padded)


def check_robot(robot: Robot) -> None:
    """Refuse what is not a concrete robot whose limits are numbers."""
    check_is_robot(robot)
    robot.known_screws()
    if not is_concrete(robot.lower, robot.upper):
        raise TypeError("robot: expected concrete joint limits, got traced ones")
    limits = np.stack([np.asarray(robot.lower), np.asarray(robot.upper)])
    if np.any(np.isnan(limits)):
        raise ValueError(f"robot: expected joint limits that are numbers, got\n{limits}")


def check_length(length: float) -> None:
    """Refuse a length that is none."""
    check_positive("length", length, "a positive number of metres")


def check_collisions(robot: Robot, collisions: object) -> None:
    """Refuse what is neither None nor a collision check for this arm."""
    if collisions is None:
        return
    if not isinstance(collisions, CollisionCheck):
        raise TypeError(f"collisions: expected a CollisionCheck or None, got {shown(collisions)}")
    collisions.check_arm(robot)


def _padded(size: int) -> int:
    """Two sizes are compiled: for a few poses, and for so many at a time."""
    return _FEW_POSES if size <= _FEW_POSES else -(-size // _POSES) * _POSES


def measure(
    robot: Robot,
    pose: jax.Array,
    *,
    method: Method | None,
    length: float,
    collisions: CollisionCheck | None = None,
) -> PoseMeasures:
    """`pose_measures` of poses (rows, 4, 4), as part of a caller's program."""
    solutions = inverse_kinematics(robot, pose, method)
    rows, slots = solutions.found.shape
    within = solutions.within_limits
    q = solutions.q.reshape(rows * slots, -1)
    limits = solutions.lower, solutions.upper

    # Few slots hold a solution within the limits: what is computed of each is computed for those.
    def some(state: _State, at: jax.Array, live: jax.Array) -> _State:
        best, number = state
        posture = q[at]
        if collisions is not None:
            live = live & collisions.keeps(robot, posture)
        worth = _worth(robot, posture.T, length=length)
        margin = limit_margin(posture, *limits)
        where = jnp.where(live, at // slots, rows)
        best = best.at[where].max(jnp.stack([margin, *worth], axis=-1), mode="drop")
        return best, number if collisions is None else tally(number, where, live)

    everything = jnp.sum(within, axis=-1, dtype=jnp.int32)
    start = everything if collisions is None else jnp.zeros_like(everything)
    nothing = jnp.full((rows, 4), -jnp.inf, pose.dtype)
    chunk = min(_POSTURES, rows * slots)
    best, number = for_each_chunk(within.reshape(rows * slots), chunk, some, (nothing, start))
    reached = (number > 0)[:, None]
    noise_last = best * jnp.array([1.0, 1.0, 1.0, -1.0], best.dtype)
    margin, volume, smallest, noise = jnp.where(reached, noise_last, jnp.nan).T
    return PoseMeasures(
        number,
        everything - number,
        solutions.count,
        solutions.complete,
        volume,
        margin,
        smallest,
        noise,
    )


@specialised
def _worth(geometry: Geometry, q: jax.Array, length: float) -> tuple[jax.Array, ...]:
    """Manipulability, smallest singular value and minus the position noise of q (n, rows)."""
    jacobian = on_joints(
        lambda q: pose_and_jacobian(geometry, q, "body")[1], q, geometry.joints, batch_last=True
    )
    linear = jacobian[3:]
    values = singular_values(jnp.concatenate([jacobian[:3], linear / length]))
    noise = jnp.sqrt(jnp.sum(linear * linear, axis=(0, 1)))
    # A length can be taken out of the product of six rows, not of fewer columns.
    six = geometry.joints >= 6
    volume = jnp.prod(values if six else singular_values(jacobian), axis=0)
    return volume * (length**3 if six else 1.0), jnp.min(values, axis=0), -noise
