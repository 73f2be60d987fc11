"""The book's sequences of subproblems give the sets that `inverse_kinematics` gives."""

from __future__ import annotations

import numpy as np
from support import product_of_exponentials

import niryo_jax as nj

sub = nj.subproblems


def motion(robot, q, joints):
    """exp([S_i] q_i) of some joints in their order, (..., 4, 4)."""
    screws = np.asarray(robot.screws)[list(joints)]
    return product_of_exponentials(screws, np.eye(4), q[..., list(joints)]).astype(float)


def applied(pose, point):
    return pose[..., :3, :3] @ point + pose[..., :3, 3]


def solved(name, rng, count=20):
    """Solutions (m, n) of poses made from random joint vectors, with T M^-1 of each (m, 4, 4)."""
    robot = nj.robots.load(name)
    q = rng.uniform(-2, 2, (count, robot.joints))
    pose = motion(robot, q, range(robot.joints)) @ robot.home
    answer = nj.inverse_kinematics(robot, pose)
    found = np.asarray(answer.found)
    assert np.all(np.asarray(answer.complete))
    whole = pose @ np.linalg.inv(robot.home)
    return robot, np.asarray(answer.q)[found], whole[np.nonzero(found)[0]], found.sum(axis=1)


def contains(answer, expected):
    """Whether the expected angles (m, joints) are among the answers of each problem."""
    apart = np.abs((np.asarray(answer.angles) - expected[:, None] + np.pi) % (2 * np.pi) - np.pi)
    near = apart.max(axis=-1) < 1e-7
    return np.any(near & np.asarray(answer.valid), axis=-1)


def test_wrist_of_the_irb120_by_pk2_and_by_pg6(rng):
    robot, q, whole, counts = solved("abb_irb120", rng)
    assert np.all(counts == 8)
    *_, s4, s5, s6 = np.asarray(robot.screws)
    on_6, off_6 = np.array([0.302, 0, 0.47]), np.array([0.5, 0.1, 0.2])
    left = np.linalg.inv(motion(robot, q, range(3))) @ whole
    for solve in (sub.paden_kahan_2, sub.pardos_gotor_6):
        answer = solve(s4, s5, on_6, applied(left, on_6))
        assert np.all(contains(answer, q[:, 3:5]))
        assert np.all(np.asarray(answer.valid).sum(axis=-1) == 2)
    last = applied(np.linalg.inv(motion(robot, q, (3, 4))) @ left, off_6)
    assert np.all(contains(sub.paden_kahan_1(s6, off_6, last), q[:, 5:]))


def test_gantry_by_pg1_and_pg4(rng):
    robot, q, whole, counts = solved("abb_irb6620lx", rng)
    assert np.all(counts == 4)
    s1, s2, s3 = np.asarray(robot.screws)[:3]
    wrist = np.array([2.643, 1.613, 0.0])
    goal = applied(whole, wrist)
    # Axes 2 and 3 move the wrist across the slide only: the nearest answer is the slide's.
    slide = np.asarray(sub.pardos_gotor_1(s1, wrist, goal).angles)[:, 0, 0]
    np.testing.assert_allclose(slide, q[:, 0], atol=1e-12)
    answer = sub.pardos_gotor_4(s2, s3, wrist, goal - slide[:, None] * s1[3:])
    assert np.all(contains(answer, q[:, 1:3]))


def test_scara_by_its_two_routes(rng):
    robot, q, whole, counts = solved("abb_irb910sc", rng)
    assert np.all(counts == 2)
    s1, s2, s3, s4 = np.asarray(robot.screws)
    on_4, off_4 = np.array([0.65, 0.0, 0.0]), np.array([0.7, 0.0, 0.3])
    goal = applied(whole, on_4)
    slide = np.asarray(sub.pardos_gotor_1(s3, on_4, goal).angles)[:, 0, 0]
    np.testing.assert_allclose(slide, q[:, 2], atol=1e-12)
    raised = on_4 + slide[:, None] * s3[3:]
    assert np.all(contains(sub.pardos_gotor_4(s1, s2, raised, goal), q[:, :2]))
    # Or the elbow from the distance to axis 1, at the height of the goal, and then axis 1.
    shoulder = goal * s1[:3]
    elbow = sub.paden_kahan_3(s2, raised, shoulder, np.linalg.norm(goal - shoulder, axis=-1))
    assert np.all(contains(elbow, q[:, 1:2]))
    bent = np.stack([applied(*pair) for pair in zip(motion(robot, q, (1,)), raised)])
    assert np.all(contains(sub.paden_kahan_1(s1, bent, goal), q[:, :1]))
    left = np.linalg.inv(motion(robot, q, range(3))) @ whole
    assert np.all(contains(sub.paden_kahan_1(s4, off_4, applied(left, off_4)), q[:, 3:]))


def test_ur16e_by_pg8(rng):
    robot, q, whole, counts = solved("ur16e", rng)
    assert set(counts) <= {2, 4, 6, 8}
    screws = np.asarray(robot.screws)
    left = np.linalg.inv(motion(robot, q, (0,))) @ whole
    left = left @ np.linalg.inv(motion(robot, q, (4, 5)))
    answer = sub.pardos_gotor_8(*screws[1:4], np.eye(4), left)
    assert np.all(contains(answer, q[:, 1:4]))
    assert np.all(np.asarray(answer.valid).sum(axis=-1) == 2)


def test_iiwa_by_its_redundancy_input_of_theta_3(rng):
    robot = nj.robots.load("kuka_iiwa14")
    q = rng.uniform(robot.lower, robot.upper, (20, 7))
    pose = motion(robot, q, range(7)) @ robot.home
    answer = nj.inverse_kinematics(robot, pose, locked=(2, q[:, 2]))
    found = np.asarray(answer.found)
    every, which = np.asarray(answer.q)[found], np.nonzero(found)[0]
    screws = np.asarray(robot.screws)
    shoulder, wrist = np.array([0, 0, 0.36]), np.array([0, 0, 1.18])
    goal = applied((pose @ np.linalg.inv(robot.home))[which], wrist)
    elbow = sub.paden_kahan_3(screws[3], wrist, shoulder, np.linalg.norm(goal - shoulder, axis=-1))
    assert np.all(contains(elbow, every[:, 3:4]))
    bent = applied(motion(robot, every, (2, 3)), wrist)
    pair = sub.paden_kahan_2(screws[0], screws[1], bent, goal)
    assert np.all(contains(pair, every[:, :2]))
