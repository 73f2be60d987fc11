"""Grids of voxels, sets of orientations, and the box that an arm reaches."""

from __future__ import annotations

import dataclasses
import itertools

import jax
import numpy as np
import pytest
from arms import arm, forward
from hypothesis import given as for_all
from hypothesis import strategies as st
from support import random_robot, random_rotations

import niryo_jax as nj
from niryo_jax.workspace.extent import box, extent, joint_ranges
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.orientations import (
    KINDS,
    given,
    orientations,
    quaternions_of,
    rotations_of,
)

METRES = st.floats(-3.0, 3.0)
VOXELS = st.floats(1e-3, 0.5)


# Grids


@for_all(st.tuples(METRES, METRES, METRES), st.tuples(*[st.floats(1e-3, 2.0)] * 3), VOXELS)
def test_covering_is_the_least_grid_that_holds_the_box(lower, sides, voxel):
    lower = np.array(lower)
    upper = lower + np.array(sides)
    grid = Grid.covering(lower, upper, voxel)
    slack = 2e-9 * voxel + 1e-12
    assert np.all(grid.lower <= lower + slack)
    assert np.all(grid.upper >= upper - slack)
    assert np.all(grid.lower > lower - voxel - slack)
    assert np.all(grid.upper < upper + voxel + slack)
    for centres, low, high, count in zip(grid.centres, grid.lower, grid.upper, grid.shape):
        assert len(centres) == count
        np.testing.assert_allclose(centres[0], low + voxel / 2, atol=1e-12)
        np.testing.assert_allclose(centres[-1], high - voxel / 2, atol=1e-12)


@for_all(VOXELS, st.lists(METRES, min_size=6, max_size=6))
def test_grids_of_one_voxel_line_up_bit_for_bit(voxel, corners):
    corners = np.reshape(corners, (2, 3))
    grids = [Grid.covering(corner, corner + 1.0, voxel) for corner in corners]
    for axis in range(3):
        first, second = (grid.first[axis] for grid in grids)
        a, b = (grid.centres[axis] for grid in grids)
        shared = range(max(first, second), min(first + len(a), second + len(b)))
        for index in shared:
            assert a[index - first] == b[index - second]


def test_a_box_of_whole_voxels_is_covered_by_as_many():
    grid = Grid.covering((-0.475, -0.475, -0.15), (0.475, 0.475, 0.65), 0.025)
    assert grid == Grid(0.025, (-19, -19, -6), (38, 38, 32))
    assert grid.size == 38 * 38 * 32
    assert set(grid.coordinates) == {"x", "y", "z"}


@pytest.mark.parametrize("voxel", [0.0, -0.1, np.nan, np.inf])
def test_a_voxel_must_be_a_length(voxel):
    with pytest.raises(ValueError, match="voxel"):
        Grid.covering((0, 0, 0), (1, 1, 1), voxel)
    with pytest.raises(ValueError, match="voxel"):
        Grid(voxel, (0, 0, 0), (1, 1, 1))


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        ((0, 0), (1, 1), "shape"),
        ((0, 0, 0), (1, 1, np.inf), "finite"),
        ((0, 0, np.nan), (1, 1, 1), "finite"),
        ((0, 1, 0), (1, 1, 1), "empty"),
        ((0, 2, 0), (1, 1, 1), "empty"),
    ],
)
def test_bounds_must_be_a_box(niryo, lower, upper, words):
    with pytest.raises(ValueError, match=words):
        Grid.covering(lower, upper, 0.1)
    with pytest.raises(ValueError, match=words):
        box(niryo, (lower, upper), 0.1)


def test_a_grid_needs_a_voxel():
    with pytest.raises(ValueError, match="shape"):
        Grid(0.1, (0, 0, 0), (1, 0, 1))
    with pytest.raises(ValueError, match="first"):
        Grid(0.1, (0, 0), (1, 1, 1))  # pyright: ignore[reportArgumentType]


# Orientations


def angles(a, b):
    """(M, N) angles between two sets of rotations, radians."""
    cosine = np.abs(quaternions_of(a) @ quaternions_of(b).T)
    return 2 * np.arccos(np.minimum(cosine, 1.0))


def covering_angle(rotations, rng):
    """How far a rotation can be from the nearest of the set."""
    anywhere = random_rotations(rng, (4000,)).astype(float)
    return angles(anywhere, rotations).min(axis=1).max()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0, 5])
@pytest.mark.parametrize("number", [1, 24, 600])
def test_all_are_rotations_and_reproducible(kind, seed, number):
    rolls = 6 if kind == "directions" and number > 1 else 1
    made = orientations(number, kind, seed=seed, rolls=rolls, axis=(1, -2, 0.5))
    r = made.rotations
    assert r.shape == (number, 3, 3)
    assert len(made) == number
    assert (made.kind, made.seed, made.rolls) == (kind, seed, rolls)
    np.testing.assert_allclose(
        r @ np.swapaxes(r, 1, 2), np.broadcast_to(np.eye(3), r.shape), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(r), 1.0, atol=1e-14)
    again = orientations(number, kind, seed=seed, rolls=rolls, axis=(1, -2, 0.5))
    np.testing.assert_array_equal(r, again.rotations)
    quaternions = made.quaternions
    assert quaternions.shape == (number, 4)
    assert np.all(quaternions[:, 0] >= 0)
    np.testing.assert_allclose(rotations_of(quaternions), r, atol=1e-14)


def test_super_fibonacci_is_more_even_than_chance(rng):
    number = 2000
    spiral = orientations(number).rotations
    chance = orientations(number, "random").rotations
    assert covering_angle(spiral, rng) < 0.75 * covering_angle(chance, rng)
    apart = angles(spiral, spiral) + 2 * np.pi * np.eye(number)
    # So many caps of SO(3) cannot be farther apart than a few times this.
    ideal = (6 * np.pi / number) ** (1 / 3)
    assert apart.min() > 0.9 * ideal


def test_a_seed_turns_the_whole_set():
    plain, turned = (orientations(50, seed=seed).rotations for seed in (0, 9))
    turn = turned[0] @ plain[0].T
    assert angles(turn[None], np.eye(3)[None])[0, 0] > 0.1
    np.testing.assert_allclose(turned, turn @ plain, atol=1e-14)
    other = orientations(50, seed=10).rotations
    assert np.abs(other - turned).max() > 0.1


def test_random_orientations_are_uniform():
    r = orientations(20000, "random", seed=3).rotations
    # Of a uniform rotation every entry has mean 0 and mean square 1/3.
    np.testing.assert_allclose(r.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose((r**2).mean(axis=0), 1 / 3, atol=0.02)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, -2.0), (1.0, 2.0, 3.0)])
def test_directions_share_the_approach_among_rolls(axis):
    directions, rolls = 40, 5
    made = orientations(directions * rolls, "directions", rolls=rolls, axis=axis)
    assert made.axis == pytest.approx(tuple(np.array(axis) / np.linalg.norm(axis)))
    approach = (made.rotations @ np.array(made.axis)).reshape(directions, rolls, 3)
    assert np.ptp(approach, axis=1).max() < 1e-14
    towards = approach[:, 0]
    apart = np.arccos(np.clip(towards @ towards.T, -1, 1)) + 9 * np.eye(directions)
    assert apart.min() > 0.7 * np.sqrt(4 * np.pi / directions)
    np.testing.assert_allclose(towards.mean(axis=0), 0.0, atol=0.05)
    for group in made.rotations.reshape(directions, rolls, 3, 3):
        between = angles(group, group)
        np.testing.assert_allclose(between[0, 1], 2 * np.pi / rolls, atol=1e-7)


def test_orientations_of_ones_own(rng):
    r = random_rotations(rng, (7,)).astype(float)
    made = given(r)
    assert made.kind == "given"
    np.testing.assert_array_equal(made.rotations, r)
    assert len(given(r[0])) == 1
    for wrong in (np.zeros((3, 3)), -r, 2 * r, np.full((3, 3), np.nan), r[:, :2], r[:0], np.eye(2)):
        with pytest.raises(ValueError, match="rotations"):
            given(wrong)


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ((0,), {}, "number"),
        ((10, "sobol"), {}, "'super-fibonacci', 'directions', 'random'"),
        ((10, "directions"), {"rolls": 3}, "rolls"),
        ((10, "directions"), {"rolls": 0}, "rolls"),
        ((10, "random"), {"rolls": 2}, "rolls"),
        ((10,), {"rolls": 2}, "rolls"),
        ((10,), {"seed": -1}, "seed"),
        ((10, "directions"), {"axis": (0, 0, 0)}, "axis"),
        ((10, "directions"), {"axis": (1, 0)}, "axis"),
        ((10, "directions"), {"axis": (np.nan, 0, 1)}, "axis"),
    ],
)
def test_bad_orientations_are_refused(arguments, options, words):
    with pytest.raises(ValueError, match=words):
        orientations(*arguments, **options)


# The extent of an arm


def limited(robot, rng):
    """The arm with limits of its own for each joint."""
    ends = np.sort(rng.uniform(-2.5, 2.5, (2, robot.joints)), axis=0)
    return dataclasses.replace(robot, lower=ends[0], upper=ends[1])


def positions(robot, q):
    """(..., 3) positions of the tool, in numpy."""
    poses = [forward(robot, part)[0][:, :3, 3] for part in np.array_split(q, -(-len(q) // 20000))]
    return np.concatenate(poses)


def farthest(robot, direction, rng):
    """The farthest that a random search gets along a direction, joint limits kept."""
    low, high = joint_ranges(robot)
    q = rng.uniform(low, high, (20000, robot.joints))
    best = q[np.argsort(positions(robot, q) @ direction)[-60:]]
    scale = 0.3 * (high - low)
    for _ in range(45):
        around = best[:, None] + scale * rng.standard_normal((len(best), 20, robot.joints))
        tried = np.concatenate([best[:, None], np.clip(around, low, high)], axis=1)
        along = positions(robot, tried.reshape(-1, robot.joints)) @ direction
        along = along.reshape(tried.shape[:2])
        best = np.take_along_axis(tried, along.argmax(axis=1)[:, None, None], axis=1)[:, 0]
        scale = 0.7 * scale
        best = best[np.argsort(along.max(axis=1))[-max(8, len(best) * 9 // 10) :]]
    return along.max()


ARMS = (
    "gantry",
    "SCARA",
    "shoulder in general position",
    "three parallel axes",
    "two slides first",
)


def arms(rng):
    yield nj.robots.niryo_one()
    yield nj.robots.abb_irb910sc()
    yield nj.robots.kuka_iiwa14()
    for name in ARMS:
        yield limited(arm(name, rng), rng)
    for joints in (1, 2, 7):
        yield limited(random_robot(rng, joints), rng)


def test_no_position_is_outside_of_the_extent(rng):
    for robot in arms(rng):
        low, high = extent(robot)
        q = rng.uniform(*joint_ranges(robot), (15_000, robot.joints))
        q[: 2**robot.joints] = np.array(list(itertools.product(*zip(*joint_ranges(robot)))))
        reached = positions(robot, q)
        assert np.all(reached <= high + 1e-9), robot.name
        assert np.all(reached >= low - 1e-9), robot.name


def test_every_face_of_the_extent_is_touched(rng):
    for robot in (
        nj.robots.niryo_one(),
        limited(arm("gantry", rng), rng),
        limited(random_robot(rng, 3), rng),
    ):
        low, high = extent(robot)
        for axis in range(3):
            for sign, face in ((1.0, high), (-1.0, -low)):
                found = farthest(robot, sign * np.eye(3)[axis], rng)
                assert found <= face[axis] + 1e-9
                assert face[axis] - found < 1e-4, (robot.name, axis, sign)


def test_helical_joints(rng):
    for pitch in (0.02, -0.4):
        screws = np.array([[0, 0, 1, 0, 0, pitch], [1, 0, 0, pitch / 3, 0.2, 0]])
        home = np.eye(4)
        home[:3, 3] = 0.5, 0.1, 0.3
        robot = nj.Robot.from_screws(screws, home, lower=[-9.0, -7.0], upper=[4.0, 5.0])
        low, high = extent(robot)
        side = np.linspace(-9, 4, 1301), np.linspace(-7, 5, 1201)
        q = np.stack(np.meshgrid(*side), axis=-1).reshape(-1, 2)
        reached = np.asarray(nj.forward_kinematics(robot, q))[:, :3, 3]
        assert np.all(reached <= high + 1e-9)
        assert np.all(reached >= low - 1e-9)
        np.testing.assert_allclose(reached.max(axis=0), high, atol=1e-4)
        np.testing.assert_allclose(reached.min(axis=0), low, atol=1e-4)


def two_links(**limits):
    home = np.eye(4)
    home[0, 3] = 0.5
    return nj.Robot.from_axes([[0, 0, 1]] * 2, [[0, 0, 0], [0.3, 0, 0]], home, **limits)


def test_an_extent_in_closed_form():
    low, high = extent(two_links())
    np.testing.assert_allclose(high, [0.5, 0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(low, [-0.5, -0.5, 0.0], atol=1e-12)
    wide = two_links(lower=[-20.0, -3.0], upper=[20.0, np.inf])
    np.testing.assert_allclose(extent(wide), extent(two_links()), atol=1e-12)
    bent = two_links(lower=[0.0, np.pi / 2], upper=[0.0, np.pi / 2])
    np.testing.assert_allclose(extent(bent), [[0.3, 0.2, 0.0]] * 2, atol=1e-12)


def test_an_arm_that_moves_in_a_plane_gets_one_layer():
    grid = box(two_links(), None, 0.1)
    assert grid == Grid(0.1, (-5, -5, 0), (10, 10, 1))


def test_box(niryo):
    low, high = extent(niryo)
    assert box(niryo, None, 0.05) == Grid.covering(low, high, 0.05)
    assert box(niryo, ((0, 0, 0), (0.2, 0.2, 0.2)), 0.1).shape == (2, 2, 2)
    with pytest.raises(ValueError, match="larger than what the arm can reach"):
        box(niryo, None, 2.0)
    with pytest.raises(ValueError, match="larger than the bounds"):
        box(niryo, ((0, 0, 0), (0.2, 0.1, 0.2)), 0.3)
    with pytest.raises(ValueError, match="two corners"):
        box(niryo, ((0, 0, 0),), 0.3)  # pyright: ignore[reportArgumentType]


def test_a_workspace_without_end_is_refused(rng):
    slide = arm("slide first", rng)
    with pytest.raises(ValueError, match=r"prismatic.*bounds"):
        extent(slide)
    assert box(slide, ((0, 0, 0), (1, 1, 1)), 0.1).size == 1000
    with pytest.raises(ValueError, match="lower: expected numbers"):
        dataclasses.replace(slide, lower=np.full(4, np.nan))
    # What is made as a tree is not looked at.
    leaves, tree = jax.tree.flatten(slide)
    broken = jax.tree.unflatten(tree, [*leaves[:2], np.full(4, np.nan), leaves[3]])
    with pytest.raises(ValueError, match=r"limits.*lower"):
        extent(broken)


@pytest.mark.parametrize("voxel", [1e-9, 1e-320])
def test_more_voxels_than_any_store_holds_are_refused(voxel):
    with pytest.raises(ValueError, match=r"voxel: .* too small"):
        Grid.covering(np.zeros(3), np.ones(3), voxel)
