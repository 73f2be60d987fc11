"""Tasks beside a reference: paths followed, and what is left free as near to it as it can be."""

from __future__ import annotations

import dataclasses

import arms
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES
from test_fewer_joints import at_steps, desktop
from test_tasks import ALONG, UP, freed, placed

import niryo_jax as nj
from niryo_jax.ik import IKStatus
from niryo_jax.ik.task import task_of

START = np.array([0.3, -0.4, -0.5, 0.4, 0.6, -0.3, 0.2])
CHANGE = np.array([0.5, 0.3, -0.3, -0.4, 0.3, 0.6, -0.4])
SAMPLES = 64


def made_path(robot, task, axis, rng, change=CHANGE):
    """Joint vectors (SAMPLES, n) on a line, and poses that do the same of the task alone."""
    n = robot.joints
    q = START[:n] + np.linspace(0, 1, SAMPLES)[:, None] * change[:n]
    return q, freed(arms.forward(robot, q)[0], task, axis, rng)


def missed(robot, q, pose, task, axis):
    """Metres and radians, largest of joint vectors (k, n)."""
    off = arms.forward(robot, np.asarray(q))[0] - pose
    radians = np.abs(off[:, :3, :3] @ np.array(axis)).max() if task == "direction" else 0.0
    return np.abs(off[:, :3, 3]).max() + radians


def surplus(robot, q, wish, task, axis):
    """What of the way (k, n) from joint vectors to others neither the task nor a limit forbids:
    nothing where the distance is least (Karush, Kuhn and Tucker)."""
    q, wish = np.asarray(q), np.asarray(wish)
    across = task_of(task, axis).across()
    rows = np.asarray(nj.body_jacobian(robot, q))
    rows = np.concatenate([across @ rows[:, :3], rows[:, 3:]], axis=1)
    inside = (q > robot.lower + 1e-7) & (q < robot.upper - 1e-7)
    way, columns = wish - q, np.swapaxes(rows, 1, 2)
    force = np.linalg.pinv(columns * inside[..., None], rcond=1e-10) @ (way * inside)[..., None]
    left = way - (columns @ force)[..., 0]
    # A joint is at its limit where it would go on beyond it.
    side = np.where(q > 0.5 * (robot.lower + robot.upper), 1, -1)
    assert np.all(inside | (left * side > -1e-6))
    return np.abs(left * inside).max()


# --- references


SPARE = {
    "six joints": ("niryo_one", "direction", UP),
    "six joints, a point": ("niryo_one", "position", UP),
    "seven joints": ("kuka_iiwa14", "direction", ALONG),
}


@pytest.mark.parametrize("name", SPARE)
def test_of_infinitely_many_those_nearest_to_the_reference_are_found(name, rng):
    arm, task, axis = SPARE[name]
    robot = nj.robots.load(arm)
    q = rng.uniform(robot.lower, robot.upper, (SAMPLES, robot.joints))
    pose = freed(arms.forward(robot, q)[0], task, axis, rng)
    reference = np.clip(q + rng.uniform(-0.1, 0.1, q.shape), robot.lower, robot.upper)
    options = {"task": task, "tool_axis": axis}
    answer = nj.inverse_kinematics(robot, pose, q_ref=reference, **options)
    assert np.all(answer.status == IKStatus.SOLVED)
    assert not np.any(answer.complete)
    nearest, ok = answer.nearest(reference)
    assert np.all(ok)
    assert missed(robot, nearest, pose, task, axis) < 1e-10
    away = np.linalg.norm(nearest - reference, axis=1)
    assert np.all(away <= np.linalg.norm(q - reference, axis=1) + 1e-9)
    assert surplus(robot, nearest, reference, task, axis) < 1e-6
    found = np.asarray(answer.found)
    counts = np.asarray(answer.count)
    np.testing.assert_array_equal(found.sum(axis=1), counts)
    for row, mask in zip(np.asarray(answer.q), found):
        for i, one in enumerate(row[mask]):
            assert np.all(arms.apart(robot, one, row[mask][i + 1 :]) > 1e-7)
    # An answer without a reference knows how to come near to one, and q_ref does what it asks.
    plain = nj.inverse_kinematics(robot, pose, **options)
    again, ok = plain.nearest(reference)
    assert np.all(ok)
    np.testing.assert_allclose(again, nearest, atol=1e-6)
    # What does the task already is its own nearest.
    itself, ok = plain.nearest(q)
    assert np.all(ok)
    np.testing.assert_allclose(itself, q, atol=1e-8)


FREE = {
    "six joints, an axis": ("niryo_one", "direction", ALONG, (5,)),
    "five joints, an axis": ("desktop", "direction", ALONG, (4,)),
    "six joints, a point": ("niryo_one", "position", UP, (5,)),
}


@pytest.mark.parametrize("name", FREE)
def test_joints_that_do_not_matter_stay_where_the_reference_has_them(name, rng):
    arm, task, axis, free = FREE[name]
    robot = desktop() if arm == "desktop" else nj.robots.load(arm)
    q = at_steps(robot, rng, SAMPLES)
    pose = freed(arms.forward(robot, q)[0], task, axis, rng)
    options = {"task": task, "tool_axis": axis}
    plain = nj.inverse_kinematics(robot, pose, **options)
    assert plain.free == free
    # Beyond the limits the nearest value within them is taken.
    reference = q + 0.01
    reference[::3, free[0]] += 5.0
    wanted = np.clip(reference, robot.lower, robot.upper)[:, free[0]]
    given = nj.inverse_kinematics(robot, pose, q_ref=reference, **options)
    mapped = plain.map(lambda x: x)
    for answer in (plain, given, mapped):
        nearest, ok = answer.nearest(reference)
        assert np.all(ok)
        np.testing.assert_allclose(nearest[:, free[0]], wanted, atol=1e-12)
        assert missed(robot, nearest, pose, task, axis) < 1e-9
    if task == "direction":
        np.testing.assert_array_equal(given.complete, plain.complete)
        np.testing.assert_array_equal(given.count, plain.count)
        others = np.delete(np.asarray(given.nearest(reference)[0]) - q, free[0], axis=1)
        assert np.abs(others[SAMPLES // 2 :]).max() < 1e-5
    found = np.asarray(given.found)
    values = np.asarray(given.q)[..., free[0]]
    np.testing.assert_allclose(values[found], np.repeat(wanted, found.sum(axis=1)), atol=1e-12)


def test_a_joint_that_turns_about_the_point_stays_where_the_reference_has_it():
    # The point is on axis 1, which matters else.
    robot = placed()
    q = np.array([0.7, 0.4, 1.0])
    reach = 0.0

    def aside(angle):
        return arms.forward(robot, np.array([0.0, 0.4, angle]))[0][0, 3]

    low, high = 0.0, 3.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if aside(middle) * aside(low) > 0 else (low, middle)
    q[2] = low
    pose, _ = arms.forward(robot, q)
    assert abs(pose[0, 3] - reach) < 1e-12
    for angle in (0.7, -1.2):
        reference = np.array([angle, *q[1:]])
        answer = nj.inverse_kinematics(robot, pose, task="position", q_ref=reference)
        nearest, ok = answer.nearest(reference)
        assert bool(ok)
        np.testing.assert_allclose(nearest, reference, atol=1e-6)


@pytest.mark.parametrize("batch", BATCHES)
def test_references_have_the_batch_of_the_poses(batch):
    robot = desktop()
    pose = np.broadcast_to(arms.forward(robot, np.full(5, 0.3))[0], (*batch, 4, 4))
    reference = np.full(5, 0.31, np.float32)
    for task in ("direction", "position"):
        options = {"task": task, "tool_axis": ALONG}
        answer = nj.inverse_kinematics(robot, pose.astype(np.float32), q_ref=reference, **options)
        nearest, ok = answer.nearest(reference)
        assert nearest.shape == (*batch, 5)
        assert nearest.dtype == np.float32
        assert np.all(ok)
        assert np.all(np.abs(nearest - reference) < 0.02)
    with pytest.raises(ValueError, match="q_ref: expected the batch of the poses"):
        nj.inverse_kinematics(robot, np.eye(4), q_ref=np.zeros((3, 5)), task="position")
    with pytest.raises(ValueError, match=r"q_ref: expected shape \(..., 5\)"):
        nj.inverse_kinematics(robot, np.eye(4), q_ref=np.zeros(6), task="direction")


def test_references_inside_of_a_transformation(rng):
    robot = nj.robots.niryo_one()
    q, pose = made_path(robot, "position", UP, rng)
    q, pose = q[:4], pose[:4]

    def solve(pose):
        answer = nj.inverse_kinematics(robot, pose, task="position", q_ref=q + 0.02)
        return answer.nearest(q + 0.02)[0]

    np.testing.assert_allclose(jax.jit(solve)(pose), solve(pose), atol=1e-6)
    rate = jax.jvp(solve, (jnp.asarray(pose),), (jnp.zeros_like(pose).at[:, 0, 3].set(1.0),))[1]
    moved = np.asarray(nj.space_jacobian(robot, solve(pose))) @ np.asarray(rate)[..., None]
    at = pose[:, :3, 3]
    velocity = moved[:, 3:, 0] + np.cross(moved[:, :3, 0], at)
    np.testing.assert_allclose(velocity, np.broadcast_to([1.0, 0, 0], (4, 3)), atol=1e-8)


# --- paths


COMPLETE = {
    "six joints, the last along the axis": ("niryo_one", "direction", ALONG),
    "five joints": ("desktop", "direction", UP),
    "five joints, the last along the axis": ("desktop", "direction", ALONG),
    "three joints": ("placed", "position", UP),
}


def arm_of(name):
    makers = {"desktop": lambda: desktop(0.03), "placed": lambda: placed(0.02)}
    return makers[name]() if name in makers else nj.robots.load(name)


@pytest.mark.parametrize("name", COMPLETE)
def test_the_joints_that_matter_are_found_again_and_the_others_stay(name, rng):
    arm, task, axis = COMPLETE[name]
    robot = arm_of(arm)
    q, pose = made_path(robot, task, axis, rng)
    path = nj.follow(robot, pose, q[0], task=task, tool_axis=axis)
    assert path.ok.all(), path.message
    expected = q.copy()
    free = nj.inverse_kinematics(robot, pose[0], task=task, tool_axis=axis).free
    expected[:, list(free)] = q[0, list(free)]
    np.testing.assert_allclose(path.q, expected, atol=1e-8)
    assert np.all(path.label >= 0)


@pytest.mark.parametrize("name", SPARE)
def test_with_joints_to_spare_each_step_is_the_least(name, rng):
    arm, task, axis = SPARE[name]
    robot = nj.robots.load(arm)
    q, pose = made_path(robot, task, axis, rng)
    path = nj.follow(robot, pose, q[0], task=task, tool_axis=axis)
    assert path.ok.all(), path.message
    assert path.message == f"The whole path was followed, all {SAMPLES} samples."
    found = np.asarray(path.q)
    assert missed(robot, found, pose, task, axis) < 1e-10
    assert np.all((found >= robot.lower - 1e-9) & (found <= robot.upper + 1e-9))
    assert surplus(robot, found[1:], found[:-1], task, axis) < 1e-7

    def travel(q):
        return np.linalg.norm(np.diff(q, axis=0), axis=1).sum()

    assert travel(found) < travel(q)
    assert np.all(path.label == -1)


@pytest.mark.parametrize("name", [*SPARE, *COMPLETE])
def test_turns_that_are_free_move_nothing(name, rng):
    arm, task, axis = {**SPARE, **COMPLETE}[name]
    robot = arm_of(arm)
    q = np.repeat(START[None, : robot.joints], SAMPLES, axis=0)
    pose = freed(arms.forward(robot, q)[0], task, axis, rng)
    path = nj.follow(robot, pose, q[0], task=task, tool_axis=axis)
    assert path.ok.all(), path.message
    np.testing.assert_allclose(path.q, q, atol=1e-8)


@pytest.mark.parametrize("task", ["direction", "position"])
def test_a_path_out_of_reach_ends_where_nothing_reaches(task, rng):
    robot = nj.robots.niryo_one()
    pose = np.repeat(arms.forward(robot, START[:6])[0][None], SAMPLES, axis=0)
    away = pose[0, :3, 3] - [0, 0, 0.183]
    pose[:, :3, 3] += np.linspace(0, 0.5, SAMPLES)[:, None] * away / np.linalg.norm(away)
    path = nj.follow(robot, pose, START[:6], task=task)
    end = int(path.ok.sum())
    assert 3 < end < SAMPLES
    np.testing.assert_array_equal(path.ok, np.arange(SAMPLES) < end)
    np.testing.assert_array_equal(
        path.q[end:], np.broadcast_to(path.q[end - 1], (SAMPLES - end, 6))
    )
    assert missed(robot, path.q[:end], pose[:end], task, UP) < 1e-10
    assert path.message.startswith(f"The branch ends at sample {end} of 0 to 63: ")
    if task == "position":
        # The stretched arm is the edge of what it reaches.
        count = nj.inverse_kinematics(robot, pose[end + 1], task=task).count
        assert int(count) == 0


def test_joints_to_spare_make_up_for_those_at_their_limits(rng):
    robot = nj.robots.load("kuka_iiwa14")
    q, pose = made_path(robot, "position", UP, rng)
    free = nj.follow(robot, pose, q[0], task="position")
    top = np.asarray(free.q).max(axis=0)
    moves = int(np.argmax(top - q[0]))
    upper = np.array(robot.upper)
    upper[moves] = (0.8 * top + 0.2 * q[0])[moves]
    narrow = dataclasses.replace(robot, upper=upper)
    path = nj.follow(narrow, pose, q[0], task="position")
    assert path.ok.all(), path.message
    assert np.max(np.asarray(path.q)[:, moves]) == pytest.approx(upper[moves], abs=1e-9)
    assert missed(narrow, path.q, pose, "position", UP) < 1e-10
    assert surplus(narrow, path.q[1:], path.q[:-1], "position", UP) < 1e-7
    # With all of them held, none can.
    tight = dataclasses.replace(robot, lower=q[0] - 0.02, upper=q[0] + 0.02)
    path = nj.follow(tight, pose, q[0], task="position")
    assert 0 < path.ok.sum() < SAMPLES
    assert "beyond its limit" in path.message
    assert "joints to spare cannot make up" in path.message


@pytest.mark.parametrize("case", [("niryo_one", UP), ("niryo_one", ALONG)])
def test_what_ends_a_path_is_told(case, rng):
    arm, axis = case
    robot = nj.robots.load(arm)
    q, pose = made_path(robot, "direction", axis, rng)
    options = {"task": "direction", "tool_axis": axis}
    bad = pose.copy()
    bad[20, 0, 0] = np.nan
    path = nj.follow(robot, bad, q[0], **options)
    np.testing.assert_array_equal(path.ok, np.arange(SAMPLES) < 20)
    assert IKStatus.INVALID_POSE.message in path.message
    assert np.all(np.isfinite(path.q))
    coarse = nj.follow(robot, pose[::16], q[0], largest_step=0.02, **options)
    assert coarse.ok.sum() == 1
    assert "farther than the largest step of 0.020 rad" in coarse.message
    nothing = nj.follow(robot, np.zeros((0, 4, 4)), q[0], **options)
    assert nothing.q.shape == (0, 6)
    single = nj.follow(robot, pose.astype(np.float32), q[0], **options)
    assert single.q.dtype == np.float32
    assert single.ok.all(), single.message
    np.testing.assert_allclose(single.q, nj.follow(robot, pose, q[0], **options).q, atol=2e-3)


# --- poses out of reach


@pytest.mark.parametrize(
    "options", [{"task": "direction", "tool_axis": ALONG}, {"task": "position"}]
)
def test_what_is_bound_is_brought_within_reach(options, rng):
    robot = nj.robots.niryo_one()
    shoulder = np.array([0.0, 0.0, 0.183])
    pose = arms.forward(robot, rng.uniform(robot.lower, robot.upper, (4, 6)))[0]
    far = pose.copy()
    far[:, :3, 3] = shoulder + 2.5 * (pose[:, :3, 3] - shoulder)
    given = np.concatenate([pose[:1], far])
    moved, ok = nj.nearest_reachable(robot, given, **options)
    np.testing.assert_array_equal(moved[0], given[0])
    np.testing.assert_array_equal(moved[:, :3, :3], given[:, :3, :3])
    assert np.all(ok)
    assert np.all(nj.inverse_kinematics(robot, moved, **options).status == IKStatus.SOLVED)
    off = np.cross(given[:, :3, 3] - shoulder, np.asarray(moved)[:, :3, 3] - shoulder)
    np.testing.assert_allclose(off, 0.0, atol=1e-12)
    # Less is bound, so no more is to be moved.
    whole, reached = nj.nearest_reachable(robot, given)
    distance = [np.linalg.norm((given - x)[:, :3, 3], axis=1) for x in (moved, whole)]
    assert np.all((distance[0] <= distance[1] + 1e-6) | ~np.asarray(reached))


def test_wrong_tasks_are_refused_by_name():
    robot = nj.robots.niryo_one()
    pose = np.eye(4)[None]
    with pytest.raises(ValueError, match="task: expected one of"):
        nj.nearest_reachable(robot, pose, task="axis")
    with pytest.raises(ValueError, match="task: expected one of"):
        nj.follow(robot, pose, START[:6], task="axis")
    with pytest.raises(ValueError, match="tool_axis: expected a vector"):
        nj.follow(robot, pose, START[:6], task="direction", tool_axis=(0, 0, 0))
