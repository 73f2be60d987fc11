"""Time along moves and paths: limits are kept, and nothing is faster that keeps them."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import logging
import math

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from support import BATCHES, DTYPES, eps

import niryo_jax as nj
from niryo_jax import motion
from niryo_jax.motion.fastest import squared_rates
from niryo_jax.motion.spline import place_at, spline_through

LIMITS = motion.niryo_limits()
PROFILES = "trapezoid", "quintic", "scurve"
METHODS = "fastest", "quintic"
MOVES = 40
BETWEEN = 1e-4, 1e-8
"""How far velocities and accelerations may pass their limits between nodes, as shares."""

every_profile = pytest.mark.parametrize("profile", PROFILES)
every_method = pytest.mark.parametrize("method", METHODS)
straight_or_not = pytest.mark.parametrize("straight", [False, True])


@pytest.fixture(scope="module")
def niryo():
    return nj.robots.niryo_one()


@pytest.fixture(scope="module")
def ends():
    """Start and end of moves: small and large ones, joints that rest, one move of no joint."""
    rng = np.random.default_rng(1)
    start = rng.uniform(-2, 2, (MOVES, 6))
    way = rng.uniform(-1, 1, (MOVES, 6)) * 10.0 ** rng.uniform(-4, 0.5, (MOVES, 1))
    way[rng.uniform(size=way.shape) < 0.15] = 0
    way[0] = 0
    way[1], way[1, 3] = 0, 1.0
    return start, start + way


def waypoints(seed, count=6, wide=1.2):
    return np.random.default_rng(seed).uniform(-wide, wide, (count, 6))


@functools.cache
def timed(seed, method, count=6):
    return motion.retime(waypoints(seed, count), LIMITS, method=method)


def numbers(trajectory):
    """The same in numpy."""
    return motion.JointTrajectory(*map(np.asarray, trajectory))


def shares(trajectory, limits=LIMITS):
    """The largest velocity and acceleration of any joint, as shares of their limits."""
    return [
        np.max(np.abs(np.asarray(rate)) / np.asarray(most))
        for rate, most in (
            (trajectory.velocity, limits.velocity),
            (trajectory.acceleration, limits.acceleration),
        )
    ]


def consistent(trajectory, jerk):
    """q and the velocity are the sums of their rates, to second order of the step."""
    time = np.asarray(trajectory.time)
    step = np.diff(time, axis=-1)[..., None]
    largest = float(step.max())
    _, q, velocity, acceleration = (np.asarray(x) for x in trajectory)
    mean = 0.5 * (velocity[..., 1:, :] + velocity[..., :-1, :])
    most = 1.01 * np.max(np.abs(acceleration)) + 1e-12
    np.testing.assert_allclose(np.diff(q, axis=-2), mean * step, atol=0.26 * most * largest**2)
    mean = 0.5 * (acceleration[..., 1:, :] + acceleration[..., :-1, :])
    np.testing.assert_allclose(np.diff(velocity, axis=-2), mean * step, atol=jerk * largest**2)


# Limits


def test_niryo_limits_are_those_of_the_planner():
    for name, model in nj.robots.niryo.MODELS.items():
        limits = motion.niryo_limits(name)
        np.testing.assert_array_equal(limits.velocity, model.max_velocity)
        np.testing.assert_array_equal(limits.acceleration, model.max_acceleration)
        np.testing.assert_allclose(limits.jerk, 10 * np.array(model.max_acceleration))
    half = LIMITS.scaled(0.5, acceleration=0.25)
    np.testing.assert_allclose(half.velocity, 0.5 * LIMITS.velocity)
    np.testing.assert_allclose(half.acceleration, 0.25 * LIMITS.acceleration)
    np.testing.assert_array_equal(half.jerk, LIMITS.jerk)
    assert motion.MotionLimits([1.0], [2.0]).scaled(2.0).jerk is None
    doubled = jax.tree.map(lambda x: 2 * x, LIMITS)
    np.testing.assert_array_equal(doubled.jerk, 2 * LIMITS.jerk)


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
def test_limits_that_are_none_are_refused_by_name(name, wrong):
    numbers = np.ones(3)
    numbers[1] = wrong
    with pytest.raises(ValueError, match=f"^{name}: expected positive, finite numbers"):
        dataclasses.replace(motion.MotionLimits(*np.ones((3, 3))), **{name: numbers})


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: motion.MotionLimits(1.0, 1.0), ValueError, r"^velocity: expected shape \(n,\)"),
        (lambda: motion.MotionLimits([1, 1], [1]), ValueError, r"^acceleration: expected .*\(2,\)"),
        (lambda: motion.MotionLimits("fast", [1]), TypeError, "^velocity: expected an array"),
        (lambda: LIMITS.scaled(0.0), ValueError, "^velocity: expected a positive number"),
        (lambda: LIMITS.scaled(jerk=-1), ValueError, "^jerk: expected a positive number"),
        (lambda: motion.niryo_limits("niryo_two"), ValueError, "^name: expected one of"),
        (lambda: motion.CartesianLimits(linear=0.0), ValueError, "^linear: expected a positive"),
        (lambda: motion.CartesianLimits(angular=np.nan), ValueError, "^angular: expected a pos"),
        (lambda: motion.CartesianLimits("1"), TypeError, "^linear: expected a positive"),
    ],
)
def test_bad_limits_are_refused_by_name(make, error, message):
    with pytest.raises(error, match=message):
        make()


# From point to point


@straight_or_not
@every_profile
def test_moves_keep_all_limits_and_meet_both_ends_at_rest(ends, profile, straight):
    start, end = ends
    moves = motion.point_to_point(start, end, LIMITS, profile, straight=straight)
    duration = np.asarray(moves.duration)
    assert duration[0] == 0
    assert np.all(duration[1:] > 0)
    found = moves.at(np.linspace(0, 1, 1001) * duration[:, None])
    assert max(shares(found)) < 1 + 1e-9
    jerk = np.inf
    if profile != "trapezoid":
        step = np.maximum(np.diff(found.time, axis=1), 1e-300)[..., None]
        jerk = np.max(np.abs(np.diff(found.acceleration, axis=1)) / step / LIMITS.jerk)
        assert jerk < 1 + 1e-6
    consistent(found, 1e3 if profile == "trapezoid" else 20.0)
    np.testing.assert_array_equal(found.q[:, 0], start)
    np.testing.assert_array_equal(found.q[:, -1], end)
    np.testing.assert_array_equal(found.velocity[:, [0, -1]], 0)
    # Each joint goes one way.
    steps = np.diff(found.q, axis=1) * np.sign(end - start)[:, None]
    assert np.all(steps >= -1e-13)
    if straight or profile == "quintic":
        share = np.linalg.norm(found.q - start[:, None], axis=-1)
        whole = np.maximum(np.linalg.norm(end - start, axis=-1), 1e-300)
        line = start[:, None] + (share / whole[:, None])[..., None] * (end - start)[:, None]
        np.testing.assert_allclose(found.q, line, atol=1e-13)


@straight_or_not
@every_profile
def test_no_move_is_shorter(ends, profile, straight):
    # Some limit is met: all bounds of the shape in use are looked at in closed form elsewhere.
    start, end = (x[1:] for x in ends)
    moves = motion.point_to_point(start, end, LIMITS, profile, straight=straight)
    found = moves.at(np.linspace(0, 1, 4001) * np.asarray(moves.duration)[:, None])
    met = np.maximum(
        np.max(np.abs(found.velocity) / LIMITS.velocity, axis=(1, 2)),
        np.max(np.abs(found.acceleration) / LIMITS.acceleration, axis=(1, 2)),
    )
    if profile != "trapezoid":
        step = np.diff(found.time, axis=1)[..., None]
        jerk = np.abs(np.diff(found.acceleration, axis=1)) / step / LIMITS.jerk
        met = np.maximum(met, np.max(jerk, axis=(1, 2)))
    assert np.all(met > 0.99)


def test_shapes_are_ordered_and_scale_with_time(ends):
    start, end = ends
    of = {p: np.asarray(motion.point_to_point(start, end, LIMITS, p).duration) for p in PROFILES}
    assert np.all(of["trapezoid"] <= of["scurve"] + 1e-12)
    assert np.all(of["scurve"] <= of["quintic"] + 1e-12)
    for profile in PROFILES:
        straight = motion.point_to_point(start, end, LIMITS, profile, straight=True)
        assert np.all(of[profile] <= straight.duration + 1e-12)
        # Twice the velocity, four times the acceleration, eight times the jerk: half the time.
        fast = motion.point_to_point(start, end, LIMITS.scaled(2, 4, 8), profile)
        np.testing.assert_allclose(fast.duration, 0.5 * of[profile], rtol=1e-12)
        back = motion.point_to_point(end, start, LIMITS, profile)
        np.testing.assert_allclose(back.duration, of[profile], rtol=1e-12)


@given(
    h=st.floats(1e-6, 10),
    v=st.floats(0.01, 10),
    a=st.floats(0.01, 10),
    j=st.floats(0.01, 100),
)
def test_an_s_curve_is_the_optimum_of_its_bounds(h, v, a, j):
    limits = motion.MotionLimits([v], [a], [j])
    duration = float(motion.point_to_point([0.0], [h], limits, "scurve").duration)

    # The length that a peak velocity p covers rises with p: bisection, for an independent answer.
    def speeding_up(p):
        return 2 * math.sqrt(p / j) if p * j < a * a else p / a + a / j

    low, high = 0.0, v
    if v * speeding_up(v) > h:
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if middle * speeding_up(middle) < h else (low, middle)
    peak = high
    assert duration == pytest.approx(h / peak + speeding_up(peak), rel=1e-9)


def test_ruckig_is_not_faster_nor_slower(ends):
    ruckig = pytest.importorskip("ruckig")
    start, end = ends
    duration = motion.point_to_point(start, end, LIMITS, "scurve").duration
    for q0, q1, ours in list(zip(start, end, np.asarray(duration)))[1:]:
        given = ruckig.InputParameter(6)
        given.current_position, given.target_position = q0.tolist(), q1.tolist()
        given.max_velocity, given.max_acceleration, given.max_jerk = (
            np.asarray(x).tolist() for x in (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)
        )
        answer = ruckig.Trajectory(6)
        assert ruckig.Ruckig(6).calculate(given, answer) == ruckig.Result.Working
        assert ours == pytest.approx(answer.duration, rel=1e-6, abs=1e-9)


@every_profile
def test_durations_and_joint_vectors_have_finite_true_derivatives(ends, profile):
    start, end = ends

    def total(start, end, limits):
        moves = motion.point_to_point(start, end, limits, profile)
        t = moves.duration[..., None] * jnp.array([0.0, 0.3, 0.7, 1.0])
        return jnp.sum(moves.duration) + jnp.sum(moves.at(t).q)

    gradients = jax.grad(total, (0, 1, 2))(start, end, LIMITS)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(gradients))
    rng = np.random.default_rng(0)
    moved = (np.abs(end - start) > 1e-3) * rng.standard_normal(end.shape)
    step = 1e-7
    ahead, behind = (total(start, end + s * moved, LIMITS) for s in (step, -step))
    found = np.sum(gradients[1] * moved)
    assert found == pytest.approx(float(ahead - behind) / (2 * step), rel=1e-4)


@every_profile
@pytest.mark.parametrize("dtype", DTYPES)
def test_moves_have_every_batch_shape_and_keep_the_type(profile, dtype):
    rng = np.random.default_rng(2)
    for batch in BATCHES:
        start = rng.uniform(-1, 1, (*batch, 6)).astype(dtype)
        moves = motion.point_to_point(start, np.ones(6, dtype), LIMITS, profile)
        found = moves.at(np.linspace(0, 1, 5))
        assert moves.duration.shape == batch
        assert found.q.shape == found.velocity.shape == (*batch, 5, 6)
        assert {x.dtype for x in jax.tree.leaves((moves, found))} == {np.dtype(dtype)}
    both = rng.uniform(-1, 1, (2, 3, 6)).astype(dtype)
    whole = motion.point_to_point(*both, LIMITS, profile).duration
    mapped = jax.jit(jax.vmap(lambda a, b: motion.point_to_point(a, b, LIMITS, profile).duration))(
        *both
    )
    np.testing.assert_allclose(whole, mapped, rtol=4 * eps(dtype))


def test_equal_steps_go_to_the_end_of_the_longest(ends):
    start, end = (x[:5] for x in ends)
    moves = motion.point_to_point(start, end, LIMITS)
    found = moves.every(0.01)
    np.testing.assert_allclose(np.diff(found.time), 0.01, rtol=1e-9)
    assert found.time[-2] < np.max(moves.duration) <= found.time[-1] + 1e-8
    np.testing.assert_array_equal(found.q[:, -1], end)
    with pytest.raises(TypeError, match=r"^every: expected a concrete duration"):
        jax.jit(lambda q: motion.point_to_point(q, q + 1, LIMITS).every(0.1).q)(start)
    with pytest.raises(ValueError, match=r"^step: expected a positive number"):
        moves.every(0.0)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"q_start": [0.0, np.nan]}, ValueError, "^q_start: expected finite numbers"),
        ({"q_end": [0.0, np.inf]}, ValueError, "^q_end: expected finite numbers"),
        ({"q_end": [0.0]}, ValueError, r"^q_end: expected shape \(\.\.\., 2\), got \(1,\)"),
        ({"limits": LIMITS}, ValueError, "^limits: expected those of 2 joints, got 6"),
        ({"limits": 1.0}, TypeError, "^limits: expected MotionLimits, got float"),
        ({"profile": "linear"}, ValueError, "^profile: expected one of 'trapezoid'"),
        ({"profile": "scurve"}, ValueError, "^limits: expected a jerk for the profile 'scurve'"),
        ({"straight": 1}, TypeError, "^straight: expected True or False"),
    ],
)
def test_bad_moves_are_refused_by_name(options, error, message):
    good = {"q_start": np.zeros(2), "q_end": np.ones(2)}
    good["limits"] = motion.MotionLimits(np.ones(2), np.ones(2))
    with pytest.raises(error, match=message):
        motion.point_to_point(**{**good, **options})


# Splines


def test_splines_are_those_of_scipy_and_repeats_do_not_matter():
    interpolate = pytest.importorskip("scipy.interpolate")
    s = np.linspace(0, 1, 301)
    q = np.stack([np.concatenate([waypoints(i, k), np.tile(0.0, (9 - k, 6))]) for i, k in SIZES])
    for i, (_, k) in enumerate(SIZES):
        q[i, k:] = q[i, k - 1]
    splines = spline_through(jnp.asarray(q))
    repeated = spline_through(jnp.asarray(np.repeat(q, 2, axis=1)))
    both = [place_at(x, jnp.asarray(s)) for x in (splines, repeated)]
    for i, (_, k) in enumerate(SIZES):
        chords = np.linalg.norm(np.diff(q[i, :k], axis=0), axis=1)
        knots = np.concatenate([[0], np.cumsum(chords) / chords.sum()])
        truth = interpolate.CubicSpline(knots, q[i, :k])
        for order in range(3):
            expected = truth(s, order)
            for place in both:
                np.testing.assert_allclose(
                    place[order][i], expected, atol=1e-12 * (1 + np.max(np.abs(expected)))
                )


SIZES = [(0, 2), (1, 3), (2, 4), (3, 5), (4, 9)]


# Along a path


@every_method
@pytest.mark.parametrize("seed", range(3))
def test_paths_keep_all_limits_between_samples_and_pass_every_waypoint(seed, method):
    path = timed(seed, method)
    found = numbers(path.at(np.linspace(0, float(path.duration), 100_001)))
    velocity, acceleration = shares(found)
    assert velocity < 1 + BETWEEN[0]
    assert acceleration < 1 + BETWEEN[1]
    assert max(velocity, acceleration) > 1 - 1e-3 or method == "quintic"
    consistent(found, 1e5)
    q = waypoints(seed)
    np.testing.assert_allclose(found.q[[0, -1]], q[[0, -1]], atol=1e-12)
    np.testing.assert_array_equal(found.velocity[[0, -1]], 0)
    for waypoint in q:
        assert np.min(np.max(np.abs(found.q - waypoint), axis=1)) < 1e-4
    if method == "quintic":
        third = np.diff(found.acceleration, axis=0) / np.diff(found.time)[:, None]
        assert 0.5 < np.max(np.abs(third) / LIMITS.jerk) < 1.01 or acceleration > 0.99


@every_method
@pytest.mark.parametrize("seed", range(8))
def test_limits_are_kept_on_the_worst_of_paths(seed, method):
    # Pieces of any length, turns on the spot, limits that differ by powers of ten.
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-7, 0, (16, 1))
    q = np.cumsum(scale * rng.standard_normal((16, 6)), axis=0)
    if seed % 2:
        q[1::4] = q[::4]
        q[2::4] = q[::4] + 1e-10
    limits = motion.MotionLimits(*10.0 ** rng.uniform(-1, 2, (3, 6)))
    path = motion.retime(q, limits, method=method)
    found = path.at(np.linspace(0, float(path.duration), 100_001))
    velocity, acceleration = shares(found, limits)
    assert velocity < 1 + BETWEEN[0]
    assert acceleration < 1 + 1e-6
    assert max(velocity, acceleration) > 0.99 or method == "quintic"


def test_a_straight_path_is_the_straight_move_of_a_trapezoid():
    q = waypoints(5, 2)
    path = motion.retime(q, LIMITS)
    move = motion.point_to_point(*q, LIMITS, straight=True)
    np.testing.assert_allclose(path.duration, move.duration, rtol=1e-3)
    assert path.duration >= move.duration * (1 - 1e-9)
    smooth = motion.retime(q, LIMITS, method="quintic")
    move = motion.point_to_point(*q, LIMITS, "quintic")
    np.testing.assert_allclose(smooth.duration, move.duration, rtol=1e-6)


@every_method
def test_repeated_waypoints_change_nothing(method):
    q = waypoints(0)
    for repeats in ([1, 2, 1, 3, 1, 1], [4, 1, 1, 1, 1, 9]):
        again = motion.retime(np.repeat(q, repeats, axis=0), LIMITS, method=method)
        np.testing.assert_allclose(again.duration, timed(0, method).duration, rtol=1e-9)
        t = np.linspace(0, 5, 7)
        np.testing.assert_allclose(again.at(t).q, timed(0, method).at(t).q, atol=1e-9)


@every_method
def test_a_path_that_goes_nowhere_takes_no_time(method):
    for q in (np.ones((1, 6)), np.ones((5, 6))):
        path = motion.retime(q, LIMITS, method=method)
        assert path.duration == 0
        found = path.at([0.0, 1.0])
        np.testing.assert_array_equal(found.q, np.ones((2, 6)))
        np.testing.assert_array_equal(found.velocity, 0)
        assert path.every(0.1).q.shape == (1, 6)
    # Of a batch, the others go on as they do alone.
    both = motion.retime(np.stack([np.ones((6, 6)), waypoints(0)]), LIMITS, method=method)
    assert both.duration[0] == 0
    np.testing.assert_allclose(both.duration[1], timed(0, method).duration, rtol=1e-12)
    np.testing.assert_allclose(both.at([0.7]).q[1], timed(0, method).at([0.7]).q, atol=1e-12)


def test_a_path_there_and_back_stops_where_it_turns():
    a, b = waypoints(8, 2)
    path = motion.retime([a, b, a], LIMITS)
    found = path.at(np.linspace(0, float(path.duration), 20_001))
    assert max(shares(found)) < 1 + BETWEEN[0]
    half = found.q[10_000]
    np.testing.assert_allclose(half, b, atol=1e-3)
    np.testing.assert_allclose(found.velocity[10_000], 0, atol=1e-2)


def test_rounding_of_a_joint_that_turns_round_changes_nothing():
    # Joint 2 bounds x alone at the middle node, where its slope is zero but for rounding.
    rng, count = np.random.default_rng(0), 64
    s = np.linspace(0, 1, 2 * count + 1)
    c = rng.uniform(1.2, 2.0, (256, 1))
    t = s - 0.5
    bend = np.stack([0 * c * t, c + 2 * t**2], axis=-1)
    exact = np.stack([1 + 0 * c * t, c * t + 2 / 3 * t**3], axis=-1)
    rounded = exact.copy()
    rounded[:, count, 1] = rng.uniform(-3e-17, 3e-17, 256)

    def within(x):
        return jnp.asarray(np.stack([x[:, :-1:2], x[:, 1::2], x[:, 2::2]], axis=2))

    most = jnp.full((256, count + 1), 10.0)
    step = jnp.full((256, count), 1 / count)
    squared = jax.jit(squared_rates)
    right, found = (squared(within(x), within(bend), most, step) for x in (exact, rounded))
    np.testing.assert_allclose(right[:, count // 2], 1 / c[:, 0], rtol=1e-3)
    np.testing.assert_allclose(found, right, rtol=1e-6)


@every_method
def test_time_scales_with_limits_and_runs_backwards(method):
    path = timed(1, method)
    fast = motion.retime(waypoints(1), LIMITS.scaled(2, 4, 8), method=method)
    np.testing.assert_allclose(fast.duration, 0.5 * path.duration, rtol=1e-9)
    back = motion.retime(waypoints(1)[::-1], LIMITS, method=method)
    np.testing.assert_allclose(back.duration, path.duration, rtol=2e-3)
    # Less is allowed: it takes longer.
    slow = motion.retime(waypoints(1), LIMITS.scaled(0.3), method=method)
    assert slow.duration > path.duration


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("seed", "count"), [(0, 6), (1, 6), (2, 6), (11, 3), (12, 12), (13, 16)])
def test_toppra_takes_as_long_to_one_percent(seed, count):
    ta = pytest.importorskip("toppra")
    ta.setup_logging(logging.WARNING) if hasattr(ta, "setup_logging") else None
    constraint, algorithm = (
        importlib.import_module(f"toppra.{name}") for name in ("constraint", "algorithm")
    )
    path = timed(seed, "fastest", count)
    velocity, acceleration = (
        np.stack([-np.asarray(x), np.asarray(x)], axis=1)
        for x in (LIMITS.velocity, LIMITS.acceleration)
    )
    theirs = algorithm.TOPPRA(
        [
            constraint.JointVelocityConstraint(velocity),
            constraint.JointAccelerationConstraint(acceleration),
        ],
        ta.SplineInterpolator(
            np.asarray(path.spline.knots)[:count], waypoints(seed, count), bc_type="not-a-knot"
        ),
        gridpoints=np.linspace(0, 1, 2049),
        parametrizer="ParametrizeConstAccel",
    ).compute_trajectory()
    assert float(path.duration) == pytest.approx(theirs.duration, rel=0.01)


def test_the_tool_keeps_its_limits(niryo):
    q = waypoints(2) * 0.4
    free = motion.retime(q, LIMITS, robot=niryo)

    def speeds(path):
        found = path.at(np.linspace(0, float(path.duration), 5001))
        twist = np.einsum("kij,kj->ki", nj.body_jacobian(niryo, found.q), found.velocity)
        return [np.linalg.norm(x, axis=1).max() for x in (twist[:, 3:], twist[:, :3])]

    linear, angular = speeds(free)
    for limits, which, most in (
        (motion.CartesianLimits(linear=0.1), 0, 0.1),
        (motion.CartesianLimits(angular=0.3), 1, 0.3),
    ):
        assert (linear, angular)[which] > 1.5 * most
        for method in METHODS:
            bound = motion.retime(q, LIMITS, robot=niryo, cartesian=limits, method=method)
            assert 0.98 * most < speeds(bound)[which] < most * (1 + 1e-4)
            assert bound.duration > free.duration
    loose = motion.CartesianLimits(10.0, 100.0)
    same = motion.retime(q, LIMITS, robot=niryo, cartesian=loose)
    np.testing.assert_allclose(same.duration, free.duration, rtol=1e-12)


def test_a_line_of_the_tool_is_timed_on_the_line(niryo):
    start, end = np.tile(np.eye(4), (2, 1, 1))
    start[:3, 3], end[:3, 3] = [0.25, -0.15, 0.2], [0.25, 0.15, 0.2]
    poses = motion.cartesian_trajectory(start, end, 1.0, 301, lambda u: u).pose
    best = motion.best_path(niryo, poses)
    assert best.ok, best.message
    # In the middle joints 2 and 3 turn round, at a node of the second.
    free = [motion.retime(best, LIMITS, intervals=n).duration for n in (2048, 4096)]
    np.testing.assert_allclose(*free, rtol=1e-3)
    path = motion.retime(best, LIMITS, robot=niryo, cartesian=motion.CartesianLimits(0.25))
    found = path.every(1e-3)
    assert max(shares(found)) < 1 + BETWEEN[0]
    assert np.max(np.abs(np.diff(found.q, axis=0))) < 1e-3 * 2.2
    reached = np.asarray(nj.forward_kinematics(niryo, found.q))
    assert np.max(np.abs(reached[:, [0, 2], 3] - [0.25, 0.2])) < 1e-9
    assert np.all(np.diff(reached[:, 1, 3]) > -1e-9)
    np.testing.assert_allclose(reached[[0, -1], 1, 3], [-0.15, 0.15], atol=1e-9)


@every_method
def test_durations_of_paths_have_finite_true_derivatives(method):
    q = np.repeat(waypoints(3, 4), [1, 2, 1, 1], axis=0)

    @jax.jit
    def duration(q, limits):
        return motion.retime(q, limits, method=method, intervals=128).duration

    slope = jax.grad(duration, (0, 1))(q, LIMITS)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(slope))
    step = 1e-6
    more, less = (duration(q, LIMITS.scaled(*(1 + s,) * 3)) for s in (step, -step))
    found = sum(np.sum(x * y) for x, y in zip(*map(jax.tree.leaves, (slope[1], LIMITS))))
    assert found == pytest.approx(float(more - less) / (2 * step), rel=1e-4)
    nowhere = jax.grad(duration, (0, 1))(np.ones((5, 6)), LIMITS)
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(nowhere))


@every_method
@pytest.mark.parametrize("dtype", DTYPES)
def test_paths_have_every_batch_shape_and_keep_the_type(method, dtype):
    rng = np.random.default_rng(2)
    for batch in BATCHES:
        q = rng.uniform(-1, 1, (*batch, 4, 6)).astype(dtype)
        path = motion.retime(q, LIMITS, method=method, intervals=64)
        found = path.at(np.linspace(0, 3, 9))
        assert path.duration.shape == batch
        assert found.q.shape == (*batch, 9, 6)
        assert {x.dtype for x in jax.tree.leaves((path, found))} == {np.dtype(dtype)}
        assert np.all(np.isfinite(found.acceleration))
    exact = motion.retime(q.astype(float), LIMITS, method=method, intervals=64)
    np.testing.assert_allclose(path.duration, exact.duration, rtol=1e-3)


def test_a_path_does_not_depend_on_its_batch():
    q = np.stack([waypoints(seed) for seed in range(6)]).reshape(2, 3, 6, 6)
    whole = motion.retime(q, LIMITS)
    for place in ((0, 0), (1, 2)):
        alone = motion.retime(q[place], LIMITS)
        np.testing.assert_allclose(whole.duration[place], alone.duration, rtol=1e-12)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"path": np.full((3, 6), np.nan)}, ValueError, "^path: expected finite numbers"),
        ({"path": np.zeros(6)}, ValueError, r"^path: expected shape \(\.\.\., n, n\)"),
        ({"path": np.zeros((0, 6))}, ValueError, "^path: expected one sample or more"),
        ({"path": np.zeros((3, 5))}, ValueError, "^limits: expected those of 5 joints, got 6"),
        ({"limits": None}, TypeError, "^limits: expected MotionLimits"),
        ({"method": "slow"}, ValueError, "^method: expected one of 'fastest', 'quintic'"),
        ({"intervals": 2}, ValueError, "^intervals: expected 24 or more, got 2"),
        ({"robot": "niryo_one"}, TypeError, "^robot: "),
        ({"cartesian": 0.1}, TypeError, "^cartesian: expected CartesianLimits, got float"),
        ({"cartesian": motion.CartesianLimits(1.0)}, ValueError, "^cartesian: expected a robot"),
        ({"pace": np.ones(4)}, ValueError, r"^pace: expected shape \(5,\), .*, got \(4,\)"),
        ({"pace": 0.0}, ValueError, r"^pace: expected shares in \(0, 1\], got 0.0"),
        ({"pace": [1, 1, 1.1, 1, 1]}, ValueError, r"^pace: expected shares in \(0, 1\]"),
        ({"pace": "slow"}, TypeError, "^pace: "),
    ],
)
def test_bad_paths_are_refused_by_name(options, error, message):
    good = {"path": waypoints(0), "limits": LIMITS}
    with pytest.raises(error, match=message):
        motion.retime(**{**good, **options})


@pytest.mark.parametrize("method", ["fastest", "quintic"])
def test_a_pace_bounds_the_velocities_of_a_part(method):
    """And of that part alone: what is faster elsewhere stays so."""
    q, loose = waypoints(3), LIMITS.scaled(acceleration=10.0)
    pace = np.array([1.0, 0.3, 0.3, 1.0, 0.6])
    path = motion.retime(q, loose, pace=pace, method=method)
    s = np.asarray(path.spline.knots)[: len(q)]
    found = numbers(path.every(2e-3))
    done = np.interp(found.time, *_shares_of(path, method))
    part = np.clip(np.searchsorted(s, done, side="right") - 1, 0, len(pace) - 1)
    share = np.max(np.abs(found.velocity) / np.asarray(loose.velocity), axis=-1)
    most = [np.max(share[part == i]) for i in range(len(pace))]
    assert np.all(most <= pace * (1 + 1e-3))
    if method == "fastest":
        np.testing.assert_allclose(most, pace, rtol=2e-2)
    assert path.duration > motion.retime(q, loose, method=method).duration
    assert path.duration <= motion.retime(q, loose.scaled(0.3), method=method).duration


def _shares_of(path, method):
    if method == "fastest":
        return np.asarray(path.time), np.asarray(path.s)
    u = np.linspace(0, 1, 20_001)
    return u * float(path.duration), np.asarray(motion.quintic_time_scaling(u, 1.0).s)


def test_an_even_pace_is_that_of_scaled_limits():
    q = waypoints(4)
    even = motion.retime(np.stack([q, q]), LIMITS, pace=np.array([[0.4], [1.0]]))
    for path, limits in zip(np.asarray(even.duration), (LIMITS.scaled(0.4), LIMITS)):
        assert path == pytest.approx(float(motion.retime(q, limits).duration), rel=1e-12)
    # Samples that repeat the one before take their parts with them.
    repeated = motion.retime(
        q[[0, 1, 1, 2, 3, 4, 5, 5]], LIMITS, pace=[0.5, 0.01, 1, 1, 1, 1, 0.01]
    )
    plain = motion.retime(q, LIMITS, pace=[0.5, 1, 1, 1, 1])
    assert float(repeated.duration) == pytest.approx(float(plain.duration), rel=1e-12)


def test_paths_beyond_the_limits_of_joints_are_refused_by_sample_and_joint(niryo):
    q = np.zeros((4, 6))
    q[:, 0] = np.arange(4) * 0.1
    q[2, 1] = 0.7
    with pytest.raises(
        ValueError, match=r"^path: sample 2 leaves the limits of joint_2, .*0\.7000"
    ):
        motion.retime(q, LIMITS, robot=niryo)
    with pytest.raises(ValueError, match=r"^path: sample 2 of path \(1,\) leaves the limits"):
        motion.retime(np.stack([0 * q, q]), LIMITS, robot=niryo)
    # Samples within, and the spline through them not.
    q[:, 1] = [0.0, 0.639, 0.639, 0.0]
    between = r"^path: the spline between samples 1 and 2{} leaves the limits of joint_2"
    with pytest.raises(ValueError, match=between.format("")):
        motion.retime(q, LIMITS, robot=niryo)
    many = np.zeros((3, 2, 4, 6))
    many[2, 1] = q
    with pytest.raises(ValueError, match=between.format(r" of path \(2, 1\)")):
        motion.retime(many, LIMITS, robot=niryo)
    with pytest.raises(ValueError, match=r"^path: expected 6 joints, got 5"):
        motion.retime(q[:, :5], motion.MotionLimits(*np.ones((2, 5))), robot=niryo)


def test_a_path_that_is_not_done_is_not_timed(niryo):
    far = np.tile(np.eye(4), (3, 1, 1))
    far[:, 0, 3] = 5.0
    lost = motion.best_path(niryo, far)
    with pytest.raises(ValueError, match=r"^path: expected one that is done, got: "):
        motion.retime(lost, LIMITS)


# Arcs and round corners


@pytest.fixture(scope="module")
def poses(niryo):
    q = np.random.default_rng(7).uniform(niryo.lower, niryo.upper, (6, 6))
    return np.asarray(nj.forward_kinematics(niryo, q))


def is_rigid(poses):
    rotation = np.asarray(poses)[..., :3, :3]
    identity = np.broadcast_to(np.eye(3), rotation.shape)
    np.testing.assert_allclose(np.swapaxes(rotation, -1, -2) @ rotation, identity, atol=1e-13)
    assert np.all(np.linalg.det(rotation) > 0)


def test_arcs_are_circles_through_three_points_run_through_evenly(poses):
    start, via, end = poses[:2], poses[2:4, :3, 3], poses[4:6]
    count = 1001
    found = np.asarray(motion.arc(start, via, end, count))
    is_rigid(found)
    np.testing.assert_allclose(found[:, 0], start, atol=1e-14)
    np.testing.assert_allclose(found[:, -1], end, atol=1e-13)
    p = found[..., :3, 3]
    steps = np.linalg.norm(np.diff(p, axis=1), axis=-1)
    np.testing.assert_allclose(steps, steps[:, :1] * np.ones_like(steps), rtol=1e-9)
    assert np.all(np.min(np.linalg.norm(p - via[:, None], axis=-1), axis=1) < steps[:, 0])
    # On one plane, and on one sphere: a circle.
    for points, through in zip(p, via):
        away = points - through
        assert np.linalg.svd(away, compute_uv=False)[2] < 1e-12
        centre, *_ = np.linalg.lstsq(2 * away, np.sum(away**2, axis=1), rcond=None)
        radius = np.linalg.norm(away - centre, axis=1)
        np.testing.assert_allclose(radius, np.linalg.norm(centre), rtol=1e-9)
    line = motion.cartesian_trajectory(start, end, 1.0, count, lambda u: u).pose
    np.testing.assert_array_equal(found[..., :3, :3], line[..., :3, :3])


def test_arcs_the_long_way_round_and_points_on_a_line(poses):
    pose = np.tile(np.eye(4), (2, 1, 1))
    angle = np.deg2rad([0.0, 300.0])
    pose[:, :2, 3] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = motion.arc(pose[0], [-1.0, 0.0, 0.0], pose[1], 11)
    expected = np.deg2rad(np.linspace(0, 300, 11))
    np.testing.assert_allclose(found[:, 0, 3], np.cos(expected), atol=1e-14)
    np.testing.assert_allclose(found[:, 1, 3], np.sin(expected), atol=1e-14)
    middle = 0.5 * (pose[0] + pose[1])[:3, 3]
    with pytest.raises(ValueError, match=r"^via: expected a point off the line"):
        motion.arc(pose[0], middle, pose[1], 11)
    with pytest.raises(ValueError, match=r"^via: expected a point off the line"):
        motion.arc(pose[0], middle, pose[0], 11)
    traced, slope = jax.jit(
        jax.value_and_grad(lambda x: jnp.sum(motion.arc(pose[0], x, pose[1], 3)[1, :3, 3]))
    )(middle)
    assert traced == pytest.approx(middle.sum())
    assert np.all(np.isfinite(slope))
    with pytest.raises(ValueError, match=r"^via: expected shape \(\.\.\., 3\)"):
        motion.arc(pose[0], [1.0, 2.0], pose[1], 11)


def test_blends_round_each_corner_and_keep_to_the_lines_elsewhere(poses):
    radius, count = 0.03, 4001
    found = np.asarray(motion.blend(poses, radius, count))
    is_rigid(found)
    np.testing.assert_allclose(found[[0, -1]], poses[[0, -1]], atol=1e-13)
    p, corners = found[:, :3, 3], poses[:, :3, 3]
    chords = np.diff(corners, axis=0)
    off = np.stack(
        [
            np.linalg.norm(p - a - np.clip((p - a) @ c / (c @ c), 0, 1)[:, None] * c, axis=1)
            for a, c in zip(corners, chords)
        ]
    ).min(axis=0)
    near = np.linalg.norm(p[:, None] - corners, axis=-1)
    assert np.all(off[np.all(near > radius, axis=1)] < 1e-12)
    assert np.all(near.min(axis=0)[1:-1] <= 0.5 * radius + 1e-4)
    assert np.all(off <= 0.5 * radius)
    # The direction turns little by little.
    ways = np.diff(p, axis=0)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert np.max(np.linalg.norm(np.diff(ways, axis=0), axis=1)) < 0.2
    turns = np.swapaxes(found[:-1, :3, :3], 1, 2) @ found[1:, :3, :3]
    assert np.max(np.linalg.norm(nj.so3.log(turns), axis=1)) < 0.05
    many = motion.blend(np.stack([poses, poses[::-1]]), radius, count)
    np.testing.assert_allclose(many[0], found, atol=1e-14)
    np.testing.assert_allclose(many[1], found[::-1], atol=1e-9)


def test_a_blend_of_two_poses_is_the_straight_line(poses):
    line = motion.cartesian_trajectory(poses[0], poses[1], 1.0, 9, lambda u: u).pose
    np.testing.assert_allclose(motion.blend(poses[:2], 0.1, 9), line, atol=1e-13)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"radius": 0.0}, ValueError, "^radius: expected a positive number"),
        ({"radius": None}, TypeError, "^radius: expected a positive number"),
        ({"samples": 1}, ValueError, "^samples: expected 2 or more"),
        ({"poses": np.eye(4)}, ValueError, r"^poses: expected shape \(\.\.\., k, 4, 4\)"),
        ({"poses": np.ones((3, 4, 4))}, ValueError, "^poses: expected a rigid motion"),
        ({"poses": np.tile(np.eye(4), (3, 1, 1))}, ValueError, "^poses: expected each position"),
    ],
)
def test_bad_blends_are_refused_by_name(options, error, message, poses):
    with pytest.raises(error, match=message):
        motion.blend(**{"poses": poses, "radius": 0.1, "samples": 9, **options})
