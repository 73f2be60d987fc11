"""Programs compiled fast and programs compiled to run fast, and what must not be compiled again."""

from __future__ import annotations

import functools
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax._jax import COMPILE_FAST, Compiled, _is_known, environment_flags
from niryo_jax.execution.padding import SMALL, is_small, program_size
from niryo_jax.ik.complete import driver
from niryo_jax.ik.methods.complete import CompleteSolver, _structure
from niryo_jax.specialise import _pattern_of

# What XLA does of itself; the tests' own environment says otherwise.
RUN_FAST = {"xla_backend_optimization_level": 3, "xla_cpu_use_fusion_emitters": True}
RUN_FAST = {option: value for option, value in RUN_FAST.items() if _is_known(option, value)}
LARGEST = 30_000


@functools.cache
def poses(name: str) -> np.ndarray:
    """(64, 4, 4) within reach."""
    robot = nj.robots.load(name)
    q = np.random.default_rng(5).uniform(robot.lower, robot.upper, (64, robot.joints))
    return np.array(nj.forward_kinematics(robot, q))


def same_sets(a: nj.IKSolutions, b: nj.IKSolutions) -> None:
    """Both have the same solutions, in any order, and say the same of them."""
    for name in ("status", "complete", "count"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for mine, other, found in zip(*(np.asarray(x) for x in (a.q, b.q, a.found))):
        away = np.abs((mine[found][:, None] - other[None] + np.pi) % (2 * np.pi) - np.pi)
        assert np.all(away.max(-1).min(1) < 1e-9)


@pytest.mark.parametrize("name", ["niryo_one", "abb_irb1600"])
def test_programs_of_both_kinds_give_the_same_solutions(name):
    robot, pose = nj.robots.load(name), jnp.asarray(poses(name))
    solve = jax.jit(lambda pose: nj.inverse_kinematics(robot, pose), compiler_options=RUN_FAST)
    same_sets(nj.inverse_kinematics(robot, pose), solve(pose))


def test_a_small_batch_has_the_solutions_of_a_large_one(niryo):
    pose = poses("niryo_one")
    large = nj.inverse_kinematics(niryo, np.tile(pose, (SMALL // 64 + 1, 1, 1)))
    assert not is_small(program_size(len(large.status)))
    same_sets(nj.inverse_kinematics(niryo, pose), large.map(lambda x: x[:64]))


def test_an_answer_is_the_same_alone_and_in_any_small_batch(niryo):
    pose = poses("niryo_one")[:40]
    batch = nj.inverse_kinematics(niryo, pose)
    for others in ([0], [3, 7, 5], [39, 1]):
        few = nj.inverse_kinematics(niryo, pose[others])
        rows = np.array(others)
        same_sets(batch.map(lambda x, rows=rows: x[rows]), few)


def test_options_that_the_compiler_does_not_know_are_left_out():
    traces = []

    def function(x: jax.Array) -> jax.Array:
        traces.append(x)
        return x + 1

    compiled = Compiled(function, {**COMPILE_FAST, "xla_of_another_version": True})
    np.testing.assert_array_equal([compiled(True, 1.0), compiled(True, 2.0)], [2.0, 3.0])
    assert len(traces) == 1


def test_derivatives_and_vmap_do_not_trace_the_solver_again(niryo, monkeypatch):
    pose = jnp.asarray(poses("niryo_one")[:4])
    solve = functools.partial(nj.inverse_kinematics, niryo)
    jax.block_until_ready((solve(pose), solve(pose[0])))

    def traced(*_: object) -> None:
        raise AssertionError("the solver is traced again")

    monkeypatch.setattr(driver, "solve_rows", traced)
    jax.jacobian(lambda pose: solve(pose).q)(pose[0])
    jax.jacrev(lambda pose: solve(pose).q)(pose[0])
    jax.grad(lambda pose: jnp.sum(solve(pose).q))(pose)
    jax.jvp(lambda pose: solve(pose).q, (pose,), (pose,))
    np.testing.assert_array_equal(jax.vmap(lambda pose: solve(pose).q)(pose), solve(pose).q)
    jax.vmap(jax.grad(lambda pose: jnp.sum(solve(pose).q)))(pose)


@pytest.mark.parametrize(
    "name", ["niryo_one", "niryo_ned2", "abb_irb1600", "abb_irb910sc", "ur16e"]
)
def test_programs_that_are_compiled_fast_stay_small(name):
    # Without its fusion emitters XLA works out again what several loops read: what that costs in
    # time and memory shows in how many instructions are left.
    robot = nj.robots.load(name)
    solver = CompleteSolver(_structure(robot, None, False))
    pattern, rest = _pattern_of(robot, "units of screws")

    def program(rest: jax.Array, *arrays: jax.Array) -> nj.IKSolutions:
        function = driver.complete_solutions.__wrapped__
        options = {"structure": solver.structure, "periodic": solver.periodic(robot.joints)}
        return function(pattern.geometry(list(rest)), *arrays, **options, sharding=None)

    arrays = [jnp.eye(4)[None], jnp.zeros((1, 0)), solver._numbers(robot), robot.lower, robot.upper]
    arrays.append(jnp.asarray(solver.tolerance))
    lowered = jax.jit(program).lower(rest, *map(jnp.asarray, arrays))
    compiled = lowered.compile(compiler_options=dict(COMPILE_FAST))
    assert compiled.as_text().count(" = ") < LARGEST


def test_a_process_is_given_no_option_that_ends_it():
    emitters, optimisation = "--xla_cpu_use_fusion_emitters=false", "optimization_level=0"
    assert emitters in environment_flags("0.10.2").split()
    for version in ("0.11.0", "0.11.2", "0.12.0.1"):
        assert emitters not in environment_flags(version)
        assert optimisation in environment_flags(version)
    assert environment_flags("0.13.0") == environment_flags("1.0.0") == ""


def test_xla_takes_the_options_that_a_process_is_given():
    """With the jaxlib that is installed; a process of its own, since it would end."""
    code = "import jax; jax.devices(); print('alive')"
    environment = {**os.environ, "XLA_FLAGS": environment_flags()}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert done.stdout == b"alive\n", done.stderr
