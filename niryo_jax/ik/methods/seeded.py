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
from niryo_jax.codes import Code
from niryo_jax.ik.methods.newton_answer import answer_of_newton
from niryo_jax.ik.newton.newton_raphson import NewtonResult, newton_raphson
from niryo_jax.ik.results.assemble import assemble
from niryo_jax.ik.results.deduplicate import duplicates
from niryo_jax.ik.results.limits import are_within_limits, limits_of, wrap_into_limits
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import UnreachableReason
from niryo_jax.ik.target import Target, make_target
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, check_shape, on_lanes
from niryo_jax.lie import se3
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.structure.offset_wrist import OffsetWristArm, offset_wrist_arm
from niryo_jax.subproblems import (
    Solved,
    paden_kahan_1_lanes,
    paden_kahan_2_lanes,
    paden_kahan_3_lanes,
)
from niryo_jax.tolerances import LIMIT_ROUNDING

BRANCHES = 8


class SeededBranches(NamedTuple):
    """The eight branches of the method, in the order wrist, shoulder, elbow.

    Attributes:
        guess: (..., 8, n) joint vectors of the arm with a spherical wrist: its solutions, or its
            closest approach where it has none.
        guess_error: (..., 8) metres by which the guess misses the target on the true arm.
        shoulder_distance: (...,) metres from the shoulder to the target's axis 6, at the wrist.
        newton: the refinement of each, with leading shape (..., 8).
        outcome: (..., 8) a `BranchStatus`: what became of it.
    """

    guess: jax.Array
    guess_error: jax.Array
    shoulder_distance: jax.Array
    newton: NewtonResult
    outcome: jax.Array


def seeded_branches(robot: Robot, pose: ArrayLike) -> SeededBranches:
    """The guesses of the published method and what Newton-Raphson makes of them.

    Args:
        robot: a concrete arm whose axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet.
        pose: (..., 4, 4) targets; poses that are no rigid motions count as the identity.

    Raises:
        ValueError: an arm of another family, or a wrong shape.
        TypeError: a traced robot.
    """
    return _branches(robot, _family(robot), _target(pose).pose)


def _target(pose: ArrayLike) -> Target:
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    return make_target(pose)


def _branches(robot: Robot, arm: OffsetWristArm, pose: jax.Array) -> SeededBranches:
    points = (jnp.asarray(x, pose.dtype) for x in (arm.shoulder, arm.wrist, arm.offset))
    guess, exact, error, distance = _guesses(robot, pose, *points)
    newton = newton_raphson(robot, pose[..., None, :, :], guess)
    outcome = _outcomes(newton, exact, limits_of(robot.lower, robot.upper, pose.dtype))
    return SeededBranches(guess, error, distance, newton, outcome)


def solve_seeded(robot: Robot, pose: ArrayLike) -> IKSolutions:
    """`inverse_kinematics` by the published method."""
    arm = _family(robot)
    target = _target(pose)
    branches = _branches(robot, arm, target.pose)
    offset = float(np.linalg.norm(arm.offset))
    limits = limits_of(robot.lower, robot.upper, target.pose.dtype)
    periodic = (True,) * robot.joints
    answer = answer_of_newton(branches.newton, limits, periodic)
    reason = _reason_out_of_reach(branches.shoulder_distance, (arm.wrist_range, offset))
    return assemble(answer._replace(unreachable=reason), target, limits, periodic)


class BranchStatus(Code):
    """What became of one branch."""

    SOLVED = 0, "A solution within the joint limits."
    OUTSIDE_LIMITS = 1, "A solution, but a joint is outside its limits."
    DUPLICATE = 2, "Dropped: Newton-Raphson ended at the solution of another branch."
    NOT_CONVERGED = 3, "Dropped: Newton-Raphson did not converge from this guess."
    NO_GUESS = (
        4,
        "Dropped: the arm with a spherical wrist has no solution in this branch, and "
        "Newton-Raphson did not converge from its closest approach.",
    )


def _family(robot: Robot) -> OffsetWristArm:
    check_is_robot(robot)
    arm = offset_wrist_arm(robot.known_screws())
    if arm is None:
        raise ValueError(
            f"method 'seeded' needs six revolute joints of which axes 1 and 2 meet, 2 and 3 are "
            f"parallel, 4 and 5 meet; {robot.name} is not such an arm:\n{robot.describe()}"
        )
    return arm


@specialised
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


@jax.jit
def _outcomes(
    newton: NewtonResult, exact: jax.Array, limits: tuple[jax.Array, jax.Array]
) -> jax.Array:
    """What became of each branch."""
    periodic = (True,) * newton.q.shape[-1]
    q = wrap_into_limits(newton.q, *limits, periodic)
    found = newton.converged & ~duplicates(q, newton.converged, periodic)
    return jnp.select(
        [found & are_within_limits(q, *limits), found, newton.converged, exact],
        [
            jnp.int32(BranchStatus.SOLVED),
            jnp.int32(BranchStatus.OUTSIDE_LIMITS),
            jnp.int32(BranchStatus.DUPLICATE),
            jnp.int32(BranchStatus.NOT_CONVERGED),
        ],
        jnp.int32(BranchStatus.NO_GUESS),
    )


@functools.partial(jax.jit, static_argnames="reach")
def _reason_out_of_reach(
    distance: jax.Array, reach: tuple[tuple[float, float], float]
) -> jax.Array:
    """What a distance of the target's axis 6 from the shoulder proves."""
    (near, far), offset = reach
    rounding = LIMIT_ROUNDING.of(distance.dtype)
    return jnp.select(
        [distance - offset > far + rounding, distance + offset < near - rounding],
        [jnp.int32(UnreachableReason.TOO_FAR), jnp.int32(UnreachableReason.TOO_NEAR)],
        jnp.int32(UnreachableReason.NONE),
    )
