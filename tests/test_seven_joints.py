"""Arms with a joint to spare: an answer within the limits wherever there is one."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import check_closes, posed

import niryo_jax as nj
from niryo_jax.ik import IKStatus
from niryo_jax.ik.dispatch import method_for

SIZES = [64, pytest.param(256, marks=pytest.mark.completeness)]


@functools.cache
def arm(name):
    rng = np.random.default_rng(3)
    if name == "panda":
        # Franka Emika's published lengths and limits.
        z, y, lift = np.array([0, 0, 1.0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0])
        axes = [z, y, z, -y, z, -y, -z]
        points = [
            0 * z,
            0.333 * lift,
            0 * z,
            [0.0825, 0, 0.649],
            0 * z,
            1.033 * lift,
            [0.088, 0, 0],
        ]
        home = np.diag([1.0, -1.0, -1.0, 1.0])
        home[:3, 3] = 0.088, 0, 0.926
        lower = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
        upper = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
        return nj.Robot.from_axes(axes, points, home, lower=lower, upper=upper)
    if name == "narrow":
        nominal = nj.robots.load("kuka_iiwa14")
        lower = np.array([-0.5, -1.2, -0.6, 0.3, -0.7, -0.9, -1.1])
        return nj.Robot.from_screws(nominal.screws, nominal.home, lower=lower, upper=lower + 0.8)
    axes, points = rng.standard_normal((7, 3)), 0.3 * rng.standard_normal((7, 3))
    return nj.Robot.from_axes(
        axes, points, np.eye(4), lower=np.full(7, -1.2), upper=np.full(7, 0.8)
    )


def made(robot, size):
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (size, robot.joints))
    return posed(robot, q)


def check(robot, answer, pose):
    check_closes(robot, answer, pose, within=1e-9)
    found = np.asarray(answer.found)
    q, within = np.asarray(answer.q), np.asarray(answer.within_limits)
    inside = np.all((q >= robot.lower - 1e-8) & (q <= robot.upper + 1e-8), axis=-1)
    np.testing.assert_array_equal(within, inside & found)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    ("name", "method"), [("panda", "sampled"), ("narrow", "sampled"), ("random", "multistart")]
)
def test_a_pose_made_within_the_limits_is_answered_within_them(name, method, size):
    robot = arm(name)
    assert method_for(robot) == method
    pose = made(robot, size)
    answer = nj.inverse_kinematics(robot, pose)
    check(robot, answer, pose)
    assert np.all(answer.status == IKStatus.SOLVED)
    assert not np.any(answer.complete)


def test_the_joint_that_is_locked_is_one_that_moves_while_the_tool_rests():
    # At a pose the Panda's fourth joint, its elbow, can hardly move.
    assert [plan.locked for plan in arm("panda").plans][-1] == 3


@pytest.mark.parametrize("size", SIZES)
def test_inside_of_a_transformation_answers_are_right_and_follow_the_pose(size):
    robot = arm("narrow")
    pose = made(robot, size)
    twist = np.array([0.2, -0.1, 0.3, 0.05, 0.1, -0.2])

    @jax.jit
    def solve(pose, step):
        def at(step):
            answer = nj.inverse_kinematics(robot, pose @ nj.se3.exp(step * twist))
            return answer.q, answer

        return jax.jvp(at, (step,), (jnp.ones_like(step),), has_aux=True)

    q, rate, answer = solve(pose, jnp.float64(0.0))
    check(robot, answer, pose)
    assert np.mean(answer.status == IKStatus.SOLVED) > 0.95
    np.testing.assert_array_equal(q, answer.q)
    jacobian = nj.body_jacobian(robot, q)
    followed = np.einsum("bsij,bsj->bsi", jacobian, rate)
    found = np.asarray(answer.found)
    # Next to singularities rates are large.
    regular = found & (np.linalg.svd(jacobian, compute_uv=False)[..., -1] > 1e-3)
    assert regular.sum() > 10 * size
    np.testing.assert_allclose(
        followed[regular], np.broadcast_to(twist, (regular.sum(), 6)), atol=1e-6
    )
