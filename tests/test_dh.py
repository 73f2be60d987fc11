"""Denavit-Hartenberg tables: elementary motions in extended precision, and tables in print."""

from __future__ import annotations

import json

import jax
import numpy as np
import pytest
from support import DATA, LD, expm, hat6, product_of_exponentials, random_poses, rate, rate_truth

import niryo_jax as nj
from niryo_jax.robots.dh import from_dh

EXACT = 1e-12
OMEGA_X, OMEGA_Z, ALONG_X, ALONG_Z = np.eye(6, dtype=LD)[[0, 2, 3, 5]]


def motion(twist: np.ndarray, amount: np.ndarray) -> np.ndarray:
    """The rotation or translation along one coordinate axis, in extended precision."""
    return expm(hat6(twist * LD(amount)))


def walk(table: np.ndarray, q: np.ndarray, prismatic: np.ndarray, convention: str) -> np.ndarray:
    """The motions of the rows one after the other, each of four elementary ones."""
    pose = np.eye(4, dtype=LD)
    for (a, alpha, d, theta), value, slides in zip(np.asarray(table, LD), q, prismatic):
        about_z = motion(OMEGA_Z, theta + (0 if slides else value))
        along_z = motion(ALONG_Z, d + (value if slides else 0))
        if convention == "standard":
            pose = pose @ about_z @ along_z @ motion(ALONG_X, a) @ motion(OMEGA_X, alpha)
        else:
            pose = pose @ motion(OMEGA_X, alpha) @ motion(ALONG_X, a) @ about_z @ along_z
    return pose


def random_table(rng: np.random.Generator, n: int) -> np.ndarray:
    table = rng.uniform(-1, 1, (n, 4))
    table[:, [1, 3]] *= np.pi
    # Right angles and zeros, as most tables have.
    return np.where(rng.random((n, 4)) < 0.4, np.array([0, np.pi / 2, 0, -np.pi / 2]), table)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_table_is_the_product_of_its_elementary_motions(rng, convention):
    for n in range(1, 9):
        table, prismatic = random_table(rng, n), rng.random(n) < 0.3
        base, tool = random_poses(rng, (2,)).astype(float)
        robot = from_dh(
            table, convention=convention, base=base, tool=tool, prismatic=list(prismatic)
        )
        for q in rng.uniform(-3, 3, (4, n)):
            truth = base @ walk(table, q, prismatic, convention) @ tool
            poses = product_of_exponentials(robot.screws, robot.home, q)
            np.testing.assert_allclose(poses, truth, rtol=0, atol=EXACT)


def test_the_conventions_differ_by_where_a_row_ends(rng):
    """Rz Tz (Tx Rx Rz Tz) ... (Tx Rx Rz Tz) Tx Rx: the same motions, cut in another place."""
    table = random_table(rng, 6)
    last = motion(ALONG_X, table[-1, 0]) @ motion(OMEGA_X, table[-1, 1])
    shifted = np.column_stack([np.vstack([[0, 0], table[:-1, :2]]), table[:, 2:]])
    standard = from_dh(table)
    modified = from_dh(shifted, convention="modified", tool=last.astype(float))
    np.testing.assert_allclose(modified.screws, standard.screws, rtol=0, atol=EXACT)
    np.testing.assert_allclose(modified.home, standard.home, rtol=0, atol=EXACT)


# --- tables in print: (d, theta, a, alpha) of Pardos-Gotor, degrees


IRB120 = [
    [0.29, 0, 0, -90],
    [0, -90, 0.27, 0],
    [0, 0, 0.07, -90],
    [0.302, 0, 0, 90],
    [0, -90, 0, 90],
    [0.16, 0, 0, 0],
]
RTTR = [[1, 0, 0, 0], [0, 90, 0, 90], [0, 0, 0, 0], [4, 0, 0, 0]]


def from_classic(table: list[list[float]], **options) -> nj.Robot:
    columns = np.array(table, float)[:, [2, 3, 0, 1]]
    columns[:, [1, 3]] = np.deg2rad(columns[:, [1, 3]])
    return from_dh(columns, **options)


def book(part: str, name: str) -> dict:
    entries = json.loads((DATA / "book_robots.json").read_text())[part]
    return next(entry for entry in entries if name in (entry.get("name"), entry.get("robot")))


def test_the_books_table_of_the_irb120_is_its_robot():
    truth = book("robots", "ABB IRB120 tool down, Z up (2022 book)")
    robot = from_classic(IRB120)
    for case in truth["fk"]:
        pose = nj.forward_kinematics(robot, np.array(case["theta"]))
        np.testing.assert_allclose(pose, case["pose"], rtol=0, atol=EXACT)
    # Right angles leave no rounding behind.
    lengths = [0.0, 1.0, 0.29, 0.56, 0.63, 0.302, 0.47]
    numbers = np.abs(np.concatenate([robot.screws.ravel(), robot.home.ravel()]))
    assert np.all(np.isclose(numbers[:, None], lengths, rtol=1e-15, atol=0).any(axis=1))


def test_the_books_table_of_the_rttr_arm_gives_the_printed_pose():
    truth = book("printed_examples", "4-DOF R-T-T-R exercise robot")
    robot = from_classic(RTTR, prismatic=[False, True, True, False])
    poses = product_of_exponentials(robot.screws, robot.home, np.array(truth["theta"], float))
    np.testing.assert_allclose(poses, truth["pose"], rtol=0, atol=EXACT)
    for case in book("robots", "4-DOF R-T-T-R exercise robot")["fk"]:
        poses = product_of_exponentials(robot.screws, robot.home, np.array(case["theta"], float))
        np.testing.assert_allclose(poses, case["pose"], rtol=0, atol=EXACT)


# --- labels, derivatives, mistakes


def test_labels_and_limits_are_passed_on():
    options = {"lower": [-1, -2], "upper": [1, 2], "joint_names": ["a", "b"], "name": "arm"}
    robot = from_dh(np.ones((2, 4)), **options)
    assert {key: getattr(robot, key) for key in ("name", "joint_names")} == {
        "name": "arm",
        "joint_names": ("a", "b"),
    }
    np.testing.assert_array_equal([robot.lower, robot.upper], [[-1, -2], [1, 2]])
    assert from_dh(np.ones((2, 4))).joint_names == ("joint_1", "joint_2")


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_traced_table_can_be_calibrated(rng, convention):
    """The rate of the pose along a change of the table, at tables with right angles too."""
    table, q, change = random_table(rng, 3), rng.uniform(-2, 2, 3), rng.standard_normal((3, 4))
    prismatic = np.array([False, True, False])

    def pose(table):
        robot = from_dh(table, convention=convention, prismatic=list(prismatic))
        return nj.forward_kinematics(robot, q)

    truth = rate_truth(lambda table: walk(table, q, prismatic, convention), table, change)
    np.testing.assert_allclose(rate(pose, table, change), truth, rtol=0, atol=1e-10)


def test_a_traced_table_keeps_its_dtype():
    robot = jax.eval_shape(from_dh, jax.ShapeDtypeStruct((2, 4), np.float32))
    assert (robot.screws.dtype, robot.home.dtype) == (np.float32, np.float32)


@pytest.mark.parametrize(
    ("table", "options", "message"),
    [
        (np.ones((2, 3)), {}, r"table: expected shape \(n, 4\) with n >= 1, got \(2, 3\)"),
        (np.ones(4), {}, r"table: expected shape \(n, 4\)"),
        (np.ones((0, 4)), {}, r"table: expected shape \(n, 4\)"),
        ([[0, 0, np.nan, 0]], {}, "table: expected finite numbers"),
        (np.ones((1, 4)), {"convention": "craig"}, "convention: expected one of 'standard', "),
        (np.ones((1, 4)), {"base": np.eye(3)}, r"base: expected shape \(4, 4\), got \(3, 3\)"),
        (np.ones((1, 4)), {"base": 2 * np.eye(4)}, "base: expected a rigid motion"),
        (np.ones((1, 4)), {"tool": np.diag([1, 1, -1, 1])}, "tool: expected a rigid motion"),
        (np.ones((2, 4)), {"prismatic": [True]}, "prismatic: expected 2 flags"),
        (np.ones((2, 4)), {"lower": [0]}, r"lower: expected shape \(2,\)"),
        (np.ones((2, 4)), {"joint_names": ["a"]}, "joint_names: expected 2 names"),
    ],
)
def test_mistakes_are_named(table, options, message):
    with pytest.raises(ValueError, match=message):
        from_dh(table, **options)
