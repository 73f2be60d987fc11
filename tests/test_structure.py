"""Kinematic structure: which axes meet, and which arms belong to the Niryo family."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from pose_sets import spherical

import niryo_jax as nj
from niryo_jax.structure.axes import AxisRelation, distance_between, meeting_point, relation
from niryo_jax.structure.offset_wrist import offset_wrist_arm


@pytest.mark.parametrize(
    ("name", "offset", "wrist"),
    [
        ("niryo_one", 0.0055, (0.2215, 0.0, 0.423)),
        ("niryo_ned", 0.00925, (0.247, 0.0, 0.425)),
        ("niryo_ned2", 0.00925, (0.247, 0.0, 0.4198)),
    ],
)
def test_the_niryo_arms_have_an_offset_wrist(name, offset, wrist):
    arm = offset_wrist_arm(getattr(nj.robots, name)().screws)
    assert arm is not None
    np.testing.assert_allclose(np.linalg.norm(arm.offset), offset, atol=1e-15)
    np.testing.assert_allclose(arm.wrist, wrist, atol=1e-15)


def test_the_wrist_stays_within_its_range(niryo, rng):
    arm = offset_wrist_arm(niryo.screws)
    q = rng.uniform(-np.pi, np.pi, (20000, 6))
    wrist = nj.link_poses(niryo, q)[:, 2] @ np.append(arm.wrist, 1.0)
    distance = np.linalg.norm(wrist[:, :3] - arm.shoulder, axis=1)
    assert arm.wrist_range[0] <= distance.min() + 1e-12
    assert distance.max() <= arm.wrist_range[1] + 1e-12
    np.testing.assert_allclose([distance.min(), distance.max()], arm.wrist_range, atol=1e-6)


def test_relations_of_known_axes():
    x, y, z = np.eye(3)

    def screw(direction, point):
        return np.concatenate([direction, np.cross(point, direction)])

    cases = [
        (screw(x, 0 * x), screw(x, 3 * x), AxisRelation.COINCIDENT, 0.0),
        (screw(x, 0 * x), screw(-x, 3 * x), AxisRelation.COINCIDENT, 0.0),
        (screw(x, 0 * x), screw(x, 2 * y), AxisRelation.PARALLEL, 2.0),
        (screw(x, z), screw(y, z + y), AxisRelation.INTERSECTING, 0.0),
        (screw(x, 0 * x), screw(y, 0.5 * z), AxisRelation.SKEW, 0.5),
    ]
    for first, second, expected, distance in cases:
        assert relation(first, second) is expected
        assert relation(second, first) is expected
        np.testing.assert_allclose(distance_between(first, second), distance, atol=1e-15)


def test_meeting_point_is_on_both_axes(rng):
    for _ in range(20):
        point, a, b = rng.standard_normal((3, 3))
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        screws = [np.concatenate([w, np.cross(point, w)]) for w in (a, b)]
        np.testing.assert_allclose(meeting_point(*screws), point, atol=1e-12)


def test_other_arms_are_not_of_the_family(niryo, rng):
    prismatic = niryo.screws.copy()
    prismatic[2] = [0, 0, 0, 1, 0, 0]
    moved = niryo.screws.copy()
    moved[0, 3:] += [0.0, 0.001, 0.0]
    seven = nj.Robot.from_axes(rng.standard_normal((7, 3)), rng.standard_normal((7, 3)), np.eye(4))
    for screws in (seven.screws, prismatic, moved):
        assert offset_wrist_arm(screws) is None


def test_description_names_joints_limits_and_family(niryo):
    text = niryo.describe()
    assert "joint_3: revolute" in text
    assert "-79.89 to 89.96 deg" in text
    assert "axes 5 and 6 miss each other, 5.5 mm apart" in text
    assert "wrist offset 5.5 mm" in text


def test_description_names_the_solver(niryo, rng):
    calibrated = niryo.screws.copy()
    calibrated[0, 3:] += [0.0, 1e-4, 0.0]
    other = nj.Robot.from_axes(np.eye(3)[[2, 0, 1]], rng.standard_normal((3, 3)), np.eye(4))
    for arm, words in (
        (niryo, "every solution, with a proof"),
        (spherical(niryo), "every solution, in closed form"),
        (nj.Robot.from_screws(calibrated, niryo.home), "from the roots of one polynomial"),
        (other, "some may be missed"),
    ):
        assert words in arm.describe()


def test_a_traced_robot_is_refused_with_the_way_out(niryo):
    with pytest.raises(TypeError, match="Close over the robot"):
        jax.jit(lambda robot: robot.describe() and 0)(niryo)


def rounded(digits: int, lengths: tuple[float, ...] = (0.264, 0.245)) -> nj.Robot:
    """Axes 2, 3 and 4 are parallel, 5 and 6 meet, but for right angles with so many digits."""
    half, turn = round(np.pi / 2, digits), round(np.pi, digits)
    table = [
        (0.02, half, 0.1, 0.0),
        (lengths[0], turn, 0.0, 0.0),
        (lengths[1], 0.0, 0.06, 0.0),
        (0.07, half, 0.0, 0.0),
        (0.0, half, 0.0, half),
        (0.0, 0.0, 0.09, 0.0),
    ]
    return nj.robots.from_dh(table)


@pytest.mark.parametrize("digits", [3, 4, 5, 6])
def test_description_names_the_angle_by_which_axes_miss_being_parallel(digits):
    arm = rounded(digits)
    angle = abs(round(np.pi, digits) - np.pi)
    assert f"axes 2 and 3 miss parallel by {angle:.2g} rad, 264 mm apart" in arm.describe()
    assert "miss parallel" not in rounded(15).describe()


@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-3])
def test_description_names_how_far_axes_miss_one_point(size, rng):
    axes, point = rng.standard_normal((6, 3)), rng.standard_normal((6, 3))
    point[4:] = point[3]
    axes[3:] = np.eye(3)
    for i, words in ((5, "axes 4, 5 and 6 miss one point by"), (0, "")):
        moved = point.copy()
        moved[i] += size * axes[4 if i else 1]
        text = nj.Robot.from_axes(axes, moved, np.eye(4)).describe()
        assert ("miss one point" in text) == bool(words)
        assert f"{words} {size * 1e3:.2g} mm" in text or not words


@pytest.mark.parametrize("name", ["kuka_iiwa14"])
def test_description_counts_locked_joints_as_they_are_given(name):
    robot = nj.robots.load(name)
    (line,) = [line for line in robot.describe().splitlines() if "locked joint" in line]
    told = [int(x) for x in line.split("one of ")[1].split(")")[0].split(",")]
    assert told == sorted(plan.locked for plan in robot.plans if plan.locked is not None)
    pose = nj.forward_kinematics(robot, np.full(7, 0.4))
    assert told
    with pytest.raises(ValueError, match=r"^locked: "):
        nj.inverse_kinematics(robot, pose, locked=(7, 0.4))
