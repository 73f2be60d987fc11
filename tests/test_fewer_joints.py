"""Arms of fewer than six joints: every solution, and the nearest pose where a pose is rounded."""

from __future__ import annotations

import dataclasses

import arms
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES

import niryo_jax as nj
from niryo_jax.ik import IKStatus, Singularity

POSES = 200
PLANAR = [name for name, letters in arms.FAMILIES.items() if set(letters) <= set("Rpq")]
FEW = [name for name, letters in arms.FAMILIES.items() if len(letters) < 6]
LARGE = pytest.mark.completeness


def desktop(offset: float = 0.0, roll: bool = True) -> nj.Robot:
    """A small arm: yaw, three parallel axes, and a roll; `offset` lays axis 2 beside axis 1."""
    home = np.eye(4)
    home[:3, 3] = 0.42, offset, 0.25
    axes = [[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0]]
    points = [[0, 0, 0], [offset, 0, 0.1], [0.05, 0, 0.25], [0.2, 0, 0.25], [0.3, offset, 0.25]]
    joints = 5 if roll else 4
    limit = np.array([2.6, 2.0, 2.0, 2.0, 2.6])[:joints]
    return nj.Robot.from_axes(axes[:joints], points[:joints], home, lower=-limit, upper=limit)


def at_steps(robot: nj.Robot, rng: np.random.Generator, count: int = POSES) -> np.ndarray:
    """Joint vectors within the limits, of which the first half has turns of whole 45 degrees."""
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    q = rng.uniform(low, high, (count, robot.joints))
    steps = np.round(q / (np.pi / 4)) * np.pi / 4
    steps = np.where((steps < low) | (steps > high), 0.0, steps)
    q[: count // 2] = np.where(arms.turns(robot), steps, q)[: count // 2]
    return q


def made(robot: nj.Robot, answer: nj.IKSolutions, q: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether the joint vector that made a pose is among its solutions."""
    apart = arms.apart(robot, np.asarray(answer.q), q[:, None])
    return np.any((apart < tolerance) & np.asarray(answer.found), axis=1)


def misses(robot: nj.Robot, answer: nj.IKSolutions, poses: np.ndarray) -> tuple[np.ndarray, ...]:
    """Metres and radians by which the solutions miss, in numpy; zero where there is none."""
    reached, _ = arms.forward(robot, np.asarray(answer.q, float))
    metres = np.linalg.norm(reached[..., :3, 3] - poses[:, None, :3, 3], axis=-1)
    turn = reached[..., :3, :3] - poses[:, None, :3, :3]
    radians = np.linalg.norm(turn, axis=(-1, -2)) / np.sqrt(2)
    return tuple(np.where(answer.found, x, 0.0) for x in (metres, radians))


ROBOTS = {
    "desktop": desktop,
    "desktop with an offset": lambda: desktop(0.03),
    "four joints": lambda: desktop(roll=False),
    "SCARA": lambda: nj.robots.load("abb_irb910sc"),
    "cylindrical": lambda: nj.robots.load("rttr"),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_every_pose_is_solved_completely_at_singularities_too(name, rng):
    robot = ROBOTS[name]()
    q = at_steps(robot, rng)
    poses, jacobian = arms.forward(robot, q)
    answer = nj.inverse_kinematics(robot, poses)
    assert np.all(answer.status == IKStatus.SOLVED)
    assert np.all(answer.complete)
    regular = np.linalg.svd(jacobian, compute_uv=False)[:, -1] > 1e-4
    assert np.all(made(robot, answer, q, 1e-6)[regular])
    assert max(x.max() for x in misses(robot, answer, poses)) < 1e-12


@pytest.mark.parametrize(
    "name", [*PLANAR[:2], *(pytest.param(name, marks=LARGE) for name in FEW[:1] + PLANAR[2:])]
)
def test_rounded_poses_are_answered_by_the_nearest_pose(name, rng):
    robot = arms.arm(name, rng)
    q = at_steps(robot, rng)
    poses, _ = arms.forward(robot, q)
    for digits, tolerance in ((12, 1e-8), (8, 1e-4), (6, 1e-2)):
        rounded = poses.round(digits)
        answer = nj.inverse_kinematics(robot, rounded)
        assert np.all(answer.count > 0)
        assert np.all(answer.complete)
        assert np.mean(made(robot, answer, q, tolerance)) > 0.97
        target = rounded.copy()
        target[:, :3, :3] = np.asarray(nj.so3.project(rounded[:, :3, :3])[0])
        seen = misses(robot, answer, target)
        for said, is_so in zip((answer.position_error, answer.rotation_error), seen):
            np.testing.assert_allclose(np.where(answer.found, said, 0.0), is_so, atol=1e-12)
        # No joint vector near the one that made the pose is nearer to it.
        least = np.min(np.where(answer.found, np.hypot(*seen), np.inf), axis=1)
        given = np.hypot(
            np.linalg.norm(target[:, :3, 3] - poses[:, :3, 3], axis=-1),
            np.linalg.norm(target[:, :3, :3] - poses[:, :3, :3], axis=(1, 2)) / np.sqrt(2),
        )
        assert np.all(least <= given * 1.01 + 1e-12)


@pytest.mark.parametrize("name", ["desktop with an offset", "four joints", "SCARA"])
def test_no_pose_within_the_tolerance_is_called_unreachable(name, rng):
    robot = ROBOTS[name]()
    q = at_steps(robot, rng) + rng.choice([0.0, 1e-9, 1e-6, 1e-4], (POSES, robot.joints))
    poses, _ = arms.forward(robot, q)
    for tolerance in (1e-5, 1e-3):
        twist = rng.standard_normal((POSES, 6))
        for part in (twist[:, :3], twist[:, 3:]):
            part *= tolerance * rng.uniform(size=(POSES, 1)) / np.linalg.norm(part, axis=1)[:, None]
        near = poses @ np.asarray(nj.se3.exp(twist))
        answer = nj.inverse_kinematics(robot, near, tolerance=tolerance)
        assert not np.any(answer.status == IKStatus.UNREACHABLE)
        assert np.mean(answer.count > 0) > 0.97
        for error in (answer.position_error, answer.rotation_error):
            assert np.all(np.where(answer.found, error, 0.0) <= tolerance)


def test_poses_beyond_the_tolerance_are_refused_or_proved_out_of_reach(rng):
    robot = desktop()
    poses, _ = arms.forward(robot, at_steps(robot, rng))
    # A turn about the vertical through the tool's origin takes the arm's plane off axis 1.
    turned = poses.copy()
    turned[:, :3, :3] = np.asarray(nj.so3.exp(jnp.array([0.0, 0.0, 0.3]))) @ poses[:, :3, :3]
    upright = np.abs(poses[:, 2, 0]) > 0.95
    answer = nj.inverse_kinematics(robot, turned)
    assert np.all(np.asarray(answer.status)[~upright] == IKStatus.UNREACHABLE)
    assert "position and orientation" in answer.message(int(np.argmin(upright)))
    poses[:, 2, 3] += 2.0
    assert np.all(nj.inverse_kinematics(robot, poses).status == IKStatus.UNREACHABLE)
    exact = nj.inverse_kinematics(robot, arms.forward(robot, at_steps(robot, rng))[0], tolerance=0)
    assert np.all(exact.count > 0)


def test_a_stretched_arm_and_a_tool_along_axis_1_are_named(rng):
    robot = desktop()
    q = np.zeros((2, 5))
    # The wrist bent so that axis 5 points straight down.
    q[0] = 0.3, 0.2, 0.4, 0.6 - np.pi / 2, 0.5
    # Axes 2, 3 and 4 in a plane.
    straight = -np.arctan2(0.15, 0.05)
    q[1] = 0.3, 0.2, straight, 0.4, 0.5
    poses, _ = arms.forward(robot, q)
    answer = nj.inverse_kinematics(robot, poses)
    assert np.all(made(robot, answer, q, 1e-6))
    assert np.all(answer.complete)
    codes = np.asarray(answer.singularity)[1][np.asarray(answer.found)[1]]
    assert Singularity.ELBOW in codes
    # Axis 5 in line with axis 1: both turn, the tool rests.
    folded = nj.inverse_kinematics(robot, _in_line(robot))
    assert np.all(folded.count > 0)
    assert np.all(np.isin(folded.singularity[folded.found], [Singularity.SELF_MOTION]))


def _in_line(robot: nj.Robot) -> np.ndarray:
    """A pose with axis 5 in line with axis 1, pointing down."""
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(nj.so3.exp(jnp.array([0.0, np.pi / 2, 0.0])))
    pose[2, 3] = -0.1
    return pose


@pytest.mark.parametrize("name", ["desktop with an offset", "four joints"])
def test_float32_is_solved(name, rng):
    robot = ROBOTS[name]()
    poses, _ = arms.forward(robot, at_steps(robot, rng))
    answer = nj.inverse_kinematics(robot, poses.astype(np.float32))
    assert answer.q.dtype == np.float32
    assert np.all(answer.count > 0)
    assert max(x.max() for x in misses(robot, answer, poses)) < 2e-5


@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_are_kept(batch):
    robot = desktop()
    pose = np.broadcast_to(arms.forward(robot, np.full(5, 0.3))[0], (*batch, 4, 4))
    answer = nj.inverse_kinematics(robot, pose)
    assert answer.q.shape == (*batch, 4, 5)
    assert np.all(answer.status == IKStatus.SOLVED)


def test_an_answer_is_the_same_in_a_large_batch(rng):
    robot = desktop(0.03)
    q = at_steps(robot, rng, 1100)
    poses = arms.forward(robot, q)[0]
    poses[::3] = poses[::3].round(8)
    large, small = (nj.inverse_kinematics(robot, x) for x in (poses, poses[:POSES]))
    np.testing.assert_array_equal(large.found[:POSES], small.found)
    np.testing.assert_array_equal(large.complete[:POSES], small.complete)
    assert np.all(large.count > 0)


def test_a_traced_arm_is_looked_at_inside_the_program(rng):
    robot = desktop()
    solve = jax.jit(lambda robot, pose: nj.inverse_kinematics(robot, pose))
    poses = arms.forward(robot, at_steps(robot, rng))[0]
    assert np.all(solve(robot, poses).complete)
    screws = np.array(robot.screws)
    # Axis 4 leaves the direction of axes 2 and 3.
    screws[3, :3] = np.asarray(nj.so3.exp(jnp.array([0.0, 0.0, 1e-3]))) @ screws[3, :3]
    moved = dataclasses.replace(jax.tree.map(jnp.asarray, robot), screws=jnp.asarray(screws))
    stale = jax.tree.unflatten(jax.tree.structure(robot), jax.tree.leaves(moved))
    answer = solve(stale, poses)
    assert not np.any(answer.complete)
    assert not np.any(answer.status == IKStatus.UNREACHABLE)


def test_derivatives_are_those_of_the_arm(rng):
    robot = desktop(0.03)
    q = rng.uniform(-1, 1, 5)

    def solve(q):
        return nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q)).q

    slot = int(np.argmin(arms.apart(robot, np.asarray(solve(q)), q)))
    np.testing.assert_allclose(jax.jacfwd(lambda q: solve(q)[slot])(q), np.eye(5), atol=1e-9)
    poses = np.stack(
        [arms.forward(robot, np.zeros(5))[0], _in_line(robot), np.full((4, 4), np.nan)]
    )
    gradient = jax.grad(lambda pose: jnp.sum(nj.inverse_kinematics(robot, pose).q ** 2))
    assert np.all(np.isfinite(gradient(jnp.asarray(poses))))


def test_arms_of_no_family_are_answered_by_the_nearest_pose_too(rng):
    robot = nj.Robot.from_axes(
        rng.standard_normal((4, 3)), rng.standard_normal((4, 3)), np.eye(4), name="general"
    )
    assert robot.plans == ()
    q = rng.uniform(-2, 2, (16, 4))
    poses = arms.forward(robot, q)[0].round(7)
    answer = nj.inverse_kinematics(robot, poses)
    assert np.all(answer.count > 0)
    assert np.all(made(robot, answer, q, 1e-3))
    assert not np.any(answer.complete)
    assert np.all(nj.inverse_kinematics(robot, poses, tolerance=1e-12).status == IKStatus.UNDECIDED)
