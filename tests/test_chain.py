"""Laws of robots and of forward kinematics: the product of exponentials, whatever builds it."""

from __future__ import annotations

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import (
    BATCHES,
    DTYPES,
    LD,
    Urdf,
    eps,
    expm,
    hat6,
    modern_robotics,
    product_of_exponentials,
    random_poses,
    random_robot,
    random_screws,
    rate_truth,
    unit_vectors,
)

import niryo_jax as nj

NIRYO_ARMS = ("niryo_one", "niryo_ned", "niryo_ned2")
KINDS = {
    "one revolute": (1, {}),
    "revolute": (6, {}),
    "prismatic": (3, {"prismatic": (0, 1, 2)}),
    "helical": (2, {"helical": (0, 1)}),
    "mixed": (7, {"prismatic": (1, 4), "helical": (3, 6)}),
}
every_kind = pytest.mark.parametrize("kind", KINDS)
fk = nj.forward_kinematics


def robot_of(rng, kind) -> nj.Robot:
    n, joints = KINDS[kind]
    return random_robot(rng, n, **joints)


def truth_of(robot, q):
    return product_of_exponentials(robot.screws, robot.home, q).astype(float)


def unit_screws(columns):
    """Rows of unit screws and their magnitudes, from columns of any magnitude."""
    rows = columns.T
    angular, linear = np.linalg.norm(rows[:, :3], axis=1), np.linalg.norm(rows[:, 3:], axis=1)
    magnitude = np.where(angular > 0, angular, linear)
    return rows / magnitude[:, None], magnitude


# Forward kinematics


@every_kind
def test_forward_kinematics_is_the_product_of_exponentials(rng, kind):
    robot = robot_of(rng, kind)
    q = rng.uniform(-np.pi, np.pi, (200, robot.joints))
    pose, truth = fk(robot, q), truth_of(robot, q)
    np.testing.assert_allclose(
        pose, truth, atol=5 * robot.joints * eps(float) * np.abs(truth).max()
    )
    single = fk(robot, q.astype(np.float32))
    assert single.dtype == np.float32
    bound = 5 * robot.joints * eps(np.float32) * np.abs(truth).max()
    np.testing.assert_allclose(single, truth_of(robot, q.astype(np.float32)), atol=bound)


@pytest.mark.parametrize("name", NIRYO_ARMS)
def test_niryo_arms_equal_the_robot_description(rng, name):
    robot, urdf = getattr(nj.robots, name)(), Urdf(name)
    q = rng.uniform(-np.pi, np.pi, (300, 6))
    np.testing.assert_allclose(fk(robot, q), urdf.pose(q).astype(float), atol=1e-14)
    np.testing.assert_allclose([robot.lower, robot.upper], urdf.limits, atol=1e-14)
    assert robot.joint_names == tuple(joint.get("name") for joint in urdf.moving)
    assert robot.name == name


def test_limits_of_the_niryo_one_by_source():
    robot = nj.robots.niryo_one(limits="niryo_one_ros")
    np.testing.assert_allclose(
        np.rad2deg([robot.lower, robot.upper]),
        [[-175, -110, -80.07, -175, -100, -147.5], [175, 36.68, 90, 175, 110, 147.5]],
    )
    with pytest.raises(ValueError, match=r"limits: 'vendor' .*ned_ros, niryo_one_ros"):
        nj.robots.niryo_one(limits="vendor")


@pytest.mark.parametrize("name", ["FKinSpace", "FKinBody"])
def test_modern_robotics_vectors(name):
    build = nj.Robot.from_screws if name == "FKinSpace" else nj.Robot.from_body_screws
    for (home, screws, q), pose in modern_robotics(name):
        rows, magnitude = unit_screws(screws)
        np.testing.assert_allclose(fk(build(rows, home), magnitude * q), pose, atol=2e-14)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_and_dtype_follow_the_joint_vector(niryo, batch, dtype):
    q = jax.ShapeDtypeStruct((*batch, 6), dtype)
    pose = jax.eval_shape(lambda q: fk(niryo, q), q)
    assert (pose.shape, pose.dtype) == ((*batch, 4, 4), dtype)
    poses = jax.eval_shape(lambda q: nj.link_poses(niryo, q), q)
    assert (poses.shape, poses.dtype) == ((*batch, 6, 4, 4), dtype)


def test_a_batch_is_its_elements_and_may_be_empty(rng, niryo):
    q = rng.uniform(-np.pi, np.pi, (3, 2, 6))
    whole = fk(niryo, q)
    np.testing.assert_allclose(whole[2, 1], fk(niryo, q[2, 1]), atol=1e-15)
    np.testing.assert_allclose(jax.vmap(lambda q: fk(niryo, q))(q), whole, atol=1e-15)
    assert fk(niryo, q[:0]).shape == (0, 2, 4, 4)


def test_single_precision_joints_are_computed_in_single_precision(niryo):
    traced = jax.jit(lambda robot, q: fk(robot, q))
    for call in (lambda q: fk(niryo, q), lambda q: traced(niryo, q)):
        program = str(jax.make_jaxpr(lambda: call(np.zeros((5, 6), np.float32)))())  # noqa: B023
        assert "f32[5" in program
        assert not re.findall(r"f64\[5.*\] = .*", program)


def test_what_is_not_a_number_is_not_hidden(niryo):
    q = np.zeros(6)
    q[2] = np.nan
    assert not np.all(np.isfinite(fk(niryo, q)))


def test_wrong_arguments_are_refused_by_name(niryo):
    for wrong in ((), (5,), (6, 1), (3, 7)):
        with pytest.raises(ValueError, match=r"^q: expected shape \(\.\.\., 6\), got"):
            fk(niryo, np.zeros(wrong))
    with pytest.raises(TypeError, match=r"^q: expected real numbers"):
        fk(niryo, np.zeros(6, complex))
    with pytest.raises(TypeError, match=r"^robot: expected"):
        fk(np.zeros((6, 6)), np.zeros(6))
    with pytest.raises(ValueError, match=r"^homes: expected shape"):
        nj.link_poses(niryo, np.zeros(6), np.zeros((6, 3, 4)))


# Links and tools


def test_link_poses_are_the_partial_products(rng):
    robot = random_robot(rng, 4, prismatic=(2,), helical=(1,))
    q = rng.uniform(-np.pi, np.pi, (50, 4))
    homes = random_poses(rng, (4,)).astype(float)
    moved, placed = nj.link_poses(robot, q), nj.link_poses(robot, q, homes)
    for i in range(4):
        partial = product_of_exponentials(robot.screws[: i + 1], np.eye(4), q[:, : i + 1])
        np.testing.assert_allclose(moved[:, i], partial.astype(float), atol=3e-14)
        np.testing.assert_allclose(placed[:, i], (partial @ homes[i]).astype(float), atol=3e-14)
    np.testing.assert_allclose(moved[:, -1] @ robot.home, fk(robot, q), atol=1e-14)


def test_a_tool_multiplies_from_the_right(rng, niryo):
    tool = random_poses(rng).astype(float)
    q = rng.uniform(-np.pi, np.pi, (50, 6))
    armed = niryo.with_tool(tool)
    np.testing.assert_allclose(fk(armed, q), np.asarray(fk(niryo, q)) @ tool, atol=1e-14)
    np.testing.assert_array_equal(armed.screws, niryo.screws)
    assert armed.joint_names == niryo.joint_names
    # The screws in the tool frame move with it: body_screws follows the tool.
    back = nj.Robot.from_body_screws(armed.body_screws, armed.home)
    np.testing.assert_allclose(back.screws, niryo.screws, atol=1e-15)


def test_a_batch_of_tools_gives_a_batch_of_poses(rng, niryo):
    tools = random_poses(rng, (5,)).astype(float)
    q = rng.uniform(-np.pi, np.pi, (5, 6))
    poses = fk(niryo.with_tool(tools), q)
    np.testing.assert_allclose(poses, np.asarray(fk(niryo, q)) @ tools, atol=1e-14)


# Ways to build a robot


def test_body_screws_give_the_product_of_exponentials_on_the_right(rng):
    screws, home = random_screws(rng, 4, prismatic=(0,), helical=(2,)), random_poses(rng)
    robot = nj.Robot.from_body_screws(screws, home.astype(float))
    q = rng.uniform(-np.pi, np.pi, (50, 4))
    truth = home
    for i in range(4):
        truth = truth @ expm(hat6(screws[i] * q[:, i, None]))
    np.testing.assert_allclose(fk(robot, q), truth.astype(float), atol=3e-14)
    np.testing.assert_allclose(robot.body_screws, screws, atol=1e-15)


def test_axes_and_points_give_turns_about_lines_and_slides_along_them(rng):
    axes, points = unit_vectors(rng, (3,)).astype(float), rng.uniform(-1, 1, (3, 3))
    lengths = np.array([[0.5], [3.0], [1.0]])
    robot = nj.Robot.from_axes(lengths * axes, points, np.eye(4), prismatic=[False, True, False])
    np.testing.assert_allclose(np.linalg.norm(robot.screws[[0, 2], :3], axis=1), 1, atol=1e-15)
    # One joint at a time: a turn leaves the points of its axis, a slide moves all by its amount.
    pose = np.asarray(fk(robot, 0.7 * np.eye(3)))
    homogeneous = np.concatenate([points, np.ones((3, 1))], axis=1)
    moved = np.einsum("nij,nj->ni", pose, homogeneous)[:, :3]
    np.testing.assert_allclose(moved[[0, 2]], points[[0, 2]], atol=1e-15)
    np.testing.assert_allclose(moved[1], points[1] + 0.7 * axes[1], atol=1e-15)
    np.testing.assert_allclose(np.trace(pose, axis1=1, axis2=2) - 2, [*(2 * np.cos([0.7, 0, 0.7]))])
    shifted = nj.Robot.from_axes(axes, points + axes, np.eye(4), prismatic=[False, True, False])
    np.testing.assert_allclose(shifted.screws, robot.screws, atol=1e-15)


def test_a_robot_is_a_pytree_of_four_arrays_with_static_labels(niryo):
    leaves, structure = jax.tree.flatten(niryo)
    assert [np.shape(leaf) for leaf in leaves] == [(6, 6), (4, 4), (6,), (6,)]
    again = jax.tree.unflatten(structure, leaves)
    assert (again.joint_names, again.name) == (niryo.joint_names, niryo.name)
    assert niryo.joints == 6


def test_defaults_are_no_limits_and_numbered_joints(rng):
    robot = random_robot(rng, 3)
    np.testing.assert_array_equal([robot.lower, robot.upper], [[-np.inf] * 3, [np.inf] * 3])
    assert robot.joint_names == ("joint_1", "joint_2", "joint_3")


def test_a_robot_keeps_its_own_numbers_in_double_precision(rng):
    screws, home = random_screws(rng, 2), np.eye(4)
    robot = nj.Robot.from_screws(screws, home)
    before = screws.copy()
    screws[:] = 0
    np.testing.assert_array_equal(robot.screws, before)
    assert robot.screws.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        robot.screws[0, 0] = 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.home = home


GOOD = [[0, 0, 1, 0, 0, 0], [0, 1, 0, 0, 0, 1], [0, 0, 0, 1, 0, 0]]
REFLECTION = np.diag([1.0, 1, -1, 1])
SCALED = np.diag([1.01, 1.01, 1.01, 1])
NOT_A_ROW = np.vstack([np.eye(4)[:3], [0, 0, 0.1, 1]])
INFINITE = np.eye(4) + np.diag([0, np.nan, 0, 0])
WRONG_ROBOTS = [
    ("screws", {"screws": np.zeros((3, 5))}),
    ("screws", {"screws": np.zeros(6)}),
    ("screws", {"screws": np.zeros((0, 6))}),
    ("screws", {"screws": np.zeros((3, 6))}),
    ("screws", {"screws": 2.0 * np.array(GOOD)}),
    ("screws", {"screws": [[0, 0, 1e-3, 1, 0, 0]] * 3}),
    ("screws", {"screws": [[0, 0, np.nan, 1, 0, 0]] * 3}),
    ("screws", {"screws": [[0, 0, 1, np.inf, 0, 0]] * 3}),
    ("home", {"home": np.eye(3)}),
    *[("home", {"home": home}) for home in (REFLECTION, SCALED, NOT_A_ROW, INFINITE)],
    ("lower", {"lower": [0, 0]}),
    ("upper", {"upper": [1, 1, 1, 1]}),
    ("lower", {"lower": [0, 0, 1], "upper": [1, 1, 0]}),
    ("lower", {"lower": [0, 0, np.nan]}),
    ("upper", {"upper": [np.nan, 0, 0]}),
    ("joint_names", {"joint_names": ["a", "b"]}),
]


@pytest.mark.parametrize(("name", "change"), WRONG_ROBOTS)
def test_wrong_robots_are_refused_by_the_argument(name, change):
    arguments = {"screws": GOOD, "home": np.eye(4)} | change
    for build in (nj.Robot.from_screws, nj.Robot.from_body_screws):
        with pytest.raises(ValueError, match=rf"\b{name}\b"):
            build(**arguments)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("axes", {"axes": np.eye(4)}),
        ("axes", {"axes": [1.0, 0, 0]}),
        ("axes", {"axes": np.diag([1.0, 1, 0])}),
        ("axes", {"axes": np.diag([1.0, 1, np.nan])}),
        ("axes", {"axes": np.diag([1.0, 1, np.inf])}),
        ("points", {"points": np.zeros((2, 3))}),
        ("points", {"points": np.full((3, 3), np.nan)}),
        ("prismatic", {"prismatic": [True]}),
        ("home", {"home": REFLECTION}),
    ],
)
def test_wrong_axes_are_refused_by_the_argument(name, change):
    arguments = {"axes": np.eye(3), "points": np.zeros((3, 3)), "home": np.eye(4)} | change
    with pytest.raises(ValueError, match=rf"^{name}\b"):
        nj.Robot.from_axes(**arguments)


@pytest.mark.parametrize("tool", [np.eye(3), REFLECTION, SCALED, NOT_A_ROW, INFINITE])
def test_wrong_tools_are_refused(niryo, tool):
    with pytest.raises(ValueError, match=r"^tool: expected"):
        niryo.with_tool(tool)


# Traced, batched and differentiated robots


@pytest.mark.parametrize("kind", ["revolute", "mixed"])
def test_a_robot_as_an_argument_of_jit_gives_what_the_concrete_one_gives(rng, kind):
    robot = robot_of(rng, kind)
    q = rng.uniform(-np.pi, np.pi, (50, robot.joints))
    concrete = fk(robot, q)
    np.testing.assert_allclose(jax.jit(fk)(robot, q), concrete, atol=1e-13)
    np.testing.assert_allclose(jax.jit(lambda q: fk(robot, q))(q), concrete, atol=1e-14)
    constant = jax.jit(lambda factor: factor * fk(robot, np.asarray(q)))
    np.testing.assert_allclose(constant(1.0), concrete, atol=1e-14)


def test_a_batch_of_robots_by_vmap_by_replace_and_by_its_arrays(rng):
    robots = [random_robot(rng, 3, prismatic=(1,)) for _ in range(5)]
    q = rng.uniform(-np.pi, np.pi, (5, 3))
    truth = np.stack([truth_of(robot, x) for robot, x in zip(robots, q)])
    batch = jax.tree.map(
        lambda *leaves: np.stack(leaves),
        *(dataclasses.replace(robot, name="same") for robot in robots),
    )
    np.testing.assert_allclose(jax.vmap(fk)(batch, q), truth, atol=1e-14)
    np.testing.assert_allclose(fk(batch, q), truth, atol=1e-14)

    def replaced(screws, home, q):
        return fk(dataclasses.replace(robots[0], screws=screws, home=home), q)

    found = jax.jit(jax.vmap(replaced))(batch.screws, batch.home, q)
    np.testing.assert_allclose(found, truth, atol=1e-14)


@pytest.mark.parametrize("arm", ["mixed", "niryo"])
def test_derivative_by_every_screw_entry_equals_finite_differences(rng, niryo, arm):
    robot = random_robot(rng, 3, prismatic=(1,), helical=(2,))
    if arm == "niryo":  # its first joints: most entries are zero
        robot = nj.Robot.from_screws(niryo.screws[:3], niryo.home)
    n = robot.joints
    q = rng.uniform(-2, 2, n)
    directions = np.eye(6 * n).reshape(6 * n, n, 6)
    weights = rng.standard_normal((4, 4))

    def total(screws):
        return jnp.sum(weights * fk(dataclasses.replace(robot, screws=screws), q))

    truth = rate_truth(
        lambda screws: product_of_exponentials(screws, robot.home, q),
        np.broadcast_to(robot.screws, directions.shape),
        directions,
    )
    truth = np.sum(weights * truth, axis=(1, 2)).astype(float)
    reverse = jax.jit(jax.grad(total))(robot.screws)
    np.testing.assert_allclose(reverse.ravel(), truth, atol=1e-9)
    if arm == "mixed":
        forward = jax.jit(jax.jacfwd(total))(robot.screws)
        np.testing.assert_allclose(forward, reverse, atol=1e-13)


def test_derivative_by_the_home_pose_is_the_motion(rng, niryo):
    q = rng.uniform(-2, 2, 6)
    change = rng.standard_normal((4, 4)) * [[1], [1], [1], [0]]
    _, found = jax.jvp(
        lambda home: fk(dataclasses.replace(niryo, home=home), q), (niryo.home,), (change,)
    )
    motion = product_of_exponentials(niryo.screws, np.eye(4), q)
    np.testing.assert_allclose(found, (motion @ change.astype(LD)).astype(float), atol=1e-14)


def test_robots_with_zeros_in_the_same_places_share_one_program(niryo, caplog):
    q = np.zeros((11, 6))  # a shape of its own, so that no other test has compiled it

    def programs(robot):
        caplog.clear()
        with jax.log_compiles():
            pose = fk(robot, q)
        np.testing.assert_allclose(pose[3], robot.home, atol=1e-15)
        return sum("Compiling" in record.getMessage() for record in caplog.records)

    def stretched(lengths):
        shoulder, elbow, wrist, hand = lengths
        axes = [[0, 0, 1], [0, -1, 0], [0, -1, 0], [1, 0, 0], [0, -1, 0], [1, 0, 0]]
        points = [[0, 0, 0], [0, 0, shoulder], [0, 0, elbow], [0, 0, wrist]]
        points += [[hand - 0.02, 0, wrist], [0, 0, wrist - 0.01]]
        home = np.eye(4)
        home[:3, 3] = [hand, 0, wrist - 0.01]
        return nj.Robot.from_axes(axes, points, home)

    assert programs(stretched([0.2, 0.4, 0.45, 0.3])) > 0
    assert programs(stretched([0.3, 0.7, 0.77, 0.5])) == 0
    assert programs(nj.Robot.from_axes(np.eye(3)[[0, 1, 2] * 2], np.eye(3)[[1] * 6], np.eye(4))) > 0


@pytest.mark.parametrize("q", ["abc", None, [0.0, "a"]])
def test_what_is_no_array_of_numbers_is_named(niryo, q):
    with pytest.raises(TypeError, match="q: expected an array of numbers"):
        nj.forward_kinematics(niryo, q)


def test_a_list_is_an_array(niryo):
    np.testing.assert_array_equal(nj.forward_kinematics(niryo, [0, 0, 0, 0, 0, 0]), niryo.home)
