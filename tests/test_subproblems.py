"""The canonical subproblems: against vectors, against their own equations, and at their edges."""

from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from known_cases import check_known_cases
from support import BATCHES, DATA, DTYPES

import niryo_jax as nj
from niryo_jax.subproblems import SubproblemKind

CASES = json.loads((DATA / "subproblems.json").read_text())["subproblems"]
SOLVERS = {
    "PK1": nj.subproblems.paden_kahan_1,
    "PK2": nj.subproblems.paden_kahan_2,
    "PK3": nj.subproblems.paden_kahan_3,
    "PG4": nj.subproblems.paden_kahan_2,  # two parallel axes are a case of its own in PK2
}


def wrapped(angle):
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def rotated(screw, angle, point):
    """exp([S] t) p by Rodrigues' formula in plain numpy."""
    w, r = screw[..., :3], np.cross(screw[..., :3], screw[..., 3:])
    u = point - r
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    along = w * np.sum(w * u, -1, keepdims=True)
    return r + along + c * (u - along) + s * np.cross(w, u)


def solve(name, dtype=np.float64):
    cases = CASES[name]
    arguments = [np.array([case["in"][key] for case in cases], dtype) for key in cases[0]["in"]]
    return cases, arguments, SOLVERS[name](*arguments)


def random_problem(rng, count=200):
    """Two axes that meet, a point, and the angles that carry it somewhere."""
    directions = rng.standard_normal((2, count, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    point = rng.standard_normal((count, 3))
    screws = np.concatenate([directions, np.cross(point, directions)], axis=-1)
    return screws, rng.standard_normal((count, 3)), rng.uniform(-np.pi, np.pi, (2, count))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", SOLVERS)
def test_known_cases_are_reproduced_with_their_number_of_solutions(name, dtype):
    cases, _, answer = solve(name, dtype)
    check_known_cases(cases, answer, dtype)


@pytest.mark.parametrize("name", SOLVERS)
def test_residual_is_how_far_the_angles_miss(name):
    _, arguments, answer = solve(name)
    angles = np.asarray(answer.angles)
    if name == "PK1":
        screw, p, k = arguments
        missed = np.linalg.norm(
            rotated(screw[:, None], angles[..., 0], p[:, None]) - k[:, None], axis=-1
        )
    elif name == "PK3":
        screw, p, k, distance = arguments
        moved = rotated(screw[:, None], angles[..., 0], p[:, None])
        missed = np.abs(np.linalg.norm(moved - k[:, None], axis=-1) - distance[:, None])
    else:
        first, second, p, k = arguments
        moved = rotated(second[:, None], angles[..., 1], p[:, None])
        missed = np.linalg.norm(
            rotated(first[:, None], angles[..., 0], moved) - k[:, None], axis=-1
        )
    np.testing.assert_allclose(answer.residual, missed, atol=1e-14, rtol=1e-12)
    assert np.asarray(answer.residual)[np.asarray(answer.valid)].max() < 1e-12
    assert np.all((angles > -np.pi) & (angles <= np.pi))


def test_closest_approach_is_given_where_there_is_no_solution():
    cases, arguments, answer = solve("PK3")
    angles = np.linspace(-np.pi, np.pi, 20001)
    for i, case in enumerate(cases):
        if case["count"] != 0:
            continue
        screw, p, k, distance = (a[i] for a in arguments)
        lengths = np.linalg.norm(rotated(screw, angles, p) - k, axis=-1)
        best = np.abs(lengths - distance).min()
        np.testing.assert_allclose(answer.residual[i], best, atol=1e-6)


def test_axes_that_miss_each_other_have_no_solution_in_subproblem_2(rng):
    screws, p, (t1, t2) = random_problem(rng)
    away = np.cross(screws[0, :, :3], screws[1, :, :3])
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    moved = screws[1] + np.concatenate([0 * away, np.cross(0.1 * away, screws[1, :, :3])], -1)
    k = rotated(screws[0], t1, rotated(screws[1], t2, p))
    answer = nj.subproblems.paden_kahan_2(screws[0], moved, p, k)
    wrong = np.asarray(answer.residual)[np.asarray(answer.valid)]
    assert np.all(wrong < 1e-8)
    assert np.mean(np.asarray(answer.kind) == SubproblemKind.NONE) > 0.99
    unsolved = ~np.any(answer.valid, axis=-1)
    np.testing.assert_array_equal(np.asarray(answer.kind) == SubproblemKind.NONE, unsolved)


def test_generating_angles_are_among_the_answers(rng):
    screws, p, (t1, t2) = random_problem(rng, 2000)
    k = rotated(screws[0], t1, rotated(screws[1], t2, p))
    answer = nj.subproblems.paden_kahan_2(screws[0], screws[1], p, k)
    truth = np.stack([t1, t2], -1)[:, None]
    distance = np.abs(wrapped(answer.angles - truth)).max(-1)
    distance = np.where(answer.valid, distance, np.inf).min(-1)
    assert np.quantile(distance, 0.99) < 1e-10
    assert distance.max() < 1e-5


def test_opposite_coincident_axes_turn_by_the_difference(rng):
    screws, p, (t1, t2) = random_problem(rng)
    for sign in (1.0, -1.0):
        k = rotated(screws[0], t1, rotated(sign * screws[0], t2, p))
        answer = nj.subproblems.paden_kahan_2(screws[0], sign * screws[0], p, k)
        assert np.all(np.asarray(answer.kind) == SubproblemKind.INFINITE)
        np.testing.assert_allclose(
            wrapped(answer.angles[:, 0, 0] - (t1 + sign * t2)), 0.0, atol=1e-11
        )
        np.testing.assert_array_equal(answer.angles[:, 0, 1], 0.0)


def test_derivatives_equal_finite_differences(rng):
    screws, p, (t1, t2) = random_problem(rng, 20)
    k = rotated(screws[0], t1, rotated(screws[1], t2, p))
    q = rng.standard_normal((20, 3))
    distance = np.linalg.norm(rotated(screws[0], t1, p) - q, axis=-1)

    def subproblem_3(p):
        return nj.subproblems.paden_kahan_3(screws[0], p, q, distance).angles

    step = 1e-6 * rng.standard_normal(p.shape)
    rate = jax.jvp(subproblem_3, (jnp.asarray(p),), (jnp.asarray(step),))[1]
    difference = (subproblem_3(p + step) - subproblem_3(p - step)) / 2
    np.testing.assert_allclose(rate, difference, atol=1e-10, rtol=1e-4)

    # Subproblem 2 needs |p - r| = |k - r|: move both along their spheres.
    def subproblem_2(angle):
        moved = jax.vmap(lambda s, t, x: nj.se3.exp(s * t)[:3, :3] @ x + nj.se3.exp(s * t)[:3, 3])(
            jnp.asarray(screws[0]), t1 + angle, jnp.asarray(rotated(screws[1], t2, p))
        )
        return nj.subproblems.paden_kahan_2(screws[0], screws[1], p, moved).angles[..., 0]

    rate = jax.jvp(subproblem_2, (jnp.zeros(20),), (jnp.ones(20),))[1]
    np.testing.assert_allclose(rate, 1.0, atol=1e-6)
    assert np.all(np.isfinite(nj.subproblems.paden_kahan_2(screws[0], screws[1], p, k).residual))


@pytest.mark.parametrize("name", SOLVERS)
def test_no_case_has_a_derivative_that_is_not_finite(name):
    _, arguments, _ = solve(name)

    def total(*arguments):
        answer = SOLVERS[name](*arguments)
        return jnp.sum(answer.angles) + jnp.sum(answer.residual)

    gradients = jax.jit(jax.grad(total, argnums=tuple(range(len(arguments)))))(*arguments)
    assert all(np.all(np.isfinite(g)) for g in gradients)


@pytest.mark.parametrize("batch", BATCHES)
def test_any_batch_axes(batch):
    screw = np.broadcast_to([0.0, 0, 1, 0, 0, 0], (*batch, 6))
    p, k = np.array([1.0, 0, 0]), np.array([0.0, 1, 0])
    for answer, slots, joints in (
        (nj.subproblems.paden_kahan_1(screw, p, k), 1, 1),
        (nj.subproblems.paden_kahan_2(screw, [1.0, 0, 0, 0, 0, 0], p, k), 2, 2),
        (nj.subproblems.paden_kahan_3(screw, p, k, 1.0), 2, 1),
    ):
        assert answer.angles.shape == (*batch, slots, joints)
        assert answer.valid.shape == answer.residual.shape == (*batch, slots)
        assert answer.kind.shape == batch
        assert answer.valid.dtype == bool


def test_wrong_shapes_name_the_argument():
    with pytest.raises(ValueError, match=r"p: expected shape \(\.\.\., 3\), got \(2,\)"):
        nj.subproblems.paden_kahan_1([0.0, 0, 1, 0, 0, 0], [1.0, 0], [0.0, 1, 0])


def test_not_a_number_is_no_solution():
    answer = nj.subproblems.paden_kahan_1([0.0, 0, 1, 0, 0, 0], [np.nan, 0, 0], [0.0, 1, 0])
    assert not answer.valid[0]
    assert SubproblemKind(int(answer.kind)) is SubproblemKind.NONE
    assert "no solution" in SubproblemKind.NONE.message
