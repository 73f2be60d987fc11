"""Six revolute joints of any geometry: every solution, and a proof only where there is one."""

from __future__ import annotations

import dataclasses
import functools
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import check_closes, has, off_by, posed, turned_apart
from hypothesis import given
from hypothesis import strategies as st
from support import random_robot

import niryo_jax as nj
from benchmarks import honesty, singular
from benchmarks.arms import at_quarter_turns
from niryo_jax.ik import IKStatus
from niryo_jax.ik.complete.general_arm import are_proved, solve_general_arm
from niryo_jax.ik.general.isolation import FAR, Roots, isolated, refined
from niryo_jax.ik.general.polynomial import equations_and_polynomial
from niryo_jax.ik.methods.multistart import solve_multistart
from niryo_jax.ik.trig_polynomial import DEGREE, UNBOUNDED, Polynomial
from niryo_jax.specialise import traced_geometry
from niryo_jax.structure import closure
from niryo_jax.tolerances import POLYNOMIAL_NOISE

POSES = 256  # one shape, so one program, for most tests


@functools.cache
def solved(name, size, seed=0):
    """An arm of a few kinds with axes that are off by `size`, joint vectors, and the answer."""
    rng = np.random.default_rng([seed, len(name)])
    robot = random_robot(rng, 6) if name == "random" else off_by(nj.robots.load(name), rng, size)
    q = rng.uniform(-np.pi, np.pi, (POSES, 6))
    pose = posed(robot, q)
    return robot, q, pose, nj.inverse_kinematics(robot, pose)


BETWEEN = 1e-3, 1e-5
KINDS = [("random", 0.0), ("random", 1.0)] + [
    pytest.param(name, size, marks=pytest.mark.completeness if size in BETWEEN else ())
    for name in ("ur16e", "abb_irb120", "niryo_one")
    for size in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
]


@pytest.mark.parametrize(("name", "size"), KINDS)
def test_the_joint_vector_that_made_a_pose_is_found(name, size):
    robot, q, pose, answer = solved(name, size, int(size))
    assert robot.is_general
    check_closes(robot, answer, pose)
    made_by = has(answer, q)
    assert np.all(made_by | ~np.asarray(answer.complete))
    assert np.mean(made_by) >= 0.99
    assert np.mean(answer.complete) >= 0.93
    assert not np.any(answer.status == IKStatus.UNREACHABLE)
    # Solutions of an arm with six revolute joints come and go in pairs.
    assert np.all(np.asarray(answer.count)[np.asarray(answer.complete)] % 2 == 0)


@pytest.mark.parametrize(
    ("name", "size"), [("ur16e", 1e-5), ("abb_irb120", 1e-5), ("niryo_one", 1e-4)]
)
def test_postures_of_whole_quarter_turns_are_solved_as_others_are(name, size):
    # Of a posture in a plane all solutions share angles.
    rng = np.random.default_rng(8)
    robot = off_by(nj.robots.load(name), rng, size)
    q = at_quarter_turns(robot, POSES, rng)
    answer = nj.inverse_kinematics(robot, posed(robot, q))
    made_by = has(answer, q)
    assert np.all(made_by | ~np.asarray(answer.complete))
    assert np.mean(made_by) >= 0.98
    assert np.mean(answer.complete) >= 0.94


@pytest.mark.parametrize(("name", "size"), [("random", 0.0), ("abb_irb120", 1e-6)])
def test_errors_are_those_of_the_joint_vectors_next_to_singular_postures(name, size):
    robot = solved(name, size)[0]
    case = honesty.Case(name, robot, searched=True)
    q = honesty.joint_vectors(case, 4 * POSES, np.random.default_rng(5))[:POSES]
    pose = posed(robot, q)
    answer = nj.inverse_kinematics(robot, pose)
    check_closes(robot, answer, pose)
    found = np.asarray(answer.found)
    assert np.mean(np.any(found, axis=1)) >= 0.95
    reached = posed(robot, np.asarray(answer.q)[found])
    wanted = np.broadcast_to(pose[:, None], (*found.shape, 4, 4))[found]
    missed = np.linalg.norm(reached[:, :3, 3] - wanted[:, :3, 3], axis=1)
    said = np.asarray(answer.position_error)[found]
    np.testing.assert_array_less(missed, said + 1e-13)


def test_a_solution_that_is_met_twice_does_not_count_as_two():
    # Where the smallest singular value is 1e-8, rounding spreads what is met over 1e-5 rad.
    robot = next(
        case.robot for case in honesty.from_file(honesty.REAL_ARMS) if case.robot.name == "m0609_ik"
    )
    q = singular.near(robot, 1e-8, 128, 28689008)
    answer = nj.inverse_kinematics(robot, posed(robot, q))
    assert np.mean(np.any(answer.found, axis=1)) > 0.99
    assert np.all(has(answer, q, 1e-4) | ~np.asarray(answer.complete))


@pytest.mark.parametrize(("name", "size"), [("random", 0.0), ("ur16e", 1e-3)])
def test_many_guesses_find_nothing_more(name, size):
    robot, _, pose, answer = solved(name, size)
    few = slice(0, 8)
    other = solve_multistart(robot, pose[few], starts=400)
    missing = np.asarray(other.found)
    for k in range(answer.q.shape[1]):
        near = turned_apart(other.q, np.asarray(answer.q)[few, None, k]) < 1e-5
        missing = missing & ~(near & np.asarray(answer.found)[few, None, k])
    assert not np.any(missing[np.asarray(answer.complete)[few]])


def test_a_pose_beyond_the_arm_is_proved_out_of_reach():
    robot, _, pose, _ = solved("random", 0.0)
    far = pose.copy()
    far[:, :3, 3] += 50.0
    answer = nj.inverse_kinematics(robot, far)
    assert np.mean(answer.status == IKStatus.UNREACHABLE) > 0.9
    assert not np.any(answer.found)


def test_base_and_tool_move_nothing(rng):
    robot, _, pose, answer = solved("random", 0.0)
    base = posed(robot, rng.uniform(-3, 3, 6))
    tool = posed(robot, rng.uniform(-3, 3, 6))
    screws = np.asarray(nj.se3.adjoint(base)) @ np.asarray(robot.screws).T
    moved = nj.Robot.from_screws(screws.T, base @ np.asarray(robot.home) @ tool)
    other = nj.inverse_kinematics(moved, base @ pose @ tool)
    both = np.asarray(answer.complete & other.complete)
    assert np.mean(both) > 0.98
    np.testing.assert_array_equal(answer.count[both], other.count[both])
    for k in range(answer.q.shape[1]):
        there = np.asarray(answer.found)[:, k] & both
        assert np.all(has(other, np.asarray(answer.q)[:, k])[there])


def test_a_pose_is_answered_alike_alone_and_in_any_batch():
    robot, _, pose, answer = solved("ur16e", 1e-4)
    # Programs for other sizes differ in the last bits.
    one = nj.inverse_kinematics(robot, pose[3])
    np.testing.assert_array_equal(one.found, answer.found[3])
    np.testing.assert_allclose(one.q, answer.q[3], atol=1e-9)
    order = np.random.default_rng(0).permutation(POSES)
    other = nj.inverse_kinematics(robot, pose[order])
    np.testing.assert_array_equal(other.q, np.asarray(answer.q)[order])
    grid = nj.inverse_kinematics(robot, pose.reshape(16, -1, 4, 4))
    assert grid.q.shape == (16, POSES // 16, 16, 6)
    np.testing.assert_array_equal(np.reshape(grid.q, answer.q.shape), answer.q)
    assert nj.inverse_kinematics(robot, pose[:0]).q.shape == (0, 16, 6)


def test_a_large_batch_is_answered_as_a_small_one():
    robot, q, pose, answer = solved("ur16e", 1e-3)
    many = nj.inverse_kinematics(robot, np.concatenate([pose] * 5))
    assert np.all(has(many.map(lambda x: x[-POSES:]), q))
    both = np.asarray(answer.complete) & np.asarray(many.complete)[:POSES]
    assert np.mean(both) > 0.97
    np.testing.assert_array_equal(np.asarray(many.count)[:POSES][both], answer.count[both])


def test_an_arm_that_is_traced_is_solved_as_well():
    robot, q, pose, _ = solved("random", 0.0)
    answer = jax.jit(nj.inverse_kinematics)(robot, pose)
    assert np.all(has(answer, q) | ~np.asarray(answer.complete))
    assert np.mean(has(answer, q)) > 0.99
    assert np.mean(answer.complete) > 0.95
    again = pickle.loads(pickle.dumps(robot))
    assert again.is_general
    np.testing.assert_array_equal(nj.inverse_kinematics(again, pose).q, solved("random", 0.0)[3].q)


def test_derivatives_by_pose_and_geometry():
    robot, _, pose, _ = solved("random", 0.0)
    twist = np.array([0.3, -0.2, 0.5, 0.1, 0.4, -0.6])
    change = 0.1 * np.random.default_rng(2).standard_normal((6, 6))
    weights = np.arange(1.0, 7.0)

    def total(step, shift):
        w, v = robot.screws[:, :3], robot.screws[:, 3:]
        w = w + shift * change[:, :3]
        points = jnp.cross(robot.screws[:, :3], v) + shift * change[:, 3:]
        w = w / jnp.linalg.norm(w, axis=1, keepdims=True)
        screws = jnp.concatenate([w, jnp.cross(points, w)], axis=1)
        arm = dataclasses.replace(robot, screws=screws)
        moved = pose[3] @ nj.se3.exp(step * twist)
        return jnp.sum(nj.inverse_kinematics(arm, moved, "complete").q[0] * weights)

    def along(step, shift):
        return np.asarray(total(jnp.asarray(step), jnp.asarray(shift)))

    by_pose, by_geometry = jax.grad(total, argnums=(0, 1))(0.0, 0.0)
    h = 1e-6
    assert by_pose == pytest.approx((along(h, 0.0) - along(-h, 0.0)) / (2 * h), rel=1e-6)
    assert by_geometry == pytest.approx((along(0.0, h) - along(0.0, -h)) / (2 * h), rel=1e-6)


def test_poses_in_float32_are_solved_in_float64():
    robot, q, pose, _ = solved("random", 0.0)
    answer = nj.inverse_kinematics(robot, pose.astype(np.float32))
    assert answer.q.dtype == answer.lower.dtype == np.float32
    assert np.mean(has(answer, q, 1e-3)) > 0.99
    assert np.mean(answer.complete) > 0.95
    found = np.asarray(answer.found)
    assert np.all(np.asarray(answer.position_error)[found] > 1e-8)


@jax.jit
def solved_by_elimination(screws, home, numbers, pose):
    """One program for all arms."""
    arm = dataclasses.replace(nj.robots.load("ur16e"), screws=screws, home=home)
    limits = jnp.full(6, -10.0), jnp.full(6, 10.0)
    geometry, live = traced_geometry(arm, pose.dtype), jnp.ones(len(pose), bool)
    return solve_general_arm(geometry, numbers, pose, live, limits)


@pytest.mark.parametrize("name", ["ur16e", "abb_irb120", "niryo_one"])
def test_an_arm_whose_polynomial_vanishes_is_never_proved(name):
    # These have solvers of their own; by elimination nothing but rounding is left of most.
    robot = nj.robots.load(name)
    screws = np.asarray(robot.screws)
    numbers = closure.numbers_of_ways(screws, closure.eliminations(screws))
    q = np.random.default_rng(4).uniform(-np.pi, np.pi, (64, 6))
    answer = solved_by_elimination(screws, robot.home, numbers, posed(robot, q))
    near = turned_apart(answer.solutions.q, q[:, None]) < 1e-5
    assert np.all(np.any(near & np.asarray(answer.solutions.found), axis=1) | ~answer.proved)


# The roots of one polynomial.


def product(roots):
    """The coefficients of the product of sin((t - root) / 2) over sixteen roots, and its size."""
    t = 2 * np.pi * np.arange(64) / 64
    values = np.prod(np.sin((t[:, None] - roots) / 2), axis=1)
    values /= np.abs(values).max()
    c = np.fft.rfft(values)[:9] / 64
    return np.concatenate([c.real, c.imag[1:]])


@jax.jit
def roots_of(coefficients):
    g = Polynomial(coefficients, jnp.full(coefficients.shape[1], 1e-16))
    roots = isolated(g, FAR)
    row = jnp.minimum(roots.owner, coefficients.shape[1] - 1)
    return roots, refined(g, row, roots.near)


ROWS = 4


def roots_and_proof(*polynomials):
    """The roots of each polynomial, and whether they are simple and all."""
    table = np.zeros((17, ROWS))
    table[0] = 1.0
    table[:, : len(polynomials)] = np.transpose(polynomials)
    found, angle = roots_of(jnp.asarray(table))
    owner, angle, simple = map(np.asarray, (found.owner, angle, found.most == 1))
    return [
        (np.sort(angle[own] % (2 * np.pi)), bool(found.listed[i]) and np.all(simple[own]))
        for i, own in enumerate(owner == i for i in range(len(polynomials)))
    ]


@given(st.lists(st.integers(0, 40), min_size=16, max_size=16, unique=True), st.floats(0, 6.28))
def test_sixteen_real_roots_are_isolated(places, turn):
    roots = np.sort((2 * np.pi * np.array(places) / 41 + turn) % (2 * np.pi))
    ((found, simple),) = roots_and_proof(product(roots))
    if simple:
        assert len(found) == 16
        offset = np.abs((found[:, None] - roots + np.pi) % (2 * np.pi) - np.pi)
        np.testing.assert_allclose(offset.min(axis=0), 0, atol=1e-4)


def test_well_separated_roots_are_simple():
    roots = 2 * np.pi * np.arange(16) / 16 + 0.123
    ((found, simple),) = roots_and_proof(product(roots))
    assert simple
    np.testing.assert_allclose(found, roots, atol=1e-12)


@given(
    st.lists(st.integers(0, 23), min_size=16, max_size=16, unique=True), st.sampled_from([0, 1, 45])
)
def test_roots_at_whole_degrees_are_simple(places, degrees):
    # What is the end of two arcs neither of them can settle.
    roots = np.sort(np.radians(15.0 * np.array(places) + degrees) % (2 * np.pi))
    ((found, simple),) = roots_and_proof(product(roots))
    assert simple
    found = np.sort((found + 0.1) % (2 * np.pi)) - 0.1
    np.testing.assert_allclose(found, roots, atol=1e-6)


@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-8, 1e-6])
def test_roots_that_noise_may_merge_are_a_pair_and_never_simple(gap):
    double = np.concatenate([np.linspace(0.5, 2.5, 14), [4.0, 4.0 + gap]])
    ((found, simple),) = roots_and_proof(product(double))
    assert not simple
    near = found[np.abs(found - 4.0) < 1e-3]
    assert len(near) == 2
    np.testing.assert_allclose(np.sort(near), [4.0, 4.0 + gap], atol=1e-6)


def test_as_many_solutions_as_there_are_roots_at_most_are_a_proof():
    def of(most, arcs, kept, listed=True):
        number = len(most)
        arc = jnp.asarray(arcs, float).T
        owner = jnp.zeros(number, int)
        near = jnp.zeros((number, 3))
        roots = Roots(owner, near, arc, jnp.asarray(most), jnp.array([listed]), number)
        table = np.full((16, 1), np.inf)
        table[: len(kept), 0] = kept
        return bool(are_proved(roots, jnp.asarray(table))[0])

    most, arcs = [1, 2, 2], [(0.0, 0.1), (3.1, 3.2), (3.1, 3.2)]
    assert of(most, arcs, [0.05, 3.11, 3.15 - 2 * np.pi])
    assert not of(most, arcs, [0.05, 3.11])
    assert not of(most, arcs, [3.11, 3.15])
    assert not of(most, arcs, [0.05, 3.11, 3.12, 3.15])
    assert not of(most, arcs, [0.05, 0.06, 3.11, 3.15])
    assert not of(most, arcs, [0.05, 3.11, 3.15], listed=False)
    assert not of([UNBOUNDED], [(0.0, 0.1)], [0.05])
    assert of([], np.zeros((0, 2)), [])


def test_a_polynomial_without_roots_is_settled_and_noise_is_not():
    constant = np.eye(17)[0]
    nothing = 1e-16 * np.ones(17)
    (first, second) = roots_and_proof(constant, nothing)
    assert first[1]
    assert len(first[0]) == 0
    assert not second[1]


# What noise is taken for, measured.


@jax.jit
def value_at_root(numbers, robot, pose, q):
    """(rows,) |g| at the angle of the kept joint of joint vectors that made the poses, in units of
    the estimated noise."""
    way = closure.unflattened(numbers)
    geometry, live = traced_geometry(robot, pose.dtype), jnp.ones(len(pose), bool)
    _, g = equations_and_polynomial(way, geometry, pose, live)
    angle = jnp.sum(jnp.where(way.order == 0, q, 0.0), axis=1)
    k = jnp.arange(1, DEGREE + 1)[:, None]
    real, imaginary = g.coefficients[1 : DEGREE + 1], g.coefficients[DEGREE + 1 :]
    waves = jnp.sum(real * jnp.cos(k * angle) - imaginary * jnp.sin(k * angle), axis=0)
    return jnp.abs(g.coefficients[0] + 2 * waves) / (g.margin / POLYNOMIAL_NOISE)


@pytest.mark.completeness
@pytest.mark.parametrize(
    ("name", "far", "beyond"),
    [
        ("random", 200, 0.0),
        ("ur16e", 2000, 2e-3),
        ("abb_irb120", 2000, 2e-3),
        ("niryo_one", 2000, 2e-3),
    ],
)
def test_g_vanishes_at_known_roots_but_for_its_noise(name, far, beyond):
    ratios = list[np.ndarray]()
    for seed in range(20):
        rng = np.random.default_rng([seed, 3])
        size = 10.0 ** rng.uniform(-6, -2)
        robot = (
            random_robot(rng, 6) if name == "random" else off_by(nj.robots.load(name), rng, size)
        )
        q = rng.uniform(-np.pi, np.pi, (1000, 6))
        pose = posed(robot, q)
        screws = np.asarray(robot.screws)
        for way in closure.eliminations(screws):
            numbers = closure.flattened(closure.closure_numbers(screws, way))
            ratios.append(np.asarray(value_at_root(numbers, robot, pose, q)))
    ratio = np.concatenate(ratios)
    assert np.mean(ratio > POLYNOMIAL_NOISE) <= beyond
    # How often rounding goes further falls with the square of how far: the largest of so many is
    # of no fixed size.
    assert np.mean(ratio > far) <= beyond / 10
    assert np.max(ratio) < 100 * far
    # The estimate is of the right size, not large for safety.
    assert np.median(ratio) > 0.1


@pytest.mark.completeness
@pytest.mark.parametrize("name", ["random", "ur16e", "abb_irb120", "niryo_one"])
@pytest.mark.parametrize("distance", [1e-5, 1e-6, 1e-7, 1e-8])
def test_roots_that_almost_merge_are_not_left_out_of_a_proof(name, distance):
    # Noise moves simple roots; only a pair that is nearly one could vanish in it.
    for seed in range(2):
        rng = np.random.default_rng([seed, 7])
        size = 10.0 ** rng.uniform(-6, -2)
        robot = (
            random_robot(rng, 6) if name == "random" else off_by(nj.robots.load(name), rng, size)
        )
        q = singular.near(robot, distance, 256, seed)
        assert len(q) > 50
        q = np.resize(q, (256, 6))
        answer = nj.inverse_kinematics(robot, posed(robot, q))
        made_by = has(answer, q, 1e-4)
        assert np.all(made_by | ~np.asarray(answer.complete))
        assert np.mean(made_by) > 0.99
