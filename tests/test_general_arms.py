"""Arms that no closed form fits: many guesses for any chain, continuation for calibrated arms."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import check_closes, off_by, posed
from support import random_robot

import niryo_jax as nj
from niryo_jax.ik import IKStatus
from niryo_jax.ik.methods.continuation import nominal, solve_by_continuation
from niryo_jax.ik.methods.multistart import additive_recurrence, solve_multistart

POSES = 256  # one shape, so one program, for all tests on many poses


def turns_apart(a, b, periodic):
    apart = np.asarray(a) - np.asarray(b)
    return np.abs(apart - np.where(periodic, 2 * np.pi * np.round(apart / (2 * np.pi)), 0))


def has(solutions, q, tolerance=1e-4):
    """(...,): whether joint vectors (..., n) are among the solutions."""
    apart = turns_apart(solutions.q, q[..., None, :], solutions.periodic).max(axis=-1)
    return np.any((apart < tolerance) & np.asarray(solutions.found), axis=-1)


def check(robot, solutions, pose):
    check_closes(robot, solutions, pose, within=1e-9)
    assert not np.any(solutions.complete)


def perturbed(robot, rng, size):
    """A calibrated arm: `size` is how far off an axis is, not each of its coordinates."""
    return off_by(robot, rng, size / np.sqrt(3), limited=True)


@functools.cache
def random_case(joints, prismatic=()):
    rng = np.random.default_rng(joints)
    robot = random_robot(rng, joints, prismatic=prismatic)
    q = rng.uniform(-np.pi, np.pi, (POSES, joints))
    q[:, list(prismatic)] = rng.uniform(-1, 1, (POSES, len(prismatic)))
    pose = posed(robot, q)
    return robot, q, pose, solve_multistart(robot, pose)


def test_points_fill_the_cube_additive_recurrence():
    points = additive_recurrence(4096, 3)
    assert points.shape == (4096, 3)
    np.testing.assert_array_equal(points[:10], additive_recurrence(10, 3))
    cell = np.floor(points * 8).astype(int) @ [64, 8, 1]
    counts = np.bincount(cell, minlength=512)  # 8 on average
    assert counts.min() >= 3
    assert counts.max() <= 14


@pytest.mark.parametrize(("joints", "prismatic"), [(6, ()), (6, (2,)), (7, ())])
def test_every_answer_of_many_starts_reaches_the_pose(joints, prismatic):
    robot, _, pose, solutions = random_case(joints, prismatic)
    check(robot, solutions, pose)
    assert np.mean(np.asarray(solutions.status) == IKStatus.SOLVED) >= 0.98
    assert solutions.periodic == tuple(i not in prismatic for i in range(joints))
    assert solutions.q.shape == (POSES, 16, joints)


@pytest.mark.parametrize("prismatic", [(), (2,)])
def test_many_starts_find_the_joint_vector_that_made_the_pose(prismatic):
    _, q, _, solutions = random_case(6, prismatic)
    assert np.mean(has(solutions, q)) >= 0.97


def test_a_redundant_arm_fills_the_slots():
    *_, solutions = random_case(7)
    assert np.median(solutions.count) == 16


def test_many_starts_give_the_same_answer_again_in_any_batch_shape():
    robot, _, pose, solutions = random_case(6)
    again = solve_multistart(robot, pose)
    np.testing.assert_array_equal(solutions.q, again.q)
    one = solve_multistart(robot, pose[0])
    assert one.q.shape == (16, 6)
    assert one.status.shape == ()
    few = solve_multistart(robot, pose[:6].reshape(3, 2, 4, 4))
    assert few.q.shape == (3, 2, 16, 6)
    assert solve_multistart(robot, pose[:0]).q.shape == (0, 16, 6)
    np.testing.assert_array_equal(one.count, solutions.count[0])
    np.testing.assert_array_equal(few.count.ravel(), solutions.count[:6])


def test_more_poses_than_a_chunk_are_solved_chunk_by_chunk():
    robot, _, pose, solutions = random_case(6)
    many = solve_multistart(robot, np.concatenate([pose, pose[:10]]))
    np.testing.assert_array_equal(many.q[:POSES], solutions.q)
    np.testing.assert_array_equal(many.q[POSES:], solutions.q[:10])
    np.testing.assert_array_equal(many.lower, robot.lower)


def test_many_starts_prove_only_what_all_links_in_a_row_do_not_reach():
    for prismatic, status in (((), IKStatus.UNREACHABLE), ((2,), IKStatus.UNDECIDED)):
        robot, _, pose, _ = random_case(6, prismatic)
        far = pose[:6].copy()
        far[:, :3, 3] += 50.0
        far[0, 0, 0] = np.nan
        found = np.asarray(solve_multistart(robot, far).status)
        assert found[0] == IKStatus.INVALID_POSE
        assert np.all(found[1:] == status)


def test_many_starts_respect_the_limits(niryo, rng):
    q = rng.uniform(niryo.lower, niryo.upper, (POSES, 6))
    pose = posed(niryo, q)
    solutions = solve_multistart(niryo, pose)
    check(niryo, solutions, pose)
    assert np.mean(has(solutions, q)) >= 0.95
    inside = np.all((solutions.q >= niryo.lower) & (solutions.q <= niryo.upper), axis=-1)
    np.testing.assert_array_equal(solutions.within_limits, inside & solutions.found)


def test_many_starts_refuse_what_they_cannot_use(niryo):
    with pytest.raises(ValueError, match="starts: expected 1 or more, got 0"):
        solve_multistart(niryo, np.eye(4), starts=0)
    with pytest.raises(ValueError, match=r"pose: expected shape \(\.\.\., 4, 4\)"):
        solve_multistart(niryo, np.eye(3))
    with pytest.raises(TypeError, match="traced robot"):
        jax.jit(solve_multistart)(niryo, np.eye(4))


def check_derivative(solve, robot, pose):
    """The derivative of the first solution is that of the inverse: J_b dq = body twist."""
    twist = np.array([0.3, -0.2, 0.5, 0.1, 0.4, -0.6])
    weights = np.arange(1.0, 7.0)

    def total(step):
        moved = pose @ nj.se3.exp(step * twist)
        return jnp.sum(solve(robot, moved).q[..., 0, :] * weights)

    q = solve(robot, pose).q[0]
    expected = np.linalg.solve(nj.body_jacobian(robot, q), twist) @ weights
    np.testing.assert_allclose(jax.grad(total)(0.0), expected, rtol=1e-6)


def test_derivatives_through_many_starts():
    robot, _, pose, _ = random_case(6)
    check_derivative(solve_multistart, robot, pose[3])


@pytest.mark.parametrize("size", [1e-6, 1e-4, 3e-4])
def test_a_calibrated_arm_is_solved_from_its_nominal_arm(niryo, rng, size):
    robot = perturbed(niryo, rng, size)
    assert robot.offset_wrist is None
    near = nominal(robot)
    assert near is not None
    assert near.offset_wrist is not None
    np.testing.assert_allclose(near.screws, robot.screws, atol=10 * size)
    np.testing.assert_array_equal(near.home, robot.home)
    q = rng.uniform(niryo.lower, niryo.upper, (POSES, 6))
    pose = posed(robot, q)
    solutions = solve_by_continuation(robot, pose)
    check(robot, solutions, pose)
    assert np.mean(has(solutions, q)) >= 0.99
    assert np.mean(np.asarray(solutions.status) == IKStatus.SOLVED) >= 0.99


def test_the_nominal_arm_of_an_exact_arm_is_that_arm(niryo):
    near = nominal(niryo)
    np.testing.assert_allclose(near.screws, niryo.screws, atol=1e-15)
    np.testing.assert_array_equal([near.lower, near.upper], [niryo.lower, niryo.upper])


def test_arms_that_are_far_from_the_family_have_no_nominal_arm(niryo, rng):
    assert nominal(perturbed(niryo, rng, 0.05)) is None
    assert nominal(random_robot(rng, 6)) is None
    assert nominal(random_robot(rng, 7)) is None
    assert nominal(random_robot(rng, 6, prismatic=(2,))) is None
    with pytest.raises(ValueError, match="axes 1 and 2 nearly meet"):
        solve_by_continuation(random_robot(rng, 6), np.eye(4))
    with pytest.raises(TypeError, match="traced robot"):
        jax.jit(solve_by_continuation)(niryo, np.eye(4))


def test_continuation_takes_any_batch_shape_and_pose(niryo, rng):
    robot = perturbed(niryo, rng, 1e-4)
    # As many as the calibrated arms above are solved for, whose program this is.
    q = np.resize(rng.uniform(niryo.lower, niryo.upper, (6, 6)) * 0.5, (POSES // 2, 2, 6))
    pose = posed(robot, q)
    assert solve_by_continuation(robot, pose[0, 0]).q.shape == (16, 6)
    pose[0, 0, :3, 3] += 5.0
    pose[0, 1, 0, 0] = np.nan
    solutions = solve_by_continuation(robot, pose)
    assert solutions.q.shape == (POSES // 2, 2, 16, 6)
    status = np.asarray(solutions.status)
    assert status[0, 0] == IKStatus.UNDECIDED
    assert status[0, 1] == IKStatus.INVALID_POSE
    assert np.all(status[1:] == IKStatus.SOLVED)


def test_derivatives_through_continuation(niryo, rng):
    robot = perturbed(niryo, rng, 1e-4)
    check_derivative(solve_by_continuation, robot, posed(robot, rng.uniform(0.2, 0.5, 6)))
