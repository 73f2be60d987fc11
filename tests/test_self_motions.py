"""Where the arm can move while the tool rests: representatives, references, and paths across."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import fsolve, root

import niryo_jax as nj
from niryo_jax.ik import IKStatus, Singularity

TURN = 2 * np.pi
UR5E = nj.robots.from_dh(
    [
        (0, np.pi / 2, 0.1625, 0),
        (-0.425, 0, 0, 0),
        (-0.3922, 0, 0, 0),
        (0, np.pi / 2, 0.1333, 0),
        (0, -np.pi / 2, 0.0997, 0),
        (0, 0, 0.0996, 0),
    ],
    lower=np.full(6, -TURN),
    upper=np.full(6, TURN),
    name="ur5e",
)
ANTHROPOMORPHIC = nj.robots.from_dh(
    [
        (0.18, np.pi / 2, 0.4, 0),
        (0.6, 0, 0, np.pi / 2),
        (0.12, np.pi / 2, 0, 0),
        (0, -np.pi / 2, 0.62, 0),
        (0, np.pi / 2, 0, 0),
        (0, 0, 0.115, 0),
    ],
    lower=np.deg2rad([-155, -180, -105, 30, -130, -350]),
    upper=np.deg2rad([155, 65, 158, 150, 130, 350]),
    name="anthropomorphic",
)
"""Joint 4 is never at 0, where a closed form is likely to put it."""

COUNT = 16


def within(robot: nj.Robot, rng: np.random.Generator) -> np.ndarray:
    """(COUNT, n) joint vectors within the limits."""
    lower, upper = np.asarray(robot.lower), np.asarray(robot.upper)
    return rng.uniform(lower, upper, (COUNT, robot.joints))


def aligned(robot: nj.Robot, rng: np.random.Generator) -> np.ndarray:
    """Axes 4 and 6 aligned; the UR's axis 6 then is parallel to axes 2, 3 and 4."""
    q = within(robot, rng)
    q[:, 4] = 0.0
    return q


def on_axis_1(robot: nj.Robot, rng: np.random.Generator) -> np.ndarray:
    """The wrist point of an arm with a spherical wrist on axis 1."""
    q = within(robot, rng)
    screws = np.asarray(robot.screws)
    points = np.cross(screws[3:5, :3], screws[3:5, 3:])
    lines = np.stack([screws[3, :3], -screws[4, :3]], 1)
    along = np.linalg.lstsq(lines, points[1] - points[0], rcond=None)[0]
    wrist = np.append(points[0] + along[0] * screws[3, :3], 1.0)
    place = jax.jit(lambda q: (nj.forward_kinematics(robot, q) @ np.linalg.inv(robot.home)) @ wrist)
    out = list[np.ndarray]()
    for row in q:
        for guess in np.linspace(robot.lower[1], robot.upper[1], 7):

            def beside(x: np.ndarray, row: np.ndarray = row) -> float:
                return float(place(np.array([0, x[0], row[2], 0, 0, 0]))[0])

            x, _, solved, _ = fsolve(beside, guess, xtol=1e-14, full_output=True)
            if solved == 1 and robot.lower[1] < x[0] < robot.upper[1] and abs(beside(x)) < 1e-15:
                out.append(np.array([row[0], x[0], *row[2:]]))
                break
    assert len(out) > COUNT // 2
    return np.array([out[i % len(out)] for i in range(COUNT)])


def upright(robot: nj.Robot, rng: np.random.Generator) -> np.ndarray:
    """The Niryo One with its tool straight up on axis 1."""

    def beside(x: np.ndarray) -> list[float]:
        pose = nj.forward_kinematics(robot, np.array([0, 0.1, x[0], 0, x[1], 0]))
        return [float(pose[0, 3]), float(pose[0, 0])]

    third, fifth = root(beside, np.deg2rad([72.0, 12.0]), tol=1e-15).x
    q = within(robot, rng)
    q[:, 1:] = 0.1, third, 0, fifth, 0
    return q


CASES = {
    "irb120 on axis 1": (nj.robots.abb_irb120(), on_axis_1, Singularity.SHOULDER),
    "anthropomorphic on axis 1": (ANTHROPOMORPHIC, on_axis_1, Singularity.SHOULDER),
    "anthropomorphic aligned": (ANTHROPOMORPHIC, aligned, Singularity.WRIST),
    "ur5e aligned": (UR5E, aligned, Singularity.WRIST),
    "niryo one upright": (nj.robots.niryo_one(), upright, Singularity.SELF_MOTION),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    robot, make, name = CASES[request.param]
    q = make(robot, np.random.default_rng(5))
    poses = np.asarray(nj.forward_kinematics(robot, q))
    return robot, q, poses, name, nj.inverse_kinematics(robot, poses)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest joint difference, whole turns aside."""
    return np.abs((np.asarray(a) - b + np.pi) % TURN - np.pi).max(axis=-1)


def test_a_pose_reached_within_the_limits_is_solved_within_them(case):
    robot, _, poses, name, answer = case
    assert np.all(np.asarray(answer.status) == IKStatus.SOLVED)
    assert np.all(answer.complete)
    assert np.all(np.any(answer.found & (answer.singularity == name), axis=-1))
    q = np.asarray(answer.q)[np.asarray(answer.within_limits)]
    assert np.all((q >= np.asarray(robot.lower) - 1e-6) & (q <= np.asarray(robot.upper) + 1e-6))
    reached = np.asarray(nj.forward_kinematics(robot, answer.q))
    off = np.abs(reached - poses[:, None]).max(axis=(-1, -2))
    assert np.all(off[np.asarray(answer.found)] < 1e-11)


def test_what_reaches_the_pose_is_its_own_nearest(case):
    _, q, _, _, answer = case
    nearest, ok = answer.nearest(q)
    assert np.all(ok)
    np.testing.assert_allclose(nearest, q, atol=1e-9)


def test_a_reference_is_taken_where_it_reaches_the_pose(case):
    robot, q, poses, _, plain = case
    answer = nj.inverse_kinematics(robot, poses, q_ref=q)
    distance = np.where(answer.found, apart(answer.q, q[:, None]), np.inf).min(axis=-1)
    assert np.all(distance < 1e-9)
    np.testing.assert_array_equal(answer.count, plain.count)
    np.testing.assert_array_equal(answer.complete, plain.complete)


def test_a_reference_beside_the_pose_moves_less_than_it_is_off():
    q = aligned(UR5E, np.random.default_rng(6))
    reference = q + np.random.default_rng(7).normal(0, 0.02, q.shape)
    answer = nj.inverse_kinematics(UR5E, nj.forward_kinematics(UR5E, q), q_ref=reference)
    away = (np.asarray(answer.q) - reference[:, None] + np.pi) % TURN - np.pi
    nearest = np.where(answer.found, np.linalg.norm(away, axis=-1), np.inf).min(axis=-1)
    assert np.all(nearest <= np.linalg.norm(q - reference, axis=-1) + 1e-9)


def test_a_reference_changes_nothing_elsewhere():
    q = within(UR5E, np.random.default_rng(8))
    poses = nj.forward_kinematics(UR5E, q)
    plain, answer = (nj.inverse_kinematics(UR5E, poses, q_ref=x) for x in (None, 0 * q))
    np.testing.assert_array_equal(answer.q, plain.q)


@pytest.mark.parametrize("samples", [30, 31])
@pytest.mark.parametrize("ends", [(0.3, -0.3), (0.0, 0.3), (0.3, 0.0)])
def test_a_path_leads_through_or_from_or_to_a_singular_sample(samples, ends):
    start = np.array([0.3, -1.2, 1.1, 0.4, 0.0, 0.6])
    q = np.tile(start, (samples, 1))
    q[:, 4] = np.linspace(*ends, samples)
    q[:, 3] += 0.1 * np.linspace(-1, 1, samples)
    path = nj.follow(UR5E, nj.forward_kinematics(UR5E, q), q[0])
    assert np.all(path.ok), path.message
    np.testing.assert_allclose(path.q, q, atol=1e-8)


def test_derivatives_are_finite_with_a_reference():
    q = aligned(UR5E, np.random.default_rng(9))[0]
    pose = nj.forward_kinematics(UR5E, q)
    jacobian = jax.jacobian(lambda pose: nj.inverse_kinematics(UR5E, pose, q_ref=q).q)(pose)
    assert np.all(np.isfinite(jacobian))


def test_inside_a_transformation_the_representative_is_within_the_limits_too():
    q = aligned(ANTHROPOMORPHIC, np.random.default_rng(10))
    solve = jax.jit(
        lambda q: nj.inverse_kinematics(ANTHROPOMORPHIC, nj.forward_kinematics(ANTHROPOMORPHIC, q))
    )
    answer = solve(jnp.asarray(q))
    assert np.all(np.asarray(answer.status) == IKStatus.SOLVED)


@pytest.mark.parametrize("bad", [np.zeros(5), np.zeros((3, 6)), "abc"])
def test_a_reference_of_another_shape_is_refused(bad):
    pose = nj.forward_kinematics(UR5E, np.zeros(6))
    with pytest.raises((TypeError, ValueError), match="q_ref"):
        nj.inverse_kinematics(UR5E, pose, q_ref=bad)


def test_a_method_that_does_not_look_for_singularities_says_so():
    q = aligned(UR5E, np.random.default_rng(11))[:2]
    answer = nj.inverse_kinematics(UR5E, nj.forward_kinematics(UR5E, q), "multistart")
    assert np.all(np.any(answer.found, axis=-1))
    assert set(np.asarray(answer.singularity)[np.asarray(answer.found)]) == {Singularity.UNKNOWN}
    assert Singularity.UNKNOWN.message not in answer.message(0)


@pytest.mark.parametrize("bend", [0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4])
def test_an_arm_with_an_elbow_next_to_straight_is_solved(bend):
    robot = nj.robots.load("kuka_iiwa14")
    q = within(robot, np.random.default_rng(12))
    q[:, 3] = bend
    q[: COUNT // 2, 1] = 0.0  # Upright as well.
    answer = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q))
    assert np.all(np.asarray(answer.status) == IKStatus.SOLVED)


def test_every_aligned_wrist_at_multiples_of_45_degrees_is_solved_within_the_limits():
    # A row of the Jacobian is then nothing but rounding, which is no row independent of the others.
    robot = nj.robots.load("niryo_one_report")
    rng = np.random.default_rng(13)
    quarter = np.pi / 4
    steps = rng.integers(
        np.ceil(robot.lower / quarter), np.floor(robot.upper / quarter) + 1, (64, 6)
    )
    q = steps * quarter
    q[:, 4] = 0.0
    answer = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q))
    assert np.all(np.asarray(answer.status) == IKStatus.SOLVED)
    nearest, ok = answer.nearest(q)
    assert np.all(ok)
    np.testing.assert_allclose(nearest, q, atol=1e-9)


def test_an_arm_angle_is_kept_along_a_self_motion_where_it_has_a_value():
    robot = nj.robots.load("kuka_iiwa14")
    stills = [[1], [3], [5], [1, 3], [1, 5], [3, 5], [1, 3, 5]]
    q = np.repeat(within(robot, np.random.default_rng(3))[None], len(stills), axis=0)
    for row, still in zip(q, stills):
        row[:, still] = 0.0
    angle = np.asarray(nj.arm_angle(robot, q))
    answer = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q), arm_angle=angle)
    assert np.all(np.asarray(answer.status) == IKStatus.SOLVED)
    turned = (np.asarray(nj.arm_angle(robot, answer.q)) - angle[..., None] + np.pi) % TURN - np.pi
    has_one = np.array([3 not in still for still in stills])[:, None, None]
    assert np.all(np.abs(turned)[answer.found & has_one] < 1e-8)
    named = np.asarray(answer.singularity) == Singularity.SELF_MOTION
    assert np.all(named | has_one | ~np.asarray(answer.found))
    nearest, ok = answer.nearest(q)
    assert np.all(ok)
    np.testing.assert_allclose(nearest, q, atol=1e-9)
