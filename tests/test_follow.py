"""Paths of poses followed along one branch, and poses brought within reach."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
import pytest
from pose_sets import hole, reach, robot
from support import rigid

import niryo_jax as nj
from niryo_jax.ik.paths.follow import follow
from niryo_jax.ik.paths.nearest_reachable import nearest_reachable

START = np.array([0.3, -0.4, -0.5, 0.4, 0.6, -0.3])
SHOULDER = np.array([0.0, 0.0, 0.183])


def poses_at(arm, q):
    return np.array(nj.forward_kinematics(arm, q))


def jumps(path):
    good = np.asarray(path.q)[np.asarray(path.ok)]
    return np.abs(np.diff(good, axis=0)).max(initial=0.0)


def ramp(change, samples=200):
    """From START to START + change, radians."""
    return START + np.linspace(0, 1, samples)[:, None] * np.array(change)


def smooth(arm, rng, samples=256):
    """A random joint path (samples, 6) of three harmonics within the limits."""
    time = np.linspace(0, 1, samples)[:, None]
    size, phase = rng.uniform(-1, 1, (3, 6)), rng.uniform(0, 2 * np.pi, (3, 6))
    waves = sum(size[i] * np.sin((i + 1) * np.pi * time + phase[i]) for i in range(3))
    middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
    return middle + 0.9 * half * waves / np.abs(size).sum(axis=0)


def outwards(arm, samples=100, length=0.5):
    """The pose at START moved straight away from the shoulder, beyond the reach."""
    first = poses_at(arm, START)
    away = first[:3, 3] - SHOULDER
    path = np.repeat(first[None], samples, axis=0)
    distance = np.linspace(0, length, samples)[:, None]
    path[:, :3, 3] += distance * away / np.linalg.norm(away)
    return path


def between(first, second, samples=200):
    """A line between two poses, with the chord of the rotations projected."""
    share = np.linspace(0, 1, samples)[:, None, None]
    path = (1 - share) * first + share * second
    left, _, right = np.linalg.svd(path[:, :3, :3])
    return np.asarray(rigid(left @ right, path[:, :3, 3]), float)


def unlimited(arm):
    return dataclasses.replace(arm, lower=np.full(6, -7.0), upper=np.full(6, 7.0))


@pytest.fixture(scope="module")
def lines():
    """Paths along lines between random poses of the Niryo One, many through singularities."""
    arm, rng = unlimited(robot("niryo_one")), np.random.default_rng(5)
    ends = rng.uniform(arm.lower / 4, arm.upper / 4, (20, 2, 6))
    paths = [between(*poses_at(arm, pair)) for pair in ends]
    return [(poses, follow(arm, poses, q[0])) for poses, q in zip(paths, ends)]


@pytest.mark.parametrize("name", ["niryo_one", "niryo_ned2", "spherical"])
def test_the_path_of_joints_that_made_the_poses_is_found_again(name):
    arm = robot(name)
    for seed in range(6):
        q = smooth(arm, np.random.default_rng(seed))
        path = follow(arm, poses_at(arm, q), q[0] + 0.01)
        assert path.ok.all(), path.message
        np.testing.assert_allclose(path.q, q, atol=1e-6)
        assert np.all(path.label >= 0)
        assert path.message == "The whole path was followed, all 256 samples."


def test_a_path_out_of_reach_ends_at_its_last_reachable_pose(niryo):
    poses = outwards(niryo)
    path = follow(niryo, poses, START)
    status = np.asarray(nj.inverse_kinematics(niryo, poses).status)
    end = int(np.argmax(status == nj.IKStatus.UNREACHABLE))
    assert 0 < end < 100
    np.testing.assert_array_equal(path.ok, np.arange(100) < end)
    np.testing.assert_array_equal(path.label >= 0, path.ok)
    np.testing.assert_array_equal(path.q[end:], np.broadcast_to(path.q[end - 1], (100 - end, 6)))
    assert path.message.startswith(f"The branch ends at sample {end} of 0 to 99: ")
    assert nj.IKStatus.UNREACHABLE.message in path.message
    assert "farther from the shoulder" in path.message


def test_the_branch_that_ends_at_the_edge_of_reach_meets_another_there(niryo):
    poses = outwards(niryo)
    path = follow(niryo, poses, START)
    answer = nj.inverse_kinematics(niryo, poses)
    end = int(path.ok.sum())
    gaps = []
    for i in (end - 20, end - 1):
        q = np.asarray(answer.q[i][answer.found[i]])
        gaps.append(np.sort(np.abs(q - path.q[i]).max(axis=1))[1])
    assert gaps[1] < 0.6 * gaps[0]


def test_a_branch_that_merges_with_another_ends_though_the_poses_are_reachable(lines):
    merged = [(poses, path) for poses, path in lines if "merges with another" in path.message]
    assert len(merged) == sum(
        "sampled" not in path.message for _, path in lines if not path.ok.all()
    )
    assert len(merged) >= 2
    for poses, path in merged:
        end = int(path.ok.sum())
        q = np.asarray(path.q[end - 1])
        answer = nj.inverse_kinematics(robot("niryo_one"), poses)
        turn = np.asarray(answer.q[end][answer.found[end]]) - q
        assert len(turn) > 0
        assert np.abs(turn - 2 * np.pi * np.round(turn / (2 * np.pi))).max(axis=1).min() > 0.5
        last = np.linalg.svd(nj.space_jacobian(robot("niryo_one"), q), compute_uv=False)[-1]
        assert last < 0.01, "the arm is nearly singular"


def test_no_path_jumps_and_every_sample_reaches_its_pose(lines):
    followed = 0
    for poses, path in lines:
        ok = np.asarray(path.ok)
        followed += ok.all()
        assert jumps(path) <= 0.5
        assert np.all(np.diff(ok.astype(int)) <= 0), "once ended, ended"
        np.testing.assert_allclose(poses_at(robot("niryo_one"), path.q)[ok], poses[ok], atol=1e-9)
    assert 10 < followed < len(lines)


def test_a_smaller_step_ends_a_path_sooner_and_says_so(niryo):
    q = ramp([0.9, 0.1, 0.1, 0.1, 0.1, -0.9], samples=10)
    poses = poses_at(niryo, q)
    assert follow(niryo, poses, START, largest_step=0.11).ok.all()
    path = follow(niryo, poses, START, largest_step=0.09)
    assert path.ok.sum() == 1
    assert "0.100 rad from sample 0 in joint_" in path.message
    assert "sampled too coarsely" in path.message


def test_leaving_the_limits_is_told_with_the_joint_and_how_far(niryo):
    q = ramp([0, 1.5, 0, 0, 0, 0])
    path = follow(niryo, poses_at(niryo, q), START)
    end = int(np.argmax(q[:, 1] > niryo.upper[1]))
    np.testing.assert_array_equal(path.ok, np.arange(200) < end)
    beyond = math.degrees(q[end, 1] - niryo.upper[1])
    assert "joint_2" in path.message
    assert f"{beyond:.3g} deg beyond its limit of 36.67 deg" in path.message


def test_whole_turns_are_followed_where_the_limits_allow(niryo):
    q = ramp([0.1, 0.2, 0.1, 6.0, 0.2, -6.0])
    poses = poses_at(niryo, q)
    path = follow(unlimited(niryo), poses, START)
    assert path.ok.all()
    np.testing.assert_allclose(path.q, q, atol=1e-9)
    narrow = follow(niryo, poses, START)
    assert not narrow.ok.all()
    assert "joint_6 would be at -1" in narrow.message


@pytest.mark.parametrize("broken", [0, 70])
def test_a_pose_that_is_none_ends_the_path(niryo, broken):
    poses = poses_at(niryo, ramp(np.full(6, 0.2)))
    poses[broken, 1, 3] = np.nan
    path = follow(niryo, poses, START)
    np.testing.assert_array_equal(path.ok, np.arange(200) < broken)
    assert f"sample {broken} of 0 to 199" in path.message
    assert nj.IKStatus.INVALID_POSE.message in path.message
    assert np.all(np.isfinite(path.q))


def test_a_start_far_from_every_solution_is_refused_in_words(niryo):
    path = follow(niryo, poses_at(niryo, ramp(np.full(6, 0.1))), START + 1.0)
    assert not path.ok.any()
    np.testing.assert_array_equal(path.q, np.broadcast_to(START + 1.0, (200, 6)))
    np.testing.assert_array_equal(path.label, -1)
    assert "1.000 rad from q_start in joint_" in path.message


def test_paths_without_samples_and_in_single_precision(niryo):
    nothing = follow(niryo, np.zeros((0, 4, 4)), START)
    assert nothing.q.shape == (0, 6)
    assert nothing.ok.shape == nothing.label.shape == (0,)
    q = ramp(np.full(6, 0.3), samples=256).astype(np.float32)
    path = follow(niryo, poses_at(niryo, q), START)
    assert path.q.dtype == np.float32
    assert path.ok.all()
    np.testing.assert_allclose(path.q, q, atol=1e-3)


def test_wrong_use_of_follow_is_refused_by_name(niryo):
    poses = np.broadcast_to(np.eye(4), (3, 4, 4))
    with pytest.raises(ValueError, match=r"poses: expected shape \(k, 4, 4\), got \(4, 4\)"):
        follow(niryo, np.eye(4), START)
    with pytest.raises(ValueError, match=r"q_start: expected shape \(6,\), got \(5,\)"):
        follow(niryo, poses, START[:5])
    with pytest.raises(ValueError, match="q_start: expected finite numbers"):
        follow(niryo, poses, START * np.nan)
    with pytest.raises(ValueError, match=r"largest_step: expected radians in \(0, pi\], got 4"):
        follow(niryo, poses, START, largest_step=4.0)
    with pytest.raises(TypeError, match=r"outside jax\.jit"):
        jax.jit(lambda poses: follow(niryo, poses, START).q)(poses)


@pytest.fixture(scope="module")
def targets():
    """Poses (8, 4, 4) of random rotations: reachable, too far, too near, none."""
    arm, rng = robot("niryo_one"), np.random.default_rng(3)
    poses = poses_at(arm, rng.uniform(arm.lower, arm.upper, (8, 6)))
    poses[2:5, :3, 3] = SHOULDER + 2.0 * (poses[2:5, :3, 3] - SHOULDER)
    poses[5:7] = hole(arm, 2, rng)
    poses[7, 0, 0] = np.nan
    return poses


@pytest.mark.parametrize("within_limits", [True, False])
def test_poses_are_brought_within_reach_along_the_line_to_the_shoulder(
    niryo, targets, within_limits
):
    moved, ok = nearest_reachable(niryo, targets, within_limits=within_limits)
    np.testing.assert_array_equal(moved[:2], targets[:2])
    np.testing.assert_array_equal(moved[7], targets[7])
    assert ok[:2].all()
    assert not ok[7]
    assert np.all(ok[:7]) or within_limits
    assert np.all(ok[2:5])
    np.testing.assert_array_equal(moved[..., :3, :3], targets[..., :3, :3])
    for i in np.flatnonzero(ok):
        given, new = targets[i, :3, 3] - SHOULDER, np.asarray(moved[i, :3, 3]) - SHOULDER
        np.testing.assert_allclose(np.cross(given, new), 0.0, atol=1e-12)
    status = nj.inverse_kinematics(niryo, moved).status
    fine = (nj.IKStatus.SOLVED,) if within_limits else (nj.IKStatus.SOLVED, 1)
    assert np.all(np.isin(status, fine) == ok)


def test_the_edge_of_what_is_reachable_is_met(niryo, targets):
    moved, ok = nearest_reachable(niryo, targets, within_limits=False)
    some = np.flatnonzero(ok)[2:]
    step = targets[some, :3, 3] - moved[some, :3, 3]
    beyond = np.array(moved)
    beyond[some, :3, 3] += 1e-8 * step / np.linalg.norm(step, axis=1, keepdims=True)
    count = nj.inverse_kinematics(niryo, beyond).count
    assert np.all(count[some] == 0)


def test_targets_in_the_hole_move_outwards_if_that_is_nearer(niryo, targets):
    moved, ok = nearest_reachable(niryo, targets, within_limits=False)
    assert ok[5:7].all()
    assert np.all(reach(niryo)[0] > 0)
    direction = np.zeros(8)
    for sign in (-1, 1):
        line = targets[5:7].copy()
        away = line[:, :3, 3] - SHOULDER
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        distance = np.linalg.norm(moved[5:7, :3, 3] - targets[5:7, :3, 3], axis=1)
        line[:, :3, 3] += sign * 0.97 * distance[:, None] * away
        direction[5:7] += np.asarray(nj.inverse_kinematics(niryo, line).count)
    np.testing.assert_array_equal(direction, 0.0)


@pytest.mark.parametrize("batch", [(), (2, 1), (0,)])
def test_any_batch_axes_of_targets(niryo, batch):
    far = poses_at(niryo, START)
    far[:3, 3] *= 3.0
    moved, ok = nearest_reachable(niryo, np.broadcast_to(far, (*batch, 4, 4)))
    assert moved.shape == (*batch, 4, 4)
    assert ok.shape == batch
    assert np.all(ok)
    assert np.all(np.abs(np.asarray(moved) - far).max(axis=(-2, -1)) > 0.1)


def test_wrong_use_of_nearest_reachable_is_refused_by_name(niryo, rng):
    with pytest.raises(ValueError, match=r"pose: expected shape \(\.\.\., 4, 4\)"):
        nearest_reachable(niryo, np.eye(3))
    random = nj.Robot.from_axes(rng.standard_normal((6, 3)), rng.standard_normal((6, 3)), np.eye(4))
    with pytest.raises(ValueError, match="axes 1 and 2 meet"):
        nearest_reachable(random, np.eye(4))
    with pytest.raises(TypeError, match=r"outside jax\.jit"):
        jax.jit(lambda pose: nearest_reachable(niryo, pose))(np.eye(4))
