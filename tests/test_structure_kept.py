"""What a program takes an arm for: never a false proof, whatever the geometry is made of."""

from __future__ import annotations

import copy
import dataclasses
import functools
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax.ik.complete import driver
from niryo_jax.structure.classify import structure_of
from niryo_jax.structure.conditions import is_offset_wrist, plan_fits

NAMES = "niryo_one", "abb_irb1600", "ur16e", "abb_irb910sc", "rttr"
TOOL = np.array([[0, 0, 1, 0.02], [0.6, 0.8, 0, -0.1], [-0.8, 0.6, 0, 0.3], [0, 0, 0, 1.0]])

solve = jax.jit(lambda robot, pose: nj.inverse_kinematics(robot, pose))
"""One program for all arms of a kind: the arm is an argument."""


def made(robot: nj.Robot, n: int = 8) -> tuple[np.ndarray, jax.Array]:
    """Joint vectors within the limits and their poses."""
    low, high = np.maximum(robot.lower, -3), np.minimum(robot.upper, 3)
    q = np.random.default_rng(3).uniform(low, high, (n, robot.joints))
    return q, nj.forward_kinematics(robot, q)


def judge(robot: nj.Robot, answer: nj.IKSolutions, q: np.ndarray) -> None:
    """No pose is unreachable, or complete without its joint vector; nothing is spurious."""
    turns = np.asarray(answer.q) - q[:, None]
    turns = np.where(answer.periodic, turns - 2 * np.pi * np.round(turns / (2 * np.pi)), turns)
    own = np.any((np.abs(turns).max(-1) < 1e-5) & np.asarray(answer.found), axis=1)
    assert not np.any(np.asarray(answer.complete) & ~own)
    assert not np.any(answer.status == nj.IKStatus.UNREACHABLE)
    reached = nj.forward_kinematics(robot, answer.q)
    pose = nj.forward_kinematics(robot, q)[:, None]
    miss = np.abs(np.asarray(reached - pose)).max((-1, -2))
    assert np.all(miss[np.asarray(answer.found)] < 1e-9)


FORMS = {
    "jax arrays": lambda robot: dataclasses.replace(
        robot, screws=jnp.asarray(robot.screws), home=jnp.asarray(robot.home)
    ),
    "jax arrays as a tree": functools.partial(jax.tree.map, jnp.asarray),
    "lists": lambda robot: nj.Robot.from_screws(
        robot.screws.tolist(),
        robot.home.tolist(),
        lower=robot.lower,
        upper=robot.upper,
        joint_names=robot.joint_names,
        name=robot.name,
    ),
    "pickled": lambda robot: pickle.loads(pickle.dumps(robot)),
    "copied": copy.deepcopy,
    "numpy tool": lambda robot: robot.with_tool(TOOL),
    "jax tool": lambda robot: robot.with_tool(jnp.asarray(TOOL)),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", NAMES)
def test_an_arm_is_solved_completely_whatever_it_is_made_of(name, form):
    robot = FORMS[form](nj.robots.load(name))
    q, pose = made(robot)
    for answer in (nj.inverse_kinematics(robot, pose), solve(robot, pose)):
        judge(robot, answer, q)
        assert np.all(answer.complete)


@pytest.mark.parametrize("size", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", NAMES)
def test_a_program_proves_nothing_of_an_arm_that_it_was_not_made_for(name, size, rng):
    robot = nj.robots.load(name)
    turns = nj.se3.exp(rng.normal(size=(robot.joints, 6)) * size)
    screws = np.einsum("nij,nj->ni", nj.se3.adjoint(turns), robot.screws)
    slides = ~np.any(robot.screws[:, :3], axis=1)
    screws[slides, :3] = 0
    # As an optimiser does it: the numbers of a tree change, and what it was made from stays.
    moved = jax.tree.unflatten(
        jax.tree.structure(robot), [jnp.asarray(screws), robot.home, robot.lower, robot.upper]
    )
    q, pose = made(moved)
    judge(moved, solve(moved, pose), q)


SHIFTS = [
    # The upper arm is longer: an arm of the same family.
    ("niryo_one", [(slice(2, None), 0.02, True), (0, 0.003, False), (5, 1e-4, False)]),
    ("abb_irb1600", [(slice(2, None), 0.02, True), (3, 0.003, False), (5, 1e-4, False)]),
]


@pytest.mark.parametrize(("name", "shifts"), SHIFTS, ids=[name for name, _ in SHIFTS])
def test_screws_that_are_traced_are_each_looked_at(name, shifts):
    robot = nj.robots.load(name)
    arms, wanted = [robot], [[True] * 4]
    for joints, by, kept in shifts:
        screws = np.array(robot.screws)
        way = [0, 0, by] if kept else [0, by, by]
        screws[joints, 3:] += np.cross(way, screws[joints, :3])
        arms.append(dataclasses.replace(robot, screws=screws))
        wanted.append([kept] * 4)
    made_by, poses = zip(*(made(arm, 4) for arm in arms))

    @jax.jit
    @jax.vmap
    def solve_each(screws, pose):
        return nj.inverse_kinematics(dataclasses.replace(robot, screws=screws), pose)

    answers = solve_each(np.stack([arm.screws for arm in arms]), np.stack(poses))
    np.testing.assert_array_equal(answers.complete, wanted)
    for i, (arm, q) in enumerate(zip(arms, made_by)):
        judge(arm, answers.map(lambda x, i=i: x[i]), q)


def test_a_robot_and_its_rates_are_trees_of_one_kind(niryo):
    pose = made(niryo, 2)[1]
    rates = jax.grad(lambda robot: jnp.sum(nj.inverse_kinematics(robot, pose).q))(niryo)
    stepped = jax.tree.map(lambda x, rate: x - 1e-3 * jnp.asarray(rate), niryo, rates)
    assert jax.tree.structure(stepped) == jax.tree.structure(niryo)
    assert stepped.offset_wrist is None
    assert nj.robots.niryo_one().offset_wrist == niryo.offset_wrist


@pytest.mark.parametrize("name", nj.robots.names())
def test_what_is_found_of_an_arm_is_what_a_program_looks_for(name):
    screws = nj.robots.load(name).screws
    known, plans, _ = structure_of(screws)
    traced = jnp.asarray(screws)
    assert bool(is_offset_wrist(traced, jnp)) == (known is not None)
    for plan in plans:
        assert plan_fits(plan, screws)
        assert plan_fits(plan, traced, jnp)


def test_another_tool_compiles_nothing(niryo, monkeypatch):
    q, pose = made(niryo, 3)
    jax.block_until_ready(nj.inverse_kinematics(niryo, pose))

    def traced(*_: object) -> None:
        raise AssertionError("the solver is traced again")

    monkeypatch.setattr(driver, "solve_rows", traced)
    robot = niryo.with_tool(TOOL)
    judge(robot, nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q)), q)


X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
UNITS = {
    "offset wrist": (
        [Z, Y, Y, X, Y, X],
        [ORIGIN, ORIGIN, Z, Z, X + Z, X],
    ),
    "spherical wrist": ([Z, Y, Y, X, Y, X], [ORIGIN, ORIGIN, Z, X + Z, X + Z, X + Z]),
    "three parallel axes": ([Z, Y, Y, Y, Z, Y], [ORIGIN, Z, X + Z, X, X, X + Y]),
}


@pytest.mark.parametrize("name", UNITS)
def test_an_arm_of_zeros_and_ones_is_solved(name):
    robot = nj.Robot.from_axes(*map(np.array, UNITS[name]), np.eye(4), name=name)
    assert set(np.unique(np.abs(robot.screws))) == {0.0, 1.0}
    q, pose = made(robot, 4)
    answer = nj.inverse_kinematics(robot, pose)
    judge(robot, answer, q)
    assert np.all(answer.found.any(-1))
    assert np.all(nj.newton_raphson(robot, pose, q + 1e-3).converged)
