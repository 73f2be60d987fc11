"""Errors of joints: against numpy in extended precision, differences, the lab report and trials."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES, DTYPES, LD, eps, expm, hat3, product_of_exponentials, random_robot

import niryo_jax as nj
from niryo_jax import uncertainty as un
from niryo_jax.hardware.pick_and_place import TABLE_2_1
from niryo_jax.lie.zyz import rotation_from_zyz, zyz_from_rotation
from niryo_jax.uncertainty.normal import factor, radius_of, standard_normal

SIGMA = 0.01
NIRYO = nj.robots.niryo_one()
Q = np.array([0.3, -0.2, 0.4, 0.5, -0.6, 0.7])
KEY = jax.random.key(5)


# Three joints, for programs of traced screws take long to compile: the elbow and the shoulder are
# parallel, and stretched at q = 0.
SMALL = nj.Robot.from_axes(
    axes=np.eye(3)[[2, 1, 1]],
    points=np.array([[0, 0, 0], [0, 0, 0.2], [0.3, 0, 0.2]]),
    home=np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0.1], [0, 0, 1, 0.2], [0, 0, 0, 1]]),
)
SMALL_Q = np.array([0.3, -0.4, 0.9])


def spread(n=6, scale=1e-4, seed=0):
    """A covariance with correlations."""
    a = np.random.default_rng(seed).standard_normal((n, n))
    return scale * (a @ a.T) / n


def pose(robot, q):
    return product_of_exponentials(robot.screws, robot.home, q)


def errors(robot, q, d):
    """Rotation vector (to second order) and displacement, axes of the space frame."""
    before, after = pose(robot, q), pose(robot, np.asarray(q, LD) + d)
    turn = after[..., :3, :3] @ before[..., :3, :3].T
    skew = (turn - np.swapaxes(turn, -1, -2)) / 2
    vector = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)
    return np.concatenate([vector, after[..., :3, 3] - before[..., :3, 3]], -1)


def jacobian(robot, q):
    h = LD(1e-6)
    steps = h * np.eye(robot.joints, dtype=LD)
    return ((errors(robot, q, steps) - errors(robot, q, -steps)) / (2 * h)).T


def second(robot, q):
    """(3, n, n) second derivatives of the position by differences."""
    h = LD(1e-4)
    n = robot.joints
    unit = h * np.eye(n, dtype=LD)
    out = np.empty((3, n, n))
    for i in range(n):
        for j in range(n):
            corners = [s * unit[i] + t * unit[j] for s in (1, -1) for t in (1, -1)]
            a, b, c, d = (errors(robot, q, corner)[3:] for corner in corners)
            out[:, i, j] = (a - b - c + d) / (4 * h * h)
    return out


ARMS = {
    "niryo": (NIRYO, Q),
    "mixed": (
        random_robot(np.random.default_rng(1), 4, prismatic=[1], helical=[2]),
        np.array([0.2, -0.3, 0.5, 0.9]),
    ),
}


@pytest.mark.parametrize("arm", ARMS)
def test_covariance_and_shift_are_those_of_differences(arm):
    robot, q = ARMS[arm]
    c, m = spread(robot.joints), np.linspace(-1e-3, 2e-3, robot.joints)
    j, h = jacobian(robot, q).astype(float), second(robot, q)
    found = un.propagate(robot, q, c, m)
    np.testing.assert_allclose(found.covariance, j @ c @ j.T, rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(found.position_covariance, (j @ c @ j.T)[3:, 3:], atol=1e-14)
    shift = j[3:] @ m + 0.5 * np.einsum("ij,kij->k", c + np.outer(m, m), h)
    np.testing.assert_allclose(found.mean_shift, shift, atol=1e-11)
    np.testing.assert_array_equal(found.covariance, np.asarray(found.covariance).T)
    expected = 0.5 * np.einsum("ij,kij->k", c, h)
    np.testing.assert_allclose(un.propagate(robot, q, c).mean_shift, expected, atol=1e-11)


@pytest.mark.parametrize("frame", ["body", "space"])
def test_the_frame_is_that_of_the_jacobian(frame):
    j = np.asarray({"body": nj.body_jacobian, "space": nj.space_jacobian}[frame](NIRYO, Q))
    found = un.propagate(NIRYO, Q, spread(), frame=frame)
    np.testing.assert_allclose(found.covariance, j @ spread() @ j.T, rtol=1e-12, atol=1e-18)
    assert found.frame == frame
    same = un.propagate(NIRYO, Q, spread())
    np.testing.assert_allclose(found.position_covariance, same.position_covariance, atol=1e-18)
    np.testing.assert_allclose(found.mean_shift, same.mean_shift, atol=1e-15)


@functools.cache
def poses_of_the_table():
    """Joint vectors of poses 2 and 3 of Table 2.1."""
    above, at = (-29.0303, -38.3463, 0, -22.6234), (-46.8656, -34.8624, 0, -8.272)
    return np.deg2rad([[-45, *between, -45] for between in (above, at)])


def test_the_figures_of_the_lab_report_corrected():
    q = poses_of_the_table()
    targets = np.stack([TABLE_2_1[i].pose for i in (1, 2)])
    np.testing.assert_allclose(pose(NIRYO, q[0]), targets[0], atol=1e-6)
    np.testing.assert_allclose(pose(NIRYO, q[1]), targets[1], atol=1e-6)
    found = un.propagate(NIRYO, q, SIGMA**2 * np.eye(6))
    np.testing.assert_allclose(1e3 * found.rms, [3.85, 3.97], atol=5e-3)
    axes = [[2.867, 2.098, 1.475], [3.021, 2.095, 1.490]]
    np.testing.assert_allclose(1e3 * found.ellipsoid().half_axes, axes, atol=6e-4)
    alone = un.sensitivity(NIRYO, q, SIGMA)
    of_joints = [[2.09, 2.12, 2.42, 0.14, 0.24, 0], [2.09, 2.30, 2.45, 0.09, 0.24, 0]]
    np.testing.assert_allclose(alone.millimetres, of_joints, atol=5e-3)
    np.testing.assert_allclose(alone.milliradians, 10.0, rtol=1e-12)
    np.testing.assert_array_equal(alone.ranking, [[2, 1, 0, 4, 3, 5]] * 2)
    np.testing.assert_allclose(np.sqrt(np.sum(alone.position**2, -1)), found.rms, rtol=1e-12)
    # What averaging 200 draws before multiplying hides.
    averaged = un.propagate(NIRYO, q, SIGMA**2 / 200 * np.eye(6)).rms
    np.testing.assert_allclose(found.rms / averaged, np.sqrt(200), rtol=1e-12)


@pytest.mark.parametrize(
    ("probability", "quantile"),
    [(0.95, 7.8147), (0.99, 11.3449), (0.90, 6.2514), (0.5, 2.3660), (0.01, 0.1148)],
)
def test_quantiles_are_the_published_ones(probability, quantile):
    assert radius_of(probability) ** 2 == pytest.approx(quantile, abs=5e-5)


def test_quantiles_invert_the_incomplete_gamma_function():
    for p in (1e-6, 0.1, 0.3, 0.7, 0.999, 1 - 1e-9):
        given = jax.scipy.special.gammainc(1.5, radius_of(p) ** 2 / 2)
        assert float(given) == pytest.approx(p, rel=1e-9)


def test_an_ellipsoid_holds_its_share():
    c = spread(3, seed=4)
    found = un.position_ellipsoid(c, 0.95)
    v, h = np.asarray(found.directions), np.asarray(found.half_axes)
    np.testing.assert_allclose(v @ np.diag(h**2) @ v.T, 7.814728 * c, rtol=1e-6)
    assert np.all(np.diff(h) <= 0)
    assert found.probability == 0.95
    x = np.random.default_rng(0).multivariate_normal(np.zeros(3), c, 100_000) @ v / h
    assert np.mean(np.sum(x * x, -1) < 1) == pytest.approx(0.95, abs=3e-3)


@functools.cache
def trials(samples=1_000_000):
    noise = un.Gaussian.independent(np.full(6, SIGMA))
    return un.monte_carlo(NIRYO, poses_of_the_table()[1], noise, KEY, samples)


def test_trials_agree_with_the_formula_within_three_standard_errors():
    q = poses_of_the_table()[1]
    found = un.propagate(NIRYO, q, SIGMA**2 * np.eye(6))
    side = un.compare(found, trials())
    assert np.all(side.agrees(3.0))
    assert np.all(np.abs(side.half_axes_ratio - 1) < 3 * side.half_axes_standard_error)
    np.testing.assert_allclose(side.rms_ratio, 1.0, atol=3e-3)
    # The shift is not nothing: it is seen by ten standard errors along the widest direction.
    unshifted = dataclasses.replace(found, mean_shift=0 * found.mean_shift)
    assert not np.any(un.compare(unshifted, trials()).agrees(3.0))
    percents = 1e3 * np.asarray(trials().percentiles)
    assert np.all(np.diff(percents) > 0)
    np.testing.assert_allclose(percents[0], 3.38, atol=0.01)
    assert np.all(trials().mean_norm < trials().rms)


@pytest.mark.parametrize("samples", [2, 70_000])
def test_moments_are_those_of_the_very_draws(samples):
    noise = un.Gaussian(spread(3))
    found = un.monte_carlo(SMALL, SMALL_Q, noise, KEY, samples, percentiles=(0, 30, 100))
    chunk = min(samples, 65_536)
    keys = [jax.random.fold_in(KEY, i) for i in range(-(-samples // chunk))]
    parts = [noise.sample(key, SMALL_Q, chunk) for key in keys]
    q = SMALL_Q + np.concatenate(parts)[:samples]
    nominal, moved = nj.forward_kinematics(SMALL, SMALL_Q), nj.forward_kinematics(SMALL, q)
    turn = nj.so3.log(moved[:, :3, :3] @ nominal[:3, :3].T)
    rows = np.concatenate([turn, moved[:, :3, 3] - nominal[:3, 3]], -1)
    np.testing.assert_allclose(found.mean, rows.mean(0), atol=1e-14)
    np.testing.assert_allclose(found.covariance, np.cov(rows.T), rtol=1e-9, atol=1e-16)
    norms = np.linalg.norm(rows[:, 3:], axis=-1)
    np.testing.assert_allclose(found.percentiles, np.percentile(norms, (0, 30, 100)), rtol=1e-9)
    np.testing.assert_allclose(found.rms, np.sqrt(np.mean(norms**2)), rtol=1e-12)
    np.testing.assert_allclose(found.mean_norm, np.mean(norms), rtol=1e-12)


TOGETHER = np.array([0.01, 0, 0.02, 0, 0, -0.01])
NOISES = {
    "gaussian": un.Gaussian(spread()),
    "semidefinite": un.Gaussian(
        np.outer([0.01, 0, 0.02, 0, 0, -0.01], [0.01, 0, 0.02, 0, 0, -0.01])
    ),
    "uniform": un.Uniform(0.02),
    "bias": un.Bias(np.arange(6) * 1e-3),
    "gear": un.GearRatio(1e-3, sigma=2e-3),
    "backlash": un.Backlash(0.01, [1, -1, 0, 0, 1, -1]),
    "encoder": un.EncoderSteps([0.1, 0.0, 0.3, 0.01, 0.02, 0.05]),
    "sum": un.Uniform(0.02) + un.Bias(0.01) + un.Gaussian(spread()) + un.Backlash(0.01),
}


@pytest.mark.parametrize("kind", NOISES)
def test_draws_have_the_mean_and_the_covariance_that_is_said(kind):
    noise, count = NOISES[kind], 200_000
    q = np.stack([Q, 2 * Q])
    drawn = np.asarray(noise.sample(KEY, q, count))
    assert drawn.shape == (2, count, 6)
    for i in range(2):
        mean, covariance = np.asarray(noise.mean(q))[i], np.asarray(noise.covariance(q))[i]
        variance = np.diag(covariance)
        apart = np.abs(drawn[i].mean(0) - mean)
        assert np.all(apart <= 4.5 * np.sqrt(variance / count) + 1e-12)
        error = np.sqrt(np.outer(variance, variance) + covariance**2)
        apart = np.abs(np.cov(drawn[i].T) - covariance)
        assert np.all(apart <= 4.5 * error / np.sqrt(count) + 1e-12)


def test_what_each_kind_of_error_is():
    q = np.array([0.34, -0.34, 1.0])
    np.testing.assert_allclose(un.EncoderSteps(0.1).mean(q), [-0.04, 0.04, 0.0], atol=1e-15)
    np.testing.assert_allclose(un.GearRatio(0.01).mean(q), 0.01 * q)
    # Arriving from below the joint lags behind: it stands below.
    np.testing.assert_allclose(un.Backlash(0.02, [1, -1, 0]).mean(q), [-0.01, 0.01, 0.0])
    drawn = np.asarray(un.Backlash(0.02).sample(KEY, q, 1000))
    assert set(np.unique(np.abs(drawn))) == {0.01}
    assert np.max(np.abs(un.Uniform(0.02).sample(KEY, q, 1000))) <= 0.02
    parts = (un.Bias(0.1) + (un.Bias(0.2) + un.Bias(0.3))).parts
    assert [float(part.offset) for part in parts] == [0.1, 0.2, 0.3]
    np.testing.assert_array_equal(
        un.Uniform(0.02).sample(KEY, q, 5), un.Uniform(0.02).sample(KEY, q, 5)
    )


def test_normal_variates_are_normal():
    for dtype in DTYPES:
        x = np.asarray(standard_normal(KEY, (3, 100_001), np.dtype(dtype)), np.float64)
        assert x.dtype == np.float64
        assert np.all(np.isfinite(x))
        for power, moment in ((1, 0), (2, 1), (3, 0), (4, 3)):
            assert np.mean(x**power) == pytest.approx(moment, abs=0.08)
        assert np.mean(np.abs(x) < 1) == pytest.approx(0.682689, abs=3e-3)
        assert abs(np.corrcoef(x)[0, 1]) < 0.01


def test_a_factor_of_a_semidefinite_matrix():
    a = np.random.default_rng(2).standard_normal((5, 6, 3))
    matrix = a @ np.swapaxes(a, -1, -2)
    matrix[0] = 0
    lower = np.asarray(factor(jnp.asarray(matrix)))
    np.testing.assert_allclose(lower @ np.swapaxes(lower, -1, -2), matrix, atol=1e-6)
    assert np.all(np.triu(lower, 1) == 0)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batches_and_dtypes(batch, dtype):
    q = np.broadcast_to(SMALL_Q, (*batch, 3)).astype(dtype)
    c = spread(3).astype(dtype)
    found = un.propagate(SMALL, q, c)
    alone = un.sensitivity(SMALL, q, dtype(SIGMA))
    tried = un.monte_carlo(SMALL, q, un.Gaussian(spread(3)), KEY, 50)
    half_axes = found.ellipsoid(0.9).half_axes
    shapes = {
        (6, 6): (found.covariance, tried.covariance),
        (3, 3): (found.position_covariance, found.ellipsoid(0.9).directions),
        (3,): (found.mean_shift, alone.position, alone.rotation, half_axes, tried.percentiles),
        (6,): (tried.mean,),
        (): (found.rms, tried.rms, tried.mean_norm),
    }
    for shape, arrays in shapes.items():
        for array in arrays:
            assert array.shape == (*batch, *shape)
            assert array.dtype == dtype
            assert np.all(np.isfinite(array))
    truth = np.asarray(un.propagate(SMALL, SMALL_Q, spread(3)).covariance)
    tolerance = 30 * eps(dtype) * np.max(truth)
    if q.size:
        np.testing.assert_allclose(
            np.asarray(found.covariance, np.float64).reshape(-1, 6, 6)[-1], truth, atol=tolerance
        )
    assert un.compare(found, tried).agrees().shape == batch


def measure(robot, q, c):
    """One number in which everything that is propagated takes part."""
    found = un.propagate(robot, q, c)
    shape = found.ellipsoid(0.95)
    return (
        jnp.sum(found.covariance * jnp.arange(36.0).reshape(6, 6))
        + jnp.sum(found.mean_shift)
        + found.rms
        + jnp.sum(shape.half_axes * jnp.arange(3.0))
        + 1e-3 * jnp.sum(shape.directions[:, 0])
    )


@jax.jit
def gradient(screws, q, c):
    def of(screws, q, c):
        return measure(dataclasses.replace(SMALL, screws=screws), q, c)

    return jax.grad(of, argnums=(0, 1, 2))(screws, q, c)


@jax.jit
def value_and_rate(screws, q, c, ds, dq, dc):
    def of(screws, q, c):
        return measure(dataclasses.replace(SMALL, screws=screws), q, c)

    return jax.jvp(of, (screws, q, c), (ds, dq, dc))


def test_derivatives_by_everything_are_those_of_differences():
    rng = np.random.default_rng(3)
    at = np.asarray(SMALL.screws), SMALL_Q, spread(3)
    along = [rng.standard_normal(x.shape) for x in at]
    along[2] = 1e-4 * (along[2] + along[2].T)
    by_reverse = sum(np.sum(g * u) for g, u in zip(gradient(*at), along))
    by_forward = value_and_rate(*at, *along)[1]
    h = 1e-5
    ahead, behind = (
        value_and_rate(*(x + s * h * u for x, u in zip(at, along)), *along)[0] for s in (1, -1)
    )
    assert float(by_forward) == pytest.approx(float(by_reverse), rel=1e-10)
    assert float(by_forward) == pytest.approx(float(ahead - behind) / (2 * h), rel=1e-6)


@pytest.mark.parametrize(
    ("q", "c"),
    [
        (np.zeros(3), SIGMA**2 * np.eye(3)),  # The elbow stretched.
        (np.array([0.1, 0, np.pi]), SIGMA**2 * np.eye(3)),  # And folded.
        (SMALL_Q, np.zeros((3, 3))),
        (SMALL_Q, np.diag([1e-4, 0, 0])),
    ],
)
def test_derivatives_are_finite_at_singular_points(q, c):
    screws = np.asarray(SMALL.screws)
    for part in gradient(screws, q, c):
        assert np.all(np.isfinite(part))
    rate = value_and_rate(screws, q, c, np.ones_like(screws), np.ones(3), np.eye(3))[1]
    assert np.isfinite(rate)


def test_trials_can_be_differentiated():
    def rms(sigma, q):
        noise = un.Gaussian.independent(sigma) + un.GearRatio(1e-3)
        return un.monte_carlo(SMALL, q, noise, KEY, 300).rms

    by = jax.jit(jax.grad(rms, argnums=(0, 1)))
    of_sigma, of_q = by(np.full(3, SIGMA), SMALL_Q)
    assert np.all(np.isfinite(of_q))
    h = 1e-6
    value = jax.jit(rms)
    for i in (0, 2):
        step = h * np.eye(3)[i]
        up, down = (value(SIGMA * np.ones(3) + s * step, SMALL_Q) for s in (1, -1))
        assert float(of_sigma[i]) == pytest.approx(float(up - down) / (2 * h), rel=1e-6)


def test_under_jit_and_vmap_the_answers_are_the_same():
    q = np.stack([SMALL_Q, -SMALL_Q, 0.5 * SMALL_Q])
    c = np.stack([spread(3, seed=i) for i in range(3)])
    plain = un.propagate(SMALL, q, c)
    mapped = jax.jit(jax.vmap(lambda q, c: un.propagate(SMALL, q, c)))(q, c)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(mapped)):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-17)
    noise = un.Uniform(0.01) + un.Bias(0.001)
    once = un.monte_carlo(SMALL, SMALL_Q, noise, KEY, 100)
    again = jax.jit(lambda noise, key: un.monte_carlo(SMALL, SMALL_Q, noise, key, 100))(noise, KEY)
    for a, b in zip(jax.tree.leaves(once), jax.tree.leaves(again)):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-17)


def test_the_least_sensitive_solution_is_the_best_within_the_limits():
    poses = nj.forward_kinematics(NIRYO, np.stack([Q, 0.5 * Q]))
    poses = np.concatenate([poses, np.eye(4)[None] + 5 * np.eye(4, k=3)])
    solutions = nj.inverse_kinematics(NIRYO, poses)
    c = spread()
    q, ok = un.least_sensitive(NIRYO, solutions, c)
    np.testing.assert_array_equal(ok, [True, True, False])
    for i in range(2):
        within = np.asarray(solutions.within_limits[i])
        rms = np.asarray(un.propagate(NIRYO, solutions.q[i], c).rms)
        best = np.argmin(np.where(within, rms, np.inf))
        np.testing.assert_array_equal(q[i], solutions.q[i, best])


def test_models_are_trees_of_their_parameters():
    for noise in NOISES.values():
        leaves, tree = jax.tree.flatten(noise)
        assert type(jax.tree.unflatten(tree, [None] * len(leaves))) is type(noise)
        assert all(np.ndim(x) <= 2 for x in leaves)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.eye(5), r"covariance: expected shape \(..., 6, 6\), got \(5, 5\)"),
        (np.ones(6), r"covariance: expected shape \(..., 6, 6\), got \(6,\)"),
        (np.full((6, 6), np.nan), "covariance: expected finite numbers"),
        (np.eye(6) + np.eye(6, k=1), "covariance: expected a symmetric matrix"),
        (-np.eye(6), "covariance: expected a positive semidefinite matrix, got the eigenvalue -1"),
        (np.eye(6) - 0.5, "covariance: expected a positive semidefinite matrix"),
        (np.stack([np.eye(6), -np.eye(6)]), "covariance: expected a positive semidefinite matrix"),
        ("abc", "covariance: expected an array of numbers"),
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance, message):
    with pytest.raises((TypeError, ValueError), match=rf"^{message}"):
        un.propagate(NIRYO, Q, covariance)
    # Rounding is let through.
    un.propagate(NIRYO, Q, spread() * (1 + 1e-14 * np.arange(36).reshape(6, 6)))


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda: un.Gaussian.independent([-0.1] * 6), "sigma: expected 0 or more"),
        (lambda: un.Gaussian.independent([np.nan] * 6), "sigma: expected finite numbers"),
        (lambda: un.Gaussian.independent(0.1), r"sigma: expected shape \(..., n\)"),
        (lambda: un.Gaussian(-np.eye(6)), "matrix: expected a positive semidefinite"),
        (lambda: un.Gaussian(np.eye(5)).mean(Q), r"matrix: expected shape \(6, 6\)"),
        (lambda: un.Uniform(-1.0), "half_width: expected 0 or more"),
        (lambda: un.Uniform([0.1] * 5).mean(Q), "half_width: expected one number or 6"),
        (lambda: un.Uniform(np.eye(6)), "half_width: expected one number or one for each joint"),
        (lambda: un.Bias("abc"), "offset: expected an array of numbers"),
        (lambda: un.Bias(np.inf), "offset: expected finite numbers"),
        (lambda: un.GearRatio(0.1, sigma=-1), "sigma: expected 0 or more"),
        (lambda: un.Backlash(-1), "play: expected 0 or more"),
        (lambda: un.Backlash(1, 2), "direction: expected -1, 0 or 1"),
        (lambda: un.EncoderSteps(-1), "step: expected 0 or more"),
        (lambda: un.Combined(()), "parts: expected one model of noise or more"),
        (lambda: un.Combined((1,)), "parts: expected models of noise"),
        (lambda: un.Bias(1) + 1, "unsupported operand"),
        (lambda: un.Bias(1).sample(5, Q, 3), "key: expected one key of jax.random"),
        (lambda: un.Bias(1).sample(KEY, Q, 0), "count: expected 1 or more"),
        (lambda: un.sensitivity(NIRYO, Q, -1.0), "sigma: expected 0 or more"),
        (lambda: un.sensitivity(NIRYO, Q, np.nan), "sigma: expected finite numbers"),
        (lambda: un.sensitivity(NIRYO, Q, np.ones(5)), r"sigma: expected shape \(..., 6\)"),
        (lambda: un.propagate(NIRYO, Q, np.eye(6), np.full(6, np.nan)), "mean: expected finite"),
        (lambda: un.propagate(NIRYO, Q[:5], np.eye(6)), r"q: expected shape \(..., 6\)"),
        (lambda: un.propagate(NIRYO, Q, np.eye(6), frame="zz"), "frame: expected one of"),
        (lambda: un.position_ellipsoid(np.eye(3), 1.0), "probability: expected a probability"),
        (lambda: un.position_ellipsoid(np.eye(3), "a"), "probability: expected a probability"),
        (lambda: un.position_ellipsoid(-np.eye(3)), "covariance: expected a positive semidef"),
        (lambda: tried(samples=10**12), r"samples: expected at most \d+"),
        (lambda: tried(samples=1), "samples: expected 2 or more"),
        (lambda: tried(samples=1e6), "samples: expected an integer"),
        (lambda: tried(noise=np.eye(6)), "noise: expected a model of noise"),
        (lambda: tried(noise=un.Uniform([0.1] * 5)), "half_width: expected one number or 6"),
        (lambda: tried(key=0), "key: expected one key of jax.random"),
        (lambda: tried(key=jax.random.split(KEY, 2)), "key: expected one key of jax.random"),
        (lambda: tried(percentiles=(101,)), "percentiles: expected percents from 0 to 100"),
        (lambda: tried(percentiles="95"), "percentiles: expected percents"),
        (lambda: un.compare(1, 2), "propagated: expected a Propagated"),
        (lambda: un.least_sensitive(NIRYO, Q, np.eye(6)), "solutions: expected IKSolutions"),
    ],
)
def test_bad_input_is_named(function, message):
    with pytest.raises((TypeError, ValueError), match=rf"^{message}"):
        function()


def tried(noise=NOISES["uniform"], key=KEY, samples=10, **options):
    return un.monte_carlo(NIRYO, Q, noise, key, samples, **options)


def test_trials_are_compared_in_their_frame_alone():
    found = un.propagate(NIRYO, Q, spread(), frame="body")
    with pytest.raises(ValueError, match=r"^propagated: expected the frame"):
        un.compare(found, tried())


def test_zyz_angles_rebuild_the_rotation_and_follow_the_convention(rng):
    angles = rng.uniform([-np.pi, 0.01, -np.pi], [np.pi, np.pi - 0.01, np.pi], (50, 3))
    rotation = rotation_from_zyz(angles)
    turns = [expm(hat3(axis * angles[:, i, None])) for i, axis in enumerate(np.eye(3)[[2, 1, 2]])]
    np.testing.assert_allclose(rotation, turns[0] @ turns[1] @ turns[2], atol=1e-15)
    np.testing.assert_allclose(zyz_from_rotation(rotation), angles, atol=1e-12)
    # Where beta is 0 or pi gamma is 0, and alpha takes the whole turn.
    for beta, alpha in ((0.0, 0.7 + 0.4), (np.pi, 0.7 - 0.4)):
        found = zyz_from_rotation(rotation_from_zyz([0.7, beta, 0.4]))
        np.testing.assert_allclose(found, [alpha, beta, 0.0], atol=1e-12)


POSE_3 = ["-45", "-46.8656", "-34.8624", "0", "-8.2720", "-45", "--degrees"]


def test_the_command_gives_the_figures_of_the_library(as_json):
    code, said = as_json("uncertainty", *POSE_3, "--sigma", "0.5729578", "--samples", "2000")
    assert code == 0
    assert said["rms_m"] == pytest.approx(3.97e-3, abs=5e-6)
    assert said["frame"] == "tool_point"
    half_axes = np.array(said["half_axes_m"]) / said["half_axes_one_sigma_m"]
    np.testing.assert_allclose(half_axes, np.sqrt(7.814728), rtol=1e-6)
    alone = [1e3 * joint["position_m"] for joint in said["joints"]]
    np.testing.assert_allclose(alone, [2.09, 2.30, 2.45, 0.09, 0.24, 0], atol=5e-3)
    assert said["draws"]["samples"] == 2000
    assert said["draws"]["rms_m"] == pytest.approx(said["rms_m"], rel=0.06)


def test_the_command_draws_and_prints(cli, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "errors.svg"
    sigma = "0.1 0.1 0.1 0.1 0.1 0.2"
    code, out, _ = cli("uncertainty", *POSE_3, "--sigma", sigma, "--figure", picture)
    assert code == 0
    assert "95 % ellipsoid" in picture.read_text()
    assert f"wrote {picture}" in out
    assert "rms about the mean" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--sigma", "-1"], "--sigma: expected 0 or more"),
        (["--sigma", "1 2"], "--sigma: expected 6 finite numbers, got 2"),
        (["--sigma", "1", "--samples", "1000000000000"], "samples: expected at most"),
        (["--sigma", "1", "--probability", "1.5"], "probability: expected a probability"),
        (["--sigma", "1", "--figure", "a.txt"], "path: expected a suffix of"),
        ([], "Missing option"),
    ],
)
def test_the_command_says_what_is_wrong(cli, options, message):
    code, _, error = cli("uncertainty", *POSE_3, *options)
    assert code == 2
    assert message in error
