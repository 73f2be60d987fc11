"""How many compiled programs are kept, and that what is let go is really freed."""

from __future__ import annotations

import gc
import weakref

import arms
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax import programs, specialise
from niryo_jax._jax import RUN_FAST, Compiled
from niryo_jax.programs import Programs, mapped_share


def adder(number: float) -> Compiled:
    return Compiled(lambda x: x + number, RUN_FAST)


def test_never_more_are_kept_than_the_bound_and_what_is_let_go_is_freed():
    kept, made = Programs(most=3, least=1), []

    def make(number: float) -> Compiled:
        function = adder(number)
        made.append(weakref.ref(function))
        return function

    for number in range(8):
        for _ in range(2):
            answer = kept.run(number, lambda number=number: make(number), True, jnp.ones(2))
            np.testing.assert_array_equal(answer, [number + 1.0] * 2)
        assert len(kept) <= 3
    gc.collect()
    assert len(made) == 8
    assert [function() is not None for function in made] == [False] * 5 + [True] * 3


def test_what_was_used_last_is_kept():
    kept, made = Programs(most=2, least=1), []

    def run(number: float) -> None:
        kept.run(number, lambda: made.append(number) or adder(number), True, 1.0)

    for number in (1, 2, 1, 3, 1, 2):
        run(number)
    assert made == [1, 2, 3, 2]


def test_programs_are_let_go_where_memory_has_too_many_pieces(monkeypatch):
    kept = Programs(most=10, least=2)
    for number in range(4):
        kept.run(number, lambda number=number: adder(number), True, 1.0)
    assert len(kept) == 4
    monkeypatch.setattr(programs, "mapped_share", lambda: 0.6)
    # Another size of a batch is another program.
    kept.run(3, lambda: adder(3), True, jnp.ones(5))
    assert len(kept) == 2
    # No program is compiled, so that nobody looks.
    monkeypatch.setattr(programs, "mapped_share", lambda: pytest.fail("looked"))
    kept.run(3, lambda: adder(3), True, jnp.ones(5))


def test_a_function_that_fails_leaves_the_others():
    kept = Programs(most=2, least=1)

    def fail(x: jax.Array) -> jax.Array:
        raise ValueError("x: no")

    kept.run(1, lambda: adder(1), True, 1.0)
    for _ in range(3):
        with pytest.raises(ValueError, match="x: no"):
            kept.run(2, lambda: Compiled(fail, {}), True, 1.0)
    assert kept.run(1, lambda: pytest.fail("compiled again"), True, 1.0) == 2.0


def test_a_share_of_memory_is_told_or_zero():
    assert 0 <= mapped_share() < 1


def test_arms_beyond_the_bound_are_answered_and_the_callers_programs_stay(monkeypatch):
    monkeypatch.setattr(specialise, "PROGRAMS", kept := Programs(most=2, least=1))
    traces = []

    @jax.jit
    def own(x: jax.Array) -> jax.Array:
        traces.append(x)
        return x + 1

    own(1.0)
    for name in ("niryo_one", "abb_irb120", "ur16e", "abb_irb910sc", "niryo_one"):
        robot = nj.robots.load(name)
        q = np.full((2, robot.joints), 0.3)
        pose, jacobian = arms.forward(robot, q)
        np.testing.assert_allclose(nj.forward_kinematics(robot, q), pose, atol=1e-12)
        np.testing.assert_allclose(nj.space_jacobian(robot, q), jacobian, atol=1e-12)
        assert len(kept) == 2
    own(2.0)
    assert len(traces) == 1


@pytest.mark.completeness
def test_the_memory_of_solvers_of_many_arms_stays_bounded(monkeypatch, rng):
    if not mapped_share():
        pytest.skip("the system does not say how many pieces of memory a process has")
    monkeypatch.setattr(specialise, "PROGRAMS", Programs(least=1))
    bound = mapped_share() + 0.05
    monkeypatch.setattr(programs, "_SHARE", bound)
    for name in arms.FAMILIES:
        robot = arms.arm(name, rng)
        pose, _ = arms.forward(robot, q := arms.joint_vectors(robot, 2, rng))
        answer = nj.inverse_kinematics(robot, pose)
        away = arms.apart(robot, np.asarray(answer.q), q[:, None])
        assert np.all(np.any((away < 1e-6) & np.asarray(answer.found), axis=1))
        assert mapped_share() < bound + 0.05
