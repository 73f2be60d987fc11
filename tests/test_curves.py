"""The solutions of arms with a joint to spare as curves, against forward kinematics and guesses."""

from __future__ import annotations

import dataclasses
import functools

import arms
import jax
import numpy as np
import pytest
from support import product_of_exponentials

import niryo_jax as nj
from benchmarks import random_arms
from niryo_jax.ik.methods.multistart import solve_multistart

STEP = 0.1
POSES = 12


@functools.cache
def case(name):
    """An arm, joint vectors within its limits, their poses, and the curves."""
    rng = np.random.default_rng(11)
    if name == "iiwa":
        robot = nj.robots.kuka_iiwa14()
    elif name == "panda":
        robot = panda()
    else:
        robot = random_arms.arm(name, rng)
        robot = dataclasses.replace(robot, lower=np.full(7, -1.9), upper=np.full(7, 2.3))
    q = rng.uniform(robot.lower, robot.upper, (POSES, 7))
    pose = np.asarray(product_of_exponentials(robot.screws, robot.home, q), float)
    return robot, q, pose, nj.inverse_kinematics(robot, pose, redundancy="curves", step=STEP)


def panda():
    """Franka Emika's published lengths and limits."""
    up, left = np.eye(3)[2], np.eye(3)[1]
    axes = [up, left, up, -left, up, -left, -up]
    heights = [0.0, 0.333, 0.0, 0.649, 0.0, 1.033, 0.0]
    points = [h * up for h in heights]
    points[3], points[6] = np.array([0.0825, 0, 0.649]), np.array([0.088, 0, 0])
    home = np.diag([1.0, -1.0, -1.0, 1.0])
    home[:3, 3] = 0.088, 0, 0.926
    lower = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    upper = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
    return nj.Robot.from_axes(axes, points, home, lower=lower, upper=upper)


ARMS = "iiwa", "panda", "seven joints in general position"
each_arm = pytest.mark.parametrize("name", ARMS)


def wrapped(difference):
    return (difference + np.pi) % (2 * np.pi) - np.pi


def away_from_curves(curves, row, q):
    """How far a joint vector is from the stretches of the curves of a pose."""
    best = np.inf
    for points, valid, ends in zip(curves.q[row], curves.valid[row], curves.ends[row]):
        way = np.asarray(points)[np.asarray(valid)]
        if len(way) and ends[0] == nj.CurveEnd.CLOSED:
            way = np.concatenate([way, way[-1:] + wrapped(way[:1] - way[-1:])])
        if len(way) < 2:
            continue
        along, off = np.diff(way, axis=0), wrapped(q - way[:-1])
        share = np.clip(np.sum(along * off, axis=1) / np.sum(along**2, axis=1), 0, 1)
        best = min(best, np.abs(off - share[:, None] * along).max(axis=1).min())
    return best


@each_arm
def test_every_point_reaches_its_pose_within_the_limits(name):
    robot, _, pose, curves = case(name)
    valid = np.asarray(curves.valid)
    reached = product_of_exponentials(robot.screws, robot.home, np.asarray(curves.q)[valid])
    wanted = np.broadcast_to(pose[:, None, None], (*valid.shape, 4, 4))[valid]
    np.testing.assert_allclose(np.asarray(reached, float), wanted, atol=1e-11)
    assert np.all(np.asarray(curves.position_error)[valid] < 1e-11)
    assert np.all(np.isinf(np.asarray(curves.position_error)[~valid]))
    margin = np.minimum(curves.q - robot.lower, robot.upper - curves.q).min(axis=-1)
    np.testing.assert_allclose(np.asarray(curves.limit_margin)[valid], margin[valid], atol=1e-15)
    assert np.all(margin[valid] >= -1e-9)


@each_arm
def test_no_joint_jumps_and_what_is_closed_returns(name):
    _, _, _, curves = case(name)
    q, valid = np.asarray(curves.q), np.asarray(curves.valid)
    moves = np.abs(np.diff(q, axis=2)).max(axis=-1)
    assert np.all(moves[valid[:, :, 1:]] <= STEP * (1 + 1e-9))
    # Those of a curve come first.
    assert np.all(valid[:, :, :-1] | ~valid[:, :, 1:])
    for row, i in zip(*np.nonzero(np.asarray(curves.ends)[..., 0] == nj.CurveEnd.CLOSED)):
        if curves.found[row, i]:
            mine = q[row, i][valid[row, i]]
            assert np.abs(wrapped(mine[0] - mine[-1])).max() <= STEP


@each_arm
def test_ends_are_where_a_joint_comes_to_its_limit(name):
    robot, _, _, curves = case(name)
    ends, joints = np.asarray(curves.ends), np.asarray(curves.end_joint)
    at_limit = 0
    for row, i in zip(*np.nonzero(np.asarray(curves.found))):
        mine = np.asarray(curves.q[row, i])[np.asarray(curves.valid[row, i])]
        for side, point in enumerate((mine[0], mine[-1])):
            if ends[row, i, side] != nj.CurveEnd.LIMIT:
                assert joints[row, i, side] == -1
                continue
            j = joints[row, i, side]
            room = min(abs(point[j] - robot.lower[j]), abs(point[j] - robot.upper[j]))
            # Where a curve all but touches a limit it ends at its last point within.
            at_limit += room < 1e-12
            assert room <= STEP
    limits = int(np.sum(ends[np.asarray(curves.found)] == nj.CurveEnd.LIMIT))
    assert limits > 0
    assert at_limit >= 0.98 * limits


@each_arm
def test_the_joint_vectors_that_made_the_poses_are_on_curves(name):
    _, q, _, curves = case(name)
    away = [away_from_curves(curves, row, x) for row, x in enumerate(q)]
    np.testing.assert_array_less(away, 0.1 * STEP)
    np.testing.assert_array_equal(curves.status, nj.IKStatus.SOLVED)
    np.testing.assert_array_equal(curves.count, np.sum(curves.found, axis=-1))


@each_arm
def test_guesses_know_no_other_solutions(name):
    robot, _, pose, curves = case(name)
    guessed = solve_multistart(robot, pose)
    within = np.asarray(guessed.within_limits)
    known = [
        away_from_curves(curves, row, np.asarray(guessed.q)[row, slot]) < 0.1 * STEP
        for row, slot in zip(*np.nonzero(within))
    ]
    assert len(known) > POSES
    # Curves that are shorter than the values of the locked joint are apart can be missed.
    assert np.mean(known) >= 0.98


def test_without_limits_curves_are_closed_and_pass_all_samples():
    robot, _, pose, _ = case("iiwa")
    free = dataclasses.replace(robot, lower=np.full(7, -np.inf), upper=np.full(7, np.inf))
    curves = nj.inverse_kinematics(free, pose[:4], redundancy="curves", step=STEP)
    found = np.asarray(curves.found)
    assert np.mean(np.asarray(curves.ends)[found] == nj.CurveEnd.CLOSED) > 0.9
    sets = nj.inverse_kinematics(robot, pose[:4, None], arm_angle=np.array([-2.1, 0.3, 1.9]))
    for row, i, slot in zip(*np.nonzero(np.asarray(sets.found))):
        assert away_from_curves(curves, row, np.asarray(sets.q)[row, i, slot]) < 0.1 * STEP


def test_what_is_chosen_along_the_curves_is_the_best_of_their_points():
    robot, q, _, curves = case("panda")
    valid, points = np.asarray(curves.valid), np.asarray(curves.q)
    far, ok = curves.farthest_from_limits()
    assert np.all(ok)
    best = np.where(valid, curves.limit_margin, -np.inf).max(axis=(1, 2))
    margin = np.minimum(far - robot.lower, robot.upper - far).min(axis=-1)
    np.testing.assert_allclose(margin, best, atol=1e-15)
    able, _ = curves.most_manipulable()
    measure = np.where(valid, nj.manipulability(robot, points), -np.inf).max(axis=(1, 2))
    np.testing.assert_allclose(nj.manipulability(robot, able), measure, rtol=1e-9)
    near, _ = curves.nearest(q)
    assert np.all(np.abs(near - q).max(axis=-1) <= STEP)
    answer = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q))
    reach = np.minimum(answer.q[:, 0] - robot.lower, robot.upper - answer.q[:, 0]).min(axis=-1)
    assert np.all(margin >= reach - STEP)


@pytest.mark.parametrize("batch", [(), (2, 1), (0,)])
def test_any_batch_gives_the_curves_of_its_poses(batch):
    robot, _, pose, curves = case("iiwa")
    count = int(np.prod(batch))
    given = pose[:count].reshape(*batch, 4, 4)
    some = nj.inverse_kinematics(robot, given, redundancy="curves", step=STEP)
    assert some.status.shape == batch
    assert some.found.shape[:-1] == batch
    np.testing.assert_array_equal(np.ravel(some.count), curves.count[:count])
    if count:
        longest = np.asarray(curves.length)[:count, 0]
        np.testing.assert_allclose(np.asarray(some.length).reshape(count, -1)[:, 0], longest)
        again = some.map(lambda x: x.reshape(count, *x.shape[len(batch) :]))
        np.testing.assert_array_equal(again.status, np.ravel(some.status))


def test_a_pose_without_curves_says_why():
    robot, _, pose, _ = case("iiwa")
    bad, far = np.full((4, 4), np.nan), pose[0].copy()
    far[0, 3] += 10.0
    given = np.stack([bad, far, pose[0]])
    curves = nj.inverse_kinematics(robot, given, redundancy="curves", step=STEP)
    expected = nj.IKStatus.INVALID_POSE, nj.IKStatus.UNREACHABLE, nj.IKStatus.SOLVED
    np.testing.assert_array_equal(curves.status, expected)
    q, ok = curves.nearest(np.full(7, 0.3))
    np.testing.assert_array_equal(ok, [False, False, True])
    np.testing.assert_array_equal(q[:2], 0.3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 0.0}, "step: expected"),
        ({"step": 2.0}, "step: expected"),
        ({"method": "multistart"}, "expected no method"),
        ({"locked": (0, 0.1)}, "expected no method"),
        ({"redundancy": "lines"}, "redundancy: expected"),
        ({"redundancy": "points", "step": 0.1}, "step: is for redundancy 'curves'"),
    ],
)
def test_what_curves_cannot_take_is_refused(options, words):
    robot = nj.robots.kuka_iiwa14()
    with pytest.raises(ValueError, match=words):
        nj.inverse_kinematics(robot, np.eye(4), **{"redundancy": "curves", **options})


def test_other_arms_and_traced_ones_are_refused():
    with pytest.raises(ValueError, match="seven joints"):
        nj.inverse_kinematics(nj.robots.niryo_one(), np.eye(4), redundancy="curves")
    robot = nj.robots.kuka_iiwa14()
    with pytest.raises(TypeError, match="concrete"):
        jax.jit(lambda pose: nj.inverse_kinematics(robot, pose, redundancy="curves").q)(np.eye(4))


@pytest.mark.parametrize("joint", [0, 6])
def test_the_first_or_the_last_joint_of_any_seven_can_be_locked(joint, rng):
    robot = random_arms.arm("seven joints in general position", rng)
    q = rng.uniform(-np.pi, np.pi, (64, 7))
    pose = arms.forward(robot, q)[0]
    answer = nj.inverse_kinematics(robot, pose, locked=(joint, q[:, joint]))
    found = np.asarray(answer.found)
    assert np.mean(answer.complete) >= 0.95
    assert np.all(np.any(found & (arms.apart(robot, answer.q, q[:, None]) < 1e-6), axis=1))
    held = np.broadcast_to(q[:, None, joint], found.shape)[found]
    np.testing.assert_allclose(np.asarray(answer.q)[found][:, joint], held, atol=1e-15)
    reached = arms.forward(robot, np.asarray(answer.q)[found])[0]
    wanted = np.broadcast_to(pose[:, None], (*found.shape, 4, 4))[found]
    np.testing.assert_allclose(reached, wanted, atol=1e-10)
    with pytest.raises(ValueError, match=r"joint 3 .* cannot be locked; .* \[0, 6\]"):
        nj.inverse_kinematics(robot, pose, locked=(3, 0.0))


def test_an_arm_whose_neighbouring_axes_all_meet_is_solved_by_guesses(rng):
    axes, points = rng.standard_normal((6, 3)), np.zeros((6, 3))
    for i in range(1, 6):
        points[i] = points[i - 1] + rng.normal() * axes[i - 1] / np.linalg.norm(axes[i - 1])
    robot = nj.Robot.from_axes(axes, points, np.eye(4))
    assert not robot.is_general
    assert "some may be missed" in robot.describe()
    q = rng.uniform(-np.pi, np.pi, (32, 6))
    answer = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q))
    assert not np.any(answer.complete)
    assert np.mean(np.any(arms.apart(robot, answer.q, q[:, None]) < 1e-5, axis=1)) >= 0.9
