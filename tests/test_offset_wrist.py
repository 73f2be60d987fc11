"""The product of the four branches of an offset-wrist arm: what proves most of its answers."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pose_sets
import pytest
from arms import posed
from test_honesty import SPOILERS

import niryo_jax as nj
from niryo_jax import lanes
from niryo_jax.ik.offset_wrist.parameters import parameters_from
from niryo_jax.ik.offset_wrist.product import product_of_branches
from niryo_jax.ik.offset_wrist.wrist_circle import wrist_circle
from niryo_jax.ik.trig_polynomial import DEGREE, forms_on_arcs, most_roots
from niryo_jax.lanes import Lane
from niryo_jax.structure.offset_wrist import concrete_numbers

NAMES = ["niryo_one", "crx10ia", "xarm6", "sideways", "all_at_once"]
POSES, ARCS = 256, 16


@functools.cache
def case(name):
    """An arm, joint vectors, their poses, and of these the product, the angle u of each joint
    vector and how many roots the product has at most."""
    robot = SPOILERS[name][0] if name in SPOILERS else pose_sets.robot(name)
    q = np.random.default_rng(4).uniform(-np.pi, np.pi, (POSES, 6))
    pose = posed(robot, q)
    known = robot.offset_wrist
    numbers = concrete_numbers(np.asarray(robot.screws), np.asarray(robot.home)[:3, 3])

    def of(free, pose):
        arm = parameters_from(known, free)
        circle = wrist_circle(arm, lanes.unpack(pose, 2))
        product = product_of_branches(arm, circle)
        most, _ = most_roots(forms_on_arcs(product, ARCS), product.margin)
        start = lanes.atan2(circle.start[1], circle.start[0]).array
        return product, jnp.sum(most, axis=0), start

    free = [jnp.asarray(x) for x, entry in zip(numbers, known.entries) if entry is None]
    untwisted = pose.copy()
    untwisted[:, :3, :3] = pose[:, :3, :3] @ np.asarray(robot.home)[:3, :3].T
    product, most, start = jax.jit(of)(free, untwisted)
    return robot, q, pose, product, np.asarray(start) - q[:, 5], np.asarray(most)


def value(coefficients, angle):
    """g at an angle of each row."""
    k = np.arange(1, DEGREE + 1)[:, None]
    real, imaginary = coefficients[1 : DEGREE + 1], coefficients[DEGREE + 1 :]
    return coefficients[0] + 2 * np.sum(
        real * np.cos(k * angle) - imaginary * np.sin(k * angle), axis=0
    )


@pytest.mark.parametrize("name", NAMES)
def test_it_is_of_degree_eight_whatever_the_offset(name):
    product = case(name)[3]
    assert np.max(product.noise) < 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_every_joint_vector_is_one_of_its_roots(name):
    _, _, _, product, angle, _ = case(name)
    off = np.abs(value(np.asarray(product.coefficients), angle))
    # A fifth of what the proof allows for.
    assert np.all(off < 0.2 * np.asarray(product.margin))


@pytest.mark.parametrize("name", ["niryo_one", "crx10ia", "all_at_once"])
def test_it_never_has_fewer_roots_than_there_are_solutions(name):
    robot, _, pose, _, _, most = case(name)
    answer = nj.inverse_kinematics(robot, pose)
    count = np.asarray(answer.count)
    simple = ~np.any(np.asarray(answer.singularity) != nj.Singularity.NONE, axis=-1)
    assert np.all((most >= count) | ~simple)
    assert np.mean(most == count) > 0.8


def test_a_pose_without_numbers_leaves_nothing_but_noise():
    robot = nj.robots.niryo_one()
    known = robot.offset_wrist
    numbers = concrete_numbers(np.asarray(robot.screws), np.asarray(robot.home)[:3, 3])
    free = [Lane(jnp.asarray(x)).value for x, e in zip(numbers, known.entries) if e is None]
    pose = np.broadcast_to(np.eye(4), (2, 4, 4)).copy()
    pose[1, :3, 3] = np.nan
    circle = wrist_circle(parameters_from(known, free), lanes.unpack(jnp.asarray(pose), 2))
    product = product_of_branches(parameters_from(known, free), circle)
    assert np.all(np.isfinite(product.coefficients))
    assert np.asarray(product.noise)[1] == 1.0
