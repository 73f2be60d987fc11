"""Derivatives of complete inverse kinematics: against finite differences, and finite everywhere."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pose_sets
import pytest
from support import unit_vectors

import niryo_jax as nj
from niryo_jax.ik import Singularity

ROBOT = nj.robots.niryo_one()
SCALES = [pytest.param(64, id="small"), pytest.param(1024, marks=pytest.mark.completeness)]


class Solved(NamedTuple):
    """All joint vectors (k, 16, 6), which are found, which are singular, and derivatives."""

    q: np.ndarray
    found: np.ndarray
    singular: np.ndarray
    rate: np.ndarray
    screws_bar: np.ndarray
    pose_bar: np.ndarray


@jax.jit
def _solve(screws, pose, screws_rate, pose_rate, weights):
    # Forward and reverse mode of one program: the solver is compiled once.
    def answers(screws, pose):
        answer = nj.inverse_kinematics(dataclasses.replace(ROBOT, screws=screws), pose)
        return answer.q, (answer.found, answer.singularity)

    q, rates, (found, singular) = jax.linearize(answers, screws, pose, has_aux=True)
    pull_back = jax.linear_transpose(rates, screws, pose)
    return Solved(q, found, singular, rates(screws_rate, pose_rate), *pull_back(weights))


def solve(screws, pose, screws_rate=None, pose_rate=None, weights=None) -> Solved:
    """The solutions, their rate for rates of screws and pose, and `weights` pulled back."""
    screws, pose = jnp.asarray(screws), jnp.asarray(pose)
    screws_rate = jnp.zeros_like(screws) if screws_rate is None else jnp.asarray(screws_rate)
    pose_rate = jnp.zeros_like(pose) if pose_rate is None else jnp.asarray(pose_rate)
    weights = jnp.ones((len(pose), 16, 6)) if weights is None else jnp.asarray(weights)
    return Solved(*map(np.asarray, _solve(screws, pose, screws_rate, pose_rate, weights)))


def random_rates(rng, pose):
    """Rates of the tool (about 1) and of axis 6, which keep screws unit and poses rigid."""
    twist = rng.standard_normal((len(pose), 6))
    pose_rate = np.asarray(pose) @ np.asarray(nj.se3.hat(twist))
    screws_rate = np.zeros((6, 6))
    turn = unit_vectors(rng).astype(float)
    screws_rate[5, :3] = np.cross(turn, ROBOT.screws[5, :3])
    screws_rate[5, 3:] = np.cross(turn, ROBOT.screws[5, 3:])
    return screws_rate, pose_rate, turn, twist


def moved(turn, twist, pose, step):
    """Screws and poses along those rates."""
    screws = np.array(ROBOT.screws)
    rotation = np.asarray(nj.so3.exp(step * turn))
    screws[5, :3], screws[5, 3:] = rotation @ screws[5, :3], rotation @ screws[5, 3:]
    return jnp.asarray(screws), pose @ nj.se3.exp(step * twist)


def matched(base, other: Solved):
    """The joint vectors that `other` found nearest to `base` (k, 16, 6), slot by slot."""
    apart = np.abs((other.q[:, None] - base[:, :, None] + np.pi) % (2 * np.pi) - np.pi).max(-1)
    apart = np.where(other.found[:, None], apart, np.inf)
    chosen = np.take_along_axis(other.q, np.argmin(apart, -1)[..., None], 1)
    turns = np.round((chosen - base) / (2 * np.pi))
    return chosen - 2 * np.pi * turns


@pytest.mark.parametrize("size", SCALES)
def test_rates_by_pose_and_geometry_are_those_of_finite_differences(rng, size):
    q = rng.uniform(ROBOT.lower, ROBOT.upper, (size, 6))
    pose = nj.forward_kinematics(ROBOT, q)
    screws_rate, pose_rate, turn, twist = random_rates(rng, pose)
    weights = rng.standard_normal((size, 16, 6))
    base = solve(ROBOT.screws, pose, screws_rate, pose_rate, weights)
    found, rate = base.found, base.rate
    assert not base.singular[found].any()
    np.testing.assert_array_equal(rate[~found], 0.0)
    step = 2e-6
    sides = [matched(base.q, solve(*moved(turn, twist, pose, s * step))) for s in (-2, -1, 1, 2)]
    expected = (8 * (sides[2] - sides[1]) - (sides[3] - sides[0])) / (12 * step)
    error = np.abs(rate - expected).max(-1) / (1 + np.abs(rate).max(-1))
    # Near where two solutions merge the differences, not the derivatives, are wrong.
    regular = found & (np.abs(rate).max(-1) < 30)
    assert regular.sum() > 0.7 * found.sum()
    assert error[regular].max() < 1e-6

    forward = np.sum(weights * rate)
    backward = np.sum(base.screws_bar * screws_rate) + np.sum(base.pose_bar * pose_rate)
    assert backward == pytest.approx(forward, rel=1e-9)


@pytest.mark.parametrize(
    "gradient_of",
    [
        pytest.param(jax.jacfwd, id="forward"),
        pytest.param(jax.jacrev, id="hessian", marks=pytest.mark.completeness),
    ],
)
def test_second_derivatives(rng, gradient_of):
    pose = nj.forward_kinematics(ROBOT, jnp.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8]))
    twist = jnp.asarray(rng.standard_normal((2, 6)))

    def height(x):
        q = nj.inverse_kinematics(ROBOT, pose @ nj.se3.exp(x @ twist)).q
        return jnp.sum(jnp.sin(q[:4]) ** 2)

    def gradient(x):
        slope = gradient_of(height)(x)
        return slope, slope

    # One program for both: the solver is compiled once.
    both = jax.jit(jax.jacfwd(gradient, has_aux=True))
    hessian, _ = both(jnp.zeros(2))
    step = 1e-5 * jnp.eye(2)
    expected = jnp.stack([(both(e)[1] - both(-e)[1]) / 2e-5 for e in step])
    # Differences of gradients are right to a share of the largest entry, not of each.
    scale = float(jnp.max(jnp.abs(hessian)))
    np.testing.assert_allclose(hessian, expected, rtol=1e-6, atol=1e-8 * scale)


@pytest.mark.parametrize("name", sorted(pose_sets.HARD))
def test_nothing_is_nan_at_singularities(rng, name):
    parts = [pose_sets.HARD[name](ROBOT, 40, delta, rng) for delta in (1e-3, 1e-6, 1e-9, 0.0)]
    q = np.concatenate(parts)
    # In batches of the size that another test compiles.
    for part in np.resize(q, (3, 64, 6)):
        pose = nj.forward_kinematics(ROBOT, part)
        screws_rate, pose_rate, _, _ = random_rates(rng, pose)
        answer = solve(ROBOT.screws, pose, screws_rate, pose_rate)
        assert all(np.all(np.isfinite(x)) for x in answer)


def test_a_self_motion_is_told_and_its_direction_given():
    # The tool's axis lies on axis 1 and points up: joints 1 and 6 turn against each other.
    pose = np.array([[0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0.5], [0, 0, 0, 1.0]])
    answer = nj.inverse_kinematics(ROBOT, pose)
    found = np.asarray(answer.found)
    assert found.sum() == 4
    assert set(np.asarray(answer.singularity)[found]) == {Singularity.SELF_MOTION}
    assert "infinitely many" in answer.message()
    direction, speed = nj.free_direction(ROBOT, answer.q[0])
    np.testing.assert_allclose(np.abs(direction), [0.5**0.5, 0, 0, 0, 0, 0.5**0.5], atol=1e-9)
    assert speed < 1e-12
    moved_on = np.asarray(answer.q[0]) + 0.4 * np.asarray(direction)
    np.testing.assert_allclose(nj.forward_kinematics(ROBOT, moved_on), pose, atol=1e-12)


def test_a_spherical_wrist_names_its_singularities():
    robot = pose_sets.robot("spherical")
    aligned = np.array([0.3, -0.4, 0.5, 0.2, 0.0, 0.7])
    stretched = np.array([0.3, -0.4, np.arctan2(0.2215, 0.03), 0.2, 0.5, 0.7])
    answer = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, [aligned, stretched]))
    names = [
        {Singularity(int(x)).name for x in code[found]}
        for code, found in zip(np.asarray(answer.singularity), np.asarray(answer.found))
    ]
    assert "WRIST" in names[0]
    assert names[1] == {"ELBOW"}
    # The two solutions that differ in the wrist are members of one family.
    assert answer.count.tolist() == [7, 4]
