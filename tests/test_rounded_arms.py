"""Arms whose axes lie in a special way but for rounded numbers: solved as if they did, and proved
only as they are."""

import dataclasses
import functools

import jax
import numpy as np
import pytest
from arms import has, posed
from arms import off_by as moved_by

import niryo_jax as nj
from benchmarks import honesty, singular
from niryo_jax.structure.rounding import off_by
from niryo_jax.tolerances import AXES_EXACT

ARMS = "niryo_one", "ur16e", "abb_irb120"
POSES = 64


@functools.cache
def rounded(name, off):
    return moved_by(nj.robots.load(name), np.random.default_rng([0, 11]), off)


@pytest.mark.parametrize("name", nj.robots.names())
def test_shipped_arms_are_exact(name):
    assert off_by(np.asarray(nj.robots.load(name).screws)) == 0


@pytest.mark.parametrize("off", [1e-9, 1e-10, 1e-12])
def test_an_axis_that_is_turned_by_little_is_told(off):
    screws = np.array(nj.robots.load("niryo_one").screws)
    x, y = screws[2, :2]
    screws[2, :2] = np.cos(off) * x - np.sin(off) * y, np.sin(off) * x + np.cos(off) * y
    assert off_by(screws) == pytest.approx(0.0 if off == 1e-9 else off, rel=0.1)


def test_a_traced_arm_is_off_by_as_much():
    screws = np.asarray(rounded("ur16e", 1e-10).screws)
    assert AXES_EXACT < off_by(screws) < 1e-9
    traced = jax.jit(lambda x: off_by(x, jax.numpy))(screws)
    np.testing.assert_allclose(traced, off_by(screws), rtol=1e-3)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("off", [1e-12, 1e-10])
def test_at_random_postures_all_is_found_and_proved(name, off, rng):
    robot = rounded(name, off)
    q = rng.uniform(-np.pi, np.pi, (POSES, 6))
    answer = nj.inverse_kinematics(robot, posed(robot, q), method="complete")
    assert has(answer, q).all()
    assert np.mean(answer.complete) > 0.95


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("off", [1e-12, 2e-10])
def test_next_to_singular_postures_nothing_is_proved_falsely(name, off):
    robot = rounded(name, off)
    for size in (1e-4, 1e-5, 1e-6, 1e-7):
        q = np.resize(singular.near(robot, size, POSES, 3), (POSES, 6))
        answer = nj.inverse_kinematics(robot, posed(robot, q), method="complete")
        assert not np.any(np.asarray(answer.complete) & ~has(answer, q))
        assert not np.any(np.asarray(answer.status) == nj.IKStatus.UNREACHABLE)


@pytest.mark.parametrize("off", [1e-11, 3e-10])
def test_what_is_just_within_reach_is_not_out_of_it(off):
    nominal = nj.robots.load("niryo_one")
    screws = honesty.off(nominal, off, np.random.default_rng(3))
    robot = dataclasses.replace(nominal, screws=screws)
    counts = honesty.judged(honesty.Case("rounded", robot, searched=True), 200, 1)
    assert [counts[key] for key in honesty.FALSE] == [0, 0, 0]
