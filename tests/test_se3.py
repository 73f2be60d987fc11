"""Laws of the rigid motions, their twists and their screws."""

from __future__ import annotations

import inspect

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
    adjoint_matrix,
    eps,
    expm,
    hat6,
    modern_robotics,
    random_poses,
    random_rotations,
    rate,
    rate_truth,
    rigid,
    rigid_inverse,
    second_rate,
    unit_vectors,
    vee6,
)

from niryo_jax import se3, so3

N = 1000


def twists(rng, dtype, n=N):
    """Twists that turn by nearly 0, by nearly pi and in between, n each, and n translations."""
    smallest, below = (-300, 16) if dtype == np.float64 else (-30, 7)
    angles = np.concatenate(
        [
            10.0 ** rng.uniform(smallest, -6, n),
            np.pi - 10.0 ** rng.uniform(-below, -1, n),
            rng.uniform(0, np.pi, n),
            np.zeros(n),
        ]
    )
    w = unit_vectors(rng, (4 * n,)) * angles[:, None]
    return np.concatenate([w, rng.uniform(-1, 1, (4 * n, 3))], axis=1).astype(dtype)


def length(vector):
    return np.sqrt(np.sum(np.square(np.asarray(vector, LD)), axis=-1))


# Exponential and logarithm


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_is_the_matrix_exponential(rng, dtype):
    v = twists(rng, dtype)
    pose = se3.exp(v)
    assert pose.dtype == dtype
    assert np.max(np.abs(np.asarray(pose) - expm(hat6(v.astype(LD))))) < 10 * eps(dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_of_several_turns_is_the_matrix_exponential(rng, dtype):
    v = (rng.standard_normal((N, 6)) * 5).astype(dtype)
    error = np.max(np.abs(np.asarray(se3.exp(v)) - expm(hat6(v.astype(LD)))), axis=(1, 2))
    assert np.all(error < 4 * eps(dtype) * (1 + length(v[:, :3])) * (1 + length(v[:, 3:])))


@pytest.mark.parametrize("dtype", DTYPES)
def test_log_undoes_exp_up_to_the_half_turn(rng, dtype):
    v = twists(rng, dtype)
    v = v[length(v[:, :3]) < PI - 16 * eps(dtype)][: 3 * N]
    found = np.asarray(se3.log(se3.exp(v)), LD)
    angle = length(v[:, :3])
    assert np.all(length(found[:, :3] - v[:, :3]) <= 16 * eps(dtype) * angle)
    assert np.max(length(found[:, 3:] - v[:, 3:])) < 40 * eps(dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_exp_undoes_log(rng, dtype):
    turns = np.concatenate(
        [
            random_rotations(rng, (N,)),
            2 * (a := unit_vectors(rng, (N,)))[:, :, None] * a[:, None, :] - np.eye(3),
            [np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])],
        ]
    )
    pose = rigid(turns, rng.uniform(-1, 1, (len(turns), 3))).astype(dtype)
    v = se3.log(pose)
    assert v.dtype == dtype
    assert np.max(np.abs(se3.exp(v) - pose)) < 40 * eps(dtype)


@given(
    angle=st.one_of(
        st.floats(1e-300, 1e-6),
        st.floats(0, 1e-6).map(lambda x: np.pi - x),
        st.sampled_from([np.pi, np.pi - 1e-15, np.pi - 1e-9, 0.5, 1.0]),
        st.floats(0, np.pi),
    ),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: sum(x * x for x in v) > 1e-3),
    linear=st.tuples(*[st.floats(-2, 2)] * 3),
)
def test_exp_undoes_log_undoes_exp_at_any_angle(angle, direction, linear):
    w = angle * np.array(direction) / np.linalg.norm(direction)
    pose = np.asarray(se3.exp(np.array([*w, *linear])))
    found = np.asarray(se3.log(pose))
    assert np.all(np.isfinite(found))
    np.testing.assert_allclose(se3.exp(found), pose, atol=2e-14)
    if angle < np.pi - 1e-14:
        np.testing.assert_allclose(found, [*w, *linear], atol=2e-14)


# The group and its adjoint representation


def test_inverse_and_motions_along_one_screw_add_up(rng):
    v = twists(rng, np.float64)
    pose = np.asarray(se3.exp(v))
    identity = np.broadcast_to(np.eye(4), pose.shape)
    np.testing.assert_allclose(pose @ np.asarray(se3.inverse(pose)), identity, atol=2e-15)
    np.testing.assert_allclose(se3.inverse(pose), se3.exp(-v), atol=2e-15)
    s, t = rng.uniform(-2, 2, (2, len(v), 1))
    product = np.asarray(se3.exp(s * v)) @ np.asarray(se3.exp(t * v))
    np.testing.assert_allclose(product, se3.exp((s + t) * v), atol=1e-13)


def test_hat_is_the_matrix_of_a_twist_and_vee_undoes_it(rng):
    v = rng.standard_normal((50, 6))
    np.testing.assert_array_equal(se3.hat(v), hat6(v))
    np.testing.assert_array_equal(se3.vee(se3.hat(v)), v)


def test_adjoint_carries_twists_as_conjugation_carries_their_matrices(rng):
    pose, v = random_poses(rng, (N,)), rng.standard_normal((N, 6))
    adjoint = np.asarray(se3.adjoint(pose.astype(float)))
    np.testing.assert_allclose(adjoint, adjoint_matrix(pose).astype(float), atol=1e-15)
    moved = np.einsum("nij,nj->ni", adjoint, v)
    conjugate = pose @ hat6(v) @ rigid_inverse(pose)
    np.testing.assert_allclose(se3.hat(moved), conjugate.astype(float), atol=1e-14)
    np.testing.assert_allclose(
        se3.exp(moved), (pose @ expm(hat6(v)) @ rigid_inverse(pose)).astype(float), atol=1e-13
    )


def test_adjoint_is_a_representation(rng):
    a, b = random_poses(rng, (2, N)).astype(float)
    product = np.asarray(se3.adjoint(a)) @ np.asarray(se3.adjoint(b))
    np.testing.assert_allclose(se3.adjoint(a @ b), product, atol=1e-14)
    inverse = np.linalg.inv(se3.adjoint(a))
    np.testing.assert_allclose(se3.adjoint(se3.inverse(a)), inverse, atol=1e-13)


def test_ad_is_the_lie_bracket_and_the_derivative_of_the_adjoint(rng):
    v, w = rng.standard_normal((2, N, 6))
    bracket = hat6(v) @ hat6(w) - hat6(w) @ hat6(v)
    ad = np.asarray(se3.ad(v))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", ad, w), vee6(bracket), atol=1e-14)
    np.testing.assert_allclose(se3.adjoint(se3.exp(v)), expm(ad).astype(float), atol=1e-13)


# Derivatives


def round_trip(v):
    return se3.log(se3.exp(v))


def twists_and_directions(rng, dtype):
    v = twists(rng, dtype, 15)
    return v, *rng.standard_normal((2, *v.shape)).astype(dtype)


def test_derivatives_of_exp_at_the_identity_are_the_generators(rng):
    _, u, s = twists_and_directions(rng, np.float64)
    zero = np.zeros_like(u)
    np.testing.assert_array_equal(rate(se3.exp, zero, u), hat6(u))
    symmetric = (hat6(u) @ hat6(s) + hat6(s) @ hat6(u)) / 2
    np.testing.assert_allclose(second_rate(se3.exp, zero, u, s), symmetric, atol=2e-15)


def test_derivatives_of_exp_equal_finite_differences(rng):
    v, u, s = twists_and_directions(rng, np.float64)

    def truth(v):
        return expm(hat6(v))

    first = rate_truth(truth, v, u).astype(float)
    np.testing.assert_allclose(rate(se3.exp, v, u), first, atol=1e-9)
    second = rate_truth(lambda v: rate_truth(truth, v, u), v, s).astype(float)
    np.testing.assert_allclose(second_rate(se3.exp, v, u, s), second, atol=1e-7)


@pytest.mark.parametrize("dtype", DTYPES)
def test_log_after_exp_has_the_derivatives_of_the_identity_map(rng, dtype):
    v, u, s = twists_and_directions(rng, dtype)
    v[0] = 0
    v[length(v[:, :3]) > PI - 16 * eps(dtype)] = 0
    first = rate(round_trip, v, u)
    assert first.dtype == dtype
    np.testing.assert_allclose(first, u, atol=200 * eps(dtype))
    if dtype == np.float64:
        second = second_rate(round_trip, v, u, s)
        np.testing.assert_allclose(second, np.zeros_like(u), atol=4000 * eps(dtype))


def test_derivatives_of_log_are_finite_at_the_identity_and_at_exact_half_turns(rng):
    turns = [np.eye(3), *(2 * np.outer(a, a) - np.eye(3) for a in np.eye(3))]
    pose = rigid(np.array(turns * 15), rng.uniform(-1, 1, (60, 3))).astype(float)
    u, s = rng.standard_normal((2, 60, 4, 4))
    assert np.all(np.isfinite(rate(se3.log, pose, u)))
    assert np.all(np.isfinite(second_rate(se3.log, pose, u, s)))
    gradient = jax.grad(lambda pose: jnp.sum(se3.log(pose)))(pose)
    assert np.all(np.isfinite(gradient))


# Projection


def test_project_is_the_projection_of_the_rotation_and_restores_the_last_row(rng):
    matrix = random_poses(rng, (200,)).astype(float) + 0.05 * rng.standard_normal((200, 4, 4))
    motion, distance = map(np.asarray, se3.project(matrix))
    np.testing.assert_allclose(motion[:, :3, :3], so3.project(matrix[:, :3, :3])[0], atol=1e-14)
    np.testing.assert_array_equal(motion[:, :3, 3], matrix[:, :3, 3])
    np.testing.assert_array_equal(motion[:, 3], np.broadcast_to([0.0, 0, 0, 1], (200, 4)))
    np.testing.assert_allclose(distance, np.linalg.norm(motion - matrix, axis=(1, 2)), rtol=1e-13)


def test_project_leaves_rigid_motions_alone(rng):
    pose = random_poses(rng, (N,)).astype(float)
    motion, distance = se3.project(pose)
    np.testing.assert_allclose(motion, pose, atol=1e-15)
    assert np.max(distance) < 2e-15


def test_project_does_not_hide_what_is_not_a_number():
    pose = np.eye(4)
    pose[1, 1] = np.nan
    assert not se3.project(pose)[1] < np.inf


# Screws and their axes


def axes(rng, n=N):
    """Points, unit directions and pitches; the points are those closest to the origin."""
    direction = unit_vectors(rng, (n,)).astype(float)
    point = np.cross(direction, rng.uniform(-1, 1, (n, 3)))
    return point, direction, rng.uniform(-2, 2, n)


def test_axis_of_the_screw_about_an_axis_is_that_axis(rng):
    point, direction, pitch = axes(rng)
    along = point + rng.uniform(-3, 3, (N, 1)) * direction
    stretch = rng.uniform(0.1, 5, (N, 1))
    screw = se3.screw_from_axis(along, stretch * direction, pitch)
    np.testing.assert_allclose(np.linalg.norm(screw[:, :3], axis=1), 1, atol=1e-15)
    rates = rng.uniform(0.1, 5, N)
    found = se3.axis_of_screw(rates[:, None] * screw)
    np.testing.assert_allclose(found.point, point, atol=1e-14)
    np.testing.assert_allclose(found.direction, direction, atol=1e-15)
    np.testing.assert_allclose(found.pitch, pitch, atol=1e-14)
    np.testing.assert_allclose(found.magnitude, rates, rtol=1e-14)


def test_a_screw_moves_the_points_of_its_axis_along_it_by_the_pitch(rng):
    point, direction, pitch = axes(rng)
    angle = rng.uniform(-3, 3, (N, 1))
    motion = np.asarray(se3.exp(angle * se3.screw_from_axis(point, direction, pitch)))
    moved = np.einsum("nij,nj->ni", motion[:, :3, :3], point) + motion[:, :3, 3]
    np.testing.assert_allclose(moved, point + angle * pitch[:, None] * direction, atol=1e-13)


def test_infinite_pitch_is_a_translation_and_zero_pitch_is_the_default(rng):
    point, direction, _ = axes(rng)
    screw = se3.screw_from_axis(point, 2 * direction, np.full(N, np.inf))
    np.testing.assert_allclose(screw, np.concatenate([0 * direction, direction], 1), atol=1e-15)
    found = se3.axis_of_screw(3 * screw)
    np.testing.assert_array_equal(found.point, 0 * point)
    np.testing.assert_allclose(found.direction, direction, atol=1e-15)
    np.testing.assert_array_equal(found.pitch, np.full(N, np.inf))
    np.testing.assert_allclose(found.magnitude, 3, rtol=1e-15)
    # A number and an array are two programs, which may round differently.
    default = se3.screw_from_axis(point, direction)
    zero = se3.screw_from_axis(point, direction, np.zeros(N))
    np.testing.assert_allclose(default, zero, rtol=0, atol=1e-15)


def test_the_zero_twist_has_no_direction_and_no_magnitude():
    found = se3.axis_of_screw(np.zeros(6))
    for part in (found.point, found.direction, found.pitch, found.magnitude):
        np.testing.assert_array_equal(part, np.zeros(part.shape))


def test_derivatives_of_screws_and_axes_are_finite_for_every_kind(rng):
    point, direction, pitch = axes(rng, 6)
    pitch[:2] = np.inf
    gradients = jax.grad(lambda *args: jnp.sum(se3.screw_from_axis(*args)), (0, 1, 2))(
        point, direction, pitch
    )
    assert all(np.all(np.isfinite(g)) for g in gradients)
    screw = np.asarray(se3.screw_from_axis(point, direction, pitch)).copy()
    screw[2] = 0

    def total(screw):
        axis = se3.axis_of_screw(screw)
        finite = jnp.where(jnp.isinf(axis.pitch), 0, axis.pitch)
        return sum(jnp.sum(x) for x in (axis.point, axis.direction, finite, axis.magnitude))

    assert np.all(np.isfinite(jax.grad(total)(screw)))


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_twist_is_its_magnitude_times_its_unit_screw(rng, dtype):
    twist = np.concatenate([twists(rng, dtype, 200), np.zeros((1, 6), dtype)])
    screw, magnitude = map(np.asarray, se3.unit_screw(twist))
    w, v = length(twist[:, :3]), length(twist[:, 3:])
    truth = np.where(w > 0, w, v)
    assert np.all(np.abs(magnitude - truth) <= 4 * eps(dtype) * truth)
    # Where v / |omega| is within the dtype's range.
    usual = (w == 0) | (w > 1e-30)
    unit = length(screw[:, :3]) + np.where(w > 0, 0, length(screw[:, 3:]))
    assert np.all(np.abs(unit[:-1] - 1) < 4 * eps(dtype))
    np.testing.assert_array_equal(screw[-1], np.zeros(6))
    missed = length(screw * magnitude[:, None] - twist)[usual]
    assert np.all(missed < 8 * eps(dtype) * (w + v)[usual] + 1e-300)


def test_a_rotation_however_small_is_not_a_translation():
    screw, magnitude = se3.unit_screw(np.array([1e-9, 0, 0, 0, 2e-9, 0]))
    np.testing.assert_allclose([*screw, magnitude], [1, 0, 0, 0, 2, 0, 1e-9], rtol=1e-15)
    gradient = jax.grad(lambda v: sum(jnp.sum(x) for x in se3.unit_screw(v)))(np.zeros((1, 6)))
    np.testing.assert_array_equal(np.isfinite(gradient), True)


def test_a_pose_is_its_rotation_and_its_position(rng):
    pose = random_poses(rng, (N,)).astype(float)
    rotation, position = se3.rotation_and_position(pose)
    np.testing.assert_array_equal(rotation, pose[:, :3, :3])
    np.testing.assert_array_equal(position, pose[:, :3, 3])
    np.testing.assert_array_equal(se3.from_rotation_and_position(rotation, position), pose)


# ModernRobotics


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("VecTose3", se3.hat),
        ("se3ToVec", se3.vee),
        ("TransInv", se3.inverse),
        ("Adjoint", se3.adjoint),
        ("ad", se3.ad),
        ("MatrixExp6", lambda matrix: se3.exp(se3.vee(matrix))),
        ("MatrixLog6", lambda pose: se3.hat(se3.log(pose))),
        ("ProjectToSE3", lambda matrix: se3.project(matrix)[0]),
        ("ScrewToAxis", se3.screw_from_axis),
    ],
)
def test_modern_robotics_vectors(name, ours):
    arguments, results = zip(*modern_robotics(name))
    found = ours(*(np.stack(values) for values in zip(*arguments)))
    np.testing.assert_allclose(found, np.stack(results), atol=1e-12)


def test_modern_robotics_screw_and_magnitude_are_those_of_the_twist():
    arguments, results = zip(*modern_robotics("AxisAng6"))
    found = se3.axis_of_screw(np.concatenate(arguments))
    screws, magnitudes = (np.stack(values) for values in zip(*results))
    np.testing.assert_allclose(found.magnitude, magnitudes, rtol=1e-14)
    again = se3.screw_from_axis(found.point, found.direction, found.pitch)
    np.testing.assert_allclose(again, screws, atol=1e-14)


# Shapes, types and transformations

FUNCTIONS = [
    (se3.hat, ((6,),), ((4, 4),)),
    (se3.vee, ((4, 4),), ((6,),)),
    (se3.inverse, ((4, 4),), ((4, 4),)),
    (se3.exp, ((6,),), ((4, 4),)),
    (se3.log, ((4, 4),), ((6,),)),
    (se3.from_rotation_and_position, ((3, 3), (3,)), ((4, 4),)),
    (se3.rotation_and_position, ((4, 4),), ((3, 3), (3,))),
    (se3.unit_screw, ((6,),), ((6,), ())),
    (se3.adjoint, ((4, 4),), ((6, 6),)),
    (se3.ad, ((6,),), ((6, 6),)),
    (se3.project, ((4, 4),), ((4, 4), ())),
    (se3.screw_from_axis, ((3,), (3,), ()), ((6,),)),
    (se3.screw_from_axis, ((3,), (3,)), ((6,),)),
    (se3.axis_of_screw, ((6,),), ((3,), (3,), (), ())),
]
every_function = pytest.mark.parametrize(
    ("function", "shapes", "results"), FUNCTIONS, ids=[f[0].__name__ for f in FUNCTIONS]
)


@every_function
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_and_dtype_follow_the_input(function, shapes, results, batch, dtype):
    arguments = [jax.ShapeDtypeStruct(batch + shape, dtype) for shape in shapes]
    found = jax.tree.leaves(jax.eval_shape(function, *arguments))
    assert [(x.shape, x.dtype) for x in found] == [(batch + r, dtype) for r in results]


@every_function
def test_a_batch_is_its_elements_and_vmap_changes_nothing(rng, function, shapes, results):
    poses = random_poses(rng, (3, 2)).astype(float)
    arguments = [
        poses if shape == (4, 4) else rng.standard_normal((3, 2, *shape)) for shape in shapes
    ]
    whole = jax.tree.leaves(function(*arguments))
    mapped = jax.tree.leaves(jax.vmap(jax.vmap(function))(*arguments))
    single = jax.tree.leaves(function(*(x[1, 1] for x in arguments)))
    for a, b, c in zip(whole, mapped, single):
        np.testing.assert_allclose(a, b, atol=2e-15)
        np.testing.assert_allclose(a[1, 1], c, atol=2e-15)


def test_batch_axes_of_several_arguments_broadcast(rng):
    point, direction = rng.standard_normal((5, 1, 3)), rng.standard_normal((4, 3))
    found = se3.screw_from_axis(point, direction, 0.5)
    assert found.shape == (5, 4, 6)
    np.testing.assert_allclose(
        found[3, 2], se3.screw_from_axis(point[3, 0], direction[2], 0.5), atol=1e-15
    )


@every_function
def test_wrong_shapes_are_refused_by_name(function, shapes, results):
    names = list(inspect.signature(function).parameters)
    for i, (name, shape) in enumerate(zip(names, shapes)):
        if shape == ():
            continue
        for wrong in ((), (2,), (4, *shape[:-1], 5)):
            arguments = [np.ones(wrong if j == i else s) for j, s in enumerate(shapes)]
            with pytest.raises(ValueError, match=rf"^{name}: expected shape .*got"):
                function(*arguments)
