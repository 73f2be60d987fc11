"""Laws of the rotation group, sampled on purpose near the identity and near the half turn."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import (
    BATCHES,
    DTYPES,
    LD,
    PI,
    eps,
    expm,
    hat3,
    modern_robotics,
    random_rotations,
    rate,
    rate_truth,
    second_rate,
    unit_vectors,
)

from niryo_jax import so3

N = 2000
HALF_TURNS = [np.diag(d) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1])]


def rotation_vectors(rng, dtype, n=N):
    """Vectors near 0, near pi and in between, a third each, as numbers of the dtype."""
    smallest, below = (-300, 16) if dtype == np.float64 else (-30, 7)
    angles = np.concatenate(
        [
            10.0 ** rng.uniform(smallest, -6, n),
            np.pi - 10.0 ** rng.uniform(-below, -1, n),
            rng.uniform(0, np.pi, n),
        ]
    )
    return (unit_vectors(rng, (3 * n,)) * angles[:, None]).astype(dtype)


def length(vector):
    return np.sqrt(np.sum(np.square(np.asarray(vector, LD)), axis=-1))


angles = st.one_of(
    st.floats(1e-300, 1e-6),
    st.floats(0, 1e-6).map(lambda x: np.pi - x),
    st.sampled_from([np.pi, np.pi - 1e-16, np.pi - 1e-15, np.pi - 1e-9, np.pi - 1e-7, 1e-8, 1.0]),
    st.floats(0, np.pi),
)
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: sum(x * x for x in v) > 1e-3)


# Exponential and logarithm


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_is_the_matrix_exponential(rng, dtype):
    w = rotation_vectors(rng, dtype)
    rotation = so3.exp(w)
    assert rotation.dtype == dtype
    assert np.max(np.abs(np.asarray(rotation) - expm(hat3(w.astype(LD))))) < 8 * eps(dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_of_more_than_half_a_turn_is_the_matrix_exponential(rng, dtype):
    w = (unit_vectors(rng, (N,)) * rng.uniform(np.pi, 30, (N, 1))).astype(dtype)
    error = np.abs(np.asarray(so3.exp(w)) - expm(hat3(w.astype(LD))))
    assert np.max(error) < 30 * 2 * eps(dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_log_undoes_exp_relative_to_the_angle_up_to_the_half_turn(rng, dtype):
    w = rotation_vectors(rng, dtype)
    angle = length(w)
    found = np.asarray(so3.log(so3.exp(w)), LD)
    error = length(found - w)
    # Where rounding may carry the angle over the half turn, the opposite vector is as right.
    opposite = length(found + (2 * PI / angle - 1)[:, None] * w)
    crossing = angle > PI - 16 * eps(dtype)
    error = np.where(crossing, np.minimum(error, opposite), error)
    assert np.all(error <= 16 * eps(dtype) * angle)


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_undoes_log(rng, dtype):
    rotation = np.concatenate(
        [
            random_rotations(rng, (N,)),
            expm(hat3(rotation_vectors(rng, np.float64).astype(LD))),
            HALF_TURNS,
            [np.eye(3)],
            2 * (v := unit_vectors(rng, (N,)))[:, :, None] * v[:, None, :] - np.eye(3),
        ]
    ).astype(dtype)
    w = so3.log(rotation)
    assert w.dtype == dtype
    assert np.all(length(w) <= PI * (1 + 2 * eps(dtype)))
    assert np.max(np.abs(so3.exp(w) - rotation)) < 16 * eps(dtype)


@given(angle=angles, direction=directions)
def test_log_and_exp_are_inverse_at_any_angle(angle, direction):
    unit = np.array(direction, LD) / length(direction)
    w = (angle * unit).astype(np.float64)
    found = np.asarray(so3.log(so3.exp(w)), LD)
    bound = 16 * eps(np.float64) * length(w) + 1e-307
    opposite = length(found + 2 * PI * unit - w) if angle > np.pi - 1e-14 else np.inf
    assert min(length(found - w), opposite) <= bound


def test_log_of_the_identity_and_of_exact_half_turns():
    np.testing.assert_array_equal(so3.log(np.eye(3)), np.zeros(3))
    found = np.abs(so3.log(np.array(HALF_TURNS)))
    np.testing.assert_allclose(found, np.pi * np.eye(3), rtol=eps(float), atol=0)


# The group


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_is_a_rotation_and_its_inverse_is_that_of_the_opposite_vector(rng, dtype):
    w = rotation_vectors(rng, dtype)
    rotation = so3.exp(w)
    product = np.asarray(so3.inverse(rotation), float) @ np.asarray(rotation, float)
    assert np.max(np.abs(product - np.eye(3))) < 10 * eps(dtype)
    assert np.max(np.abs(np.linalg.det(np.asarray(rotation, float)) - 1)) < 10 * eps(dtype)
    np.testing.assert_allclose(so3.exp(-w), so3.inverse(rotation), atol=2 * eps(dtype))


def test_turns_about_one_axis_add_up(rng):
    w = rng.standard_normal((N, 3))
    s, t = rng.uniform(-2, 2, (2, N, 1))
    product = np.asarray(so3.exp(s * w)) @ np.asarray(so3.exp(t * w))
    np.testing.assert_allclose(product, so3.exp((s + t) * w), atol=1e-14)


def test_turning_the_axis_conjugates_the_rotation(rng):
    w, turn = rotation_vectors(rng, np.float64)[:N], random_rotations(rng, (N,)).astype(float)
    turned = np.einsum("nij,nj->ni", turn, w)
    conjugate = turn @ np.asarray(so3.exp(w)) @ np.swapaxes(turn, 1, 2)
    np.testing.assert_allclose(so3.exp(turned), conjugate, atol=1e-14)


def test_log_of_the_inverse_is_the_opposite_vector(rng):
    rotation = random_rotations(rng, (N,)).astype(float)
    np.testing.assert_allclose(so3.log(so3.inverse(rotation)), -so3.log(rotation), atol=1e-15)


def test_composition_is_associative_and_stays_in_the_group(rng):
    a, b, c = (np.asarray(so3.exp(w)) for w in np.split(rotation_vectors(rng, np.float64), 3))
    np.testing.assert_allclose(a @ (b @ c), (a @ b) @ c, atol=2e-15)
    np.testing.assert_allclose(so3.exp(so3.log(a @ b @ c)), a @ b @ c, atol=1e-14)


def test_hat_is_the_cross_product_and_vee_undoes_it(rng):
    w, x = rng.standard_normal((2, 50, 3))
    product = np.einsum("nij,nj->ni", so3.hat(w), x)
    np.testing.assert_allclose(product, np.cross(w, x), atol=1e-15)
    np.testing.assert_array_equal(so3.vee(so3.hat(w)), w)
    symmetric = (m := rng.standard_normal((50, 3, 3))) + np.swapaxes(m, 1, 2)
    np.testing.assert_allclose(so3.vee(so3.hat(w) + symmetric), w, atol=1e-15)


# Axis and angle


@pytest.mark.parametrize("dtype", DTYPES)
def test_axis_and_angle_are_direction_and_length_at_any_scale(rng, dtype):
    w = rotation_vectors(rng, dtype)
    axis, angle = so3.axis_angle(w)
    assert axis.dtype == angle.dtype == dtype
    truth = length(w)
    assert np.all(np.abs(np.asarray(angle, LD) - truth) <= 4 * eps(dtype) * truth)
    assert np.max(np.abs(np.asarray(axis, LD) - w / truth[:, None])) < 4 * eps(dtype)


def test_the_zero_vector_has_no_axis_and_no_derivative_that_is_not_finite(rng):
    axis, angle = so3.axis_angle(np.zeros(3))
    np.testing.assert_array_equal([*axis, angle], np.zeros(4))
    w = np.concatenate([np.zeros((1, 3)), rotation_vectors(rng, np.float64, 20)])
    gradient = jax.grad(lambda w: sum(jnp.sum(part) for part in so3.axis_angle(w)))(w)
    assert np.all(np.isfinite(gradient))
    by_angle = jax.grad(lambda w: jnp.sum(so3.axis_angle(w)[1]))(w)
    np.testing.assert_allclose(by_angle, so3.axis_angle(w)[0], atol=1e-15)


def test_derivatives_of_axis_and_angle_equal_finite_differences(rng):
    w, u = rng.standard_normal((2, 60, 3))
    axis_rate, angle_rate = rate(so3.axis_angle, w, u)
    truth = rate_truth(lambda w: w / length(w)[:, None], w, u).astype(float)
    np.testing.assert_allclose(axis_rate, truth, atol=1e-8)
    np.testing.assert_allclose(angle_rate, rate_truth(length, w, u).astype(float), atol=1e-8)


# Derivatives


def round_trip(w):
    return so3.log(so3.exp(w))


def vectors_and_directions(rng, dtype):
    """60 vectors w (near the identity, near the half turn, in between) and two directions each."""
    w = rotation_vectors(rng, dtype, 20)
    return w, *rng.standard_normal((2, *w.shape)).astype(dtype)


def test_derivatives_of_exp_at_the_identity_are_the_generators(rng):
    _, u, s = vectors_and_directions(rng, np.float64)
    zero = np.zeros_like(u)
    np.testing.assert_array_equal(rate(so3.exp, zero, u), hat3(u))
    symmetric = (hat3(u) @ hat3(s) + hat3(s) @ hat3(u)) / 2
    np.testing.assert_allclose(second_rate(so3.exp, zero, u, s), symmetric, atol=1e-15)


def test_derivatives_of_exp_equal_finite_differences(rng):
    w, u, s = vectors_and_directions(rng, np.float64)
    w[-5:] *= 4

    def truth(w):
        return expm(hat3(w))

    first = rate_truth(truth, w, u).astype(float)
    np.testing.assert_allclose(rate(so3.exp, w, u), first, atol=1e-10)
    second = rate_truth(lambda w: rate_truth(truth, w, u), w, s).astype(float)
    np.testing.assert_allclose(second_rate(so3.exp, w, u, s), second, atol=1e-8)


def test_reverse_and_forward_derivatives_of_exp_and_log_agree(rng):
    w, u, _ = vectors_and_directions(rng, np.float64)
    weights = rng.standard_normal((60, 3, 3))
    reverse = jax.grad(lambda w: jnp.sum(weights * so3.exp(w)))(w)
    forward = np.sum(weights * rate(so3.exp, w, u), axis=(1, 2))
    np.testing.assert_allclose(np.sum(reverse * u, axis=1), forward, atol=1e-13)
    rotation = so3.exp(w)
    reverse = jax.grad(lambda r: jnp.sum(u * so3.log(r)))(rotation)
    forward = np.sum(u * rate(so3.log, rotation, weights), axis=1)
    np.testing.assert_allclose(np.sum(reverse * weights, axis=(1, 2)), forward, atol=1e-12)


@pytest.mark.parametrize("dtype", DTYPES)
def test_log_after_exp_has_the_derivatives_of_the_identity_map(rng, dtype):
    w, u, s = vectors_and_directions(rng, dtype)
    w[0] = 0
    w[length(w) > PI - 16 * eps(dtype)] = 0
    first = rate(round_trip, w, u)
    assert first.dtype == dtype
    np.testing.assert_allclose(first, u, atol=100 * eps(dtype))
    np.testing.assert_allclose(
        second_rate(round_trip, w, u, s), np.zeros_like(u), atol=1000 * eps(dtype)
    )


def test_log_after_exp_at_the_half_turn_is_one_of_the_two_smooth_branches(rng):
    unit = unit_vectors(rng, (60,)).astype(float)
    w, (u, s) = np.pi * unit, rng.standard_normal((2, 60, 3))
    same = np.einsum("ni,ni->n", round_trip(w), unit) > 0
    # Branch w, or branch w - 2 pi w / |w|, whose derivative is I - 2 (I - n n^T).
    mirrored = 2 * unit * np.sum(unit * u, axis=1, keepdims=True) - u
    truth = np.where(same[:, None], u, mirrored)
    np.testing.assert_allclose(rate(round_trip, w, u), truth, atol=1e-13)
    assert np.all(np.isfinite(second_rate(round_trip, w, u, s)))


@pytest.mark.parametrize("dtype", DTYPES)
def test_derivatives_of_log_are_finite_at_the_identity_and_at_exact_half_turns(rng, dtype):
    corners = np.array([np.eye(3), *HALF_TURNS, [[0, 1, 0], [1, 0, 0], [0, 0, -1]]], dtype)
    rotations = np.concatenate([corners] * 12)
    u, s = rng.standard_normal((2, *rotations.shape)).astype(dtype)
    assert np.all(np.isfinite(rate(so3.log, rotations, u)))
    assert np.all(np.isfinite(second_rate(so3.log, rotations, u, s)))


# Projection


def nearest_rotation(matrix):
    """Kabsch: the nearest rotation by numpy's singular value decomposition."""
    u, _, vt = np.linalg.svd(np.asarray(matrix, float))
    signs = np.ones(matrix.shape[:-1])
    signs[..., 2] = np.sign(np.linalg.det(u @ vt))
    return (u * signs[..., None, :]) @ vt


def with_singular_values(rng, values, n=N):
    u, v = random_rotations(rng, (n,)).astype(float), random_rotations(rng, (n,)).astype(float)
    return (u * np.array(values)) @ np.swapaxes(v, 1, 2)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize(
    "values",
    [(1.001, 1, 0.998), (3, 2, 1), (5, 1, 1e-3), (1, 1, 1), (1, 1, 0), (1, 0.5, 0), (3, 2, -1)],
    ids=str,
)
def test_project_gives_the_nearest_rotation_and_its_distance(rng, values, dtype):
    matrix = with_singular_values(rng, values).astype(dtype)
    rotation, distance = so3.project(matrix)
    assert rotation.dtype == distance.dtype == dtype
    np.testing.assert_allclose(rotation, nearest_rotation(matrix), atol=60 * eps(dtype))
    truth = np.linalg.norm(np.array(values) - 1)
    np.testing.assert_allclose(distance, truth, atol=20 * eps(dtype), rtol=20 * eps(dtype))


def test_no_rotation_is_nearer_than_the_projection(rng):
    matrix = rng.standard_normal((200, 3, 3))
    rotation, distance = so3.project(matrix)
    others = np.concatenate([random_rotations(rng, (500,)).astype(float), np.asarray(rotation)])
    distances = np.linalg.norm(matrix[:, None] - others, axis=(2, 3))
    assert np.all(distance <= distances.min(axis=1) + 1e-13)
    truth = np.linalg.norm(matrix - nearest_rotation(matrix), axis=(1, 2))
    np.testing.assert_allclose(distance, truth, rtol=1e-13)


@pytest.mark.parametrize("dtype", DTYPES)
def test_project_leaves_rotations_alone(rng, dtype):
    rotation = random_rotations(rng, (N,)).astype(dtype)
    projected, distance = so3.project(rotation)
    np.testing.assert_allclose(projected, rotation, atol=4 * eps(dtype))
    assert np.max(distance) < 8 * eps(dtype)


def test_project_does_not_feel_the_scale(rng):
    matrix = rng.standard_normal((N, 3, 3))
    rotation, _ = so3.project(matrix)
    for scale in (2.0**-500, 2.0**-20, 2.0**300):
        np.testing.assert_allclose(so3.project(scale * matrix)[0], rotation, atol=1e-15)


def test_project_of_singular_matrices_and_reflections():
    cases = {
        np.sqrt(3): np.zeros((3, 3)),
        np.sqrt(2): np.diag([1.0, 0, 0]),
        np.sqrt(27): np.full((3, 3), 2.0),
        np.sqrt(6): np.diag([2.0, 3, 0]),
        2.0: -np.eye(3),
        np.sqrt(5): np.diag([2.0, 1, -1]),
    }
    matrix = np.stack(list(cases.values()))
    rotation, distance = map(np.asarray, so3.project(matrix))
    identity = np.broadcast_to(np.eye(3), matrix.shape)
    np.testing.assert_allclose(np.swapaxes(rotation, 1, 2) @ rotation, identity, atol=1e-14)
    assert np.all(np.linalg.det(rotation) > 0.999)
    # Where several rotations are nearest, one of them to half the digits is as near to all of them.
    np.testing.assert_allclose(distance, list(cases), rtol=1e-10)
    gradient = jax.grad(lambda m: sum(jnp.sum(part) for part in so3.project(m)))(matrix)
    assert np.all(np.isfinite(gradient))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_project_does_not_hide_what_is_not_finite(bad):
    for matrix in (np.full((3, 3), bad), np.eye(3) + np.diag([0, bad, 0])):
        rotation, distance = so3.project(matrix)
        assert not np.all(np.isfinite(rotation))
        assert not distance < np.inf


def test_derivative_of_project_equals_finite_differences(rng):
    matrix = np.concatenate(
        [with_singular_values(rng, (3, 2, 1), 10), with_singular_values(rng, (3, 2, -1), 10)]
    )
    change = rng.standard_normal(matrix.shape)

    def distance(m):
        return np.linalg.norm(m.astype(float) - nearest_rotation(m), axis=(1, 2))

    rotation_rate, distance_rate = rate(so3.project, matrix, change)
    truth = rate_truth(nearest_rotation, matrix, change).astype(float)
    np.testing.assert_allclose(rotation_rate, truth, atol=1e-8)
    truth = rate_truth(distance, matrix, change).astype(float)
    np.testing.assert_allclose(distance_rate, truth, atol=1e-8)


def test_derivative_of_project_at_a_rotation_keeps_the_skew_part(rng):
    rotation = random_rotations(rng, (20,)).astype(float)
    change = rng.standard_normal((20, 3, 3))
    found, _ = rate(so3.project, rotation, rotation @ change)
    skew = (change - np.swapaxes(change, 1, 2)) / 2
    np.testing.assert_allclose(found, rotation @ skew, atol=1e-14)


# ModernRobotics


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("VecToso3", so3.hat),
        ("so3ToVec", so3.vee),
        ("RotInv", so3.inverse),
        ("MatrixExp3", lambda matrix: so3.exp(so3.vee(matrix))),
        ("MatrixLog3", lambda rotation: so3.hat(so3.log(rotation))),
        ("ProjectToSO3", lambda matrix: so3.project(matrix)[0]),
    ],
)
def test_modern_robotics_vectors(name, ours):
    cases = modern_robotics(name)
    found = ours(np.stack([argument for (argument,), _ in cases]))
    np.testing.assert_allclose(found, np.stack([result for _, result in cases]), atol=1e-12)


def test_modern_robotics_axis_and_angle_are_those_of_the_vector():
    for (vector,), (axis, angle) in modern_robotics("AxisAng3"):
        turn = so3.exp(vector)
        np.testing.assert_allclose(turn @ axis, axis, atol=1e-14)
        np.testing.assert_allclose(jnp.trace(turn), 1 + 2 * np.cos(angle), atol=1e-14)


# Shapes, types and transformations

FUNCTIONS = [
    (so3.hat, "w", (3,), ((3, 3),)),
    (so3.vee, "matrix", (3, 3), ((3,),)),
    (so3.inverse, "rotation", (3, 3), ((3, 3),)),
    (so3.exp, "w", (3,), ((3, 3),)),
    (so3.log, "rotation", (3, 3), ((3,),)),
    (so3.axis_angle, "w", (3,), ((3,), ())),
    (so3.project, "matrix", (3, 3), ((3, 3), ())),
]
every_function = pytest.mark.parametrize(
    ("function", "name", "shape", "results"), FUNCTIONS, ids=[f[0].__name__ for f in FUNCTIONS]
)


@every_function
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_and_dtype_follow_the_input(function, name, shape, results, batch, dtype):
    found = jax.tree.leaves(jax.eval_shape(function, jax.ShapeDtypeStruct(batch + shape, dtype)))
    assert [(x.shape, x.dtype) for x in found] == [(batch + r, dtype) for r in results]


@every_function
def test_a_batch_is_its_elements_and_vmap_and_jit_change_nothing(
    rng, function, name, shape, results
):
    rotation = random_rotations(rng, (3, 2)).astype(float)
    x = rng.standard_normal((3, 2, 3)) if shape == (3,) else rotation
    whole = jax.tree.leaves(jax.jit(function)(x))
    mapped = jax.tree.leaves(jax.vmap(jax.vmap(function))(x))
    single = jax.tree.leaves(function(x[1, 1]))
    for a, b, c in zip(whole, mapped, single):
        np.testing.assert_allclose(a, b, atol=1e-15)
        np.testing.assert_allclose(a[1, 1], c, atol=1e-15)
    assert jax.tree.leaves(function(x[:0]))[0].shape[0] == 0


@every_function
def test_wrong_shapes_are_refused_by_name(function, name, shape, results):
    for wrong in ((), (2,), (2, *shape[:-1], 4), (6,)):
        with pytest.raises(ValueError, match=rf"^{name}: expected shape .*got"):
            function(np.zeros(wrong))


@every_function
def test_types_that_are_not_real_numbers_are_refused_and_integers_are_taken(
    function, name, shape, results
):
    with pytest.raises(TypeError, match=rf"^{name}: expected real numbers"):
        function(np.zeros(shape, complex))
    one = np.eye(3, dtype=int) if len(shape) == 2 else np.array([1, 2, 3])
    for a, b in zip(jax.tree.leaves(function(one)), jax.tree.leaves(function(one.astype(float)))):
        np.testing.assert_array_equal(a, b)
