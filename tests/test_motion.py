"""Time scalings and trajectories, and the page that maps ModernRobotics to this package."""

from __future__ import annotations

import functools
import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import (
    BATCHES,
    DATA,
    DTYPES,
    LD,
    adjoint_matrix,
    eps,
    expm,
    hat3,
    hat6,
    random_poses,
    rate_truth,
    rigid,
    rigid_inverse,
    unit_vectors,
    vee6,
)

import niryo_jax as nj
import niryo_jax.motion as motion
from niryo_jax import se3, so3

PAGE = Path(__file__).parent.parent / "docs" / "modern-robotics.md"
VECTORS = json.loads((DATA / "modern_robotics.json").read_text())
N, K, T = 24, 7, 1.7
SCALINGS = {"cubic": motion.cubic_time_scaling, "quintic": motion.quintic_time_scaling}
PATHS = {"screw": motion.screw_trajectory, "cartesian": motion.cartesian_trajectory}
every_scaling = pytest.mark.parametrize("scaling", SCALINGS)
every_path = pytest.mark.parametrize("path", PATHS)


def share(scaling, u):
    """s as a function of t/T, in the precision of u."""
    return 3 * u**2 - 2 * u**3 if scaling == "cubic" else 10 * u**3 - 15 * u**4 + 6 * u**5


# Time scalings


@every_scaling
@pytest.mark.parametrize("dtype", DTYPES)
def test_scalings_are_their_polynomials_and_rates_their_derivatives(rng, scaling, dtype):
    t = rng.uniform(0, T, 50).astype(dtype)
    law = SCALINGS[scaling](t, T)
    assert {part.dtype for part in law} == {np.dtype(dtype)}

    def truth(t):
        return share(scaling, t / LD(dtype(T)))

    u = np.ones_like(t)
    first = rate_truth(truth, t, u)
    second = rate_truth(lambda t: rate_truth(truth, t, u), t, u)
    for part, value in zip(law, (truth(t.astype(LD)), first, second)):
        np.testing.assert_allclose(part, value.astype(float), atol=1e-8 + 60 * eps(dtype))


@every_scaling
def test_scalings_start_and_end_at_rest_and_stay_there_outside(scaling):
    t = np.array([-1.0, -1e-9, 0.0, T, T + 1e-9, 5.0])
    s, rate, acceleration = SCALINGS[scaling](t, T)
    np.testing.assert_array_equal(s, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(rate, np.zeros(6))
    jump = 6 / T**2 if scaling == "cubic" else 0.0
    np.testing.assert_allclose(acceleration, [0, 0, jump, -jump, 0, 0])


@every_scaling
def test_scalings_rise_and_are_as_fast_as_they_say(scaling):
    t = np.linspace(0, T, 100001)
    s, rate, acceleration = SCALINGS[scaling](t, T)
    assert np.all(np.diff(s) >= 0)
    fastest, strongest = {
        "cubic": (3 / (2 * T), 6 / T**2),
        "quintic": (15 / (8 * T), 10 / (np.sqrt(3) * T**2)),
    }[scaling]
    np.testing.assert_allclose(np.max(rate), fastest, rtol=1e-8)
    np.testing.assert_allclose(np.max(np.abs(acceleration)), strongest, rtol=1e-8)


@every_scaling
def test_autodiff_of_a_scaling_is_its_rate_at_every_time(scaling):
    t = np.array([-0.3, 0.0, 0.4, T, 2.0])
    function = SCALINGS[scaling]
    law, rates = jax.jvp(lambda t: function(t, T), (t,), (np.ones_like(t),))
    np.testing.assert_allclose(rates.s, law.rate, atol=1e-15)
    np.testing.assert_allclose(rates.rate, law.acceleration, atol=1e-14)
    # s depends on t / T alone.
    by_duration = jax.vmap(jax.grad(lambda T, t: function(t, T).s), (None, 0))(T, t)
    np.testing.assert_allclose(by_duration, -t / T * law.rate, atol=1e-15)


def test_times_and_durations_broadcast_and_numbers_that_are_not_stay_visible():
    law = motion.quintic_time_scaling(np.linspace(0, 3, 4), np.array([[1.0], [2.0]]))
    assert law.s.shape == law.rate.shape == law.acceleration.shape == (2, 4)
    assert motion.cubic_time_scaling(np.float32(0.5), 2).s.dtype == np.float32
    assert np.isnan(motion.cubic_time_scaling(np.nan, 2.0).s)


# Joint trajectories


@every_scaling
def test_joint_trajectories_are_straight_exact_at_both_ends_with_true_rates(rng, scaling):
    start, end = rng.uniform(-3, 3, (2, N, 6))
    found = motion.joint_trajectory(start, end, T, K, scaling)
    np.testing.assert_allclose(found.time, np.linspace(0, T, K), rtol=1e-15)
    np.testing.assert_array_equal(found.q[:, 0], start)
    np.testing.assert_array_equal(found.q[:, -1], end)

    def truth(t):
        s = share(scaling, t / LD(T))[:, None]
        return start[:, None].astype(LD) + s * (end - start)[:, None]

    time = np.asarray(found.time, LD)
    u = np.ones_like(time)
    np.testing.assert_allclose(found.q, truth(time).astype(float), atol=1e-14)
    first = rate_truth(truth, time, u)
    np.testing.assert_allclose(found.velocity, first.astype(float), atol=1e-9)
    second = rate_truth(lambda t: rate_truth(truth, t, u), time, u)
    np.testing.assert_allclose(found.acceleration, second.astype(float), atol=1e-9)


def test_joint_trajectories_differentiate_with_respect_to_ends_and_duration(rng):
    start, end = rng.uniform(-3, 3, (2, 6))

    def final(start, end, duration):
        found = motion.joint_trajectory(start, end, duration, K, "cubic")
        return found.q[3].sum(), found.velocity[3].sum()

    grads = jax.jacobian(final, (0, 1, 2))(start, end, T)
    (q_start, q_end, q_duration), (_, v_end, v_duration) = grads
    np.testing.assert_allclose([q_start, q_end], 0.5)
    assert q_duration == 0
    np.testing.assert_allclose(v_end, 1.5 / T, rtol=1e-14)
    np.testing.assert_allclose(v_duration, -1.5 / T**2 * np.sum(end - start), rtol=1e-14)


# Trajectories of poses

SHAPES = (K, 4, 4), (K, 6), (K, 6)
WEIGHTS = [np.random.default_rng(i).standard_normal(n) for i, n in enumerate(SHAPES)]


@functools.partial(jax.jit, static_argnums=0)
def with_gradients(path, start, end):
    """A trajectory, and the gradient of a weighted sum of all of it with respect to both ends."""

    def total(start, end):
        found = PATHS[path](start, end, T, K)
        parts = zip(WEIGHTS, (found.pose, found.twist, found.twist_rate))
        return sum(jnp.nansum(w * part) for w, part in parts), found

    gradients, found = jax.grad(total, (0, 1), has_aux=True)(start, end)
    return found, gradients


def along(gradients, changes):
    """The rate of each trajectory's sum for changes of its ends."""
    return sum(np.sum(g * c, axis=(1, 2)) for g, c in zip(gradients, changes))


def weighed(*parts):
    """Each trajectory's sum for given poses, twists and twist rates."""
    return sum(np.sum(w * p, axis=tuple(range(1, p.ndim))) for w, p in zip(WEIGHTS, parts))


def pairs(rng, n=N):
    """Poses and rotation vectors and displacements from them: tiny, none, all but pi, any."""
    angles = rng.uniform(0, np.pi, n).astype(LD)
    angles[:4] = [0, 1e-9, LD(np.pi) - 1e-9, LD(np.pi) - 1e-5]
    turn = unit_vectors(rng, (n,)) * angles[:, None]
    return random_poses(rng, (n,)), turn, rng.uniform(-1, 1, (n, 3)).astype(LD)


def truth_of(path, start, turn, line):
    """X(s) in extended precision, for s (k,): (n, k, 4, 4); the end is X(1)."""
    if path == "screw":
        way = hat6(np.concatenate([turn, line], axis=-1))
        return lambda s: start[:, None] @ expm(way[:, None] * s[:, None, None])

    def pose(s):
        rotation = start[:, None, :3, :3] @ expm(hat3(turn)[:, None] * s[:, None, None])
        return rigid(rotation, start[:, None, :3, 3] + s[:, None] * line[:, None])

    return pose


def ends(rng):
    start, turn, line = pairs(rng)
    end = truth_of("screw", start, turn, line)(np.ones(1, LD))[:, 0]
    return start.astype(float), end.astype(float)


@every_path
@pytest.mark.parametrize("frame", ["body", "space"])
def test_poses_twists_and_twist_rates_are_those_of_the_path(rng, path, frame):
    start, turn, line = pairs(rng)
    pose = truth_of(path, start, turn, line)
    end = pose(np.ones(1, LD))[:, 0].astype(float)
    found = PATHS[path](start.astype(float), end, T, K, frame=frame)
    assert found.frame == frame
    time = np.linspace(0, T, K).astype(LD)
    one = np.ones_like(time)

    def at(t):
        return pose(share("quintic", t / LD(T)))

    def twist(t):
        change = rate_truth(at, t, one)
        inverse = rigid_inverse(at(t))
        return vee6(inverse @ change if frame == "body" else change @ inverse)

    np.testing.assert_allclose(found.pose, at(time).astype(float), atol=4e-15)
    np.testing.assert_allclose(found.twist, twist(time).astype(float), atol=1e-8)
    np.testing.assert_allclose(
        found.twist_rate, rate_truth(twist, time, one).astype(float), atol=1e-7
    )


@every_path
@pytest.mark.parametrize("dtype", DTYPES)
def test_both_ends_are_met_half_turns_and_equal_poses_too(rng, path, dtype):
    start, end = (np.array(x) for x in half_turns_and_equal_poses(rng, dtype))
    found = PATHS[path](start, end, T, K)
    assert found.pose.dtype == found.twist.dtype == found.time.dtype == dtype
    np.testing.assert_allclose(found.pose[:, 0], start, atol=6 * eps(dtype))
    np.testing.assert_allclose(found.pose[:, -1], end, atol=12 * eps(dtype))
    # Half way, the rotation left is the rotation done.
    before, middle, after = (np.asarray(found.pose[:, i, :3, :3]) for i in (0, K // 2, -1))
    done = np.swapaxes(before, 1, 2) @ middle
    np.testing.assert_allclose(done, np.swapaxes(middle, 1, 2) @ after, atol=12 * eps(dtype))


def half_turns_and_equal_poses(rng, dtype):
    """18 pairs of poses exactly half a turn apart, 6 of them without moving, and 6 equal pairs."""
    axes = np.concatenate([np.eye(3), unit_vectors(rng, (15,))])
    turn = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    line = rng.uniform(-1, 1, (18, 3))
    line[::3] = 0
    start, end = rigid(np.broadcast_to(np.eye(3), (18, 3, 3)), 0 * line), rigid(turn, line)
    same = random_poses(rng, (6,))
    return tuple(np.concatenate([pose, same]).astype(dtype) for pose in (start, end))


@every_path
def test_gradients_are_finite_at_half_turns_and_equal_poses(rng, path):
    start, end = half_turns_and_equal_poses(rng, np.float64)
    _, gradients = with_gradients(path, start, end)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)
    assert all(np.all(np.abs(gradient).max(axis=(1, 2)) > 0.01) for gradient in gradients)


@every_path
def test_moving_an_end_moves_the_path_as_finite_differences_say(rng, path):
    start, end = ends(rng)
    u, v = rng.standard_normal((2, N, 6))

    def at(h):
        first, last = start @ np.asarray(se3.exp(h * u)), end @ np.asarray(se3.exp(h * v))
        found = PATHS[path](first, last, T, K)
        return weighed(found.pose, found.twist, found.twist_rate)

    _, gradients = with_gradients(path, start, end)
    rate = along(gradients, (start @ np.asarray(se3.hat(u)), end @ np.asarray(se3.hat(v))))
    # The first pairs are next to the half turn, where the path may turn the other way round.
    difference = (at(1e-5) - at(-1e-5)) / 2e-5
    np.testing.assert_allclose(rate[4:], difference[4:], atol=1e-6 * np.abs(rate).max())


@every_path
def test_a_small_move_of_the_end_of_a_path_at_rest_is_shared_out_by_s(rng, path):
    pose, u = random_poses(rng, (N,)).astype(float), rng.standard_normal((N, 6))
    change = pose @ np.asarray(se3.hat(u))
    _, gradients = with_gradients(path, pose, pose)
    law = motion.quintic_time_scaling(np.linspace(0, T, K), T)
    s, rate, acceleration = (np.asarray(part)[:, None] for part in law)
    truth = weighed(s[..., None] * change[:, None], rate * u[:, None], acceleration * u[:, None])
    np.testing.assert_allclose(along(gradients[1:], [change]), truth, atol=1e-12)


# Laws of the two paths


def test_a_screw_trajectory_has_one_screw_axis(rng):
    start, end = ends(rng)
    for frame in ("body", "space"):
        twist = np.asarray(motion.screw_trajectory(start, end, T, K, frame=frame).twist)
        screw, magnitude = se3.unit_screw(twist[:, 1:-1])
        np.testing.assert_allclose(screw[4:], np.broadcast_to(screw[4:, :1], screw[4:].shape))
        rate = motion.quintic_time_scaling(np.linspace(0, T, K), T).rate[1:-1]
        np.testing.assert_allclose(magnitude, magnitude[:, 1:2] / rate[1] * rate, rtol=1e-12)
    axis = se3.axis_of_screw(screw[:, 0])
    # In the space frame, all motions from the start leave the points of this axis on it.
    poses = np.asarray(motion.screw_trajectory(start, end, T, K).pose)
    motions = poses @ np.asarray(se3.inverse(start))[:, None]
    points = np.asarray(axis.point)[:, None]
    away = np.einsum("nkij,nkj->nki", motions[..., :3, :3], points + 0 * motions[..., :3, 3])
    away = away + motions[..., :3, 3] - points
    across = np.cross(away, np.asarray(axis.direction)[:, None])
    assert np.max(np.abs(across[4:])) < 1e-12


def test_a_cartesian_trajectory_keeps_its_origin_on_the_straight_line(rng):
    start, end = ends(rng)
    position = np.asarray(motion.cartesian_trajectory(start, end, T, K).pose)[..., :3, 3]
    s = share("quintic", np.linspace(0, 1, K))[:, None]
    line = (1 - s) * start[:, None, :3, 3] + s * end[:, None, :3, 3]
    np.testing.assert_allclose(position, line, atol=1e-15)


@every_path
def test_paths_are_the_same_from_every_space_frame_and_backwards(rng, path):
    start, end = ends(rng)
    frame = random_poses(rng).astype(float)
    found = PATHS[path](start, end, T, K).pose
    seen = PATHS[path](frame @ start, frame @ end, T, K).pose
    # Next to the half turn, rounding decides which way round.
    np.testing.assert_allclose(seen, frame @ found, atol=2e-14)
    back = PATHS[path](end, start, T, K).pose
    np.testing.assert_allclose(back[:, ::-1], found, atol=2e-14)


def test_a_screw_trajectory_is_the_same_for_every_frame_fixed_to_the_body(rng):
    start, end = ends(rng)
    tool = random_poses(rng).astype(float)
    found = motion.screw_trajectory(start, end, T, K).pose
    of_tool = motion.screw_trajectory(start @ tool, end @ tool, T, K).pose
    np.testing.assert_allclose(of_tool, found @ tool, atol=2e-14)


@every_path
def test_space_twists_are_body_twists_seen_from_space(rng, path):
    start, end = ends(rng)
    body, space = (PATHS[path](start, end, T, K, frame=frame) for frame in ("body", "space"))
    carried = adjoint_matrix(np.asarray(body.pose)) @ np.asarray(body.twist)[..., None]
    np.testing.assert_allclose(space.twist, carried[..., 0].astype(float), atol=1e-13)


# Scalings of one's own


@every_scaling
def test_a_function_gives_what_the_scaling_of_that_polynomial_gives(rng, scaling):
    start, end = ends(rng)
    named = motion.screw_trajectory(start, end, T, K, scaling)
    own = motion.screw_trajectory(start, end, T, K, lambda u: share(scaling, u))
    for a, b in zip(jax.tree.leaves(named), jax.tree.leaves(own)):
        np.testing.assert_allclose(a, b, atol=1e-13)
    sine = motion.joint_trajectory([0.0], [2.0], T, K, lambda u: 0.5 - 0.5 * jnp.cos(np.pi * u))
    angle = np.pi * np.linspace(0, 1, K)[:, None]
    np.testing.assert_allclose(sine.q, 1 - np.cos(angle), atol=1e-15)
    np.testing.assert_allclose(sine.velocity, np.pi / T * np.sin(angle), atol=1e-15)
    np.testing.assert_allclose(sine.acceleration, (np.pi / T) ** 2 * np.cos(angle), atol=1e-14)


def test_samples_of_a_scaling_have_the_rates_of_parabolas():
    u = np.linspace(0, 1, K)
    found = motion.joint_trajectory([0.0], [1.0], T, K, 0.2 * u + 0.5 * u**2)
    np.testing.assert_allclose(found.q[:, 0], 0.2 * u + 0.5 * u**2)
    np.testing.assert_allclose(found.velocity[:, 0], (0.2 + u) / T, atol=1e-14)
    np.testing.assert_allclose(found.acceleration, 1 / T**2, rtol=1e-12)
    # Of second order elsewhere: a tenth of the step, a hundredth of the error.
    errors = []
    for k in (21, 201):
        fine = np.linspace(0, T, k)
        samples = motion.joint_trajectory([0.0], [1.0], T, k, share("quintic", fine / T))
        errors.append(np.abs(samples.velocity[:, 0] - motion.quintic_time_scaling(fine, T).rate))
    assert errors[1].max() < errors[0].max() / 80
    line = motion.joint_trajectory([0.0], [1.0], 2.0, 2, [0.25, 0.75])
    np.testing.assert_array_equal(line.velocity, [[0.25], [0.25]])
    np.testing.assert_array_equal(line.acceleration, [[0], [0]])


def test_each_trajectory_may_have_its_own_samples_and_its_own_duration(rng):
    start, end = ends(rng)
    u = np.linspace(0, 1, K) ** np.linspace(1, 2, N)[:, None]
    own = motion.cartesian_trajectory(start, end, T, K, u)
    assert own.pose.shape == (N, K, 4, 4)
    assert own.time.shape == (K,)
    single = motion.cartesian_trajectory(start[5], end[5], T, K, u[5])
    np.testing.assert_allclose(own.twist_rate[5], single.twist_rate, atol=1e-12)
    durations = np.linspace(1, 2, N)
    found = motion.screw_trajectory(start, end, durations, K)
    assert found.time.shape == (N, K)
    single = motion.screw_trajectory(start[5], end[5], durations[5], K)
    np.testing.assert_allclose(found.twist[5], single.twist, atol=1e-14)
    spread = motion.joint_trajectory([0.0], [1.0], durations, K)
    assert spread.q.shape == spread.velocity.shape == (N, K, 1)


# Shapes, types, edges


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("batch", BATCHES)
def test_batch_axes_and_dtype_follow_the_input(batch, dtype):
    q, pose = (jax.ShapeDtypeStruct(batch + shape, dtype) for shape in ((5,), (4, 4)))
    found = jax.eval_shape(lambda a, b: motion.joint_trajectory(a, b, 2, K), q, q)
    assert found.time.shape == (K,)
    assert {x.shape for x in found[1:]} == {(*batch, K, 5)}
    assert {x.dtype for x in found} == {np.dtype(dtype)}
    for trajectory in PATHS.values():
        found = jax.eval_shape(lambda a, b, f=trajectory: f(a, b, 2, K), pose, pose)
        assert found.pose.shape == (*batch, K, 4, 4)
        assert found.twist.shape == found.twist_rate.shape == (*batch, K, 6)
        assert {x.dtype for x in jax.tree.leaves(found)} == {np.dtype(dtype)}
    one = jax.ShapeDtypeStruct((4, 4), dtype)
    found = jax.eval_shape(lambda a, b: motion.screw_trajectory(a, b, 2, K), pose, one)
    assert found.pose.shape == (*batch, K, 4, 4)


@every_path
def test_a_batch_is_its_elements_under_vmap_and_jit_too(rng, path):
    start, end = (pose.reshape(6, 4, 4, 4) for pose in ends(rng))

    def poses(start, end):
        return PATHS[path](start, end, T, K)

    whole = poses(start, end)
    mapped = jax.jit(jax.vmap(jax.vmap(poses)))(start, end)
    np.testing.assert_allclose(whole.pose, mapped.pose, atol=1e-14)
    np.testing.assert_allclose(whole.twist, mapped.twist, atol=1e-13)
    assert mapped.frame == "body"
    assert poses(start[:0], end[:0]).pose.shape == (0, 4, K, 4, 4)


@every_path
def test_poses_with_three_decimals_are_projected_and_others_refused(rng, path):
    start, end = ends(rng)
    found = PATHS[path](np.round(start, 3), np.round(end, 3), T, K).pose
    rotation = np.asarray(found[..., :3, :3])
    identity = np.broadcast_to(np.eye(3), rotation.shape)
    np.testing.assert_allclose(np.swapaxes(rotation, -1, -2) @ rotation, identity, atol=1e-14)
    np.testing.assert_allclose(rotation[:, 0], so3.project(np.round(start[:, :3, :3], 3))[0])
    bad = end.copy()
    bad[3, :3, :3] *= 1.1
    bad[7, 0, 0] = np.nan
    with pytest.raises(ValueError, match=r"^end: expected rigid motions to within 0\.01 .*inf"):
        PATHS[path](start, bad, T, K)
    mixed, gradients = with_gradients(path, start, bad)
    wrong = np.isin(np.arange(N), (3, 7))
    np.testing.assert_array_equal(np.all(np.isnan(mixed.pose), axis=(1, 2, 3)), wrong)
    assert np.all(np.isfinite(mixed.pose[~wrong]))
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"duration": 0.0}, ValueError, r"^duration: expected a positive .*got 0\.0"),
        ({"duration": [1.0, -2.0]}, ValueError, r"^duration: expected a positive .*-2"),
        ({"duration": np.inf}, ValueError, r"^duration: expected a positive .*inf"),
        ({"duration": np.nan}, ValueError, r"^duration: expected a positive .*nan"),
        ({"duration": "long"}, TypeError, r"^duration: expected an array of numbers"),
        ({"samples": 1}, ValueError, r"^samples: expected 2 or more, got 1"),
        ({"samples": 3.5}, TypeError, r"^samples: expected an integer, got 3\.5"),
        ({"scaling": "linear"}, ValueError, r"^scaling: expected 'cubic' or 'quintic'.*'linear'"),
        ({"scaling": [0.0, 1.0]}, ValueError, r"^scaling: expected shape \(\.\.\., 4\), got \(2,"),
        ({"scaling": [0.0, 1, 2, 3]}, ValueError, r"^scaling: expected shares .* 0\.0 to 3\.0"),
        ({"scaling": [0, np.nan, 1, 1]}, ValueError, r"^scaling: expected shares of the path"),
        ({"scaling": lambda u: 100 * u}, ValueError, r"^scaling: expected shares .*100\.0"),
        ({"scaling": lambda u: [u, u]}, ValueError, r"^scaling: expected a function .*\(2,\)"),
        ({"q_start": [1.0, 2.0]}, ValueError, r"^q_start, q_end: expected as many joints in both"),
        ({"q_start": 1.0}, ValueError, r"^q_start: expected shape \(\.\.\., n\), got \(\)"),
    ],
)
def test_bad_input_is_refused_by_name(options, error, message):
    good = {"q_start": np.zeros(3), "q_end": np.ones(3), "duration": T, "samples": 4}
    with pytest.raises(error, match=message):
        motion.joint_trajectory(**{**good, **options})


@every_path
def test_bad_poses_and_frames_are_refused_by_name(path):
    with pytest.raises(ValueError, match=r"^start: expected shape \(\.\.\., 4, 4\), got \(3, 3\)"):
        PATHS[path](np.eye(3), np.eye(4), T, K)
    with pytest.raises(ValueError, match=r"^frame: expected one of 'body', 'space', got 'tool'"):
        PATHS[path](np.eye(4), np.eye(4), T, K, frame="tool")
    with pytest.raises(ValueError, match=r"^duration: expected a positive"):
        motion.cubic_time_scaling(0.5, -1.0)


# The page docs/modern-robotics.md

ROW = re.compile(r"^\| `(\w+)\(([^)]*)\)` \| (?:`(.+?)`|(not here: \w+)) \| (.*)\|$", re.M)
ROWS = {name: (names.split(", "), here) for name, names, here, *_ in ROW.findall(PAGE.read_text())}
CHAPTERS = {
    3: "NearZero Normalize RotInv VecToso3 so3ToVec AxisAng3 MatrixExp3 MatrixLog3 RpToTrans "
    "TransToRp TransInv VecTose3 se3ToVec Adjoint ScrewToAxis AxisAng6 MatrixExp6 MatrixLog6 "
    "ProjectToSO3 ProjectToSE3 DistanceToSO3 DistanceToSE3 TestIfSO3 TestIfSE3",
    4: "FKinBody FKinSpace",
    5: "JacobianBody JacobianSpace",
    6: "IKinBody IKinSpace",
    8: "ad InverseDynamics MassMatrix VelQuadraticForces GravityForces EndEffectorForces "
    "ForwardDynamics EulerStep InverseDynamicsTrajectory ForwardDynamicsTrajectory",
    9: "CubicTimeScaling QuinticTimeScaling JointTrajectory ScrewTrajectory CartesianTrajectory",
    11: "ComputedTorque SimulateControl",
}
INVERSE_KINEMATICS = ("IKinBody", "IKinSpace")
DISTANCES = ("DistanceToSO3", "DistanceToSE3")


def test_the_page_has_every_function_of_modern_robotics_and_only_names_that_exist():
    functions = " ".join(CHAPTERS.values()).split()
    assert len(functions) == 47
    assert sorted(ROWS) == sorted(functions)
    assert {name for name, (_, here) in ROWS.items() if here} == set(VECTORS)
    for path in re.findall(r"\bnj((?:\.\w+)+)", PAGE.read_text()):
        found = nj
        for name in path.split(".")[1:]:
            found = getattr(found, name)


def evaluated(name, arguments):
    """The expression of the page for a function, on the arguments of one of its cases."""
    names, expression = ROWS[name]
    given = dict(zip(names, arguments, strict=True))
    values = {k: np.array(v, float) if isinstance(v, list) else v for k, v in given.items()}
    values["scaling"] = {3: "cubic", 5: "quintic"}.get(given.get("method"))
    return eval(expression, {"nj": nj, "jnp": jnp, "np": np}, values)


@pytest.mark.parametrize("name", [n for n in VECTORS if n not in INVERSE_KINEMATICS + DISTANCES])
def test_expressions_of_the_page_give_the_results_of_modern_robotics(name):
    # Each number of joints is a program; the kinematics' own tests have them all.
    cases = VECTORS[name][: 1 if name.startswith(("FKin", "Jacobian")) else None]
    for case in cases:
        found, truth = evaluated(name, case["in"]), case["out"]
        if name in ("AxisAng3", "AxisAng6", "TransToRp"):
            for part, expected in zip(found, truth, strict=True):
                np.testing.assert_allclose(part, expected, atol=1e-14)
        else:
            np.testing.assert_allclose(found, np.array(truth), atol=1e-12)


@pytest.mark.parametrize("name", INVERSE_KINEMATICS)
def test_inverse_kinematics_of_the_page_reaches_the_solutions_of_modern_robotics(name):
    case = VECTORS[name][0]
    (q, converged), (truth, success) = evaluated(name, case["in"]), case["out"]
    assert success
    assert converged
    # As near as the tolerances in use.
    np.testing.assert_allclose(q, truth, atol=2 * case["in"][4])


@pytest.mark.parametrize("name", DISTANCES)
def test_distances_of_modern_robotics_are_ours_times_one_plus_a_singular_value(name):
    for case in VECTORS[name]:
        matrix = np.array(case["in"][0], float)
        distance = float(evaluated(name, case["in"]))
        rotation = matrix[:3, :3]
        values = np.linalg.svd(rotation, compute_uv=False)
        if np.linalg.det(rotation) <= 0:
            assert case["out"] == 1e9
            values[2] *= -1
        row = matrix[3] - [0, 0, 0, 1] if len(matrix) == 4 else np.zeros(1)
        truth = np.sqrt(np.sum((values - 1) ** 2) + row @ row)
        np.testing.assert_allclose(distance, truth, atol=1e-14)
        if case["out"] < 1e9:
            factors = [*(1 + values), 1.0] if len(matrix) == 4 else 1 + values
            assert min(factors) - 1e-9 <= case["out"] / distance <= max(factors) + 1e-9
