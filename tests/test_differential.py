"""Velocities of the tool and joint rates: finite differences, pseudo-inverses and the book."""

from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import (
    BATCHES,
    DATA,
    DTYPES,
    eps,
    product_of_exponentials,
    random_robot,
    rate,
    rate_truth,
    rigid_inverse,
    vee6,
)

from niryo_jax import robots
from niryo_jax.differential import joint_rates, tool_velocity
from niryo_jax.robots import book

FRAMES = ("space", "body", "tool_point")
DAMPINGS = (0.0, 0.02, 0.3, 5.0)
ARMS = {
    "random of 3": random_robot(np.random.default_rng(3), 3),
    "random of 4": random_robot(np.random.default_rng(4), 4, prismatic=(2,), helical=(0,)),
    "niryo_one": robots.niryo_one(),
    "kuka_iiwa14": book.kuka_iiwa14(),
}


def velocity_truth(robot, q, rates, frame):
    """The velocity in each frame by its definition, from the rate of the pose."""

    def pose(q):
        return product_of_exponentials(robot.screws, robot.home, q)

    now, change = pose(q), rate_truth(pose, q, rates)
    space = vee6(change @ rigid_inverse(now))
    if frame == "space":
        return space
    if frame == "body":
        return vee6(rigid_inverse(now) @ change)
    return np.concatenate([space[..., :3], change[..., :3, 3]], axis=-1)


def jacobian_truth(robot, q, frame):
    """(..., 6, n) with the velocities of unit joint rates as columns."""
    units = np.eye(robot.joints)
    columns = [velocity_truth(robot, q, np.broadcast_to(u, q.shape), frame) for u in units]
    return np.stack(columns, axis=-1).astype(float)


@pytest.mark.parametrize("name", ARMS)
def test_the_velocity_of_the_tool_is_the_rate_of_its_pose(rng, name):
    robot = ARMS[name]
    q, rates = rng.uniform(-2, 2, (2, 30, robot.joints))
    for frame in FRAMES:
        truth = velocity_truth(robot, q, rates, frame).astype(float)
        np.testing.assert_allclose(tool_velocity(robot, q, rates, frame=frame), truth, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "frame"),
    [("random of 3", "tool_point"), ("niryo_one", "body"), ("kuka_iiwa14", "space")],
)
def test_joint_rates_are_the_damped_pseudo_inverse(rng, name, frame):
    robot = ARMS[name]
    n = robot.joints
    q, velocity = rng.uniform(-2, 2, (5, n)), rng.uniform(-1, 1, (5, 6))
    matrix = jacobian_truth(robot, q, frame)
    gram = np.swapaxes(matrix, 1, 2) @ matrix
    right = np.einsum("bij,bi->bj", matrix, velocity)
    truth = [np.einsum("bij,bj->bi", np.linalg.pinv(matrix), velocity)]
    for d in DAMPINGS[1:]:
        truth.append(np.linalg.solve(gram + d**2 * np.eye(n), right[..., None])[..., 0])
        bound = np.linalg.norm(velocity, axis=-1) / (2 * d)
        assert np.all(np.linalg.norm(truth[-1], axis=-1) <= bound)
    found = joint_rates(robot, q, velocity, damping=np.array(DAMPINGS)[:, None], frame=frame)
    np.testing.assert_allclose(found, truth, rtol=1e-6, atol=1e-8)
    undamped = joint_rates(robot, q, velocity, frame=frame)
    np.testing.assert_allclose(undamped, found[0], rtol=1e-9, atol=1e-10)


def test_six_joints_give_the_velocity_back(rng, niryo):
    q, rates = rng.uniform(-2, 2, (2, 30, 6))
    back = joint_rates(niryo, q, tool_velocity(niryo, q, rates))
    np.testing.assert_allclose(back, rates, atol=1e-9)


# The book


EXAMPLES = json.loads((DATA / "book_robots.json").read_text())["printed_examples"]


def turned_first(velocity):
    """The book's (v, omega) as (omega, v)."""
    return np.roll(velocity, 3)


def test_the_printed_velocity_of_the_irb120_and_back():
    example = EXAMPLES[1]
    robot = book.abb_irb120(up="y", edition=2018)
    theta, rates = np.array(example["theta"]), np.array(example["theta_dot"])
    tool = turned_first(example["tool_velocity_v_omega"])
    spatial = turned_first(example["spatial_velocity_v_omega"])
    np.testing.assert_allclose(tool_velocity(robot, theta, rates), tool, atol=6e-5)
    np.testing.assert_allclose(
        tool_velocity(robot, theta, rates, frame="space"), spatial, atol=6e-5
    )
    np.testing.assert_allclose(joint_rates(robot, theta, tool), rates, atol=6e-4)


# The first, second and fourth point of the printed trajectory.
TRAJECTORY = np.deg2rad([[-90, -90, 0, 0], [-90, -154.7, 0, 0], [90, -154.7, 0, 0]])
PRINTED_RATES = [[0.35, -1.27, 0, 0], [-0.8663, -1.2863, 0, -1.2327], [0.8663, 1.2863, 0, 3.0727]]
# The third is printed as -179.97 degrees; its rates belong to an angle between these.
FOLDED = np.deg2rad([[-90, -179.975, 0, 0], [-90, -179.965, 0, 0]])
FOLDED_RATES = np.array([-969.9, -582.5, 0, -1551.4])


def test_the_printed_velocity_of_the_scara_and_back():
    robot = book.abb_irb910sc(edition=2018)
    velocity = turned_first(EXAMPLES[2]["tool_velocity_v_omega"])
    q = np.concatenate([TRAJECTORY, FOLDED])
    rates = np.asarray(joint_rates(robot, q, velocity))
    np.testing.assert_allclose(rates[:3], PRINTED_RATES, atol=2e-3)
    assert np.all((rates[3] <= FOLDED_RATES) & (rates[4] >= FOLDED_RATES))
    forth = np.concatenate([PRINTED_RATES, rates[3:]])
    np.testing.assert_allclose(
        tool_velocity(robot, q, forth), np.broadcast_to(velocity, (5, 6)), atol=5e-3
    )
    # Damping tames the arm where it is folded, at the price of the motion along it, which is z.
    damped = joint_rates(robot, q, velocity, damping=0.05)
    assert np.all(np.linalg.norm(damped[3:], axis=1) < 2)
    lost = np.abs(tool_velocity(robot, q, damped) - velocity)
    assert np.all(lost[3:, 5] > 0.2)
    assert np.all(lost[3:, :5] < 5e-3)


# Singular configurations, derivatives, batches


def aligned():
    """The IRB120 where axes 4 and 6 are one line."""
    return book.abb_irb120(), np.array([0.3, -0.4, 0.5, 0.2, np.pi / 2, -0.7])


@pytest.mark.parametrize("dtype", DTYPES)
def test_rates_and_their_derivatives_are_finite_where_the_arm_is_singular(dtype):
    robot, q = aligned()
    damping = np.array([0.0, 0.1], dtype)

    @jax.jit
    def gradients(q, velocity, damping):
        def total(*args):
            x = joint_rates(robot, *args[:2], damping=args[2])
            return jnp.sum(x), x

        return jax.grad(total, (0, 1, 2), has_aux=True)(q, velocity, damping)

    found, x = gradients(q.astype(dtype), np.ones(6, dtype), damping)
    assert x.dtype == dtype
    assert np.linalg.norm(x[1]) <= np.sqrt(6) / 0.2
    for part in (x, *found):
        assert np.all(np.isfinite(part))


@pytest.mark.parametrize("name", ["random of 3", "niryo_one"])
def test_derivatives_equal_finite_differences(rng, name):
    robot = ARMS[name]
    n = robot.joints
    x, u = rng.uniform(0.2, 1, (2, 10, n + 7))

    def rates(x):
        return joint_rates(robot, x[..., :n], x[..., n:-1], damping=x[..., -1])

    def truth(x):
        return np.asarray(rates(x.astype(float)))

    found, expected = rate(rates, x, u), rate_truth(truth, x, u).astype(float)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_broadcast_and_the_dtype_is_that_of_the_input(niryo, batch, dtype):
    q = jax.ShapeDtypeStruct((*batch, 6), dtype)
    one = jax.ShapeDtypeStruct((6,), dtype)
    for function in (tool_velocity, joint_rates):
        for args in ((q, one), (one, q), (q, q)):
            found = jax.eval_shape(lambda *args: function(niryo, *args), *args)  # noqa: B023
            assert (found.shape, found.dtype) == ((*batch, 6), dtype)
    found = jax.eval_shape(lambda q, v: joint_rates(niryo, q, v, damping=0.1), q, one)
    assert (found.shape, found.dtype) == ((*batch, 6), dtype)


def test_single_precision_is_near_the_truth(rng, niryo):
    q, velocity = rng.uniform(0.2, 1.0, (2, 20, 6)).astype(np.float32)
    matrix = jacobian_truth(niryo, q, "tool_point")
    gram = np.swapaxes(matrix, 1, 2) @ matrix + 0.05**2 * np.eye(6)
    right = np.einsum("bij,bi->bj", matrix, velocity.astype(float))
    truth = np.linalg.solve(gram, right[..., None])[..., 0]
    found = joint_rates(niryo, q, velocity, damping=0.05)
    np.testing.assert_allclose(found, truth, atol=3e3 * eps(np.float32))


def test_a_batch_is_what_its_elements_are_and_a_traced_robot_what_it_is(rng):
    robot = ARMS["random of 3"]
    q, velocity = rng.uniform(-2, 2, (3, 2, 3)), rng.uniform(-1, 1, (3, 2, 6))
    for function, second in ((tool_velocity, q[::-1]), (joint_rates, velocity)):
        whole = function(robot, q, second)
        np.testing.assert_allclose(function(robot, q[2, 1], second[2, 1]), whole[2, 1], atol=1e-12)
        assert function(robot, q[:0], second[:0]).shape == (0, *whole.shape[1:])
    traced = jax.jit(tool_velocity)(robot, q, q[::-1])
    np.testing.assert_allclose(traced, tool_velocity(robot, q, q[::-1]), atol=1e-13)


def test_wrong_arguments_are_refused_by_name(niryo):
    q, velocity = np.zeros(6), np.zeros(6)
    for function in (tool_velocity, joint_rates):
        with pytest.raises(ValueError, match=r"^frame: expected one of 'space', 'body', 'tool_p"):
            function(niryo, q, velocity, frame="world")
        with pytest.raises(ValueError, match=r"^q: expected shape \(\.\.\., 6\), got \(5,\)"):
            function(niryo, np.zeros(5), velocity)
        with pytest.raises(TypeError, match=r"^robot: expected"):
            function(np.eye(6), q, velocity)
    with pytest.raises(ValueError, match=r"^rates: expected shape \(\.\.\., 6\), got \(7,\)"):
        tool_velocity(niryo, q, np.zeros(7))
    with pytest.raises(ValueError, match=r"^velocity: expected shape \(\.\.\., 6\), got \(3,\)"):
        joint_rates(niryo, q, np.zeros(3))
    for damping in (-0.1, np.nan, [0.1, -1.0]):
        with pytest.raises(ValueError, match=r"^damping: expected 0 or more, got"):
            joint_rates(niryo, q, velocity, damping=damping)
    with pytest.raises(TypeError, match=r"^damping: expected an array of numbers, got 'much'"):
        joint_rates(niryo, q, velocity, damping="much")
