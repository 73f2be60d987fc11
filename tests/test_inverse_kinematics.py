"""`inverse_kinematics`: both methods, solutions, statuses, limits, ranking, derivatives."""

from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES, DATA

import niryo_jax as nj
from niryo_jax.execution.compaction import running_count
from niryo_jax.ik import BranchStatus, seeded_branches, wrap_into_limits

CASES = json.loads((DATA / "niryo_one_ik.json").read_text())["cases"]
POSES = np.array([case["pose"] for case in CASES])
ROBOTS = ("niryo_one", "niryo_ned", "niryo_ned2")


def apart(a, b):
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


@pytest.fixture(scope="module")
def answer():
    return nj.inverse_kinematics(nj.robots.niryo_one(), POSES)


def test_rows_are_counted_exactly_beyond_the_whole_numbers_of_float32():
    size = 2**24 + 100
    count, total = running_count(np.ones(size, bool))
    assert total == size
    np.testing.assert_array_equal(count[-100:], np.arange(size - 99, size + 1))


def test_an_answer_that_newton_raphson_takes_across_pi_stays_right():
    # One of its solutions, theta_2 = 3.13685, is found from just above -pi.
    ned = nj.robots.niryo_ned()
    made_by = [-0.019477854133862493, -3.0400524746039346, 1.2877093304759608]
    made_by += [1.4872845583724459, -0.618738798248796, -0.17885249953582294]
    pose = nj.forward_kinematics(ned, made_by)
    answer = nj.inverse_kinematics(ned, pose)
    assert answer.count == 6
    reached = nj.forward_kinematics(ned, answer.q[answer.found])
    np.testing.assert_allclose(reached, np.broadcast_to(pose, reached.shape), atol=1e-12)


@pytest.mark.parametrize(("method", "share"), [("complete", 1.0), ("seeded", 0.92)])
def test_every_answer_is_a_known_solution(niryo, method, share):
    answer = nj.inverse_kinematics(niryo, POSES, method=method)
    found = total = 0
    for i, case in enumerate(CASES):
        truth, mine = np.array(case["solutions"]), np.asarray(answer.q[i][answer.found[i]])
        distance = apart(truth[:, None], mine[None])
        assert distance.min(axis=0).max() < 1e-8, "a spurious or inaccurate answer"
        assert len(mine) == answer.count[i]
        found += np.sum(distance.min(axis=1) < 1e-8)
        total += len(truth)
    assert found / total >= share


def test_published_poses_have_their_one_solution_within_limits(answer):
    for i in range(5):
        truth = np.array(CASES[i]["solutions"])[np.array(CASES[i]["inside_limits"])]
        assert answer.within_limits[i].sum() == len(truth) == 1
        np.testing.assert_allclose(answer.q[i, 0], truth[0], atol=1e-9)
        assert nj.IKStatus(int(answer.status[i])) is nj.IKStatus.SOLVED


def test_printed_pose_is_accepted_and_its_distance_reported(niryo):
    printed = np.array(
        [[0.540, 0, 0.841, 0.091039], [0, 1, 0, 0], [-0.841, 0, 0.540, 0.190529], [0, 0, 0, 1]]
    )
    answer = nj.inverse_kinematics(niryo, printed)
    assert nj.IKStatus(int(answer.status)) is nj.IKStatus.SOLVED
    nearest = np.linalg.norm(printed - nj.se3.project(printed)[0])
    np.testing.assert_allclose(answer.pose_distance, nearest, atol=1e-12)
    np.testing.assert_allclose(answer.q[0], [0, 0.3, -1.3, 0, 0, 0], atol=1e-4)


@pytest.mark.parametrize(
    ("name", "dtype"), [*((name, np.float64) for name in ROBOTS), ("niryo_one", np.float32)]
)
def test_forward_kinematics_of_every_answer_is_the_pose(rng, name, dtype):
    robot = getattr(nj.robots, name)()
    q = rng.uniform(robot.lower, robot.upper, (256, 6))
    pose = nj.forward_kinematics(robot, q)
    answer = nj.inverse_kinematics(robot, pose.astype(dtype))
    assert answer.q.shape == (256, 16, 6)
    assert answer.q.dtype == dtype
    reached = nj.forward_kinematics(robot, np.asarray(answer.q, float))
    error = np.abs(reached - pose[:, None]).max(axis=(-2, -1))
    assert error[answer.found].max() < (1e-9 if dtype == np.float64 else 3e-5)
    assert np.all(np.isinf(answer.position_error[~answer.found]))
    near, ok = answer.nearest(q)
    tolerance, share = (1e-6, 1.0) if dtype == np.float64 else (1e-2, 0.999)
    assert np.mean(np.asarray(ok) & (apart(near, q) < tolerance)) >= share
    assert np.mean(answer.status == nj.IKStatus.SOLVED) >= share


def test_solutions_are_distinct_and_ranked_by_their_margin_to_the_limits(niryo, answer):
    for q, found, within in zip(*map(np.asarray, (answer.q, answer.found, answer.within_limits))):
        count = found.sum()
        assert found[:count].all()
        assert not within[count:].any()
        pairs = apart(q[:count, None], q[None, :count]) + 10 * np.eye(count)
        assert pairs.min() > 1e-6
        margin = np.minimum(q - niryo.lower, niryo.upper - q).min(axis=-1)[:count]
        assert np.all(np.diff(margin) <= 1e-12)
        np.testing.assert_array_equal(within[:count], margin >= -1e-9)
        np.testing.assert_array_equal(q[count:], 0.0)


def test_guesses_of_the_published_method_miss_by_the_wrist_offset(niryo):
    branches = seeded_branches(niryo, POSES)
    exact = np.abs(branches.guess_error - 0.0055) < 1e-12
    assert exact[:5].all()
    assert exact.mean() > 0.8
    reached = nj.forward_kinematics(niryo, branches.guess)[..., :3, :3]
    difference = reached - POSES[:, None, :3, :3]
    np.testing.assert_allclose(difference[exact], 0.0, atol=1e-12)
    outcomes = np.unique(branches.outcome)
    assert all(BranchStatus(code).message.endswith(".") for code in outcomes)


def test_good_and_bad_poses_can_be_mixed(niryo):
    good = POSES[1]
    scaled, mirrored, far = (good.copy() for _ in range(3))
    scaled[:3, :3] *= 1.05
    mirrored[:3, 1] *= -1
    far[0, 3] = 2.0
    nan, inf, row = (good.copy() for _ in range(3))
    nan[0, 0], inf[1, 3], row[3, 0] = np.nan, np.inf, 0.5
    answer = nj.inverse_kinematics(
        niryo, np.stack([good, nan, inf, row, scaled, mirrored, far, good])
    )
    status = [nj.IKStatus(int(code)).name for code in answer.status]
    assert status == ["SOLVED", *["INVALID_POSE"] * 5, "UNREACHABLE", "SOLVED"]
    assert answer.count.tolist() == [8, 0, 0, 0, 0, 0, 0, 8]
    np.testing.assert_array_equal(answer.q[0], answer.q[-1])
    assert np.all(np.isfinite(answer.q))
    np.testing.assert_allclose(answer.pose_distance[4], 0.05 * np.sqrt(3), atol=1e-3)


def test_reachable_only_outside_the_limits_is_told(niryo, rng):
    narrow = nj.Robot.from_screws(
        niryo.screws, niryo.home, lower=np.full(6, -0.01), upper=np.full(6, 0.01)
    )
    answer = nj.inverse_kinematics(narrow, POSES[1])
    assert nj.IKStatus(int(answer.status)) is nj.IKStatus.OUTSIDE_LIMITS
    assert answer.count == 8
    q, ok = answer.nearest(np.zeros(6))
    assert not ok
    np.testing.assert_array_equal(q, 0.0)


def test_asymmetric_limits_are_met_by_a_whole_turn():
    degrees = np.deg2rad
    q = wrap_into_limits(
        degrees(jnp.array([45.0, 150.0, -90.0])),
        degrees(jnp.array([-90.0, -225.0, -120.0])),
        degrees(jnp.array([90.0, 45.0, 90.0])),
        (True,) * 3,
    )
    np.testing.assert_allclose(np.rad2deg(q), [45, -210, -90], atol=1e-12)


def test_wrapping_keeps_the_angle_and_prefers_half_a_turn_around_zero(rng):
    q = jnp.asarray(rng.uniform(-20, 20, (1000, 2)))
    free = jnp.array([-jnp.inf, -jnp.inf]), jnp.array([jnp.inf, jnp.inf])
    wrapped = wrap_into_limits(q, *free, (True, False))
    np.testing.assert_allclose(apart(wrapped[:, :1], q[:, :1]), 0.0, atol=1e-13)
    assert np.all((wrapped[:, 0] > -np.pi) & (wrapped[:, 0] <= np.pi))
    np.testing.assert_array_equal(wrapped[:, 1], q[:, 1])
    exact = wrap_into_limits(jnp.array([np.pi, -np.pi]), *free, (True, True))
    np.testing.assert_array_equal(exact, [np.pi, np.pi])


def test_nearest_considers_whole_turns(niryo):
    wide = nj.Robot.from_screws(
        niryo.screws, niryo.home, lower=np.full(6, -7.0), upper=np.full(6, 7.0)
    )
    answer = nj.inverse_kinematics(wide, POSES[1])
    reference = np.asarray(answer.q[0]) + np.array([0, 0, 0, 2 * np.pi, 0, 2 * np.pi])
    q, ok = answer.nearest(reference)
    assert ok
    np.testing.assert_allclose(q, reference, atol=1e-12)
    assert np.all(np.abs(q) <= 7.0)


def test_a_solution_does_not_depend_on_its_batch(niryo, answer):
    alone = nj.inverse_kinematics(niryo, POSES[7])
    np.testing.assert_allclose(alone.q, answer.q[7], atol=1e-12)


@pytest.mark.parametrize("batch", BATCHES)
def test_any_batch_axes(niryo, batch):
    answer = nj.inverse_kinematics(niryo, np.broadcast_to(POSES[1], (*batch, 4, 4)))
    assert answer.q.shape == (*batch, 16, 6)
    assert answer.found.shape == answer.label.shape == (*batch, 16)
    assert answer.status.shape == answer.count.shape == batch
    q, ok = answer.nearest(np.zeros(6))
    assert q.shape == (*batch, 6)
    assert ok.shape == batch


def test_wrong_use_is_refused_by_name(niryo, rng):
    with pytest.raises(ValueError, match="method: expected one of 'complete'"):
        nj.inverse_kinematics(niryo, POSES[0], method="magic")
    with pytest.raises(ValueError, match=r"pose: expected shape \(\.\.\., 4, 4\)"):
        nj.inverse_kinematics(niryo, np.eye(3))
    with pytest.raises(ValueError, match=r"q_ref: expected shape \(\.\.\., 6\)"):
        nj.inverse_kinematics(niryo, POSES[0]).nearest(np.zeros(5))
    random = nj.Robot.from_axes(rng.standard_normal((6, 3)), rng.standard_normal((6, 3)), np.eye(4))
    with pytest.raises(ValueError, match="axes 1 and 2 meet"):
        nj.inverse_kinematics(random, POSES[0], method="seeded")
    helical = np.array(random.screws)
    helical[2, 3:] += 0.1 * helical[2, :3]
    with pytest.raises(ValueError, match="six revolute joints; robot has neither"):
        nj.inverse_kinematics(nj.Robot.from_screws(helical, np.eye(4)), POSES[0], method="complete")
    with pytest.raises(TypeError, match="Close over the robot"):
        jax.jit(lambda robot: nj.inverse_kinematics(robot, POSES[0], method="seeded"))(niryo)
    with pytest.raises(TypeError, match=r"robot: expected a niryo_jax\.Robot, got 'niryo_one'"):
        nj.forward_kinematics("niryo_one", np.zeros(6))
