"""The robots of the founding documents: their vectors, and other ways to describe them."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest
from support import DATA, expm, hat3, product_of_exponentials, rigid

import niryo_jax as nj
from niryo_jax.robots import book, catalogue, niryo

BOOK = json.loads((DATA / "book_robots.json").read_text())
DATA_OF = {entry["name"]: entry for entry in BOOK["robots"]}
BUILDERS = {
    "ABB IRB120 tool down, Y up (2018 book)": functools.partial(
        book.abb_irb120, up="y", edition=2018
    ),
    "ABB IRB120 tool down, Z up (2022 book)": book.abb_irb120,
    "ABB IRB120 tool down, Y up (2022 book, differential kinematics)": functools.partial(
        book.abb_irb120, up="y"
    ),
    "ABB IRB120 tool up": functools.partial(book.abb_irb120, "up", up="y", edition=2018),
    "ABB IRB1600": book.abb_irb1600,
    "ABB IRB6620LX gantry (2018 book)": functools.partial(book.abb_irb6620lx, edition=2018),
    "ABB IRB6620LX gantry (2022 book)": book.abb_irb6620lx,
    "ABB IRB910SC scara (2018 book)": functools.partial(book.abb_irb910sc, edition=2018),
    "ABB IRB910SC scara (2022 book)": book.abb_irb910sc,
    "KUKA LBR iiwa 14 R820, bent home (2018 book)": functools.partial(book.kuka_iiwa14, "bent"),
    "KUKA LBR iiwa 14 R820, upright home (2022 book)": book.kuka_iiwa14,
    "KUKA LBR iiwa, side tool (2022 book)": functools.partial(book.kuka_iiwa14, "side_tool"),
    "Universal Robots UR16e": book.ur16e,
    "4-DOF R-T-T-R exercise robot": book.rttr,
}
X, Y, Z = np.eye(3)


def pose_of(robot, q):
    return product_of_exponentials(robot.screws, robot.home, q).astype(float)


def turn(axis, degrees):
    """(4, 4) rotation about an axis through the origin."""
    return rigid(expm(hat3(np.asarray(axis, float) * np.deg2rad(degrees))), np.zeros(3))


def angles(robot, rng, count=50):
    """(count, n) joint values between -2 and 2."""
    return rng.uniform(-2, 2, (count, robot.joints))


# Vectors


def test_every_definition_of_the_data_has_a_builder():
    assert set(BUILDERS) == set(DATA_OF)
    assert len(BUILDERS) == 14


@pytest.mark.parametrize("name", BUILDERS)
def test_screws_and_home_are_those_of_the_data(name):
    robot, data = BUILDERS[name](), DATA_OF[name]
    np.testing.assert_array_equal(robot.screws, data["screws"])
    np.testing.assert_allclose(robot.home, data["home_pose"], atol=3e-16)


@pytest.mark.parametrize("name", [name for name in BUILDERS if DATA_OF[name]["limits"]])
def test_limits_are_those_of_the_data(name):
    robot = BUILDERS[name]()
    lower, upper = np.array(DATA_OF[name]["limits"]).T
    # The data repeats the limits of 2022 for these, of which joint 3 is counted the other way.
    if name in (
        "ABB IRB120 tool down, Y up (2018 book)",
        "ABB IRB120 tool up",
        "ABB IRB6620LX gantry (2018 book)",
    ):
        lower[2], upper[2] = -upper[2], -lower[2]
    np.testing.assert_allclose(robot.lower, lower, rtol=1e-15)
    np.testing.assert_allclose(robot.upper, upper, rtol=1e-15)


@pytest.mark.parametrize("name", BUILDERS)
def test_forward_kinematics_reaches_the_poses_of_all_vectors_and_solutions(name):
    data = DATA_OF[name]
    cases = [(case["theta"], case["pose"], 1e-13) for case in data["fk"]]
    cases += [
        (solution, entry["pose"], 1e-9)
        for entry in data["ik"] + data.get("ik_16", [])
        for solution in entry["solutions"]
    ]
    found = nj.forward_kinematics(BUILDERS[name](), np.array([theta for theta, _, _ in cases]))
    miss = np.abs(found - np.array([pose for _, pose, _ in cases])).max(axis=(1, 2))
    assert np.all(miss <= [tolerance for _, _, tolerance in cases])


@pytest.mark.parametrize("name", BUILDERS)
def test_space_jacobian_is_that_of_the_data(name):
    data = DATA_OF[name]["space_jacobian"]
    found = nj.space_jacobian(BUILDERS[name](), np.array(data["theta"]))
    np.testing.assert_allclose(found, data["J"], atol=1e-12)


# What the books print


def test_the_printed_pose_of_the_irb120_has_eight_solutions_and_the_numeric_answer_is_none():
    printed = BOOK["printed_examples"][0]
    robot, pose = BUILDERS[printed["robot"]](), np.array(printed["pose_4_decimals"])
    solutions = np.array(printed["all_8_solutions"])
    assert solutions.shape == (8, 6)
    np.testing.assert_allclose(pose_of(robot, solutions), np.tile(pose, (8, 1, 1)), atol=1.5e-4)
    apart = np.abs(solutions[:, None] - solutions).max(axis=-1) + 9 * np.eye(8)
    assert np.min(apart) > 0.5
    exact = np.abs(solutions - printed["theta_ST24R_4_decimals"]).max(axis=-1)
    assert np.min(exact) < 5e-4
    numeric = pose_of(robot, printed["theta_numeric"])
    assert np.linalg.norm(numeric[:3, 3] - pose[:3, 3]) == pytest.approx(0.434, abs=1e-3)
    cosine = (np.trace(numeric[:3, :3].T @ pose[:3, :3]) - 1) / 2
    assert np.arccos(cosine) == pytest.approx(0.95, abs=5e-3)


def test_the_printed_pose_of_the_exercise_robot():
    printed = BOOK["printed_examples"][3]
    np.testing.assert_allclose(pose_of(book.rttr(), printed["theta"]), printed["pose"], atol=1e-14)


def denavit_hartenberg(rows):
    """The pose of a chain from classic rows (d, theta, a, alpha), degrees for alpha."""
    pose = np.eye(4)
    for d, theta, a, alpha in rows:
        shift = rigid(np.eye(3), np.array([a, 0, d]))
        pose = pose @ turn(Z, np.rad2deg(theta)) @ shift @ turn(X, alpha)
    return pose


def test_denavit_hartenberg_tables_give_the_same_poses(rng):
    right = np.pi / 2
    for q in angles(book.abb_irb120(), rng, 10):
        table = [
            (0.29, q[0], 0, -90),
            (0, q[1] - right, 0.27, 0),
            (0, q[2], 0.07, -90),
            (0.302, q[3], 0, 90),
            (0, q[4] - right, 0, 90),
            (0.16, q[5], 0, 0),
        ]
        np.testing.assert_allclose(
            pose_of(book.abb_irb120(), q), denavit_hartenberg(table).astype(float), atol=1e-14
        )
    for q in angles(book.rttr(), rng, 10):
        table = [(1, q[0], 0, 0), (q[1], right, 0, 90), (q[2], 0, 0, 0), (4, q[3], 0, 0)]
        np.testing.assert_allclose(
            pose_of(book.rttr(), q), denavit_hartenberg(table).astype(float), atol=1e-14
        )


# One arm, drawn in several ways


def check_same_arm(robot, other, factor, shift, rng, ground=None, tool=None):
    """Whether robot(q) = ground other(factor q + shift) tool, and the limits agree."""
    q = angles(robot, rng)
    left = np.eye(4) if ground is None else ground
    right = np.eye(4) if tool is None else tool
    moved = left @ pose_of(other, factor * q + shift) @ right
    np.testing.assert_allclose(pose_of(robot, q), moved.astype(float), atol=1e-14)
    limits = np.sort(factor * np.stack([robot.lower, robot.upper]) + shift, axis=0)
    np.testing.assert_allclose(limits, [other.lower, other.upper], atol=1e-14)


def test_the_editions_draw_the_same_arms(rng):
    irb120 = np.array([1, -1, -1, 1, -1, 1])
    for robot, other, factor in (
        (book.abb_irb120(edition=2018), book.abb_irb120(), irb120),
        (book.abb_irb120("up", edition=2018), book.abb_irb120("up"), irb120),
        (book.abb_irb6620lx(edition=2018), book.abb_irb6620lx(), irb120),
        (book.abb_irb910sc(edition=2018), book.abb_irb910sc(), np.array([1, 1, -1, 1])),
    ):
        tool = np.linalg.inv(other.home) @ robot.home
        np.testing.assert_allclose(tool[:3, 3], 0, atol=1e-15)
        check_same_arm(robot, other, factor, 0.0, rng, tool=tool)


def test_the_arm_with_y_up_is_the_arm_with_z_up_laid_down(rng):
    for tool in ("down", "up"):
        robot, other = book.abb_irb120(tool, up="y"), book.abb_irb120(tool)
        check_same_arm(robot, other, np.ones(6), 0.0, rng, ground=turn(X, -90))


def test_the_tool_points_up_where_joint_5_is_turned_over(rng):
    q = angles(book.abb_irb120(), rng)
    over = pose_of(book.abb_irb120(), q + np.pi * np.eye(6)[4]) @ turn(Z, 180)
    np.testing.assert_allclose(pose_of(book.abb_irb120("up"), q), over.astype(float), atol=1e-14)


def test_the_homes_of_the_iiwa_are_postures_of_one_arm(rng):
    upright, right = book.kuka_iiwa14(), np.pi / 2
    factor = np.array([1, 1, 1, 1, 1, -1, 1])
    check_same_arm(book.kuka_iiwa14("side_tool"), upright, factor, right * np.eye(7)[5], rng)
    check_same_arm(
        book.kuka_iiwa14("bent"),
        upright,
        factor,
        right * (np.eye(7)[5] - np.eye(7)[3]),
        rng,
        ground=turn(X, -90),
        tool=turn(Z, -90),
    )


def test_limits_are_chosen_by_their_source():
    default, other = book.abb_irb1600(), book.abb_irb1600("exercise 6.2.4")
    np.testing.assert_allclose(np.rad2deg(default.lower[1:3]), [-63, -235])
    np.testing.assert_allclose(np.rad2deg(other.lower[1:3]), [-90, -245])
    np.testing.assert_array_equal(default.screws, other.screws)
    with pytest.raises(ValueError, match=r"^limits: 'x' is not a source of abb_irb1600; known: ex"):
        book.abb_irb1600("x")
    assert np.all(np.isinf([book.rttr().lower, book.rttr().upper]))


# The report


def report_pose(theta):
    """Equations 1 to 4 of the report, in its signs."""
    one, two, three, four, five, six = np.rad2deg(theta)

    def shift(x, z):
        return rigid(np.eye(3), np.array([x, 0, z]))

    wrist = shift(0, 0.183) @ turn(Z, one) @ turn(Y, two) @ shift(0, 0.210) @ turn(Y, three)
    hand = turn(X, four) @ turn(Y, five) @ turn(X, six)
    return wrist @ shift(0.2215, 0.03) @ hand @ shift(0.0237, -0.0055)


def test_the_reports_niryo_one_is_its_chain_of_transforms(rng):
    robot = book.niryo_one_report()
    expected = rigid(np.eye(3), np.array([0.2452, 0, 0.4175])).astype(float)
    np.testing.assert_allclose(pose_of(robot, np.zeros(6)), expected, atol=1e-15)
    for theta in angles(robot, rng, 20):
        own = pose_of(robot, np.array([1, -1, -1, 1, -1, 1]) * theta)
        np.testing.assert_allclose(own, report_pose(theta).astype(float), atol=1e-15)


def test_the_reports_niryo_one_misses_the_robot_by_what_joint_6_turns(rng, niryo):
    robot = book.niryo_one_report()
    q = rng.uniform(-np.pi, np.pi, (50, 6))
    q[0], q[1, 5] = 0, np.pi
    ours, theirs = pose_of(niryo, q), pose_of(robot, q)
    np.testing.assert_allclose(theirs[:, :3, :3], ours[:, :3, :3], atol=1e-14)
    miss = np.linalg.norm(theirs[:, :3, 3] - ours[:, :3, 3], axis=-1)
    np.testing.assert_allclose(miss, 0.011 * np.abs(np.sin(q[:, 5] / 2)), atol=1e-15)
    np.testing.assert_array_equal(robot.lower, niryo.lower)


# The catalogue


def test_the_catalogue_loads_every_robot_under_its_name():
    names = catalogue.names()
    assert len(set(names)) == len(names) == 12
    for name in names:
        robot = catalogue.load(name)
        assert robot.name == name
        assert robot.joint_names == tuple(f"joint_{i + 1}" for i in range(robot.joints))
        assert robot.describe().startswith(f"{name}: {robot.joints} joints")
    assert set(niryo.MODELS) < set(names)
    np.testing.assert_array_equal(catalogue.load("abb_irb120_up").home, book.abb_irb120("up").home)


def test_what_is_not_known_is_refused_by_name():
    for name in ("puma", "", None):
        with pytest.raises(ValueError, match=r"^name: expected one of 'niryo_one', .*'rttr', got"):
            catalogue.load(name)
    for build, match in (
        (lambda: book.abb_irb120("left"), r"^tool: expected one of 'down', 'up', got 'left'"),
        (lambda: book.abb_irb120(up="x"), r"^up: expected one of 'y', 'z', got 'x'"),
        (lambda: book.abb_irb120(edition=2020), r"^edition: expected one of 2018, 2022, got 2020"),
        (lambda: book.abb_irb6620lx(edition=1), r"^edition: expected"),
        (lambda: book.abb_irb910sc(edition=None), r"^edition: expected"),
        (
            lambda: book.kuka_iiwa14("flat"),
            r"^home: expected one of 'upright', 'bent', 'side_tool'",
        ),
    ):
        with pytest.raises(ValueError, match=match):
            build()
