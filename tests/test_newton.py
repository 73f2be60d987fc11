"""Newton-Raphson: that it converges, says so truly, and has the derivatives of the inverse."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES, DTYPES

import niryo_jax as nj


def near_guesses(robot, rng, count, distance=0.1):
    q = rng.uniform(robot.lower, robot.upper, (count, robot.joints))
    step = rng.standard_normal(q.shape)
    return q, q + distance * step / np.linalg.norm(step, axis=1, keepdims=True)


@pytest.mark.parametrize("frame", ["body", "space"])
@pytest.mark.parametrize("dtype", DTYPES)
def test_forward_kinematics_of_the_answer_is_the_target(niryo, rng, dtype, frame):
    q, guess = near_guesses(niryo, rng, 1000)
    pose = nj.forward_kinematics(niryo, q.astype(dtype))
    result = nj.newton_raphson(niryo, pose, guess.astype(dtype), frame=frame)
    assert result.q.dtype == dtype
    # A few random poses lie so near a singularity that a guess 0.1 rad away leads elsewhere.
    assert np.mean(result.converged) > 0.998
    pose, result = jax.tree.map(lambda x: x[result.converged], (pose, result))
    reached = nj.forward_kinematics(niryo, np.asarray(result.q, float))
    np.testing.assert_allclose(reached, pose, atol=1e-10 if dtype == np.float64 else 2e-5)
    errors = np.linalg.norm(reached[:, :3, 3] - pose[:, :3, 3], axis=1)
    np.testing.assert_allclose(
        result.position_error, errors, atol=1e-14 if dtype == np.float64 else 1e-6
    )


def test_undamped_steps_are_the_same_in_both_frames(niryo, rng):
    q, guess = near_guesses(niryo, rng, 100, 0.01)
    pose = nj.forward_kinematics(niryo, q)
    body, space = (
        nj.newton_raphson(niryo, pose, guess, frame=frame, damping=0.0, max_iterations=1)
        for frame in ("body", "space")
    )
    np.testing.assert_allclose(body.q, space.q, atol=1e-8)


def test_convergence_is_quadratic(niryo, rng):
    q, guess = near_guesses(niryo, rng, 200, 0.03)
    pose = nj.forward_kinematics(niryo, q)
    errors = []
    for _ in range(3):
        result = nj.newton_raphson(niryo, pose, guess, max_iterations=1)
        errors.append(np.median(result.rotation_error))
        guess = result.q
    assert errors[1] < 10 * errors[0] ** 2
    assert errors[2] < 10 * errors[1] ** 2


def test_the_step_that_converges_may_be_the_last_one_permitted(niryo, rng):
    q, guess = near_guesses(niryo, rng, 200)
    pose = nj.forward_kinematics(niryo, q)
    free = nj.newton_raphson(niryo, pose, guess)
    assert np.all(free.converged)
    steps, done = np.zeros(200, int), np.zeros(200, bool)
    # One step at a time: converged by as many as were taken freely, and by none fewer.
    for _ in range(int(free.iterations.max())):
        one = nj.newton_raphson(niryo, pose, guess, max_iterations=1)
        assert np.all(one.converged | (one.iterations == 1))
        steps, done, guess = steps + np.asarray(one.iterations), np.asarray(one.converged), one.q
        np.testing.assert_array_equal(done, steps >= free.iterations)
    np.testing.assert_array_equal(steps, free.iterations)
    assert np.all(done)


def test_a_guess_that_is_the_answer_takes_no_step(niryo):
    q = jnp.full(6, 0.3)
    result = nj.newton_raphson(niryo, nj.forward_kinematics(niryo, q), q)
    assert result.iterations == 0
    np.testing.assert_array_equal(result.q, q)


def test_no_joint_moves_by_more_than_the_step_limit(niryo, rng):
    q, guess = near_guesses(niryo, rng, 200, 3.0)
    pose = nj.forward_kinematics(niryo, q)
    result = nj.newton_raphson(niryo, pose, guess, max_iterations=1, step_limit=0.2)
    assert np.abs(result.q - guess).max() <= 0.2 * (1 + 1e-12)


def test_singular_configurations_end_finite(niryo):
    q = jnp.array([[0.0, 0, np.deg2rad(82.28675), 0, 0, 0], [0.3, 0.2, 0.1, 0.4, 0.0, 0.2]])
    pose = nj.forward_kinematics(niryo, q)
    result = nj.newton_raphson(niryo, pose, jnp.zeros(6))
    assert np.all(np.isfinite(result.q))


@pytest.mark.parametrize("prismatic", [(1, 0, 0, 0, 0, 0), (1, 1, 1, 0, 0, 0, 0)])
def test_any_chain(rng, prismatic):
    n = len(prismatic)
    robot = nj.Robot.from_axes(
        rng.standard_normal((n, 3)), rng.standard_normal((n, 3)), np.eye(4), prismatic=prismatic
    )
    q = rng.uniform(-1, 1, (100, n))
    pose = nj.forward_kinematics(robot, q)
    result = nj.newton_raphson(robot, pose, q + 0.03 * rng.standard_normal(q.shape))
    assert np.mean(result.converged) > 0.95
    reached = nj.forward_kinematics(robot, result.q)
    np.testing.assert_allclose(reached[result.converged], pose[result.converged], atol=1e-9)


def test_fewer_than_six_joints_reach_what_they_can(rng):
    robot = nj.Robot.from_axes(np.eye(3), rng.standard_normal((3, 3)), np.eye(4))
    q = rng.uniform(-1, 1, (50, 3))
    pose = nj.forward_kinematics(robot, q)
    result = nj.newton_raphson(robot, pose, q + 0.05)
    assert np.all(result.converged)
    np.testing.assert_allclose(result.q, q, atol=1e-8)


@pytest.mark.parametrize("batch", BATCHES)
def test_any_batch_axes_broadcast(niryo, batch):
    pose = nj.forward_kinematics(niryo, jnp.full((*batch, 6), 0.2))
    result = nj.newton_raphson(niryo, pose, jnp.zeros(6))
    assert result.q.shape == (*batch, 6)
    assert result.converged.shape == result.iterations.shape == batch
    assert np.all(result.converged)


def test_bad_poses_and_guesses_leave_the_others_alone(niryo):
    q = jnp.full(6, 0.2)
    good = np.asarray(nj.forward_kinematics(niryo, q))
    far = good.copy()
    far[0, 3] = 9.0
    poses = np.stack([good, good, good, 1.2 * good, far, good])
    poses[1, 0, 0], poses[2, 1, 3] = np.nan, np.inf
    guesses = np.zeros((6, 6))
    guesses[5, 2] = np.nan
    result = nj.newton_raphson(niryo, poses, guesses)
    assert result.converged.tolist() == [True, False, False, False, False, False]
    assert np.isfinite(result.position_error).tolist() == [True, False, False, False, True, False]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frame": "tool"}, "frame: expected one of 'body', 'space', got 'tool'"),
        ({"max_iterations": -1}, "max_iterations"),
        ({"step_limit": 0.0}, "step_limit"),
        ({"damping": -1.0}, "damping"),
        ({"damping": float("nan")}, "damping"),
        ({"position_tolerance": 0.0}, "position_tolerance"),
        ({"rotation_tolerance": -1.0}, "rotation_tolerance"),
    ],
)
def test_wrong_options_are_named(niryo, options, message):
    with pytest.raises(ValueError, match=message):
        nj.newton_raphson(niryo, np.eye(4), np.zeros(6), **options)


def test_wrong_shapes_are_named(niryo):
    with pytest.raises(ValueError, match=r"q0: expected shape \(\.\.\., 6\), got \(5,\)"):
        nj.newton_raphson(niryo, np.eye(4), np.zeros(5))
    with pytest.raises(ValueError, match=r"pose: expected shape \(\.\.\., 4, 4\), got \(3, 3\)"):
        nj.newton_raphson(niryo, np.eye(3), np.zeros(6))


QS = np.array([[0.3, -0.4, 0.2, 0.5, -0.6, 0.7], [-1.0, 0.2, -0.9, 1.4, 0.8, -2.0]])


def test_derivative_by_the_pose_is_the_inverse_jacobian(niryo, rng):
    pose = nj.forward_kinematics(niryo, QS)
    truth = np.linalg.inv(nj.body_jacobian(niryo, QS))

    def solve(twist):
        return nj.newton_raphson(niryo, pose @ nj.se3.exp(twist), QS + 0.01).q

    @jax.jit
    def both_modes(twist, cotangent):
        _, pullback = jax.vjp(solve, jnp.zeros((2, 6)))
        return jax.jvp(solve, (jnp.zeros((2, 6)),), (twist,))[1], pullback(cotangent)[0]

    twist, cotangent = rng.standard_normal((2, 2, 6))
    forward, reverse = both_modes(twist, cotangent)
    np.testing.assert_allclose(forward, np.einsum("bij,bj->bi", truth, twist), atol=1e-8)
    np.testing.assert_allclose(reverse, np.einsum("bij,bi->bj", truth, cotangent), atol=1e-8)


def test_first_and_second_derivative_along_a_curve_of_poses(rng):
    robot = nj.Robot.from_axes(np.eye(3), rng.standard_normal((3, 3)), np.eye(4))
    q = np.array([0.3, -0.4, 0.7])

    def solve(t):
        return nj.newton_raphson(robot, nj.forward_kinematics(robot, q + t * t), q + 0.01).q

    def both(t):
        return jax.jvp(lambda t: jax.jvp(solve, (t,), (1.0,))[1], (t,), (1.0,))

    first, second = jax.jit(both)(0.3)
    np.testing.assert_allclose(first, 0.6, atol=1e-8)
    np.testing.assert_allclose(second, 2.0, atol=1e-8)


def test_derivative_by_the_geometry_equals_finite_differences(niryo, rng):
    pose = nj.forward_kinematics(niryo, QS[0])
    direction = rng.standard_normal((6, 6))

    @jax.jit
    def solve(t):
        robot = dataclasses.replace(niryo, screws=niryo.screws + t * direction)
        return nj.newton_raphson(robot, pose, QS[0]).q

    rate = jax.jvp(solve, (0.0,), (1.0,))[1]
    np.testing.assert_allclose(rate, (solve(1e-6) - solve(-1e-6)) / 2e-6, rtol=1e-6, atol=1e-7)


def test_where_nothing_converged_the_derivative_is_zero(niryo):
    far = np.eye(4)
    far[0, 3] = 9.0
    for pose in (far, np.full((4, 4), np.nan)):
        gradient = jax.grad(lambda p: nj.newton_raphson(niryo, p, jnp.zeros(6)).q.sum())(
            jnp.asarray(pose)
        )
        np.testing.assert_array_equal(gradient, 0.0)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc/self/status")
def test_a_hundred_thousand_poses_at_once_within_two_gibibytes():
    code = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import niryo_jax as nj
robot = nj.robots.niryo_one()
rng = np.random.default_rng(0)
q = rng.uniform(robot.lower, robot.upper, (100_000, 6))
pose = nj.forward_kinematics(robot, q)
result = nj.newton_raphson(robot, pose, q + 0.05 * rng.standard_normal(q.shape))
assert result.q.dtype == np.float64
assert result.converged.mean() > 0.999, result.converged.mean()
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(int(status["VmHWM"].split()[0]) / 1024)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(run.stdout) < 2048
