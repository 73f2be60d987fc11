"""Pardos-Gotor subproblems: against vectors, their own equations, searches and one another."""

from __future__ import annotations

import functools
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
SOLVERS = {f"PG{i}": getattr(nj.subproblems, f"pardos_gotor_{i}") for i in range(1, 9)}
TRANSLATIONS = ("PG1", "PG2", "PG3")
TWO_AXES = ("PG4", "PG6")
X, Y, Z = np.eye(3)


def wrapped(angle):
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def screw(direction, point):
    return np.concatenate(np.broadcast_arrays(direction, np.cross(point, direction)), axis=-1)


def moved(screw, angle, point):
    """exp([S] t) p in plain numpy: Rodrigues' formula, or a translation."""
    w, v = screw[..., :3], screw[..., 3:]
    turning = np.linalg.norm(w, axis=-1, keepdims=True) > 0.5
    r = np.cross(w, v)
    u = point - r
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    along = w * np.sum(w * u, -1, keepdims=True)
    turned = r + along + c * (u - along) + s * np.cross(w, u)
    return np.where(turning, turned, point + np.asarray(angle)[..., None] * v)


def chain(screws, angles, point):
    """exp([S1] t1) ... exp([Sn] tn) p for angles (..., n)."""
    for i in reversed(range(len(screws))):
        point = moved(screws[i], angles[..., i], point)
    return point


def moved_pose(screws, angles, pose):
    columns = [pose[..., :3, i] for i in range(4)]
    columns = [c + pose[..., :3, 3] for c in columns[:3]] + [columns[3]]
    images = [chain(screws, angles, c) for c in columns]
    out = np.zeros((*images[0].shape[:-1], 4, 4))
    out[..., :3, :3] = np.stack([x - images[3] for x in images[:3]], axis=-1)
    out[..., :3, 3], out[..., 3, 3] = images[3], 1
    return out


def miss(name, arguments, angles):
    """By how much angles (..., slots, joints) miss the condition of a subproblem."""
    count = {"PG2": 2, "PG4": 2, "PG6": 2, "PG7": 3, "PG8": 3}.get(name, 1)
    screws = [a[:, None] for a in arguments[:count]]
    p, k = (a[:, None] for a in arguments[count : count + 2])
    if name == "PG8":
        wrong = moved_pose(screws, angles, p) - k
        turn = np.linalg.norm(wrong[..., :3, :3], axis=(-2, -1)) / np.sqrt(2)
        return np.hypot(np.linalg.norm(wrong[..., :3, 3], axis=-1), turn)
    reached = chain(screws, angles, p)
    if name == "PG3":
        return np.abs(np.linalg.norm(reached - k, axis=-1) - arguments[3][:, None])
    if name == "PG5":
        w = screws[0][..., :3]
        r = np.cross(w, screws[0][..., 3:])
        normal = np.cross(w, k - r)
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
        return np.abs(np.sum(normal * (reached - r), axis=-1))
    return np.linalg.norm(reached - k, axis=-1)


@functools.cache
def vectors(name, dtype=np.float64):
    cases = CASES[name]
    return cases, [np.array([case["in"][key] for case in cases], dtype) for key in cases[0]["in"]]


def ask(name, *arguments):
    """The answer to n problems, by the programs that the vectors are solved by."""
    like = vectors(name)[1]
    n = max(len(a) for a, b in zip(map(np.asarray, arguments), like) if np.ndim(a) == b.ndim)
    whole = []
    for a, b in zip(arguments, like):
        whole.append(np.resize(np.broadcast_to(a, (n, *b.shape[1:])), b.shape))
    assert n <= len(like[0])
    return [np.asarray(x)[:n] for x in SOLVERS[name](*whole)]


def random_axes(rng, name, parallel=False):
    """As many pairs of axes and points as the vectors of a subproblem are."""
    n = len(CASES[name])
    d1, d2 = unit(rng.standard_normal((2, n, 3)))
    if parallel:
        d2 = d1 * rng.choice([-1.0, 1.0], (n, 1))
    r1, r2, p = rng.uniform(-1, 1, (3, n, 3))
    return screw(d1, r1), screw(d2, r2), p, rng.uniform(-np.pi, np.pi, (n, 3))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", SOLVERS)
def test_known_cases_are_reproduced_with_their_number_of_solutions(name, dtype):
    cases, arguments = vectors(name, dtype)
    answer = SOLVERS[name](*arguments)
    check_known_cases(cases, answer, dtype, turns=name not in TRANSLATIONS)
    residual, valid = np.asarray(answer.residual), np.asarray(answer.valid)
    assert residual[valid].max() < (1e-12 if dtype == np.float64 else 1e-5)


@pytest.mark.parametrize("name", SOLVERS)
def test_residual_is_how_far_the_angles_miss(name):
    _, arguments = vectors(name)
    angles, _, residual, _ = (np.asarray(x) for x in SOLVERS[name](*arguments))
    np.testing.assert_allclose(residual, miss(name, arguments, angles), atol=1e-14, rtol=1e-12)
    if name not in TRANSLATIONS:
        assert np.all((angles > -np.pi) & (angles <= np.pi))


@functools.cache
def gradient(name):
    """Of a weighted sum of the angles (and of the residuals), with respect to the arguments."""

    def total(weights, share, *arguments):
        answer = SOLVERS[name](*arguments)
        return jnp.sum(weights * answer.angles) + share * jnp.sum(answer.residual)

    count = len(vectors(name)[1])
    return jax.jit(jax.grad(total, argnums=tuple(range(2, 2 + count))))


def displaced(name, arguments, rng):
    """The arguments as a function of a step: axes turn as one and shift singly, points move."""
    spin = rng.standard_normal((len(arguments[0]), 3))
    shifts = [rng.standard_normal((len(a), 3)) for a in arguments]

    def at(step):
        rate = np.linalg.norm(spin, axis=-1)
        turn = np.concatenate([spin / rate[:, None], 0 * spin], -1)
        out = []
        for a, shift in zip(arguments, shifts):
            if a.shape[1:] == (6,):
                d = moved(turn, step * rate, a[:, 3:] if name in TRANSLATIONS else a[:, :3])
                r = np.cross(a[:, :3], a[:, 3:]) + step * shift
                out.append(np.concatenate([0 * d, d], -1) if name in TRANSLATIONS else screw(d, r))
            elif a.shape[1:] == (4, 4):
                out.append(
                    moved_pose([screw(unit(shift), 0.3 * Z)], step * np.ones((len(a), 1)), a)
                )
            else:
                out.append(a + step * (shift if a.ndim == 2 else shift[:, 0]))
        return out

    return at


@pytest.mark.parametrize("name", SOLVERS)
def test_derivatives_equal_finite_differences_and_are_finite_everywhere(name, rng):
    cases, arguments = vectors(name)
    angles, valid, _, kind = (np.asarray(x) for x in SOLVERS[name](*arguments))
    everywhere = gradient(name)(np.ones_like(angles), 1.0, *arguments)
    assert all(np.all(np.isfinite(g)) for g in everywhere)

    regular = kind == SubproblemKind.FINITE
    if name == "PG6":
        # Where axes meet, a displacement in general leaves the other slot's solution.
        regular &= [case["count"] == 1 for case in cases]
    weights = rng.standard_normal(angles.shape) * (valid & regular[:, None])[..., None]
    step = 1e-6
    at = displaced(name, arguments, rng)
    ahead, behind = at(step), at(-step)
    rates = gradient(name)(weights, 0.0, *arguments)
    rate = sum(
        np.sum(np.asarray(g) * (a - b), axis=tuple(range(1, g.ndim))) / (2 * step)
        for g, a, b in zip(rates, ahead, behind)
    )
    change = np.asarray(SOLVERS[name](*ahead).angles) - np.asarray(SOLVERS[name](*behind).angles)
    difference = np.sum(weights * wrapped(change), axis=(1, 2)) / (2 * step)
    assert regular.sum() >= 3
    np.testing.assert_allclose(rate[regular], difference[regular], rtol=1e-5, atol=1e-5)


def test_derivatives_of_skew_axes_follow_the_generating_angles(rng):
    s1, s2, p, t = random_axes(rng, "PG6")
    x = moved(s2, t[:, 1], p)
    k = moved(s1, t[:, 0], x)
    _, valid, _, _ = ask("PG6", s1, s2, p, k)
    # The rate of k while an angle increases at one radian per second.
    (w1, r1), (w2, r2) = ((s[:, :3], np.cross(s[:, :3], s[:, 3:])) for s in (s1, s2))
    rates = np.cross(w1, k - r1), moved(s1, t[:, 0], x + np.cross(w2, x - r2)) - k
    for joint, chosen in enumerate(np.eye(2)):
        gradient_k = gradient("PG6")(valid[..., None] * chosen, 0.0, s1, s2, p, k)[3]
        followed = [np.sum(gradient_k * rate, axis=-1) for rate in rates]
        np.testing.assert_allclose(followed[joint], 1.0, rtol=1e-8)
        np.testing.assert_allclose(followed[1 - joint], 0.0, atol=1e-8)


def test_forward_mode_agrees_with_reverse_mode(rng):
    s1, s2, p, t = random_axes(rng, "PG4", parallel=True)
    k = chain([s1, s2], t[:, :2], p)
    weights, rate = rng.standard_normal((len(p), 2, 2)), rng.standard_normal(p.shape)
    solver = functools.partial(nj.subproblems.pardos_gotor_4, s1, s2, p)
    forward = jax.jvp(solver, (jnp.asarray(k),), (jnp.asarray(rate),))[1].angles
    reverse = gradient("PG4")(weights, 0.0, s1, s2, p, k)[3]
    np.testing.assert_allclose(
        np.sum(weights * forward, axis=(1, 2)), np.sum(reverse * rate, axis=-1), rtol=1e-8
    )


@pytest.mark.parametrize("meeting", ["skew", "meeting", "perpendicular", "nearly parallel"])
def test_generating_angles_of_two_axes_are_among_the_answers(meeting, rng):
    for _ in range(10):
        s1, s2, p, t = random_axes(rng, "PG6")
        d1, d2 = s1[:, :3], s2[:, :3]
        r1, r2 = np.cross(d1, s1[:, 3:]), np.cross(d2, s2[:, 3:])
        if meeting == "meeting":
            r2 = r1
        if meeting == "perpendicular":
            d2 = unit(np.cross(d1, d2))
        if meeting == "nearly parallel":
            d2 = unit(d1 + 1e-3 * d2)
        s1, s2 = screw(d1, r1), screw(d2, r2)
        angles, valid, residual, kind = ask("PG6", s1, s2, p, chain([s1, s2], t[:, :2], p))
        wrong = np.abs(wrapped(angles - t[:, None, :2])).max(-1)
        assert np.where(valid, wrong, 9).min(-1).max() < 1e-6
        assert residual[valid].max() < 1e-12
        assert np.all(kind == SubproblemKind.FINITE)
        assert np.all(valid.sum(-1) == (2 if meeting == "meeting" else 1))


def test_generating_angles_of_parallel_axes_are_among_the_answers_whatever_their_sense(rng):
    for _ in range(5):
        for name in TWO_AXES:
            s1, s2, p, t = random_axes(rng, name, parallel=True)
            k = chain([s1, s2], t[:, :2], p)
            angles, valid, residual, kind = ask(name, s1, s2, p, k)
            wrong = np.abs(wrapped(angles - t[:, None, :2])).max(-1)
            assert np.where(valid, wrong, 9).min(-1).max() < 1e-6
            assert np.all(valid)
            assert np.all(kind == SubproblemKind.FINITE)
            assert residual.max() < 1e-12


@pytest.mark.parametrize("name", ["PG7", "PG8"])
def test_generating_angles_of_three_axes_are_among_the_answers_whatever_their_sense(name, rng):
    for _ in range(10):
        s2, s3, p, t = random_axes(rng, name, parallel=True)
        s1, _, _, _ = random_axes(rng, name)
        if name == "PG8":
            s1 = screw(-s2[:, :3], np.cross(s1[:, :3], s1[:, 3:]))
            pose = np.broadcast_to(np.eye(4), (len(p), 4, 4)).copy()
            pose[:, :3, 3] = p
            p, k = pose, moved_pose([s1, s2, s3], t, pose)
        else:
            k = chain([s1, s2, s3], t, p)
        angles, valid, residual, _ = ask(name, s1, s2, s3, p, k)
        wrong = np.abs(wrapped(angles - t[:, None])).max(-1)
        assert np.where(valid, wrong, 9).min(-1).max() < 1e-6
        assert residual[valid].max() < 1e-12
        assert np.all(np.isin(valid.sum(-1), (2, 4) if name == "PG7" else (2,)))


def least_distance(s1, s2, p, k):
    """The least |exp([S1] t1) exp([S2] t2) p - k|: a search over t2, the best t1 for each."""
    w = s1[:3]
    r = np.cross(w, s1[3:])
    level = (k - r) @ w
    around = np.linalg.norm(k - r - level * w)

    def distance(t2):
        x = moved(s2, t2, p) - r
        height = x @ w
        return np.hypot(height - level, np.linalg.norm(x - height[:, None] * w, axis=-1) - around)

    coarse = np.linspace(-np.pi, np.pi, 20001)
    best = coarse[np.argmin(distance(coarse))]
    return distance(best + np.linspace(-4e-4, 4e-4, 2001)).min()


@pytest.mark.parametrize("apart", [0.0, 0.3, 10.0])
@pytest.mark.parametrize("name", TWO_AXES)
def test_closest_approach_is_the_closest_there_is(name, apart, rng):
    s1, s2, p, _ = random_axes(rng, name, parallel=name == "PG4")
    r1 = np.cross(s1[:, :3], s1[:, 3:])
    s2 = screw(s2[:, :3], r1 + apart * unit(rng.standard_normal(p.shape)))
    # Small circles within large ones, and large ones about small ones.
    p, k = p * rng.choice([0.1, 1, 3], (len(p), 1)), rng.uniform(-1, 1, p.shape)
    angles, valid, residual, kind = ask(name, s1, s2, p, k)
    unsolved = kind == SubproblemKind.NONE
    assert unsolved.sum() > 10
    least = np.array([least_distance(*row) for row in zip(s1, s2, p, k)])
    np.testing.assert_allclose(residual[unsolved, 0], least[unsolved], atol=1e-9, rtol=1e-6)
    np.testing.assert_allclose(residual, miss(name, [s1, s2, p, k], angles), atol=1e-13)
    assert not np.any(valid[unsolved])


@pytest.mark.parametrize(("a", "b"), [(0.2, 2.0), (2.0, 0.2), (0.2, 0.3)])
@pytest.mark.parametrize("name", TWO_AXES)
def test_a_circle_within_the_other_or_beyond_it_is_approached_on_the_near_side(name, a, b):
    first, second = screw(Z, [1.0, 0, 0]), screw(Z, [0.0, 0, 0])
    nearest = max(abs(a - b) - 1, 1 - a - b)
    p, k = np.array([0, a, 0.0]), np.array([1, b, 0.0])
    angles, valid, residual, kind = ask(name, first[None], second[None], p, k)
    assert kind[0] == SubproblemKind.NONE
    assert not valid.any()
    np.testing.assert_allclose(residual, nearest, rtol=1e-12)
    np.testing.assert_allclose(np.abs(np.sin(angles)), 1.0, rtol=1e-12)


@pytest.mark.parametrize("name", TWO_AXES)
def test_points_on_axes_and_coincident_axes_have_infinitely_many_solutions(name):
    first, second, opposite = screw(Z, [1.0, 0, 0]), screw(Z, [0.0, 0, 0]), screw(-Z, [0.0, 0, 0])
    on_second, on_first = np.array([0, 0, 0.5]), np.array([1, 0, 0.5])
    point = np.array([0.6, 0, 0.5])
    turned = moved(second, 0.7, point)
    problems = [
        (first, second, on_second, moved(first, 0.4, on_second), (0.4, 0.0)),
        (first, second, moved(second, -0.4, on_first), on_first, (0.0, 0.4)),
        (second, second, point, turned, (0.7, 0.0)),
        (second, opposite, point, turned, (0.7, 0.0)),
        (first, second, on_second, on_second + 0.3 * X, None),
        (second, opposite, point, turned + 0.1 * Z, None),
    ]
    arguments = [np.stack(x) for x in zip(*(problem[:4] for problem in problems))]
    angles, valid, residual, kind = ask(name, *arguments)
    for i, (*_, expected) in enumerate(problems):
        if expected is None:
            assert kind[i] == SubproblemKind.NONE
            assert not valid[i].any()
            assert residual[i, 0] > 0.09
        else:
            assert kind[i] == SubproblemKind.INFINITE
            assert valid[i].tolist() == [True, False]
            np.testing.assert_allclose(angles[i, 0], expected, atol=1e-14)


def test_subproblem_5_gives_the_opposite_half_plane_too_where_the_angle_is_zero():
    axis = screw(Z, [0.2, 0.1, 0])[None]
    p, k = np.array([1.2, 0.1, 0]), np.array([[3.2, 0.1, 2.0], [-0.8, 0.1, -1.0], [0.2, 0.1, 4.0]])
    angles, valid, _, kind = ask("PG5", axis, p, k)
    np.testing.assert_allclose(angles[:2, :, 0], [[0, np.pi], [np.pi, 0]], atol=1e-15)
    assert valid.tolist() == [[True, True], [True, True], [True, False]]
    assert kind.tolist() == [1, 1, SubproblemKind.INFINITE]


def test_three_parallel_axes_can_bring_a_point_anywhere_within_reach():
    axes = [screw(Z, [x, 0, 0])[None] for x in (0.0, 1.0, 2.0)]
    k = np.array([[0, 2, 0], [3, 0, 0], [0, 0.1, 0], [0, 2, 1], [4, 0, 0.0]])
    p = 3 * X
    angles, valid, residual, kind = ask("PG7", *axes, p, k)
    infinite = SubproblemKind.INFINITE
    assert kind.tolist() == [infinite, infinite, infinite, SubproblemKind.NONE, SubproblemKind.NONE]
    np.testing.assert_allclose(residual[:3][valid[:3]], 0, atol=1e-12)
    np.testing.assert_allclose(residual[3:, 0], 1.0, rtol=1e-12)
    reached = chain([axis[:, None] for axis in axes], angles, p)
    np.testing.assert_allclose(np.linalg.norm(reached - k[:, None], axis=-1), residual, atol=1e-13)


def test_a_rotation_that_no_three_parallel_axes_make_is_a_residual_in_radians():
    axes = [screw(Z, [x, 0, 0])[None] for x in (0.0, 1.0, 2.0)]
    start = np.eye(4)
    start[:3, 3] = 3, 0, 0
    tilt = moved_pose([screw(X, 3 * X)], np.array([1e-3]), start)
    _, valid, residual, kind = ask("PG8", *axes, start[None], np.stack([start, tilt]))
    assert kind[1] == SubproblemKind.NONE
    assert not valid[1].any()
    np.testing.assert_allclose(residual[1, 0], 1e-3, rtol=0.5)
    assert residual[0, 0] < 1e-12


# ABB IRB120, tool down, of Pardos-Gotor (2022): axes 1 to 3 and the wrist point.
IRB120 = screw(np.stack([Z, Y, Y]), np.array([[0.0], [0.29], [0.56]]) * Z)
SHOULDER, WRIST = np.array([0, 0, 0.29]), np.array([0.302, 0, 0.63])


def test_equivalent_sequences_give_the_same_arm_angles(rng):
    s1, s2, s3 = IRB120
    sub = nj.subproblems
    k = chain(IRB120[:, None], rng.uniform(-2.5, 2.5, (len(CASES["PG5"]), 3)), WRIST)

    angles, valid, _, _ = ask("PG7", s1, s2, s3, WRIST, k)
    by_7 = np.where(valid[..., None], angles, np.nan)

    elbow = sub.paden_kahan_3(s3, WRIST, SHOULDER, np.linalg.norm(k - SHOULDER, axis=-1))
    t3 = np.asarray(elbow.angles)[..., 0]
    pair = sub.paden_kahan_2(s1, s2, moved(s3, t3, WRIST), k[:, None])
    assert np.all(elbow.valid)
    by_3_2 = np.concatenate(
        [np.asarray(pair.angles), np.broadcast_to(t3[..., None, None], (*t3.shape, 2, 1))], -1
    )
    by_3_2 = np.where(np.asarray(pair.valid)[..., None], by_3_2, np.nan).reshape(len(k), 4, 3)

    t1 = ask("PG5", s1, WRIST, k)[0][..., 0]
    goal = moved(s1, -t1, k[:, None]).reshape(-1, 3)
    angles, valid, _, _ = ask("PG4", s2, s3, WRIST, goal)
    by_5_4 = np.concatenate([np.repeat(t1.reshape(-1, 1, 1), 2, axis=1), angles], -1)
    by_5_4 = np.where(valid[..., None], by_5_4, np.nan).reshape(len(k), 4, 3)

    assert np.isfinite(by_7).all(axis=-1).sum(axis=-1).min() >= 2
    for other in (by_3_2, by_5_4):
        listed = np.isfinite(other[..., 0])
        assert np.array_equal(listed.sum(1), np.isfinite(by_7[..., 0]).sum(1))
        apart = np.abs(wrapped(other[:, :, None] - by_7[:, None])).max(-1)
        nearest = np.where(np.isnan(apart), 9, apart).min(-1)
        assert nearest[listed].max() < 1e-8


@pytest.mark.parametrize("batch", BATCHES)
def test_any_batch_axes(batch):
    shapes = {"PG1": (1, 1), "PG2": (1, 2), "PG3": (2, 1), "PG4": (2, 2)}
    shapes |= {"PG5": (2, 1), "PG6": (2, 2), "PG7": (4, 3), "PG8": (2, 3)}
    for name, (slots, joints) in shapes.items():
        first, *rest = (np.asarray(a[0]) for a in vectors(name)[1])
        answer = jax.eval_shape(SOLVERS[name], np.broadcast_to(first, (*batch, 6)), *rest)
        assert answer.angles.shape == (*batch, slots, joints)
        assert answer.valid.shape == answer.residual.shape == (*batch, slots)
        assert answer.kind.shape == batch
        assert answer.valid.dtype == bool


def test_wrong_shapes_name_the_argument():
    pose, axis = np.eye(4), screw(Z, [0.0, 0, 0])
    with pytest.raises(ValueError, match=r"pose_k: expected shape \(\.\.\., 4, 4\), got \(3,\)"):
        nj.subproblems.pardos_gotor_8(axis, axis, axis, pose, np.zeros(3))
    with pytest.raises(ValueError, match=r"screw_2: expected shape \(\.\.\., 6\), got \(5,\)"):
        nj.subproblems.pardos_gotor_6(axis, axis[:5], np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("name", SOLVERS)
def test_not_a_number_is_no_solution(name):
    arguments = [a.copy() for a in vectors(name)[1]]
    arguments[-1][0] = np.nan
    answer = SOLVERS[name](*arguments)
    assert not np.any(answer.valid[0])
    assert SubproblemKind(int(answer.kind[0])) is SubproblemKind.NONE
