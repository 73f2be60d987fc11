"""Solvers with derivatives and `jax.vmap` that run the compiled solver rather than trace it again.

A method is a function of a robot, poses and held values. Around it stand one rule for derivatives
(`niryo_jax.ik.newton.implicit`), which needs its solutions alone, and one for `jax.vmap`, which
makes the mapped axis one more axis of the batch. So all transformations of a call share its
program.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from niryo_jax._jax import is_concrete, opaque, untraced
from niryo_jax.execution.padding import is_small
from niryo_jax.ik.newton.held import Held
from niryo_jax.ik.newton.implicit import applied, rate_by_geometry, rate_map, zero_tangent
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.target import make_target
from niryo_jax.robot import Robot

Solver = Callable[[Robot, jax.Array, jax.Array | None, jax.Array | None], IKSolutions]
"""Solutions of poses (..., 4, 4), given values (...,) of what is held, or None, and reference joint
vectors (..., n), or None."""


def solve_differentiably(
    solver: Solver,
    held: Held,
    robot: Robot,
    pose: jax.Array,
    values: jax.Array | None,
    reference: jax.Array | None,
) -> IKSolutions:
    """`solver(robot, pose, values, reference)` for a solver that is hashable: it stands for its
    program.

    Args:
        solver: a method.
        held: what `values` are values of.
        robot, pose, values, reference: its arguments, which may be traced. The reference has no
            derivative: which solutions are chosen is held fixed.
    """
    if is_concrete(*jax.tree.leaves((robot, pose, values, reference))):
        # Outside of whatever transformation is under way, so that it finds the program compiled.
        with untraced():
            return solver(robot, pose, values, reference)
    return _differentiable(solver, held, robot, pose, values, reference)


def _batch(
    solver: Solver, arguments: tuple[Any, ...], has_axis: tuple[Any, ...], size: int
) -> tuple[IKSolutions, Any]:
    """The mapped axis as one more axis of the batch; where the arms differ, `jax.vmap`."""
    if any(jax.tree.leaves(has_axis[0])):
        axes = jax.tree.map(lambda batched: 0 if batched else None, has_axis)
        answer = jax.vmap(solver, in_axes=axes, axis_size=size)(*arguments)
        return answer, jax.tree.map(lambda _: True, answer)
    _, *rest = (
        jax.tree.map(lambda x, has: x if has else jnp.broadcast_to(x, (size, *x.shape)), *pair)
        for pair in zip(arguments, has_axis)
    )
    answer = _opaque_call(solver, (arguments[0], *rest))
    batched = jax.tree.map(lambda _: True, answer)
    return answer, dataclasses.replace(batched, lower=False, upper=False)


_opaque_call = opaque("inverse_kinematics", _batch)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _differentiable(
    solver: Solver,
    held: Held,
    robot: Robot,
    pose: jax.Array,
    values: jax.Array | None,
    reference: jax.Array | None,
) -> IKSolutions:
    del held
    return _opaque_call(solver, (robot, pose, values, reference))


def _rule(
    solver: Solver, held: Held, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[IKSolutions, IKSolutions]:
    robot, pose, *_ = primals
    answer = solve_differentiably(solver, held, *primals)
    zero = zero_tangent(answer)
    of_robot, of_pose, of_values, _ = (_known(*pair) for pair in zip(primals, tangents))
    q = zero.q
    if of_pose is not None or of_values is not None:
        arguments = robot, pose, answer.q, answer.found
        concrete = is_concrete(*jax.tree.leaves(arguments))
        with untraced() if concrete else contextlib.nullcontext():
            rates = rate_map(*arguments, held=held, quick=is_small(answer.count.size))
        of_pose = jnp.zeros_like(pose) if of_pose is None else of_pose
        q, distance = applied(rates, of_pose, of_values)
        zero = dataclasses.replace(zero, pose_distance=distance)
    if of_robot is not None:
        target = make_target(pose).pose
        q = q + rate_by_geometry(robot, of_robot, target, answer.q, answer.found, held)
    return answer, dataclasses.replace(zero, q=q)


_differentiable.defjvp(_rule, symbolic_zeros=True)


def _known(primal: Any, tangent: Any) -> Any:
    """A tangent as arrays, or None where it is known to be zero."""
    leaves = jax.tree.leaves(tangent, is_leaf=lambda x: isinstance(x, SymbolicZero))
    if all(isinstance(leaf, SymbolicZero) for leaf in leaves):
        return None

    def array(x: Any, rate: Any) -> Any:
        return jnp.zeros_like(x) if isinstance(rate, SymbolicZero) else rate

    return jax.tree.map(array, primal, tangent)
