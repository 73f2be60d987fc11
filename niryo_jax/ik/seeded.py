"""The published method for the Niryo family: Paden-Kahan guesses, then Newton-Raphson.

Algorithm 2 of Todorovic et al. (2024). Their arm is solved exactly as if its wrist were spherical
(axis 6 moved by the wrist offset L8 to where axes 4 and 5 meet): subproblem 3 gives theta3,
subproblem 2 theta1 and theta2, subproblem 2 theta4 and theta5, subproblem 1 theta6; each of the
2 x 2 x 2 branches is then refined on the true arm. A guess has the right orientation and a
position wrong by exactly L8. The arm with a spherical wrist cannot reach quite where the
true arm can; there the closest approach of each subproblem is the guess, where the paper stops.

The method is not complete: the true arm has up to 16 solutions, of which this finds at most 8.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.chain import Motion, compose, joint_motion, tool_motion
from niryo_jax.geometry import Geometry, on_robot
from niryo_jax.ik.newton import NewtonResult, newton_raphson
from niryo_jax.ik.solutions import (
    SLOTS,
    BranchStatus,
    IKSolutions,
    IKStatus,
    are_within_limits,
    limit_margin,
    wrap_into_limits,
)
from niryo_jax.ik.target import Target, make_target
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import on_lanes
from niryo_jax.lie import se3
from niryo_jax.robot import Robot
from niryo_jax.structure import OffsetWristArm, offset_wrist_arm
from niryo_jax.subproblems import (
    Solved,
    paden_kahan_1_lanes,
    paden_kahan_2_lanes,
    paden_kahan_3_lanes,
)
from niryo_jax.tolerances import LIMIT_ROUNDING, SAME_SOLUTION

BRANCHES = 8


class SeededBranches(NamedTuple):
    """The eight branches of the method, in the order wrist, shoulder, elbow.

    Attributes:
        guess: (..., 8, n) joint vectors of the arm with a spherical wrist.
        exact: (..., 8) whether the guess solves that arm, rather than being its closest approach.
        guess_error: (..., 8) metres by which the guess misses the target on the true arm.
        shoulder_distance: (...,) metres from the shoulder to the target's axis 6, at the wrist.
        newton: the refinement of each, with leading shape (..., 8).
    """

    guess: jax.Array
    exact: jax.Array
    guess_error: jax.Array
    shoulder_distance: jax.Array
    newton: NewtonResult


def seeded_branches(robot: Robot, pose: ArrayLike) -> SeededBranches:
    """The guesses of the published method and what Newton-Raphson makes of them.

    Args:
        robot: a concrete arm whose axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet.
        pose: (..., 4, 4) targets; poses that are no rigid motions count as the identity.

    Raises:
        ValueError: an arm of another family, or a wrong shape.
        TypeError: a traced robot.
    """
    return _branches(robot, _family(robot), make_target(pose).pose)


def _branches(robot: Robot, arm: OffsetWristArm, pose: jax.Array) -> SeededBranches:
    points = (jnp.asarray(x, pose.dtype) for x in (arm.shoulder, arm.wrist, arm.offset))
    guess, exact, error, distance = _guesses(robot, pose, *points)
    newton = newton_raphson(robot, pose[..., None, :, :], guess)
    return SeededBranches(guess, exact, error, distance, newton)


def solve_seeded(robot: Robot, pose: ArrayLike) -> IKSolutions:
    """`inverse_kinematics` by the published method."""
    arm = _family(robot)
    target = make_target(pose)
    branches = _branches(robot, arm, target.pose)
    dtype = target.pose.dtype
    return _collect(
        branches,
        target,
        jnp.asarray(robot.lower, dtype),
        jnp.asarray(robot.upper, dtype),
        reach=(arm.wrist_range, float(np.linalg.norm(arm.offset))),
        joints=robot.joints,
    )


def _family(robot: Robot) -> OffsetWristArm:
    arm = offset_wrist_arm(robot.known_screws())
    if arm is None:
        raise ValueError(
            f"method 'seeded' needs six revolute joints of which axes 1 and 2 meet, 2 and 3 are "
            f"parallel, 4 and 5 meet; {robot.name} is not such an arm:\n{robot.describe()}"
        )
    return arm


@on_robot
def _guesses(
    geometry: Geometry,
    target: jax.Array,
    shoulder: jax.Array,
    wrist: jax.Array,
    offset: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    batch = target.shape[:-2]

    def solve(
        target: Lanes, shoulder: Lanes, wrist: Lanes, offset: Lanes
    ) -> tuple[Lanes, Lane, Lane, Lane]:
        s1, s2, s3, s4, s5, s6 = geometry.screws
        home_rotation, home = se3.split(geometry.home)
        # Axis 6 and the home pose moved by the offset, so that axes 4, 5 and 6 meet in the wrist
        # (eq. 30 with L8 = 0).
        spherical = np.concatenate([s6[:3], s6[3:] - lanes.cross(s6[:3], offset)])
        moved = se3.inverse_lanes(home_rotation, home + offset)
        t1 = compose(se3.split(target), moved)
        goal = _apply(t1, wrist)
        distance = lanes.norm(goal - shoulder)
        elbow = paden_kahan_3_lanes(s3, wrist, shoulder, np.array([distance], dtype=object))
        theta3 = _stack(elbow, 0)
        bent = _apply(joint_motion(geometry, 2, theta3), wrist)
        upper = paden_kahan_2_lanes(s1, s2, bent, goal)
        theta1, theta2 = _stack(upper, 0), _stack(upper, 1)
        arm = compose(
            compose(joint_motion(geometry, 0, theta1), joint_motion(geometry, 1, theta2)),
            joint_motion(geometry, 2, theta3),
        )
        t2 = compose(se3.inverse_lanes(*arm), t1)
        on_axis = wrist + s6[:3]
        hand = paden_kahan_2_lanes(s4, s5, on_axis, _apply(t2, on_axis))
        theta4, theta5 = _stack(hand, 0), _stack(hand, 1)
        forearm = compose(joint_motion(geometry, 3, theta4), joint_motion(geometry, 4, theta5))
        t3 = compose(se3.inverse_lanes(*forearm), t2)
        off_axis = wrist + lanes.cross(s6[:3], s5[:3])
        twist = paden_kahan_1_lanes(spherical, off_axis, _apply(t3, off_axis))
        theta6 = twist.angles[0, 0]
        q = np.array([theta1, theta2, theta3, theta4, theta5, theta6], dtype=object)
        exact = elbow.valid[0] * upper.valid[0] * hand.valid[0]
        error = lanes.norm(tool_motion(geometry, q)[1] - target[:3, 3])
        return q, exact, error, distance

    q, exact, error, distance = on_lanes(
        solve,
        ("pose", target, (4, 4)),
        ("shoulder", shoulder, (3,)),
        ("wrist", wrist, (3,)),
        ("offset", offset, (3,)),
    )

    def to_branches(x: jax.Array, last: tuple[int, ...]) -> jax.Array:
        branches = jnp.broadcast_to(x, (2, 2, 2, *batch, *last))
        return jnp.moveaxis(branches.reshape(BRANCHES, *batch, *last), 0, len(batch))

    q = to_branches(q, (geometry.joints,))
    return q, to_branches(exact, ()) > 0.5, to_branches(error, ()), distance


def _apply(motion: Motion, point: Lanes) -> Lanes:
    return motion[0] @ point + motion[1]


def _stack(solved: Solved, joint: int) -> Lane:
    """Both solutions of one joint, along a new leading axis of the batch."""
    pair = jnp.broadcast_arrays(*(slot[joint].value for slot in solved.angles))
    return Lane(jnp.stack(pair))


@functools.partial(jax.jit, static_argnames=("reach", "joints"))
def _collect(
    branches: SeededBranches,
    target: Target,
    lower: jax.Array,
    upper: jax.Array,
    reach: tuple[tuple[float, float], float],
    joints: int,
) -> IKSolutions:
    """Wrap, deduplicate, rank, and say what became of each branch and of the pose."""
    periodic = (True,) * joints
    q, newton = wrap_into_limits(branches.newton.q, lower, upper, periodic), branches.newton
    converged = newton.converged & target.valid[..., None]
    duplicate = _duplicates(q, converged)
    found = converged & ~duplicate
    within = found & are_within_limits(q, lower, upper)
    branch = jnp.select(
        [within, found, converged, branches.exact],
        [
            jnp.int32(BranchStatus.SOLVED),
            jnp.int32(BranchStatus.OUTSIDE_LIMITS),
            jnp.int32(BranchStatus.DUPLICATE),
            jnp.int32(BranchStatus.NOT_CONVERGED),
        ],
        jnp.int32(BranchStatus.NO_GUESS),
    )
    worth = jnp.where(found, limit_margin(q, lower, upper), -jnp.inf)
    order = jnp.argsort(-worth, axis=-1, stable=True)

    def ranked(x: jax.Array, empty: float) -> jax.Array:
        index = order.reshape(order.shape + (1,) * (x.ndim - order.ndim))
        rest = jnp.full(
            (*x.shape[: order.ndim - 1], SLOTS - BRANCHES, *x.shape[order.ndim :]), empty
        )
        best_first = jnp.take_along_axis(x, index, axis=order.ndim - 1)
        return jnp.concatenate([best_first, rest.astype(x.dtype)], axis=order.ndim - 1)

    (near, far), offset = reach
    distance = branches.shoulder_distance
    rounding = LIMIT_ROUNDING.of(q.dtype)
    out_of_reach = (distance - offset > far + rounding) | (distance + offset < near - rounding)
    count = jnp.sum(found, axis=-1, dtype=jnp.int32)
    status = jnp.select(
        [~target.valid, jnp.any(within, axis=-1), count > 0, out_of_reach],
        [
            jnp.int32(IKStatus.INVALID_POSE),
            jnp.int32(IKStatus.SOLVED),
            jnp.int32(IKStatus.OUTSIDE_LIMITS),
            jnp.int32(IKStatus.UNREACHABLE),
        ],
        jnp.int32(IKStatus.UNDECIDED),
    )
    return IKSolutions(
        q=ranked(jnp.where(found[..., None], q, 0.0), 0.0),
        found=ranked(found, False),
        within_limits=ranked(within, False),
        position_error=ranked(jnp.where(found, newton.position_error, jnp.inf), jnp.inf),
        rotation_error=ranked(jnp.where(found, newton.rotation_error, jnp.inf), jnp.inf),
        branch=ranked(branch, BranchStatus.EMPTY),
        status=status,
        count=count,
        pose_distance=target.distance,
        lower=lower,
        upper=upper,
        periodic=periodic,
    )


def _duplicates(q: jax.Array, converged: jax.Array) -> jax.Array:
    """(..., 8): whether a branch has ended at the solution of one before it."""
    later = []
    for j in range(q.shape[-2]):
        turns = q[..., :j, :] - q[..., j : j + 1, :]
        apart = jnp.abs(turns - 2 * jnp.pi * jnp.round(turns / (2 * jnp.pi)))
        same = jnp.all(apart < SAME_SOLUTION.of(q.dtype), axis=-1) & converged[..., :j]
        later.append(jnp.any(same, axis=-1))
    return jnp.stack(later, axis=-1) & converged
