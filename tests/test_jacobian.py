"""Laws of the Jacobians, and of the measures made of them."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from support import (
    BATCHES,
    DTYPES,
    adjoint_matrix,
    eps,
    modern_robotics,
    product_of_exponentials,
    random_robot,
    rate,
    rate_truth,
    rigid_inverse,
    vee6,
)

import niryo_jax as nj

ROWS = {"all": slice(0, 6), "angular": slice(0, 3), "linear": slice(3, 6)}
# n: (prismatic joints, helical joints)
ARMS = {
    1: ((), ()),
    2: ((0, 1), ()),
    3: ((2,), ()),
    4: ((), (1, 3)),
    5: ((1,), (0,)),
    6: ((), ()),
    7: ((), ()),
    8: ((0, 5), (3,)),
}


def arm_of(rng, n) -> nj.Robot:
    prismatic, helical = ARMS[n]
    return random_robot(rng, n, prismatic=prismatic, helical=helical)


def space_truth(robot, q):
    """The twists dT/dqi T^-1 by finite differences, in extended precision."""

    def pose(q):
        return product_of_exponentials(robot.screws, robot.home, q)

    inverse = rigid_inverse(pose(q))
    columns = [vee6(rate_truth(pose, q, unit) @ inverse) for unit in np.eye(robot.joints)]
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("n", [1, 2, 4, 5, 6, 8])
def test_formula_and_autodiff_equal_finite_differences(rng, n):
    robot = arm_of(rng, n)
    q = rng.uniform(-np.pi, np.pi, (40, n))
    space = nj.space_jacobian(robot, q)
    truth = space_truth(robot, q).astype(float)
    np.testing.assert_allclose(space, truth, atol=1e-9)
    np.testing.assert_allclose(nj.autodiff_space_jacobian(robot, q), space, atol=1e-12)


@pytest.mark.parametrize("n", [3, 5])
def test_formula_and_autodiff_agree_in_single_precision(rng, n):
    robot = arm_of(rng, n)
    q = rng.uniform(-np.pi, np.pi, (200, n)).astype(np.float32)
    space, autodiff = nj.space_jacobian(robot, q), nj.autodiff_space_jacobian(robot, q)
    assert space.dtype == autodiff.dtype == np.float32
    np.testing.assert_allclose(autodiff, space, atol=1e-5)
    np.testing.assert_allclose(space, nj.space_jacobian(robot, q.astype(float)), atol=1e-5)


@pytest.mark.parametrize("n", [1, 6, 8])
def test_body_jacobian_is_the_space_jacobian_seen_from_the_tool(rng, n):
    robot = arm_of(rng, n)
    q = rng.uniform(-np.pi, np.pi, (40, n))
    inverse = rigid_inverse(product_of_exponentials(robot.screws, robot.home, q))
    truth = adjoint_matrix(inverse) @ np.asarray(nj.space_jacobian(robot, q))
    np.testing.assert_allclose(nj.body_jacobian(robot, q), truth.astype(float), atol=1e-13)


@pytest.mark.parametrize("name", ["JacobianSpace", "JacobianBody"])
def test_modern_robotics_vectors(name):
    space = name == "JacobianSpace"
    build = nj.Robot.from_screws if space else nj.Robot.from_body_screws
    jacobian = nj.space_jacobian if space else nj.body_jacobian
    for (screws, q), truth in modern_robotics(name)[:3]:
        robot = build(screws.T, np.eye(4))
        np.testing.assert_allclose(jacobian(robot, q), truth, atol=2e-14)


def test_the_first_space_column_and_the_last_body_column_are_constant(rng, niryo):
    q = rng.uniform(-np.pi, np.pi, (40, 6))
    first, last = nj.space_jacobian(niryo, q)[:, :, 0], nj.body_jacobian(niryo, q)[:, :, -1]
    np.testing.assert_array_equal(first, np.broadcast_to(niryo.screws[0], (40, 6)))
    np.testing.assert_allclose(last, np.broadcast_to(niryo.body_screws[-1], (40, 6)), atol=1e-15)


def test_a_traced_robot_has_the_jacobian_of_the_concrete_one(rng):
    robot = random_robot(rng, 2, prismatic=(1,))
    q = rng.uniform(-np.pi, np.pi, (20, 2))
    for jacobian in (nj.space_jacobian, nj.body_jacobian, nj.autodiff_space_jacobian):
        np.testing.assert_allclose(jax.jit(jacobian)(robot, q), jacobian(robot, q), atol=1e-13)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_and_dtype_follow_the_joint_vector(niryo, batch, dtype):
    q = jax.ShapeDtypeStruct((*batch, 6), dtype)
    results = {
        nj.space_jacobian: (6, 6),
        nj.body_jacobian: (6, 6),
        nj.autodiff_space_jacobian: (6, 6),
        nj.manipulability: (),
        nj.singular_values: (6,),
        nj.condition_number: (),
    }
    for function, shape in results.items():
        found = jax.eval_shape(lambda q: function(niryo, q), q)  # noqa: B023
        assert (found.shape, found.dtype) == (batch + shape, dtype)


def test_single_and_empty_batches_are_elements_of_a_batch(rng):
    robot = arm_of(rng, 2)
    q = rng.uniform(-np.pi, np.pi, (3, 2, 2))
    for function in (nj.space_jacobian, nj.body_jacobian, nj.autodiff_space_jacobian):
        whole = function(robot, q)
        np.testing.assert_allclose(function(robot, q[2, 1]), whole[2, 1], atol=1e-14)
        assert function(robot, q[:0]).shape == (0, *whole.shape[1:])


# Measures


@pytest.mark.parametrize("part", ROWS)
@pytest.mark.parametrize("n", [4, 6, 7])
def test_manipulability_is_the_volume_of_the_ellipsoid(rng, n, part):
    robot = arm_of(rng, n)
    q = rng.uniform(-np.pi, np.pi, (100, n))
    rows = np.asarray(nj.body_jacobian(robot, q))[:, ROWS[part]]
    found = nj.manipulability(robot, q, part)
    wide = rows if n >= rows.shape[1] else np.swapaxes(rows, 1, 2)
    gram = np.linalg.det(wide @ np.swapaxes(wide, 1, 2))
    np.testing.assert_allclose(found, np.sqrt(np.maximum(gram, 0)), rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(found, np.prod(np.linalg.svd(rows)[1], axis=1), rtol=1e-9)
    if n == rows.shape[1]:
        np.testing.assert_allclose(found, np.abs(np.linalg.det(rows)), rtol=1e-9)


def test_manipulability_does_not_depend_on_the_frame_of_the_twist(rng, niryo):
    q = rng.uniform(-np.pi, np.pi, (100, 6))
    space = np.abs(np.linalg.det(nj.space_jacobian(niryo, q)))
    np.testing.assert_allclose(nj.manipulability(niryo, q), space, rtol=1e-8, atol=1e-12)


def spherical_wrist() -> nj.Robot:
    """Three axes through one point: singular where the first and the last are one line."""
    return nj.Robot.from_axes([[0, 0, 1], [0, 1, 0], [0, 0, 1]], np.zeros((3, 3)), np.eye(4))


def test_manipulability_of_a_wrist_is_the_sine_of_its_middle_angle(rng):
    q = rng.uniform(-3, 3, (100, 3))
    found = nj.manipulability(spherical_wrist(), q, "angular")
    np.testing.assert_allclose(found, np.abs(np.sin(q[:, 1])), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_singular_configuration_has_no_volume_and_a_finite_gradient(rng, dtype):
    planar = nj.Robot.from_axes(np.eye(3)[[2] * 3], np.eye(3), np.eye(4))
    q = rng.uniform(-1, 1, (20, 3)).astype(dtype)
    for robot, x, part in (
        (spherical_wrist(), q * np.array([1, 0, 1], dtype), "angular"),
        (planar, q, "linear"),
        (spherical_wrist(), q * np.array([1, 0, 1], dtype), "all"),
    ):
        value, gradient = jax.jit(
            jax.vmap(jax.value_and_grad(lambda q: nj.manipulability(robot, q, part)))  # noqa: B023
        )(x)
        np.testing.assert_allclose(value, np.zeros(20), atol=10 * eps(dtype))
        assert np.all(np.isfinite(gradient))


def test_derivative_of_manipulability_equals_finite_differences(rng):
    robot = arm_of(rng, 4)
    q, u = rng.uniform(-2, 2, (2, 30, 4))

    def truth(q):
        rows = np.asarray(nj.body_jacobian(robot, q.astype(float)))[:, :3]
        return np.prod(np.linalg.svd(rows)[1], axis=1)

    found = rate(lambda q: nj.manipulability(robot, q, "angular"), q, u)
    np.testing.assert_allclose(found, rate_truth(truth, q, u).astype(float), rtol=1e-6, atol=1e-8)


def test_manipulability_does_not_hide_what_is_not_a_number(niryo):
    assert np.isnan(nj.manipulability(niryo, np.full(6, np.nan)))


@pytest.mark.parametrize("part", ROWS)
@pytest.mark.parametrize("length", [1.0, 0.25])
def test_singular_values_and_condition_number_are_those_of_the_scaled_jacobian(
    rng, niryo, part, length
):
    q = rng.uniform(-np.pi, np.pi, (50, 6))
    scaled = np.asarray(nj.body_jacobian(niryo, q)) / np.array([1.0] * 3 + [length] * 3)[:, None]
    truth = np.linalg.svd(scaled[:, ROWS[part]])[1]
    found = nj.singular_values(niryo, q, part, length=length)
    np.testing.assert_allclose(found, truth, atol=1e-14 * np.max(truth))
    ratio = nj.condition_number(niryo, q, part, length=length)
    np.testing.assert_allclose(ratio, truth[:, 0] / truth[:, -1], rtol=1e-8)


@pytest.mark.parametrize("dtype", DTYPES)
def test_condition_number_of_a_singular_configuration_is_infinite(rng, dtype):
    wrist = spherical_wrist()
    q = rng.uniform(-3, 3, (200, 3)).astype(dtype)
    for middle in (0.0, np.pi, -np.pi):
        q[:, 1] = middle
        # Pi in float32 is 9e-8 off, where the wrist is regular.
        if dtype == np.float64 or middle == 0:
            assert np.all(np.isinf(nj.condition_number(wrist, q, "angular")))
    assert np.all(np.isinf(nj.condition_number(wrist, q, "linear")))
    assert nj.singular_values(wrist, np.zeros(3)).shape == (3,)
    upright = nj.robots.kuka_iiwa14()
    assert np.all(np.isinf(nj.condition_number(upright, np.zeros(7, dtype))))
    q[:, 1] = 1e-3
    near = nj.condition_number(wrist, q, "angular")
    np.testing.assert_allclose(near, 1 / np.tan(5e-4), rtol=1e5 * eps(dtype))


def test_manipulability_of_a_scara_is_that_of_its_task(rng):
    scara = nj.robots.abb_irb910sc()
    q = rng.uniform(-2, 2, (50, 4))
    upper, forearm = 0.4, 0.25
    found = nj.manipulability(scara, q)
    np.testing.assert_allclose(found, upper * forearm * np.abs(np.sin(q[:, 1])), atol=1e-12)


def test_derivative_of_manipulability_of_few_joints_equals_finite_differences(rng):
    robot = arm_of(rng, 4)
    q, u = rng.uniform(-2, 2, (2, 30, 4))

    def truth(q):
        return np.prod(np.linalg.svd(np.asarray(nj.body_jacobian(robot, q.astype(float))))[1], -1)

    found = rate(lambda q: nj.manipulability(robot, q), q, u)
    np.testing.assert_allclose(found, rate_truth(truth, q, u).astype(float), rtol=1e-6, atol=1e-8)


def test_wrong_arguments_are_refused_by_name(niryo):
    for function in (
        nj.space_jacobian,
        nj.body_jacobian,
        nj.autodiff_space_jacobian,
        nj.manipulability,
        nj.singular_values,
        nj.condition_number,
    ):
        for wrong in ((), (5,), (2, 7)):
            with pytest.raises(ValueError, match=r"^q: expected shape \(\.\.\., 6\), got"):
                function(niryo, np.zeros(wrong))
        with pytest.raises(TypeError, match=r"^robot: expected"):
            function(np.eye(6), np.zeros(6))
    for function in (nj.manipulability, nj.singular_values, nj.condition_number):
        with pytest.raises(ValueError, match=r"^part: expected one of 'all', 'angular', 'linear'"):
            function(niryo, np.zeros(6), "rotation")
    for function in (nj.singular_values, nj.condition_number):
        for length in (0.0, -1.0, np.nan):
            with pytest.raises(ValueError, match=r"^length: expected a positive"):
                function(niryo, np.zeros(6), length=length)
