"""Velocity inverse kinematics: twists given back, scipy's bounded optimum, laws, differences."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import BATCHES, DTYPES, random_robot

import niryo_jax as nj
from niryo_jax.motion import VelocityStatus, velocity_ik
from niryo_jax.motion.bounded import (
    Problem,
    bounded_least_squares,
    free_least_squares,
    optimality,
)
from niryo_jax.motion.damping import squared_smallest_value
from niryo_jax.robots import book

NIRYO = nj.robots.niryo_one()
IIWA = book.kuka_iiwa14()
ARMS = {"niryo_one": NIRYO, "kuka_iiwa14": IIWA}
SMALL = random_robot(np.random.default_rng(5), 3)
FRAMES = ("space", "body", "tool_point")
AXIS = np.array([0.6, 0.0, 0.8])

bounded = jax.jit(bounded_least_squares)
missed = jax.jit(optimality)


def postures(robot, rng, count):
    """Joint vectors within the limits, away from singularities."""
    q = rng.uniform(robot.lower, robot.upper, (4 * count, robot.joints))
    smallest = np.linalg.svd(body_jacobian(robot, q), compute_uv=False)[:, -1]
    return q[smallest > 0.03][:count]


def body_jacobian(robot, q):
    return np.asarray(nj.body_jacobian(robot, q))


def in_tool(robot, q, twist, frame):
    """The body twist of one that is named in a frame."""
    pose = np.asarray(nj.forward_kinematics(robot, q))
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    omega, v = twist[..., :3], twist[..., 3:]
    if frame == "space":
        v = v + np.cross(omega, pose[..., :3, 3])
    if frame != "body":
        omega, v = (np.einsum("...ij,...j->...i", turned, x) for x in (omega, v))
    return np.concatenate([omega, v], axis=-1)


# What the tool does


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("name", ARMS)
def test_the_tool_moves_as_asked(rng, name, frame):
    robot = ARMS[name]
    q, twist = postures(robot, rng, 60), rng.uniform(-1, 1, (60, 6))
    found = velocity_ik(robot, q, twist, frame=frame)
    given = nj.tool_velocity(robot, q, found.rate, frame=frame)
    np.testing.assert_allclose(given, twist, atol=1e-12)
    np.testing.assert_allclose(found.residual, 0, atol=1e-12)
    least = np.linalg.pinv(body_jacobian(robot, q))
    expected = np.einsum("bij,bj->bi", least, in_tool(robot, q, twist, frame))
    np.testing.assert_allclose(found.rate, expected, rtol=1e-9, atol=1e-9)
    assert np.all(found.ok & (found.status == VelocityStatus.REACHED))
    assert not np.any(found.saturated)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("task", ["direction", "position"])
def test_what_a_task_does_not_bind_is_free(rng, task, frame):
    q, twist = postures(NIRYO, rng, 60), rng.uniform(-1, 1, (60, 6))
    found = velocity_ik(NIRYO, q, twist, frame=frame, task=task, tool_axis=AXIS)
    given = np.asarray(nj.tool_velocity(NIRYO, q, found.rate, frame=frame))
    off = in_tool(NIRYO, q, given - twist, frame)
    np.testing.assert_allclose(off[:, 3:], 0, atol=1e-12)
    if task == "direction":
        # How the axis moves is bound, and the turn about it is not.
        np.testing.assert_allclose(np.cross(off[:, :3], AXIS), 0, atol=1e-12)
    assert np.max(np.abs(off)) > 0.1
    np.testing.assert_allclose(found.residual, 0, atol=1e-12)
    whole = np.asarray(velocity_ik(NIRYO, q, twist, frame=frame).rate)
    assert np.all(np.linalg.norm(found.rate, axis=1) <= np.linalg.norm(whole, axis=1) + 1e-6)


LIMITED = {"rate_limits": np.full(6, 0.8), "dt": 0.05}


@pytest.mark.parametrize("keep_direction", [False, True])
def test_one_motion_gets_the_same_rates_in_every_frame(rng, keep_direction):
    q = rng.uniform(NIRYO.lower, NIRYO.upper, (60, 6))
    rates = rng.uniform(-1, 1, (60, 6))
    found = {
        frame: velocity_ik(
            NIRYO,
            q,
            nj.tool_velocity(NIRYO, q, rates, frame=frame),
            frame=frame,
            keep_direction=keep_direction,
            **LIMITED,
        )
        for frame in FRAMES
    }
    assert np.any(found["body"].saturated)
    assert np.any(found["body"].damping > 0)
    for frame in FRAMES:
        np.testing.assert_allclose(found[frame].rate, found["body"].rate, atol=1e-9)
        residual = in_tool(NIRYO, q, np.asarray(found[frame].residual), frame)
        np.testing.assert_allclose(residual, found["body"].residual, atol=1e-9)


def test_null_motion_is_taken_as_far_as_the_tool_does_not_see_it(rng):
    q, twist, wish = postures(IIWA, rng, 60), rng.uniform(-1, 1, (60, 6)), rng.normal(size=(60, 7))
    found = velocity_ik(IIWA, q, twist, null_motion=wish, frame="body")
    jacobian = body_jacobian(IIWA, q)
    inverse = np.linalg.pinv(jacobian)
    seen = np.einsum("bij,bjk,bk->bi", inverse, jacobian, wish)
    expected = np.einsum("bij,bj->bi", inverse, twist) + wish - seen
    np.testing.assert_allclose(found.rate, expected, rtol=1e-9, atol=1e-9)
    without = velocity_ik(IIWA, q, twist, frame="body")
    assert np.max(np.abs(found.rate - without.rate)) > 0.5
    for answer in (found, without):
        given = np.einsum("bij,bj->bi", jacobian, answer.rate)
        np.testing.assert_allclose(given, twist, atol=1e-12)


def test_null_motion_near_a_singularity_leaves_the_tool_alone(rng):
    q = postures(IIWA, rng, 60)
    q[:, 3] = rng.uniform(-1e-3, 1e-3, 60)  # stretched
    wish = rng.normal(size=(60, 7))
    found = velocity_ik(IIWA, q, np.zeros(6), null_motion=wish)
    assert np.all(found.damping > 0)
    np.testing.assert_allclose(nj.tool_velocity(IIWA, q, found.rate), 0, atol=5e-5)


# Singularities


def test_damping_is_that_of_the_smallest_singular_value(rng):
    q = rng.uniform(NIRYO.lower, NIRYO.upper, (60, 6))
    found = velocity_ik(NIRYO, q, np.ones(6), damping=0.1, threshold=0.05)
    smallest = np.linalg.svd(body_jacobian(NIRYO, q), compute_uv=False)[:, -1]
    np.testing.assert_allclose(found.smallest_singular_value, smallest, rtol=0, atol=1e-8)
    expected = 0.1 * np.sqrt(np.maximum(0, 1 - (smallest / 0.05) ** 2))
    np.testing.assert_allclose(found.damping, expected, atol=1e-6)
    assert np.all(np.linalg.norm(found.residual, axis=1)[expected == 0] < 1e-12)
    assert np.any(found.status == VelocityStatus.SINGULAR)
    jacobian = body_jacobian(NIRYO, q)
    twist = in_tool(NIRYO, q, np.ones((60, 6)), "tool_point")
    gram = np.swapaxes(jacobian, 1, 2) @ jacobian + (expected**2)[:, None, None] * np.eye(6)
    right = np.einsum("bji,bj->bi", jacobian, twist)
    rate = np.linalg.solve(gram, right[..., None])[..., 0]
    np.testing.assert_allclose(found.rate, rate, rtol=1e-4, atol=1e-6)


def test_the_smallest_singular_value_of_any_matrices(rng):
    function = jax.jit(squared_smallest_value)
    values = 10.0 ** rng.uniform(-4, 0.3, (3, 400, 5))
    values[0, :, 1:3] = values[0, :, :1]
    values[1, :200, 0] = 0
    values[1, 200:, :3] = 0
    values[2, :100] = values[2, :100, :1]
    values = values.reshape(-1, 5)
    left, right = (np.linalg.qr(rng.normal(size=(len(values), k, k)))[0][..., :5] for k in (5, 7))
    matrix = np.einsum("bik,bk,bjk->ijb", left, values, right)
    for dtype in DTYPES:
        rounding = 20 * np.finfo(dtype).eps * np.max(values, axis=1) ** 2
        found = np.asarray(function(matrix.astype(dtype)), float)
        off = np.abs(found - np.min(values, axis=1) ** 2)
        assert np.all(off <= rounding + 1e-6 * np.min(values, axis=1) ** 2)
        wide, tall = function(jnp.zeros((2, 3, 1), dtype)), function(jnp.zeros((3, 2, 1), dtype))
        np.testing.assert_array_equal([wide, tall], 0)


SINGULAR = {
    "wrist of an IRB120": (book.abb_irb120(), [0.3, -0.4, 0.5, 0.2, np.pi / 2, -0.7]),
    "stretched iiwa": (IIWA, np.zeros(7)),
    "wrist of a Niryo One": (NIRYO, [0.2, 0.1, -0.3, 0.4, 0.0, 0.1]),
}


@pytest.mark.parametrize(
    ("name", "dtype"),
    [
        ("wrist of an IRB120", np.float64),
        ("wrist of a Niryo One", np.float32),
        ("stretched iiwa", np.float64),
        ("stretched iiwa", np.float32),
    ],
)
def test_rates_and_derivatives_are_finite_at_singularities(name, dtype):
    robot, q = SINGULAR[name]
    n = robot.joints
    twist = np.stack([np.ones(6), np.zeros(6), np.eye(6)[3], -np.ones(6)]).astype(dtype)
    limits = np.full((2, 1, n), 0.5, dtype)
    limits[1] = np.inf

    @jax.jit
    def gradients(q, twist, limits):
        def total(q, twist, limits):
            wish = {"null_motion": 0.1 * jnp.ones(n, q.dtype)} if n > 6 else {}
            found = velocity_ik(robot, q, twist, rate_limits=limits, **wish)
            parts = found.rate, found.residual, found.damping, found.smallest_singular_value
            return sum(jnp.sum(x) for x in parts), found

        return jax.grad(total, (0, 1), has_aux=True)(q, twist, limits)

    slopes, found = gradients(jnp.asarray(q, dtype), twist, limits)
    assert found.rate.dtype == dtype
    for part in (*slopes, *jax.tree.leaves(found)):
        assert np.all(np.isfinite(part))
    assert np.all(np.abs(found.rate[0]) <= dtype(0.5))
    assert np.all(found.ok)


# Limits


def box_of(robot, q, rate, dt):
    """The same box, in plain numpy."""
    lower = np.clip((robot.lower - q) / dt, -rate, rate)
    return lower, np.clip((robot.upper - q) / dt, -rate, rate)


@pytest.mark.parametrize("name", ARMS)
def test_rates_within_limits_are_the_optimum_of_scipy(rng, name):
    optimize = pytest.importorskip("scipy.optimize")
    robot = ARMS[name]
    n = robot.joints
    q = rng.uniform(robot.lower, robot.upper, (60, n))
    q[:20, 0], q[20:40, n - 1] = robot.lower[0], robot.upper[n - 1]
    q[40:50, n - 2] = 0.0
    twist = rng.uniform(-1, 1, (60, 6))
    twist[50:56, :3] = 0
    limits = rng.uniform(0.05, 1.5, (60, n))
    found = velocity_ik(robot, q, twist, frame="body", rate_limits=limits, dt=0.1)
    assert np.all(found.ok)
    assert np.sum(np.any(found.saturated, axis=1)) > 40
    lower, upper = box_of(robot, q, limits, 0.1)
    jacobian, rate = body_jacobian(robot, q), np.asarray(found.rate)
    for i in range(60):
        square = float(found.damping[i])
        matrix = np.vstack([jacobian[i], square * np.eye(n)])
        right = np.concatenate([twist[i], np.zeros(n)])
        # scipy wants room between the bounds.
        room = 1e-13 * (upper[i] <= lower[i])
        truth = optimize.lsq_linear(
            matrix, right, (lower[i], upper[i] + room), method="bvls", tol=1e-14, max_iter=500
        )
        cost = 0.5 * np.sum((matrix @ rate[i] - right) ** 2)
        assert cost <= truth.cost + 1e-12
        if n == 6:
            np.testing.assert_allclose(rate[i], truth.x, atol=1e-6)
    assert np.all((rate >= lower) & (rate <= upper))


SIZES = (6, 6), (6, 7), (6, 4), (3, 6)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_degenerate_problems_have_optima_too(rng, size):
    optimize = pytest.importorskip("scipy.optimize")
    m, n = size
    count = 50
    matrix = rng.normal(size=(count, m, n))
    matrix[:10, :, 1] = matrix[:10, :, 0]  # two joints that do the same
    matrix[10:15, m - 1] = matrix[10:15, 0]  # rows that say the same
    matrix[15:20, :, 0] = 0  # a joint that does nothing
    matrix[20] = 0
    right = rng.normal(size=(count, m))
    lower, upper = -(10.0 ** rng.uniform(-1.5, 0.3, (count, n))), 10.0 ** rng.uniform(-1.5, 0.3, n)
    upper = np.broadcast_to(upper, lower.shape).copy()
    lower[30:35, 0] = upper[30:35, 0] = 0.1  # one that may do one thing alone
    upper[35:40, :2] = 0.0
    lower[40:44] = -np.inf
    upper[44:47] = np.inf
    right[47] = 0
    zero = np.zeros((n, count))
    for dtype, exact in ((np.float64, 1e-10), (np.float32, 2e-5)):
        given = (
            np.moveaxis(matrix, 0, -1),
            right.T,
            np.zeros(count),
            zero,
            lower.T,
            upper.T,
        )
        problem = Problem(*(jnp.asarray(x, dtype) for x in given))
        x, held = bounded(problem)
        assert np.max(missed(problem, x)) < exact
        x, held, problem = jax.tree.map(np.asarray, (x, held, problem))
        assert np.all((x >= problem.lower) & (x <= problem.upper))
        np.testing.assert_array_equal(x[held > 0], problem.upper[held > 0])
        np.testing.assert_array_equal(x[held < 0], problem.lower[held < 0])
        for i in range(count):
            room = 1e-13 * (upper[i] <= lower[i])
            truth = optimize.lsq_linear(
                matrix[i], right[i], (lower[i], upper[i] + room), method="bvls", tol=1e-14
            )
            cost = 0.5 * np.sum((matrix[i] @ x[:, i].astype(float) - right[i]) ** 2)
            assert cost <= truth.cost + exact


@given(st.lists(st.floats(-1, 1, width=16), min_size=54, max_size=54), st.booleans())
def test_no_rates_of_any_problem_are_better(numbers, loose):
    numbers = np.array(numbers)
    matrix, right = numbers[:36].reshape(6, 6, 1), numbers[36:42, None]
    lower, upper = -np.abs(numbers[42:48, None]), np.abs(numbers[48:, None])
    zero = np.zeros((6, 1))
    problem = Problem(matrix, right, np.zeros(1), zero, (1 + loose) * lower, upper)
    x, _ = bounded(jax.tree.map(jnp.asarray, problem))
    assert np.all((x >= problem.lower) & (x <= upper))
    assert float(missed(problem, x)[0]) < 1e-7


@pytest.mark.parametrize("keep_direction", [False, True])
@pytest.mark.parametrize("dtype", DTYPES)
def test_limits_are_never_exceeded(rng, dtype, keep_direction):
    lower, upper = (np.asarray(x, dtype) for x in (NIRYO.lower, NIRYO.upper))
    q = rng.uniform(lower, upper, (400, 6)).astype(dtype)
    at_limit = rng.random((400, 6))
    q = np.where(at_limit < 0.2, lower, np.where(at_limit > 0.8, upper, q))
    twist = rng.uniform(-2, 2, (400, 6)).astype(dtype)
    limits = rng.uniform(0.01, 2, (400, 6)).astype(dtype)
    found = velocity_ik(
        NIRYO, q, twist, rate_limits=limits, dt=dtype(0.02), keep_direction=keep_direction
    )
    rate = np.asarray(found.rate)
    assert np.all(np.abs(rate) <= limits)
    # Not outward, not by the last bit.
    assert np.all(rate[q == lower] >= 0)
    assert np.all(rate[q == upper] <= 0)
    after = q + dtype(0.02) * rate
    rounding = 8 * np.finfo(dtype).eps
    assert np.all((after >= lower - rounding) & (after <= upper + rounding))
    assert np.all(found.ok)
    on_bound = (np.abs(rate) == limits) | ((q == lower) | (q == upper)) & (rate == 0)
    assert np.all(np.asarray(found.saturated) >= on_bound)


def test_a_joint_outside_goes_back_as_fast_as_it_may():
    q = np.array([0.0, 0.1, -0.3, 0.2, 0.5, 0.1])
    q[0] = NIRYO.upper[0] + 0.02
    q[1] = NIRYO.lower[1] - 1e-4
    for keep_direction in (False, True):
        found = velocity_ik(
            NIRYO, q, np.zeros(6), rate_limits=np.ones(6), dt=0.01, keep_direction=keep_direction
        )
        np.testing.assert_allclose(found.rate[:2], [-1, 0.01], atol=1e-9)
        assert np.all(np.asarray(found.saturated)[:2])


def test_joints_brake_in_time_and_change_their_rates_as_they_may(rng):
    dt, change, fastest = 0.02, np.full(6, 4.0), np.full(6, 1.5)
    q = np.tile([0.1, 0.0, -0.5, 0.3, 0.4, 0.1], (60, 1))
    rate = np.zeros((60, 6))
    at_limits = np.zeros((60, 6), bool)
    twist = rng.uniform(-1, 1, (60, 6))
    for step in range(80):
        if step % 25 == 24:
            twist = rng.uniform(-1, 1, (60, 6))
        found = velocity_ik(
            NIRYO,
            q,
            twist,
            rate_limits=fastest,
            dt=dt,
            acceleration_limits=change,
            previous_rate=rate,
        )
        after = np.asarray(found.rate)
        assert np.all(np.abs(after - rate) <= change * dt + 1e-12)
        assert np.all(np.abs(after) <= fastest)
        rate, q = after, q + dt * after
        assert np.all((q >= NIRYO.lower - 1e-12) & (q <= NIRYO.upper + 1e-12))
        at_limits |= (q < NIRYO.lower + 0.02) | (q > NIRYO.upper - 0.02)
    assert np.sum(at_limits) > 10


def test_keeping_the_direction_slows_all_joints_alike(rng):
    q, twist = postures(NIRYO, rng, 60), rng.uniform(-1, 1, (60, 6))
    free = velocity_ik(NIRYO, q, twist)
    limits = np.full(6, 0.7)
    found = velocity_ik(NIRYO, q, twist, rate_limits=limits, keep_direction=True)
    expected = np.minimum(1, 0.7 / np.max(np.abs(free.rate), axis=1))
    np.testing.assert_allclose(found.scale, expected, rtol=1e-12)
    np.testing.assert_allclose(found.rate, expected[:, None] * free.rate, atol=1e-12)
    given = np.asarray(nj.tool_velocity(NIRYO, q, found.rate))
    np.testing.assert_allclose(given, expected[:, None] * twist, atol=1e-11)
    np.testing.assert_allclose(found.residual, twist - given, atol=1e-11)
    np.testing.assert_array_equal(np.any(found.saturated, axis=1), expected < 1)
    nearest = velocity_ik(NIRYO, q, twist, rate_limits=limits, frame="tool_point")
    assert np.all(
        np.linalg.norm(nearest.residual, axis=1) <= np.linalg.norm(found.residual, axis=1) + 1e-9
    )


def test_weights_say_what_counts_where_not_all_can_be_had(rng):
    q, twist = postures(NIRYO, rng, 60), rng.uniform(-1, 1, (60, 6))
    twist[:, 3:] *= 0.2
    limits = np.full(6, 0.8)
    weights = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    alike = velocity_ik(NIRYO, q, twist, rate_limits=limits)
    placed = velocity_ik(NIRYO, q, twist, rate_limits=limits, weights=weights)
    off = [np.linalg.norm(np.asarray(x.residual)[:, 3:], axis=1) for x in (alike, placed)]
    assert np.mean(off[1]) < 0.5 * np.mean(off[0])
    free = [velocity_ik(NIRYO, q, twist, weights=w).rate for w in (None, weights)]
    np.testing.assert_allclose(*free, atol=1e-8)


def test_arms_that_cannot_move_so_come_as_near_as_they_can(rng):
    q, twist = rng.uniform(-2, 2, (20, 3)), rng.uniform(-1, 1, (20, 6))
    found = velocity_ik(SMALL, q, twist, frame="body", threshold=0.0)
    truth = [np.linalg.lstsq(a, b)[0] for a, b in zip(body_jacobian(SMALL, q), twist)]
    np.testing.assert_allclose(found.rate, truth, atol=1e-9)
    assert np.all(found.status == VelocityStatus.IMPOSSIBLE)
    assert np.all(found.ok)


# Derivatives


NARROW = dataclasses.replace(SMALL, lower=np.full(3, -2.0), upper=np.full(3, 2.0))


def all_limits(n):
    return {
        "rate_limits": np.full(n, 1.0),
        "dt": 0.1,
        "acceleration_limits": np.full(n, 8.0),
        "previous_rate": np.linspace(-0.5, 0.5, n),
    }


CASES = {
    "no limits": (NIRYO, {"threshold": np.repeat([0.01, 0.5], 20), "damping": 0.2}),
    "all limits": (NIRYO, all_limits(6)),
    "one direction": (NIRYO, {"rate_limits": np.full(6, 1.0), "keep_direction": True}),
    "spare joint": (IIWA, {"null_motion": np.linspace(-1, 1, 7), "rate_limits": np.full(7, 1.5)}),
    "few joints": (NARROW, {**all_limits(3), "frame": "space"}),
}


@pytest.mark.parametrize("name", CASES)
def test_derivatives_equal_finite_differences(rng, name):
    robot, options = CASES[name]
    n = robot.joints
    q = postures(robot, rng, 40) if n >= 6 else rng.uniform(-2, 2, (40, n))
    twist = rng.uniform(-0.7, 0.7, (40, 6))
    dq, dtwist = rng.normal(size=(40, n)), rng.normal(size=(40, 6))

    def rates(q, twist):
        found = velocity_ik(robot, q, twist, **options)
        return jnp.concatenate([found.rate, found.residual], axis=-1), found.saturated

    # Values too, so that one program is compiled.
    @jax.jit
    def slopes(q, twist):
        return jax.jvp(rates, (q, twist), (dq, dtwist), has_aux=True)

    # What is spare of an arm that misses its twist is known to a part in 10^8.
    h, close = (1e-4, 1e-4) if "null_motion" in options else (1e-6, 2e-6)
    (after, _, held_after), (before, _, held_before) = (
        slopes(q + s * h * dq, twist + s * h * dtwist) for s in (1, -1)
    )
    same = np.all(np.asarray(held_after) == np.asarray(held_before), axis=1)
    assert np.sum(same) > 30
    if "rate_limits" in options or "dt" in options:
        assert np.sum(held_after) > 5
    expected = (np.asarray(after) - np.asarray(before))[same] / (2 * h)
    value, found, _ = slopes(q, twist)
    scale = 1 + np.max(np.abs(expected), axis=1, keepdims=True)
    assert np.max(np.abs(np.asarray(found)[same] - expected) / scale) < close
    if name == "few joints":
        pull = jax.jit(lambda q, twist: jax.vjp(lambda *x: rates(*x)[0], q, twist)[1](value))
        back = sum(np.sum(x * y, axis=-1) for x, y in zip(pull(q, twist), (dq, dtwist)))
        np.testing.assert_allclose(back, np.sum(value * found, axis=-1), rtol=1e-7, atol=1e-7)


def test_the_derivative_by_the_arm_equals_finite_differences(rng):
    q, twist, change = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 6), rng.normal(size=(4, 4))
    change[3] = 0

    @jax.jit
    def rates(share):
        home = SMALL.home + share * change
        return velocity_ik(dataclasses.replace(SMALL, home=home), q, twist, task="position").rate

    found = jax.jvp(rates, (0.0,), (1.0,))[1]
    expected = (rates(1e-6) - rates(-1e-6)) / 2e-6
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


def test_infinite_limits_limit_nothing_and_have_no_derivative():
    q, twist = np.array([0.3, -0.4, 0.5]), np.ones(6)
    free = velocity_ik(SMALL, q, twist).rate

    @jax.jit
    def total(dt, change):
        found = velocity_ik(
            SMALL,
            q,
            twist,
            rate_limits=np.full(3, np.inf),
            dt=dt,
            acceleration_limits=change,
            previous_rate=np.zeros(3),
        )
        return jnp.sum(found.rate), found.rate

    assert np.all(np.isinf(SMALL.upper))
    slopes, rate = jax.grad(total, (0, 1), has_aux=True)(0.1, np.full(3, 1e3))
    np.testing.assert_allclose(rate, free, atol=1e-12)
    for slope in slopes:
        np.testing.assert_array_equal(slope, 0)


# Batches, types, arguments


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_broadcast_and_the_dtype_is_that_of_the_input(batch, dtype):
    function = functools.partial(velocity_ik, SMALL, dt=0.1, rate_limits=np.ones(3))
    shapes = [((*batch, 3), (6,)), ((3,), (*batch, 6)), ((*batch, 3), (*batch, 6))]
    for shape in shapes:
        found = jax.eval_shape(function, *(jax.ShapeDtypeStruct(s, dtype) for s in shape))
        assert (found.rate.shape, found.rate.dtype) == ((*batch, 3), dtype)
        assert (found.residual.shape, found.residual.dtype) == ((*batch, 6), dtype)
        assert (found.saturated.shape, found.saturated.dtype) == ((*batch, 3), bool)
        for one in (found.scale, found.smallest_singular_value, found.damping, found.optimality):
            assert (one.shape, one.dtype) == (batch, dtype)
        assert found.status.shape == batch


def test_a_batch_is_what_its_elements_are(rng):
    q, twist = rng.uniform(-2, 2, (3, 2, 3)), rng.uniform(-1, 1, (3, 2, 6))
    options = {"rate_limits": np.full(3, 0.5), "task": "position"}
    whole = velocity_ik(SMALL, q, twist, **options)
    one = velocity_ik(SMALL, q[2, 1], twist[2, 1], **options)
    np.testing.assert_allclose(one.rate, whole.rate[2, 1], atol=1e-12)
    assert velocity_ik(SMALL, q[:0], twist[:0], **options).rate.shape == (0, 2, 3)
    function = functools.partial(velocity_ik, **options)
    mapped = jax.vmap(jax.vmap(functools.partial(function, SMALL)))(q, twist)
    np.testing.assert_allclose(mapped.rate, whole.rate, atol=1e-12)
    traced = jax.jit(function)(SMALL, q, twist)
    np.testing.assert_allclose(traced.rate, whole.rate, atol=1e-12)
    # More than are worked out at a time.
    many = velocity_ik(SMALL, np.tile(q, (300, 1, 1)), np.tile(twist, (300, 1, 1)), **options)
    np.testing.assert_allclose(many.rate, np.tile(whole.rate, (300, 1, 1)), atol=1e-12)


def test_numbers_that_are_none_get_no_rates_and_spoil_no_others(rng):
    q, twist = rng.uniform(-1, 1, (6, 3)), rng.uniform(-1, 1, (6, 6))
    q[1, 0], q[2, 2], twist[3, 4], twist[4, 0] = np.nan, np.inf, np.nan, -np.inf
    options = {"rate_limits": np.full(3, 0.5)}

    @jax.jit
    def answer(q, twist):
        found = velocity_ik(SMALL, q, twist, **options)
        return jnp.sum(found.rate), found

    slopes, found = jax.grad(answer, (0, 1), has_aux=True)(q, twist)
    bad = np.array([0, 1, 1, 1, 1, 0], bool)
    np.testing.assert_array_equal(found.status == VelocityStatus.INVALID, bad)
    np.testing.assert_array_equal(~found.ok, bad)
    np.testing.assert_array_equal(np.asarray(found.rate)[bad], 0)
    assert np.all(np.isinf(np.asarray(found.residual)[bad]))
    for slope in slopes:
        assert np.all(np.isfinite(slope))
    clean = velocity_ik(SMALL, q[~bad], twist[~bad], **options)
    np.testing.assert_allclose(np.asarray(found.rate)[~bad], clean.rate, atol=1e-12)
    assert VelocityStatus(int(found.status[1])).message.startswith("A number is not finite")


WRONG = {
    "dt": [(0.0, "above 0"), (-0.1, "above 0"), (np.nan, "above 0")],
    "damping": [(-0.1, "of 0 or more"), (np.nan, "of 0 or more")],
    "threshold": [(-1.0, "of 0 or more")],
    "rate_limits": [(np.zeros(6), "above 0"), (np.array([1, 1, 1, 1, 1, -1.0]), "above 0")],
    "weights": [(np.array([1, 1, 1, 1, 1, 0.0]), "above 0")],
}


@pytest.mark.parametrize("name", WRONG)
def test_numbers_out_of_range_are_refused_by_name(name):
    for value, expected in WRONG[name]:
        with pytest.raises(ValueError, match=rf"^{name}: expected numbers {expected}, got"):
            velocity_ik(NIRYO, np.zeros(6), np.zeros(6), **{name: value})


def test_wrong_arguments_are_refused_by_name():
    q, twist = np.zeros(6), np.zeros(6)
    with pytest.raises(TypeError, match=r"^robot: expected"):
        velocity_ik(np.eye(6), q, twist)
    with pytest.raises(ValueError, match=r"^q: expected shape \(\.\.\., 6\), got \(5,\)"):
        velocity_ik(NIRYO, q[:5], twist)
    with pytest.raises(ValueError, match=r"^twist: expected shape \(\.\.\., 6\), got \(3,\)"):
        velocity_ik(NIRYO, q, twist[:3])
    for name in ("rate_limits", "null_motion", "previous_rate", "acceleration_limits", "weights"):
        with pytest.raises(ValueError, match=rf"^{name}: expected shape \(\.\.\., 6\), got"):
            velocity_ik(NIRYO, q, twist, **{name: np.ones(7)})
        with pytest.raises(TypeError, match=rf"^{name}: expected an array of numbers"):
            velocity_ik(NIRYO, q, twist, **{name: "fast"})
    with pytest.raises(ValueError, match=r"^frame: expected one of 'space', 'body', 'tool_p"):
        velocity_ik(NIRYO, q, twist, frame="world")
    with pytest.raises(ValueError, match=r"^task: expected one of 'pose', 'direction', 'pos"):
        velocity_ik(NIRYO, q, twist, task="turn")
    with pytest.raises(ValueError, match=r"^acceleration_limits, previous_rate: expected both"):
        velocity_ik(NIRYO, q, twist, dt=0.1, acceleration_limits=np.ones(6))
    with pytest.raises(ValueError, match=r"^dt: expected the seconds that rates are kept"):
        velocity_ik(NIRYO, q, twist, acceleration_limits=np.ones(6), previous_rate=np.zeros(6))
    with pytest.raises(ValueError, match=r"^q, twist.*rate_limits: expected batch axes that broad"):
        velocity_ik(NIRYO, np.zeros((3, 6)), twist, rate_limits=np.ones((2, 6)))


def test_free_and_bounded_answers_agree_where_no_bound_holds(rng):
    given = rng.normal(size=(5, 6, 9)), rng.normal(size=(5, 9)), np.full(9, 1e-3)
    problem = Problem(
        *given, rng.normal(size=(6, 9)), np.full((6, 9), -99.0), np.full((6, 9), 99.0)
    )
    problem = jax.tree.map(jnp.asarray, problem)
    x, held = bounded(problem)
    assert not np.any(held)
    np.testing.assert_allclose(x, jax.jit(free_least_squares)(problem), atol=1e-9)
