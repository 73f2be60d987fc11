"""Inverse kinematics of a part of a pose: complete where it can be, and honest where it cannot."""

from __future__ import annotations

import arms
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_fewer_joints import at_steps, desktop, made

import niryo_jax as nj
from niryo_jax.ik import IKStatus, Singularity
from niryo_jax.ik.task import task_of

POSES = 64
ALONG, UP = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def placed(offset: float = 0.0) -> nj.Robot:
    """Three joints that place a point."""
    home = np.eye(4)
    home[:3, 3] = 0.4, offset, 0.3
    points = [[0, 0, 0], [0.02, 0, 0.1], [0.2, 0, 0.1]]
    return nj.Robot.from_axes([[0, 0, 1], [0, 1, 0], [0, 1, 0]], points, home)


def freed(pose: np.ndarray, task: str, axis: tuple[float, ...], rng) -> np.ndarray:
    """The poses turned by what the task leaves."""
    turn = rng.standard_normal((len(pose), 3))
    if task == "direction":
        turn = turn[:, :1] * np.array(axis)
    out = pose.copy()
    out[:, :3, :3] = pose[:, :3, :3] @ np.asarray(nj.so3.exp(turn))
    return out


def check(robot, pose, answer, task, axis, tolerance=1e-10):
    """What is found reaches what is bound; no two are the same, and the errors are said."""
    q, found = np.asarray(answer.q, float), np.asarray(answer.found)
    reached = arms.forward(robot, q)[0]
    metres = np.linalg.norm(reached[..., :3, 3] - pose[:, None, :3, 3], axis=-1)
    seen = (reached - pose[:, None])[..., :3, :3] @ np.array(axis)
    radians = np.linalg.norm(seen, axis=-1) if task == "direction" else np.zeros_like(metres)
    assert np.max(np.where(found, metres + radians, 0.0)) < tolerance
    for said, is_so in ((answer.position_error, metres), (answer.rotation_error, radians)):
        np.testing.assert_allclose(np.where(found, said, 0), np.where(found, is_so, 0), atol=1e-13)
    assert np.array_equal(found.sum(axis=1), answer.count)
    for row, mask in zip(q, found):
        for i, one in enumerate(row[mask]):
            assert np.all(arms.apart(robot, one, row[mask][i + 1 :]) > 1e-7)
    assert answer.task == task


COMPLETE = {
    "five joints, an axis across the last": (desktop, "direction", UP),
    "five joints with an offset": (lambda: desktop(0.03), "direction", UP),
    "four joints": (lambda: desktop(roll=False), "direction", ALONG),
    "three joints, a point": (lambda: placed(0.02), "position", UP),
    "three joints, an axis": (placed, "direction", ALONG),
}


@pytest.mark.parametrize("name", COMPLETE)
def test_as_many_joints_as_are_bound_are_solved_completely(name, rng):
    make, task, axis = COMPLETE[name]
    robot = make()
    q = at_steps(robot, rng, POSES)
    given = freed(arms.forward(robot, q)[0], task, axis, rng)
    answer = nj.inverse_kinematics(robot, given, task=task, tool_axis=axis)
    regular = slice(POSES // 2, None)
    assert np.all(answer.count > 0)
    assert np.all(answer.status[regular] == IKStatus.SOLVED)
    assert np.all(answer.complete)
    check(robot, given, answer, task, axis)
    # A random search finds none that is not among them.
    other = nj.inverse_kinematics(robot, given, "multistart", task=task, tool_axis=axis)
    assert not np.any(other.complete)
    check(robot, given, other, task, axis)
    assert np.all(made(robot, answer, q, 1e-5)[regular])
    for ours, theirs in zip(
        zip(np.asarray(answer.q)[regular], np.asarray(answer.found)[regular]),
        zip(np.asarray(other.q)[regular], np.asarray(other.found)[regular]),
    ):
        for one in theirs[0][theirs[1]]:
            assert np.min(arms.apart(robot, ours[0][ours[1]], one)) < 1e-4


SPARE = {
    "six joints": ("niryo_one", "direction", UP),
    "six joints, a point": ("niryo_one", "position", UP),
    "seven joints": ("kuka_iiwa14", "direction", ALONG),
}


@pytest.mark.parametrize("name", SPARE)
def test_joints_to_spare_are_sampled_within_the_limits(name, rng):
    arm, task, axis = SPARE[name]
    robot = nj.robots.load(arm)
    pose, _ = arms.forward(robot, rng.uniform(robot.lower, robot.upper, (POSES, robot.joints)))
    given = freed(pose, task, axis, rng)
    answer = nj.inverse_kinematics(robot, given, task=task, tool_axis=axis)
    assert np.mean(answer.status == IKStatus.SOLVED) > 0.98
    assert np.all(answer.count > 0)
    assert not np.any(answer.complete)
    check(robot, given, answer, task, axis)
    assert "There may be more solutions" in answer.message(0)
    first, best = np.asarray(answer.q)[:, 0], np.asarray(answer.within_limits)[:, 0]
    assert np.all((first >= robot.lower) & (first <= robot.upper) | ~best[:, None])


def test_a_point_beyond_the_stretched_arm_is_proved_out_of_reach(rng):
    robot = desktop()
    low, high = robot.lower, robot.upper
    reached = arms.forward(robot, rng.uniform(low, high, (POSES, 5)))[0]
    answer = nj.inverse_kinematics(robot, reached, task="position")
    assert np.all(answer.count > 0)
    far = reached.copy()
    far[:, :3, 3] += 2.0
    answer = nj.inverse_kinematics(robot, far, task="position")
    assert np.all(answer.status == IKStatus.UNREACHABLE)
    assert "Asked for: position." in answer.message(0)


@pytest.mark.parametrize("arm", ["niryo_one", "desktop"])
def test_a_last_joint_along_the_tool_axis_is_free(arm, rng):
    robot = desktop() if arm == "desktop" else nj.robots.load(arm)
    q = at_steps(robot, rng, POSES)
    pose, _ = arms.forward(robot, q)
    given = freed(pose, "direction", ALONG, rng)
    answer = nj.inverse_kinematics(robot, given, task="direction", tool_axis=ALONG)
    assert np.all(answer.complete)
    assert np.all(answer.count > 0)
    check(robot, given, answer, "direction", ALONG)
    halfway = 0.5 * (robot.lower + robot.upper)[-1]
    np.testing.assert_allclose(np.asarray(answer.q)[..., -1][np.asarray(answer.found)], halfway)
    assert Singularity.NONE not in np.asarray(answer.singularity)[np.asarray(answer.found)]
    others = np.where(np.arange(robot.joints) < robot.joints - 1, q, halfway)
    assert np.all(made(robot, answer, others, 1e-5)[POSES // 2 :])


def test_a_direction_that_is_rounded_has_the_nearest_answer(rng):
    robot = desktop()
    pose = arms.forward(robot, at_steps(robot, rng, POSES))[0].round(7)
    # The last axis of such an arm stays in a plane through axis 1: one more is bound than it has.
    answer = nj.inverse_kinematics(robot, pose, task="direction", tool_axis=ALONG)
    assert np.all(answer.count > 0)
    assert 1e-10 < np.max(np.where(answer.found, answer.rotation_error, 0.0)) < 1e-6
    assert "position and direction of the tool axis" in answer.message(0)
    tilted = pose.copy()
    tilted[:, :3, :3] = np.asarray(nj.so3.exp(jnp.array([0.0, 0.0, 0.2]))) @ pose[:, :3, :3]
    away = np.hypot(*pose[:, :2, 3].T) * np.hypot(*pose[:, :2, 0].T) > 0.01
    answer = nj.inverse_kinematics(robot, tilted, task="direction", tool_axis=ALONG)
    assert np.all(np.asarray(answer.status)[away] == IKStatus.UNREACHABLE)
    pose[:, :3, 3] += 3.0
    answer = nj.inverse_kinematics(robot, pose, task="direction", tool_axis=UP)
    assert np.all(answer.status == IKStatus.UNREACHABLE)


@pytest.mark.parametrize("case", [("direction", UP), ("position", UP)])
def test_derivatives_of_finite_sets(case, rng):
    task, axis = case
    robot = desktop(0.03) if task == "direction" else placed(0.02)
    q = rng.uniform(0.2, 1.0, robot.joints)
    pose = jnp.asarray(arms.forward(robot, q)[0])

    def solve(twist):
        at = pose @ nj.se3.exp(twist)
        return nj.inverse_kinematics(robot, at, task=task, tool_axis=axis).q

    slot = int(np.argmin(arms.apart(robot, np.asarray(solve(jnp.zeros(6))), q)))
    forward, reverse = (
        mode(lambda x: solve(x)[slot])(jnp.zeros(6)) for mode in (jax.jacfwd, jax.jacrev)
    )
    np.testing.assert_allclose(forward, reverse, atol=1e-9)
    h = 1e-6
    for column, unit in zip(forward.T, np.eye(6)):
        difference = (solve(h * unit)[slot] - solve(-h * unit)[slot]) / (2 * h)
        np.testing.assert_allclose(column, difference, atol=1e-5)
    # What is left free does not matter.
    free = slice(2, 3) if task == "direction" else slice(0, 3)
    np.testing.assert_allclose(forward[:, free], 0.0, atol=1e-9)


def test_derivatives_of_samples_are_the_least_that_follow(rng):
    robot = nj.robots.niryo_one()
    pose = jnp.asarray(arms.forward(robot, rng.uniform(-1, 1, 6))[0])

    def solve(twist):
        at = pose @ nj.se3.exp(twist)
        return nj.inverse_kinematics(robot, at, task="position").q[0]

    q, rate = solve(jnp.zeros(6)), jax.jacfwd(solve)(jnp.zeros(6))
    jacobian = np.asarray(nj.body_jacobian(robot, q))[3:]
    turn = np.asarray(nj.forward_kinematics(robot, q))[:3, :3].T @ pose[:3, :3]
    np.testing.assert_allclose(rate[:, 3:], np.linalg.pinv(jacobian) @ turn, atol=1e-8)
    bad = jnp.stack([pose, jnp.eye(4), jnp.full((4, 4), jnp.nan)])
    gradient = jax.grad(lambda p: jnp.sum(nj.inverse_kinematics(robot, p, task="position").q ** 2))
    assert np.all(np.isfinite(gradient(bad)))


@pytest.mark.parametrize("batch", [(), (1,), (3, 11), (0,)])  # of the sizes of programs 1 and 64
def test_batch_axes_are_kept_in_float32(batch):
    robot = desktop()
    pose = np.broadcast_to(arms.forward(robot, np.full(5, 0.3))[0], (*batch, 4, 4))
    for task, slots in (("direction", 8), ("position", 16)):
        answer = nj.inverse_kinematics(robot, pose.astype(np.float32), task=task)
        assert answer.q.shape == (*batch, slots, 5)
        assert answer.q.dtype == np.float32
        assert np.all(answer.status == IKStatus.SOLVED)


def test_poses_may_be_traced_and_mapped(rng):
    robot = desktop()
    pose = arms.forward(robot, at_steps(robot, rng, POSES))[0]

    def solve(pose):
        return nj.inverse_kinematics(robot, pose, task="direction")

    answer, traced = solve(pose), jax.jit(solve)(pose)
    assert traced.task == "direction"
    np.testing.assert_array_equal(answer.found, traced.found)
    np.testing.assert_allclose(answer.q[:, 0], traced.q[:, 0], atol=1e-9)
    np.testing.assert_allclose(jax.vmap(lambda x: solve(x).q)(jnp.asarray(pose)), answer.q)
    assert answer.map(lambda x: x[0]).task == "direction"


def test_newton_raphson_takes_a_task(rng):
    robot = nj.robots.niryo_one()
    q = rng.uniform(-1, 1, (POSES, 6))
    pose = arms.forward(robot, q)[0]
    for task in ("direction", "position"):
        given = freed(pose, task, UP, rng)
        result = nj.newton_raphson(robot, given, q + 0.02, task=task, tool_axis=UP)
        assert np.all(result.converged)
        reached = arms.forward(robot, np.asarray(result.q))[0]
        assert np.max(np.abs((reached - given)[:, :3, 3])) < 1e-10
        if task == "direction":
            assert np.max(np.abs((reached - given)[:, :3, :3] @ np.array(UP))) < 1e-10
    with pytest.raises(ValueError, match="expected 'body' for task 'position'"):
        nj.newton_raphson(robot, pose, q, task="position", frame="space")


def test_a_tool_axis_has_any_length():
    for length in (1e-320, 1e-200, 3.0, 1e308):
        assert task_of("direction", (0.0, -length, 0.0)).axis == (0.0, -1.0, 0.0)
        assert task_of("direction", (length, length, 0.0)) == task_of("direction", (1, 1, 0))


def test_wrong_use_is_refused_by_name():
    robot = desktop()
    for options, words in (
        ({"task": "axis"}, "task: expected one of 'pose', 'direction', 'position', got 'axis'"),
        ({"task": ["pose"]}, "task: expected one of"),
        ({"task": "direction", "tool_axis": [0, 0, 0]}, "tool_axis: expected a vector"),
        ({"task": "direction", "tool_axis": "z"}, "tool_axis: expected an array of numbers"),
        ({"task": "direction", "tool_axis": [1.0, np.nan, 0.0]}, "tool_axis: expected a vector"),
        ({"tolerance": -1.0}, "tolerance: expected"),
        ({"tolerance": "much"}, "tolerance: expected"),
        ({"task": "position", "method": "complete"}, "desktop|robot is no such arm"),
        ({"task": "position", "method": "seeded"}, "expected method 'complete' or 'multistart'"),
        ({"task": "direction", "locked": (0, 0.0)}, "neither a locked joint nor an arm angle"),
    ):
        with pytest.raises((TypeError, ValueError), match=words):
            nj.inverse_kinematics(robot, np.eye(4), **options)
    with pytest.raises(TypeError, match="traced robot"):
        jax.jit(lambda arm: nj.inverse_kinematics(arm, np.eye(4), task="position"))(robot)


def test_an_arm_in_float32_is_looked_at_as_such(rng):
    arm = desktop()
    robot = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), arm)
    pose = arms.forward(arm, at_steps(arm, rng, POSES))[0].astype(np.float32)
    answer = nj.inverse_kinematics(robot, pose, task="direction")
    assert answer.q.dtype == np.float32
    assert np.mean(answer.complete) > 0.95
    assert np.all(answer.count > 0)
