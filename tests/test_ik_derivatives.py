"""Derivatives of complete inverse kinematics: against finite differences, and finite everywhere."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pose_sets
import pytest
from support import unit_vectors

import niryo_jax as nj
from niryo_jax.ik import Singularity

ROBOT = nj.robots.niryo_one()
SCALES = [pytest.param(512, id="small"), pytest.param(1024, marks=pytest.mark.completeness)]


@jax.jit
def solve(screws, pose):
    """All joint vectors (k, 16, 6), which are found, and which of them are singular."""
    robot = dataclasses.replace(ROBOT, screws=screws)
    answer = nj.inverse_kinematics(robot, pose)
    return answer.q, answer.found, answer.singularity


@jax.jit
def rates(screws, pose, screws_rate, pose_rate):
    return jax.jvp(lambda *x: solve(*x)[0], (screws, pose), (screws_rate, pose_rate))[1]


@jax.jit
def pulled_back(screws, pose, weights):
    return jax.vjp(lambda *x: solve(*x)[0], screws, pose)[1](weights)


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


def matched(base, other, found):
    """The joint vectors of `other` (k, 16, 6) nearest to those of `base`, slot by slot."""
    apart = np.abs((other[:, None] - base[:, :, None] + np.pi) % (2 * np.pi) - np.pi).max(-1)
    apart = np.where(found[:, None], apart, np.inf)
    chosen = np.take_along_axis(other, np.argmin(apart, -1)[..., None], 1)
    turns = np.round((chosen - base) / (2 * np.pi))
    return chosen - 2 * np.pi * turns


@pytest.mark.parametrize("size", SCALES)
def test_rates_by_pose_and_geometry_are_those_of_finite_differences(rng, size):
    q = rng.uniform(ROBOT.lower, ROBOT.upper, (size, 6))
    pose = nj.forward_kinematics(ROBOT, q)
    screws_rate, pose_rate, turn, twist = random_rates(rng, pose)
    screws = jnp.asarray(ROBOT.screws)
    base, found, singular = map(np.asarray, solve(screws, pose))
    rate = np.asarray(rates(screws, pose, jnp.asarray(screws_rate), jnp.asarray(pose_rate)))
    assert not singular[found].any()
    np.testing.assert_array_equal(rate[~found], 0.0)
    step = 2e-6
    sides = [
        matched(base, *map(np.asarray, solve(*moved(turn, twist, pose, s * step))[:2]))
        for s in (-2, -1, 1, 2)
    ]
    expected = (8 * (sides[2] - sides[1]) - (sides[3] - sides[0])) / (12 * step)
    error = np.abs(rate - expected).max(-1) / (1 + np.abs(rate).max(-1))
    # Near where two solutions merge the differences, not the derivatives, are wrong.
    regular = found & (np.abs(rate).max(-1) < 30)
    assert regular.sum() > 0.7 * found.sum()
    assert error[regular].max() < 1e-6

    weights = jnp.asarray(rng.standard_normal(base.shape))
    screws_bar, pose_bar = pulled_back(screws, pose, weights)
    forward = float(jnp.sum(weights * rate))
    backward = float(jnp.sum(screws_bar * screws_rate) + jnp.sum(pose_bar * pose_rate))
    assert backward == pytest.approx(forward, rel=1e-9)


def test_second_derivatives(rng):
    pose = nj.forward_kinematics(ROBOT, jnp.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8]))
    twist = jnp.asarray(rng.standard_normal((2, 6)))

    def height(x):
        q = nj.inverse_kinematics(ROBOT, pose @ nj.se3.exp(x @ twist)).q
        return jnp.sum(jnp.sin(q[:4]) ** 2)

    zero = jnp.zeros(2)
    hessian = jax.jit(jax.hessian(height))(zero)
    gradient = jax.jit(jax.grad(height))
    step = 1e-5 * jnp.eye(2)
    expected = jnp.stack([(gradient(e) - gradient(-e)) / 2e-5 for e in step])
    # Differences of gradients are right to a share of the largest entry, not of each.
    scale = float(jnp.max(jnp.abs(hessian)))
    np.testing.assert_allclose(hessian, expected, rtol=1e-6, atol=1e-8 * scale)


@pytest.mark.parametrize("name", sorted(pose_sets.HARD))
def test_nothing_is_nan_at_singularities(rng, name):
    parts = [pose_sets.HARD[name](ROBOT, 40, delta, rng) for delta in (1e-3, 1e-6, 1e-9, 0.0)]
    q = np.concatenate(parts)
    q = np.concatenate([q, q[: 512 - len(q)]])[:512] if len(q) < 512 else q[:512]
    pose = nj.forward_kinematics(ROBOT, np.resize(q, (512, 6)))
    screws_rate, pose_rate, _, _ = random_rates(rng, pose)
    screws = jnp.asarray(ROBOT.screws)
    assert all(np.all(np.isfinite(x)) for x in solve(screws, pose))
    rate = rates(screws, pose, jnp.asarray(screws_rate), jnp.asarray(pose_rate))
    assert np.all(np.isfinite(rate))
    back = pulled_back(screws, pose, jnp.ones((512, 16, 6)))
    assert all(np.all(np.isfinite(x)) for x in back)


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
