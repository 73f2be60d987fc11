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
        (nj.Robot.from_screws(calibrated, niryo.home), "of the nearest such arm; not proved"),
        (other, "some may be missed"),
    ):
        assert words in arm.describe()


def test_a_traced_robot_is_refused_with_the_way_out(niryo):
    with pytest.raises(TypeError, match="Close over the robot"):
        jax.jit(lambda robot: robot.describe() and 0)(niryo)
