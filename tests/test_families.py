"""Closed forms of the families of arms: complete, exact, and right where arms are singular."""

from __future__ import annotations

import dataclasses
import json

import arms
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES, DATA, product_of_exponentials

import niryo_jax as nj
from niryo_jax.ik import IKStatus, Singularity
from niryo_jax.structure import classify

ROBOTS = json.loads((DATA / "book_robots.json").read_text())["robots"]
BOOK = {entry["name"]: entry for entry in ROBOTS}
SIX_OR_FOUR = [
    "ABB IRB1600",
    "ABB IRB6620LX gantry (2022 book)",
    "ABB IRB910SC scara (2018 book)",
    "Universal Robots UR16e",
    "4-DOF R-T-T-R exercise robot",
]
QUICK = (
    "shoulder with axes 2 and 3 that meet",
    "spherical base, shoulder in general position",
    "slide across axis 2",
    "three parallel axes, from the other end",
    "two turns and two slides",
    "planar arm on a base, with a roll",
)
POSES = 200


def book(name):
    entry = BOOK[name]
    return nj.Robot.from_screws(entry["screws"], entry["home_pose"], name=name)


def check_solutions(robot, poses, answer, tolerance=1e-12):
    """Every answer closes and is listed once; returns the lists of solutions."""
    found, q = np.asarray(answer.found), np.asarray(answer.q)
    assert np.all(np.isfinite(q))
    assert np.array_equal(found.sum(axis=-1), answer.count)
    lists = [q[i][found[i]] for i in range(len(poses))]
    for pose, solutions in zip(poses, lists):
        reached = product_of_exponentials(robot.screws, robot.home, solutions)
        assert np.max(np.abs(reached - pose), initial=0.0) < tolerance
        near = [arms.apart(robot, q, solutions) < 1e-6 for q in solutions]
        assert np.array_equal(np.array(near).reshape(len(near), -1), np.eye(len(near)))
    return lists


def has(robot, solutions, q, tolerance=1e-6):
    return bool(np.any(arms.apart(robot, solutions, q) < tolerance))


def poses_of(robot, q):
    return product_of_exponentials(robot.screws, robot.home, q).astype(float)


LARGE = [pytest.param(name, marks=pytest.mark.completeness) for name in arms.FAMILIES]


@pytest.mark.parametrize("name", [*QUICK, *LARGE])
def test_random_arms_are_solved_completely(name, rng):
    robot = arms.arm(name, rng)
    assert [plan.locked for plan in robot.plans] == [None]
    q = arms.joint_vectors(robot, POSES, rng)
    poses = poses_of(robot, q)
    answer = nj.inverse_kinematics(robot, poses)
    assert np.all(np.asarray(answer.complete))
    lists = check_solutions(robot, poses, answer)
    assert all(has(robot, *pair) for pair in zip(lists, q))
    most = 2 ** robot.plans[0].family.signs
    assert max(map(len, lists)) <= most
    for pose, solutions in zip(poses[:4], lists):
        searched = arms.search(robot, pose, 200, rng)
        assert searched
        assert all(has(robot, solutions, q) for q in searched)


OTHERS = [name for name in BOOK if name not in SIX_OR_FOUR and "iiwa" not in name]


@pytest.mark.parametrize(
    "name",
    [*SIX_OR_FOUR, *(pytest.param(name, marks=pytest.mark.completeness) for name in OTHERS)],
)
def test_the_sets_of_the_book_are_found(name):
    robot = book(name)
    cases = BOOK[name]["ik"]
    poses = np.array([case["pose"] for case in cases or BOOK[name]["fk"]])
    # In a batch of the size that other tests compile.
    answer = nj.inverse_kinematics(robot, np.resize(poses, (POSES, 4, 4)))
    answer = answer.map(lambda x: x[: len(poses)])
    assert np.all(np.asarray(answer.complete))
    lists = check_solutions(robot, poses, answer)
    for case, solutions in zip(cases, lists):
        assert len(solutions) == len(case["solutions"])
        assert all(has(robot, solutions, q) for q in np.array(case["solutions"]))
    for case, solutions in zip([] if cases else BOOK[name]["fk"], lists):
        assert has(robot, solutions, np.array(case["theta"]))


def near_singular(name, rng, count=POSES):
    """Joint vectors at a singularity of a robot of the book or near it, and which are at it."""
    robot = nj.robots.load("abb_irb1600" if name.startswith("irb") else "ur16e")
    q = rng.uniform(-3, 3, (count, 6))
    off = rng.choice([0.0, 1e-12, 1e-9, 1e-7, 1e-5], count)
    if name == "irb1600 wrist" or name == "ur wrist":
        q[:, 4] = off
    elif name == "irb1600 elbow":
        q[:, 2] = np.pi / 2 + off
    elif name == "ur elbow":
        q[:, 2] = off
    else:
        # The wrist on axis 1: 0.15 + 0.475 sin q2 + 0.6 cos(q2 + q3) = 0, solved for q3.
        q[:, 1] = rng.uniform(-0.5, 0.5, count)
        q[:, 2] = np.arccos(-(0.15 + 0.475 * np.sin(q[:, 1])) / 0.6) - q[:, 1] + off
    return robot, q, off == 0


@pytest.mark.parametrize(
    "name", ["irb1600 wrist", "irb1600 elbow", "irb1600 shoulder", "ur wrist", "ur elbow"]
)
def test_singular_poses_are_solved_and_named(name, rng):
    robot, q, exact = near_singular(name, rng)
    poses = poses_of(robot, q)
    answer = nj.inverse_kinematics(robot, poses)
    found = np.asarray(answer.found)
    assert np.all(found.any(axis=1))
    assert np.all(np.asarray(answer.complete))
    reached = product_of_exponentials(robot.screws, robot.home, np.asarray(answer.q))
    assert np.max(np.abs(reached - poses[:, None])[found]) < 1e-12
    if "shoulder" not in name:
        codes = np.asarray(answer.singularity)[exact & found.any(axis=1)]
        wanted = {"wrist": [Singularity.WRIST], "elbow": [Singularity.ELBOW, Singularity.MERGED]}
        assert np.all(np.isin(codes, wanted[name.split()[1]]).any(axis=1))


def test_what_is_out_of_reach_is_proved_to_be(rng):
    for name, joints in (("abb_irb1600", 6), ("abb_irb910sc", 4)):
        robot = nj.robots.load(name)
        poses = poses_of(robot, rng.uniform(-1, 1, (POSES, joints)))
        poses[:, :3, 3] += [9.0, 0.0, 0.0]
        answer = nj.inverse_kinematics(robot, poses)
        assert np.all(np.asarray(answer.status) == IKStatus.UNREACHABLE)
        assert np.all(np.asarray(answer.complete))
        assert "closed form" in answer.message(0)


def test_scara_takes_only_poses_of_its_task_space(rng):
    robot = nj.robots.load("abb_irb910sc")
    poses = poses_of(robot, rng.uniform(-1, 1, (POSES, 4)))
    tilted = poses @ np.asarray(nj.se3.exp(jnp.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])))
    assert np.all(np.asarray(nj.inverse_kinematics(robot, poses).count) >= 1)
    answer = nj.inverse_kinematics(robot, tilted)
    assert np.all(np.asarray(answer.status) == IKStatus.UNREACHABLE)


@pytest.mark.parametrize("name", ["ur16e"])
def test_float32_agrees_with_float64(name, rng):
    robot = nj.robots.load(name)
    q = rng.uniform(-2, 2, (POSES, 6))
    poses = poses_of(robot, q)
    exact, rough = (nj.inverse_kinematics(robot, poses.astype(t)) for t in (np.float64, np.float32))
    assert rough.q.dtype == np.float32
    assert np.mean(np.asarray(exact.count) == np.asarray(rough.count)) > 0.9
    found = np.asarray(rough.found)
    reached = product_of_exponentials(robot.screws, robot.home, np.asarray(rough.q, float))
    size = 1 + np.abs(np.asarray(rough.q, float)).max(axis=-1)
    misses = np.abs(reached - poses[:, None]).max(axis=(-1, -2)) / size
    assert np.max(misses[found]) < 3e-6


@pytest.mark.completeness
def test_derivatives_with_respect_to_pose_and_geometry(rng):
    robot = nj.robots.load("abb_irb910sc")
    q = jnp.asarray(rng.uniform(-1, 1, 4))

    @jax.jit
    def solve(q, screws):
        arm = dataclasses.replace(robot, screws=screws)
        return nj.inverse_kinematics(arm, nj.forward_kinematics(robot, q)).q[0]

    # The second axis moves sideways, and its pose with it.
    shift = np.zeros((4, 6))
    shift[1, 3:] = np.cross([0.3, 0.0, -0.2], robot.screws[1, :3])
    point, direction = (q, jnp.asarray(robot.screws)), (jnp.asarray(rng.standard_normal(4)), shift)
    tangent = jax.jvp(solve, point, direction)[1]
    h = 1e-6
    ahead, behind = (solve(*(x + s * h * d for x, d in zip(point, direction))) for s in (1, -1))
    np.testing.assert_allclose(tangent, (ahead - behind) / (2 * h), atol=2e-6)
    gradients = jax.grad(lambda *x: solve(*x) @ jnp.arange(4.0), (0, 1))(*point)
    along = sum(jnp.sum(g * d) for g, d in zip(gradients, direction))
    np.testing.assert_allclose(along, tangent @ jnp.arange(4.0), rtol=1e-9)


def test_derivatives_with_respect_to_the_pose(rng):
    robot = nj.robots.load("abb_irb910sc")
    q = rng.uniform(-1, 1, 4)

    def solve(q):
        return nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q)).q[0]

    np.testing.assert_allclose(np.abs(jax.jacfwd(solve)(q)[1]), [0, 1, 0, 0], atol=1e-9)
    rates = jax.jacfwd(solve)(q)
    h = 1e-6
    for i, unit in enumerate(np.eye(4)):
        difference = (solve(q + h * unit) - solve(q - h * unit)) / (2 * h)
        np.testing.assert_allclose(rates[:, i], difference, atol=1e-6)


def test_gradients_are_finite_at_singular_poses_and_out_of_reach():
    robot = nj.robots.load("abb_irb910sc")
    poses = np.stack([poses_of(robot, np.zeros(4)), np.eye(4), np.full((4, 4), np.nan)])
    gradient = jax.grad(lambda pose: jnp.sum(nj.inverse_kinematics(robot, pose).q ** 2))
    assert np.all(np.isfinite(np.asarray(gradient(jnp.asarray(poses)))))


@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_are_kept(batch):
    robot = nj.robots.load("abb_irb910sc")
    pose = np.broadcast_to(poses_of(robot, np.full(4, 0.1)), (*batch, 4, 4))
    answer = nj.inverse_kinematics(robot, pose)
    assert answer.q.shape == (*batch, 2, 4)
    assert answer.count.shape == batch
    assert np.all(np.asarray(answer.count) == 2)


class TestSevenJoints:
    """An arm with a joint to spare."""

    UPRIGHT = "KUKA LBR iiwa 14 R820, upright home (2022 book)"

    def found(self, case, joint, value):
        """The solutions for a locked joint, in a batch of the size that other tests compile."""
        robot = book(self.UPRIGHT)
        poses = np.broadcast_to(np.array(case["pose"]), (POSES, 4, 4))
        answer = nj.inverse_kinematics(robot, poses, locked=(joint, value))
        return robot, check_solutions(robot, poses[:1], answer.map(lambda x: x[:1]))[0]

    def test_sets_of_the_book(self):
        for case in BOOK[self.UPRIGHT]["ik"]:
            robot, solutions = self.found(case, case["locked_joint"] - 1, case["locked_value"])
            assert len(solutions) == len(case["solutions"])
            assert all(has(robot, solutions, q) for q in np.array(case["solutions"]))

    def test_theta_3_and_theta_1_give_the_16_of_the_book(self):
        for case in BOOK[self.UPRIGHT]["ik_16"]:
            given = case["redundancy_inputs"]
            parts = [self.found(case, joint, given[f"theta{joint + 1}"]) for joint in (2, 0)]
            assert [len(solutions) for _, solutions in parts] == [8, 8]
            together = np.concatenate([solutions for _, solutions in parts])
            assert all(has(parts[0][0], together, q) for q in np.array(case["solutions"]))

    def test_each_joint_that_can_be_locked_gives_back_what_made_the_pose(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        q = rng.uniform(robot.lower, robot.upper, (POSES, 7))
        poses = poses_of(robot, q)
        assert [plan.locked for plan in robot.plans] == [2, 4, 6, 0, 1, 5, None]
        for joint in (0, 5):
            answer = nj.inverse_kinematics(robot, poses, locked=(joint, q[:, joint]))
            assert np.all(np.asarray(answer.complete))
            lists = check_solutions(robot, poses, answer)
            assert all(has(robot, *pair) for pair in zip(lists, q))
            np.testing.assert_array_equal(
                np.asarray(answer.q)[..., joint][np.asarray(answer.found)],
                np.broadcast_to(q[:, None, joint], answer.found.shape)[np.asarray(answer.found)],
            )

    def test_without_a_value_the_best_of_many_is_given(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        poses = poses_of(robot, rng.uniform(robot.lower, robot.upper, (20, 7)))
        answer = nj.inverse_kinematics(robot, poses)
        assert np.all(np.asarray(answer.status) == IKStatus.SOLVED)
        assert not np.any(np.asarray(answer.complete))
        check_solutions(robot, poses, answer)
        margin = np.minimum(answer.q - robot.lower, robot.upper - answer.q).min(axis=-1)
        assert np.all(np.diff(margin, axis=1) <= 1e-12)

    def test_what_is_out_of_reach_is_proved_to_be(self):
        robot = nj.robots.load("kuka_iiwa14")
        poses = poses_of(robot, np.zeros((20, 7)))
        poses[:10, 2, 3] += 1.0
        status = np.asarray(nj.inverse_kinematics(robot, poses).status)
        assert np.all(status[:10] == IKStatus.UNREACHABLE)
        assert np.all(status[10:] == IKStatus.SOLVED)

    def test_every_arm_angle_reaches_what_the_arm_can_reach(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        q = rng.uniform(robot.lower, robot.upper, (POSES, 7))
        poses = poses_of(robot, q)
        angle = np.asarray(nj.arm_angle(robot, q))
        answer = nj.inverse_kinematics(robot, poses, arm_angle=angle)
        assert np.all(np.asarray(answer.complete))
        assert np.all(np.asarray(answer.count) == 8)
        lists = check_solutions(robot, poses, answer)
        assert all(has(robot, *pair) for pair in zip(lists, q))
        again = np.asarray(nj.arm_angle(robot, answer.q)) - angle[:, None]
        assert np.max(np.abs((again + np.pi) % (2 * np.pi) - np.pi)) < 1e-9
        other = nj.inverse_kinematics(robot, poses, arm_angle=rng.uniform(-3, 3, POSES))
        assert np.all(np.asarray(other.count) == 8)

    def test_arm_angle_is_the_turn_of_the_elbow_about_the_line_to_the_wrist(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        q = rng.uniform(robot.lower, robot.upper, 7)
        frames = np.asarray(nj.link_poses(robot, q))
        shoulder, elbow, wrist = (
            frame[:3, :3] @ [0.0, 0.0, height] + frame[:3, 3]
            for frame, height in zip(frames[[0, 2, 4]], (0.36, 0.78, 1.18))
        )
        along = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
        up, out = (v - (v @ along) * along for v in (np.array([0, 0, 1]), elbow - shoulder))
        angle = np.arctan2(along @ np.cross(up, out), up @ out)
        assert float(nj.arm_angle(robot, q)) == pytest.approx(angle, abs=1e-12)
        with pytest.raises(ValueError, match="ur16e is no such arm"):
            nj.arm_angle(nj.robots.load("ur16e"), np.zeros(6))

    @pytest.mark.completeness
    def test_derivatives_hold_the_arm_angle(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        q = rng.uniform(-1, 1, 7)
        pose = nj.forward_kinematics(robot, q)

        def solve(angle, twist):
            return nj.inverse_kinematics(robot, pose @ nj.se3.exp(twist), arm_angle=angle).q[0]

        angle, rest, h = nj.arm_angle(robot, q), jnp.zeros(6), 1e-6
        by_angle, by_twist = jax.jacfwd(solve, (0, 1))(angle, rest)
        difference = (solve(angle + h, rest) - solve(angle - h, rest)) / (2 * h)
        np.testing.assert_allclose(by_angle, difference, atol=1e-6)
        for column, unit in zip(by_twist.T, np.eye(6)):
            difference = (solve(angle, h * unit) - solve(angle, -h * unit)) / (2 * h)
            np.testing.assert_allclose(column, difference, atol=1e-6)

    @pytest.mark.completeness
    def test_derivatives_hold_the_locked_joint(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        q = rng.uniform(-1, 1, 7)

        def solve(value, q):
            return nj.inverse_kinematics(
                robot, nj.forward_kinematics(robot, q), locked=(2, value)
            ).q[0]

        jacobian = jax.jacfwd(solve)(q[2], q)
        h = 1e-6
        difference = (solve(q[2] + h, q) - solve(q[2] - h, q)) / (2 * h)
        np.testing.assert_allclose(jacobian, difference, atol=1e-6)
        assert jacobian[2] == 1.0

    def test_a_value_that_is_not_finite_is_named_and_harms_no_other(self, rng):
        robot = nj.robots.load("kuka_iiwa14")
        q = rng.uniform(robot.lower, robot.upper, (POSES, 7))
        values = q[:, 0].copy()
        values[:2] = np.nan, np.inf
        answer = nj.inverse_kinematics(robot, poses_of(robot, q), locked=(0, values))
        assert np.all(np.asarray(answer.status)[:2] == IKStatus.INVALID_POSE)
        assert np.all(np.asarray(answer.count)[2:] > 0)
        assert np.all(np.isfinite(np.asarray(answer.q)))

    def test_wrong_use_is_refused_by_name(self):
        robot, six = nj.robots.load("kuka_iiwa14"), nj.robots.load("ur16e")
        for arm, locked, words in (
            (robot, (3, 0.0), "joint 3 of kuka_iiwa14 cannot be locked"),
            (robot, (7, 0.0), "locked: expected at most 6, got 7"),
            (six, (2, 0.0), "cannot be locked"),
        ):
            with pytest.raises(ValueError, match=words):
                nj.inverse_kinematics(arm, np.eye(4), locked=locked)
        with pytest.raises(ValueError, match="arm_angle: ur16e has none"):
            nj.inverse_kinematics(six, np.eye(4), arm_angle=0.0)
        with pytest.raises(ValueError, match="expected one of the two"):
            nj.inverse_kinematics(robot, np.eye(4), locked=(2, 0.0), arm_angle=0.0)
        with pytest.raises(TypeError, match="locked: expected"):
            nj.inverse_kinematics(robot, np.eye(4), locked=3)
        with pytest.raises(ValueError, match="needs a joint of kuka_iiwa14 to be locked"):
            nj.inverse_kinematics(robot, np.eye(4), method="complete")
        with pytest.raises(ValueError, match="are for method 'complete', got 'sampled'"):
            nj.inverse_kinematics(robot, np.eye(4), method="sampled", locked=(2, 0.0))
        with pytest.raises(ValueError, match="'sampled' needs seven joints"):
            nj.inverse_kinematics(six, np.eye(4), method="sampled")


def test_arms_of_no_family_have_no_plan(rng):
    general = nj.Robot.from_axes(
        rng.standard_normal((6, 3)), rng.standard_normal((6, 3)), np.eye(4)
    )
    assert general.plans == ()
    # A helical joint, slides that are parallel, a shoulder whose axes meet in one point.
    helical = np.array(general.screws)
    helical[0, 3:] += helical[0, :3]
    assert classify.closed_form_plans(helical) == ()
    slides = np.zeros((4, 6))
    slides[:2, 5], slides[2:, :3] = 1.0, np.eye(3)[:2]
    assert classify.closed_form_plans(slides) == ()
    point, wrist = rng.standard_normal((2, 3))
    axes = rng.standard_normal((6, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    centres = np.array([point] * 3 + [wrist] * 3)
    assert classify.closed_form_plans(np.hstack([axes, np.cross(centres, axes)])) == ()


@pytest.mark.parametrize("name", arms.FAMILIES)
def test_description_names_family_solver_and_singularities(name, rng):
    text = arms.arm(name, rng).describe()
    assert "family: " in text
    assert "inverse kinematics: every solution, in closed form, at most" in text
    assert "singularities: " in text


def test_locking_a_joint_in_numbers_is_moving_what_is_behind_it(rng):
    robot = nj.robots.load("kuka_iiwa14")
    q = rng.uniform(-3, 3, 7)
    left = classify.lock(np.asarray(robot.screws), 3, q[3])
    step = product_of_exponentials(robot.screws[3:4], np.eye(4), q[3:4]).astype(float)
    arm = nj.Robot.from_screws(left, step @ robot.home)
    np.testing.assert_allclose(poses_of(arm, np.delete(q, 3)), poses_of(robot, q), atol=1e-14)
