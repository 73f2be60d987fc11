"""Laws of the scalar lanes: accuracy, special values, derivatives, folding, linear algebra."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import BATCHES, DTYPES, LD, PI, eps, rate, second_rate, ulps

from niryo_jax import lanes
from niryo_jax.lanes import Lane

N = 20_000
INF, NAN = np.inf, np.nan


@jax.jit
def sincos(x):
    return tuple(lane.value for lane in lanes.sincos(Lane(x)))


@jax.jit
def atan2(y, x):
    return lanes.atan2(Lane(y), Lane(x)).value


@jax.jit
def acos(x):
    return lanes.acos(Lane(x)).value


@jax.jit
def asin(x):
    return lanes.asin(Lane(x)).value


@jax.jit
def sqrt(x):
    return lanes.sqrt(Lane(x)).value


def sin(x):
    return sincos(x)[0]


def cos(x):
    return sincos(x)[1]


def signed_magnitudes(rng, low, high, dtype):
    """N numbers of both signs, their magnitudes spread over the decades low..high."""
    exponents = rng.uniform(low, high, N)
    return (10.0**exponents * rng.choice([-1, 1], N)).astype(dtype)


# Accuracy


@pytest.mark.parametrize(("dtype", "largest"), [(np.float64, 1e9), (np.float32, 2e4)])
def test_sine_and_cosine_are_within_three_ulp_up_to_the_stated_angle(rng, dtype, largest):
    multiples = np.arange(1, 4001) * (np.pi / 2)
    steps = int(largest / np.pi)
    angles = [
        rng.uniform(-7, 7, N),
        rng.uniform(-largest, largest, N),
        signed_magnitudes(rng, -30, 0, dtype),
        np.concatenate([multiples, -multiples, rng.integers(1, steps, N) * np.pi]),
    ]
    for x in angles:
        x = x.astype(dtype)
        for value, truth in zip(sincos(x), (np.sin(x.astype(LD)), np.cos(x.astype(LD)))):
            assert value.dtype == dtype
            assert np.max(ulps(value, truth)) < 3


@pytest.mark.parametrize(("dtype", "magnitude"), [(np.float64, 14), (np.float32, 5.5)])
def test_beyond_the_stated_angle_the_error_is_that_of_an_ulp_of_the_angle(rng, dtype, magnitude):
    x = signed_magnitudes(rng, magnitude - 2, magnitude, dtype)
    bound = 4 * eps(dtype) + np.spacing(np.abs(x))
    for value, truth in zip(sincos(x), (np.sin(x.astype(LD)), np.cos(x.astype(LD)))):
        assert np.all(np.abs(np.asarray(value) - truth) <= bound)


@pytest.mark.parametrize("dtype", DTYPES)
def test_arc_tangent_is_within_three_ulp(rng, dtype):
    decades = 30 if dtype == np.float32 else 290
    samples = [
        (rng.standard_normal(N), rng.standard_normal(N)),
        (rng.uniform(-1, 1, N) * 1e-3, rng.choice([-1, 1], N)),
        (rng.choice([-1, 1], N), rng.uniform(-1, 1, N) * 1e-3),
        tuple(signed_magnitudes(rng, -decades / 2, decades / 2, dtype) for _ in range(2)),
    ]
    for y, x in samples:
        y, x = y.astype(dtype), x.astype(dtype)
        value, truth = np.asarray(atan2(y, x)), np.arctan2(y.astype(LD), x.astype(LD))
        assert value.dtype == dtype
        normal = np.abs(truth) > np.finfo(dtype).tiny
        assert np.max(ulps(value, truth)[normal]) < 3
        # What is too small for a normal number may be flushed to zero.
        assert np.all(np.abs(value - truth)[~normal] <= np.finfo(dtype).tiny)


@pytest.mark.parametrize("dtype", DTYPES)
def test_arc_cosine_and_arc_sine_are_within_four_ulp_up_to_the_ends(rng, dtype):
    near_one = 1 - 10.0 ** rng.uniform(np.log10(eps(dtype)), -1, N)
    for x in (rng.uniform(-1, 1, N), near_one, -near_one, signed_magnitudes(rng, -30, -1, dtype)):
        x = x.astype(dtype)
        for value, truth in (
            (acos(x), np.arccos(x.astype(LD))),
            (asin(x), np.arcsin(x.astype(LD))),
        ):
            assert value.dtype == dtype
            assert np.max(ulps(value, truth)) < 4


# Special values


@pytest.mark.parametrize("dtype", DTYPES)
def test_sine_and_cosine_of_special_angles(dtype):
    huge = 2.0**60 if dtype == np.float64 else 2.0**30
    x = np.array([0.0, -0.0, INF, -INF, NAN, huge, -huge], dtype)
    sin_x, cos_x = sincos(x)
    np.testing.assert_array_equal(sin_x, [0, 0, NAN, NAN, NAN, NAN, NAN])
    np.testing.assert_array_equal(cos_x, [1, 1, NAN, NAN, NAN, NAN, NAN])
    np.testing.assert_array_equal(np.signbit(sin_x[:2]), [False, True])


@pytest.mark.parametrize("dtype", DTYPES)
def test_arc_tangent_has_the_signed_zeros_and_infinities_of_c(dtype):
    specials = np.array([0.0, -0.0, 1.0, -1.0, INF, -INF, NAN], dtype)
    y, x = (grid.ravel() for grid in np.meshgrid(specials, specials))
    value, truth = np.asarray(atan2(y, x)), np.arctan2(y, x)
    np.testing.assert_allclose(value, truth, rtol=eps(dtype))
    known = ~np.isnan(truth)
    np.testing.assert_array_equal(np.signbit(value[known]), np.signbit(truth[known]))


@pytest.mark.parametrize("dtype", DTYPES)
def test_arc_cosine_and_arc_sine_at_the_ends_and_outside(dtype):
    x = np.array([1, -1, 0, 1.5, -1.5, INF, -INF, NAN], dtype)
    outside = [NAN] * 5
    np.testing.assert_allclose(acos(x), [0, np.pi, np.pi / 2, *outside], rtol=eps(dtype))
    np.testing.assert_allclose(asin(x), [np.pi / 2, -np.pi / 2, 0, *outside], rtol=eps(dtype))


@pytest.mark.parametrize("value", [0.0, 0.3, 1.0, -1.0, 1.5, -7.0, INF, NAN])
def test_a_known_number_gives_what_an_array_of_it_gives(value):
    array, known = jnp.array([value]), Lane(value)

    def agree(result, lane):
        assert lane.known
        np.testing.assert_allclose(lane.value, result[0], rtol=4 * eps(np.float64), atol=1e-16)

    for result, lane in zip(sincos(array), lanes.sincos(known)):
        agree(result, lane)
    agree(acos(array), lanes.acos(known))
    agree(asin(array), lanes.asin(known))
    agree(sqrt(array), lanes.sqrt(known))
    agree(atan2(array, array - 0.5), lanes.atan2(known, known - 0.5))


def test_square_root_of_a_negative_number_is_zero_and_of_nan_is_nan():
    np.testing.assert_array_equal(
        sqrt(np.array([4.0, 0.0, -0.0, -3.0, INF, NAN])), [2, 0, 0, 0, INF, NAN]
    )


# Derivatives


SMOOTH = [
    (sin, jnp.sin, 20.0),
    (cos, jnp.cos, 20.0),
    (lambda x: atan2(x, 0.7 + 0.2 * x), lambda x: jnp.arctan2(x, 0.7 + 0.2 * x), 5.0),
    (lambda x: atan2(x - 0.3, x), lambda x: jnp.arctan2(x - 0.3, x), 5.0),
    (acos, jnp.arccos, 0.99),
    (asin, jnp.arcsin, 0.99),
]
SMOOTH_NAMES = ["sin", "cos", "atan2 right half", "atan2 all round", "acos", "asin"]


@functools.partial(jax.jit, static_argnums=0)
def slopes(function, x):
    """First and second derivatives in reverse mode, one program for both."""
    slope = jax.grad(function)
    return jax.vmap(slope)(x), jax.vmap(jax.grad(slope))(x)


@pytest.mark.parametrize(("ours", "theirs", "largest"), SMOOTH, ids=SMOOTH_NAMES)
def test_derivatives_of_first_and_second_order_forward_and_reverse(rng, ours, theirs, largest):
    x = rng.uniform(-largest, largest, 200)
    first, second = slopes(theirs, x)
    one = np.ones_like(x)
    np.testing.assert_allclose(rate(ours, x, one), first, rtol=1e-11)
    once, reverse = slopes(ours, x)
    np.testing.assert_allclose(once, first, rtol=1e-11)
    for twice in (second_rate(ours, x, one, one), reverse):
        np.testing.assert_allclose(twice, second, rtol=1e-9, atol=1e-11)
    h = 1e-6
    np.testing.assert_allclose(first, (ours(x + h) - ours(x - h)) / (2 * h), rtol=1e-6, atol=1e-8)


def test_third_derivatives_of_sine_and_cosine():
    third = jax.grad(jax.grad(jax.grad(sin)))(0.4), jax.grad(jax.grad(jax.grad(cos)))(0.4)
    np.testing.assert_allclose(third, [-np.cos(0.4), np.sin(0.4)], rtol=1e-14)


@pytest.mark.parametrize("dtype", DTYPES)
def test_derivatives_where_there_is_none_are_zero(dtype):
    zero, one = dtype(0), dtype(1)
    assert jax.grad(atan2, (0, 1))(zero, zero) == (0, 0)
    assert np.isfinite(second_rate(lambda v: atan2(v, v), zero, one, one))
    for function in (acos, asin):
        for end in (one, -one):
            assert jax.grad(function)(end) == 0
            assert np.isfinite(second_rate(function, end, one, one))
    for x in (zero, -one):
        assert jax.grad(sqrt)(x) == 0
        assert second_rate(sqrt, x, one, one) == 0
    assert not np.any(jax.grad(lambda v: lanes.norm(lanes.unpack(v)).value)(np.zeros(3, dtype)))


@pytest.mark.parametrize("scale", [1e-150, 1e-20, 1.0, 1e20, 1e150])
def test_derivatives_of_the_arc_tangent_keep_their_size_at_any_scale(scale):
    gradient = np.array(jax.grad(atan2, (0, 1))(3.0 * scale, 4.0 * scale))
    np.testing.assert_allclose(gradient * scale, [4 / 25, -3 / 25], rtol=1e-14)


# Folding


def equations(function) -> int:
    return len(jax.make_jaxpr(lambda x: function(Lane(x)).value)(jnp.ones(3)).eqns)


@pytest.mark.parametrize(
    "law",
    [
        lambda x: x + 0,
        lambda x: 0 + x,
        lambda x: x - 0,
        lambda x: x * 1,
        lambda x: 1 * x,
        lambda x: x / 1,
        lambda x: x * 0,
        lambda x: 0 * x,
        lambda x: 0 / x,
        lambda x: lanes.select(Lane(1.0) < 2.0, x, 2.0),
        lambda x: lanes.lanes_of([0, 1, 0]) @ np.array([x, x, x], dtype=object),
        lambda x: (lanes.identity(3) @ np.array([x, 2.0, 3.0], dtype=object))[0],
    ],
)
def test_known_zeros_and_ones_cost_nothing(law):
    assert equations(law) == 0


@pytest.mark.parametrize("law", [lambda x: 0 - x, lambda x: x * -1, lambda x: -1 * x])
def test_a_known_minus_one_costs_a_negation(law):
    assert equations(law) == 1


def test_products_with_a_known_zero_are_a_known_positive_zero():
    x = Lane(jnp.array([1.0, NAN]))
    for zero in (x * 0, 0 * x, -(x * 0), 0 / x, Lane(-3.0) * 0):
        assert zero.is_known(0.0)
        assert not np.signbit(zero.value)


def test_arithmetic_of_known_numbers_is_known():
    a, b = Lane(3.0), Lane(-2.0)
    results = (a + b, a - b, a * b, a / b, -a, abs(b), 1 + a, 1 - a, 2 * a, 6 / a)
    assert [lane.value for lane in results] == [1, 5, -6, -1.5, -3, 2, 4, -2, 6, 2]
    assert all(lane.known for lane in results)
    assert lanes.maximum(a, b).is_known(3.0)
    assert lanes.minimum(a, b).is_known(-2.0)
    assert all((a > b, a >= b, b < a, b <= a))


def test_maximum_and_minimum_of_arrays(rng):
    a, b = rng.standard_normal((2, 50))
    np.testing.assert_array_equal(lanes.maximum(Lane(a), Lane(b)).value, np.maximum(a, b))
    np.testing.assert_array_equal(lanes.minimum(Lane(a), Lane(b)).value, np.minimum(a, b))


# Packing


@pytest.mark.parametrize("last", [(1,), (6,), (50,), (3, 3), (6, 7), (2, 4, 4)])
def test_packing_undoes_unpacking(rng, last):
    cases = [(batch, dtype) for batch in BATCHES for dtype in DTYPES]
    arrays = [rng.standard_normal(batch + last).astype(dtype) for batch, dtype in cases]

    def undone(arrays):
        pairs = zip(arrays, cases)
        return [lanes.pack(lanes.unpack(x, len(last)), *case) for x, case in pairs]

    # One program for all of them; `test_packing` has each by itself.
    for array, back in zip(arrays, jax.jit(undone)(arrays), strict=True):
        assert back.dtype == array.dtype
        np.testing.assert_array_equal(back, array)


def test_lanes_of_data_are_known_and_broadcast_when_packed():
    data = np.arange(6.0).reshape(2, 3)
    known = lanes.unpack(data, 2)
    assert all(lane.known for lane in known.ravel())
    packed = lanes.pack(known, (4,), np.float32)
    np.testing.assert_array_equal(packed, np.broadcast_to(data, (4, 2, 3)))


# Linear algebra


def unpacked(*arrays):
    return [lanes.unpack(jnp.asarray(array), axes) for array, axes in arrays]


SHAPES = [(6, 6), (3, 6), (6, 8), (6, 4)]


def solution(matrix, rhs, damping):
    tolerance = max(1e-12, eps(matrix.dtype))
    a, b = lanes.unpack(matrix, 2), lanes.unpack(rhs)
    return lanes.pack(lanes.solve(a, b, damping, tolerance), matrix.shape[:-2], matrix.dtype)


solve = jax.jit(solution, static_argnums=2)


@jax.jit
def damped(matrix, rhs, damping):
    """One program for all dampings."""
    return solution(matrix, rhs, Lane(damping))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", SHAPES)
def test_solve_is_the_pseudo_inverse_of_a_matrix_of_full_rank(rng, shape, dtype):
    matrix = rng.standard_normal((100, *shape)).astype(dtype)
    rhs = rng.standard_normal((100, shape[0])).astype(dtype)
    x = np.asarray(solve(matrix, rhs, 0.0))
    assert x.dtype == dtype
    inverse = np.linalg.pinv(matrix.astype(float))
    truth = np.einsum("nij,nj->ni", inverse, rhs)
    sensitivity = np.linalg.norm(inverse, axis=(1, 2)) * np.linalg.norm(matrix, axis=(1, 2))
    scale = np.linalg.norm(inverse, axis=(1, 2)) * np.linalg.norm(rhs, axis=1)
    assert np.all(np.linalg.norm(x - truth, axis=1) < 10 * eps(dtype) * sensitivity * scale)


@pytest.mark.parametrize("shape", SHAPES)
def test_damping_shortens_the_solution_and_vanishes_with_its_square(rng, shape):
    matrix = rng.standard_normal((100, *shape))
    rhs = rng.standard_normal((100, shape[0]))
    lengths = [
        np.linalg.norm(damped(matrix, rhs, damping), axis=1).max()
        for damping in (0.0, 1.0, 10.0, 1000.0)
    ]
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] < 1e-3
    exact = solve(matrix, rhs, 0.0)
    near, nearer = (damped(matrix, rhs, d) for d in (2e-4, 1e-4))
    ratio = np.linalg.norm(near - exact, axis=1) / np.linalg.norm(nearer - exact, axis=1)
    np.testing.assert_allclose(np.median(ratio), 4.0, rtol=1e-2)


def test_damping_bounds_the_solution_where_the_matrix_is_nearly_singular(rng):
    matrix = rng.standard_normal((100, 6, 6))
    matrix[:, 5] = matrix[:, 4] + 1e-9 * matrix[:, 5]
    rhs = rng.standard_normal((100, 6))
    assert np.linalg.norm(solve(matrix, rhs, 0.0), axis=1).max() > 1e7
    assert np.linalg.norm(solve(matrix, rhs, 0.1), axis=1).max() < 1e4


@pytest.mark.parametrize("shape", SHAPES)
def test_a_row_or_column_that_depends_on_those_before_it_is_left_out(rng, shape):
    m, n = shape
    matrix = rng.standard_normal((100, *shape))
    rhs = rng.standard_normal((100, m))
    if m <= n:
        matrix[:, -1] = matrix[:, 0]
        rest, right = matrix[:, :-1], rhs[:, :-1]
    else:
        matrix[:, :, -1] = matrix[:, :, 0]
        rest, right = matrix[:, :, :-1], rhs
    x = np.asarray(solve(matrix, rhs, 0.0))
    truth = np.einsum("nij,nj->ni", np.linalg.pinv(rest), right)
    np.testing.assert_allclose(x[:, : truth.shape[1]], truth, rtol=1e-8, atol=1e-8)
    np.testing.assert_array_equal(x[:, truth.shape[1] :], 0.0)


def test_an_unknown_without_a_pivot_drops_out_of_the_solution():
    def solve(diagonal):
        matrix = lanes.unpack(jnp.diag(diagonal), 2)
        rhs = lanes.lanes_of([1.0, 1.0, 1.0])
        return lanes.pack(lanes.solve(matrix, rhs, 0.0, 1e-14), (), float)

    diagonal = jnp.array([2.0, 0.0, 4.0])
    np.testing.assert_allclose(solve(diagonal), [0.5, 0.0, 0.25])
    np.testing.assert_allclose(jax.jacrev(solve)(diagonal), np.diag([-0.25, 0.0, -0.0625]))


@pytest.mark.parametrize("shape", [(6, 6), (3, 6), (6, 8)])
def test_volume_is_the_root_of_the_gram_determinant(rng, shape):
    rows = rng.standard_normal((100, *shape))
    volume = jax.jit(lambda a: lanes.volume(lanes.unpack(a, 2)).value)(rows)
    gram = np.linalg.det(rows @ np.swapaxes(rows, 1, 2))
    # The determinant of the Gram matrix, not the volume, has the larger error.
    np.testing.assert_allclose(volume, np.sqrt(gram), rtol=1e-12, atol=1e-9 * np.max(volume))


def test_cross_hat_vee_outer_and_norm(rng):
    a, b = rng.standard_normal((2, 3))
    la, lb = unpacked((a, 1), (b, 1))

    def array(values):
        return np.array([lane.value for lane in values.ravel()]).reshape(values.shape)

    np.testing.assert_allclose(array(lanes.cross(la, lb)), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(array(lanes.hat(la) @ lb), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(array(lanes.vee(lanes.hat(la))), a)
    np.testing.assert_allclose(array(lanes.outer(la, lb)), np.outer(a, b))
    np.testing.assert_allclose(lanes.norm(la).value, np.linalg.norm(a))


def test_half_pi_and_pi_are_reached_with_their_rounding():
    assert float(atan2(1.0, 0.0)) == float(PI / 2)
    assert float(atan2(0.0, -1.0)) == float(PI)
    np.testing.assert_allclose(sincos(np.pi)[0], 1.2246467991473532e-16, rtol=1e-15)
