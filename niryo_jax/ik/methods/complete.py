"""Method `complete`: every solution, or a proof that there is none."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_count, shown
from niryo_jax.execution.devices import batch_sharding, on_all_cores
from niryo_jax.execution.padding import cut_rows, is_small, is_symbolic, padded_rows, program_size
from niryo_jax.ik.complete.algorithms import Structure
from niryo_jax.ik.complete.driver import complete_solutions
from niryo_jax.ik.differentiable import solve_differentiably
from niryo_jax.ik.newton.held import Held
from niryo_jax.ik.newton.pose_error import extent
from niryo_jax.ik.representative import near_reference, within_limits
from niryo_jax.ik.results.solutions import IKSolutions, map_solutions
from niryo_jax.ik.target import make_reference
from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape
from niryo_jax.robot import Robot
from niryo_jax.structure.closure import (
    FOR_ANY,
    ByClosure,
    eliminations,
    numbers_of_ways,
)
from niryo_jax.structure.families import ClosedFormPlan
from niryo_jax.structure.offset_wrist import KnownNumbers, arm_numbers, concrete_numbers
from niryo_jax.structure.rounding import concrete_off_by, off_by
from niryo_jax.tolerances import ANSWERED

Locked = tuple[int, ArrayLike]
"""The index of a joint and its value (...,)."""


@dataclasses.dataclass(frozen=True)
class CompleteSolver:
    """The complete method for arms of one structure."""

    structure: Structure
    tolerance: float = ANSWERED

    @property
    def held(self) -> Held:
        """What its values are values of."""
        if isinstance(self.structure, KnownNumbers):
            return None
        return "arm angle" if self.structure.by_arm_angle else self.structure.locked

    def periodic(self, joints: int) -> tuple[bool, ...]:
        """True for each joint that returns to its place after 2 pi."""
        plan = self.structure
        if isinstance(plan, KnownNumbers):
            return (True,) * joints
        joint, others = plan.locked, plan.periodic
        return others if joint is None else (*others[:joint], plan.locked_turns, *others[joint:])

    def __call__(
        self,
        robot: Robot,
        pose: jax.Array,
        values: jax.Array | None,
        reference: jax.Array | None,
    ) -> IKSolutions:
        """The solutions of poses (..., 4, 4), given values (...,) of what is held, and joint
        vectors (..., n) to which self-motions come as near as they can."""
        double = jnp.result_type(float)
        if not isinstance(self.structure, ClosedFormPlan) and pose.dtype != double:
            return self._in_double(robot, pose, values, reference)
        dtype, batch = pose.dtype, pose.shape[:-2]
        xp = jnp if is_symbolic(batch) else np
        held: Any = xp.zeros((*batch, 0), dtype) if values is None else values[..., None]
        sharding = batch_sharding(pose, len(batch))
        parts = sharding.parts if sharding else 1
        given = [x.astype(dtype) for x in (self._numbers(robot), robot.lower, robot.upper)]
        given.append(np.asarray(self.tolerance, dtype))

        def solve(pose: jax.Array, held: jax.Array) -> IKSolutions:
            batch = pose.shape[:-2]
            padded = parts * program_size(-(-math.prod(batch) // parts))
            whole = (padded,) == batch
            rows = [x if whole else padded_rows(x, len(batch), padded) for x in (pose, held)]
            answer = complete_solutions(
                robot,
                *rows,
                *given,
                structure=self.structure,
                periodic=self.periodic(robot.joints),
                sharding=sharding,
                quick=is_small(padded),
            )
            return answer if whole else _cut(answer, batch)

        def represented(answer: IKSolutions, pose: jax.Array, *reference: jax.Array) -> IKSolutions:
            if reference:
                return near_reference(robot, pose, answer, reference[0], self.held)
            return within_limits(robot, pose, answer, self.held)

        references = [] if reference is None else [reference]
        rows = [pose, held, *references]
        if is_symbolic(batch):

            def whole(pose: jax.Array, held: jax.Array, *reference: jax.Array) -> IKSolutions:
                return represented(solve(pose, held), pose, *reference)

            answer = on_all_cores(whole, rows, batch, program_size, map_solutions)
            return dataclasses.replace(answer, lower=given[1], upper=given[2])
        answer = on_all_cores(solve, rows[:2], batch, program_size, map_solutions)
        return represented(answer, pose, *references)

    def _in_double(
        self,
        robot: Robot,
        pose: jax.Array,
        values: jax.Array | None,
        reference: jax.Array | None,
    ) -> IKSolutions:
        """The solutions of poses in float32, to its rounding, found in float64: rounding hides less
        there of what a proof needs, which makes it the faster of the two."""
        rounding = float(jnp.finfo(pose.dtype).eps) * extent(pose)[..., None]
        answer = self(robot, *jax.tree.map(lambda x: x.astype(float), (pose, values, reference)))
        answer = answer.map(lambda x: x.astype(pose.dtype) if x.dtype.kind == "f" else x)
        answer = dataclasses.replace(
            answer,
            position_error=answer.position_error + rounding,
            rotation_error=answer.rotation_error + rounding,
        )
        lower, upper = (limit.astype(pose.dtype) for limit in (answer.lower, answer.upper))
        return dataclasses.replace(answer, lower=lower, upper=upper)

    def _numbers(self, robot: Robot) -> Any:
        """The numbers of the arm that are not known while tracing, as its algorithm sees it."""
        if isinstance(self.structure, ClosedFormPlan):
            if self.structure.is_exact:
                return np.zeros(0)
            if is_concrete(robot.screws):
                return np.array([concrete_off_by(np.asarray(robot.screws))])
            return off_by(robot.screws, jnp)[None]
        if isinstance(self.structure, ByClosure):
            screws = self.structure.left(robot.screws)
            if is_concrete(screws):
                screws = np.asarray(screws, float)
                return numbers_of_ways(screws, eliminations(screws))
            return numbers_of_ways(screws, FOR_ANY, jnp)
        tool = robot.home[:3, 3]
        if is_concrete(robot.screws, tool):
            numbers = concrete_numbers(np.asarray(robot.screws), np.asarray(tool))
        else:
            numbers = arm_numbers(robot.screws, tool, jnp)
        return numbers[np.array([i for i, x in enumerate(self.structure.entries) if x is None])]


def solve_complete(
    robot: Robot,
    pose: ArrayLike,
    locked: Locked | None = None,
    arm_angle: ArrayLike | None = None,
    q_ref: ArrayLike | None = None,
    tolerance: float = ANSWERED,
) -> IKSolutions:
    """`inverse_kinematics` by the complete method."""
    solver = CompleteSolver(_structure(robot, locked, arm_angle is not None), tolerance)
    if robot.screws.ndim != 2:
        raise ValueError(
            f"robot: expected screws (n, 6), got {robot.screws.shape}; use jax.vmap for many robots"
        )
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    given = arm_angle if locked is None else locked[1]
    values = None
    if given is not None:
        name = "arm_angle" if locked is None else "locked"
        values = as_floating(name, given)
        batch = broadcast_batch(("pose", pose, 2), (name, values, 0))
        pose = jnp.broadcast_to(pose, (*batch, 4, 4))
        values = jnp.broadcast_to(values, batch).astype(pose.dtype)
    reference = None
    if q_ref is not None:
        reference = make_reference(q_ref, pose, robot.joints)
    answer = solve_differentiably(solver, solver.held, robot, pose, values, reference)
    answer.remember(functools.partial(near_reference, robot, pose, held=solver.held))
    return answer


def _structure(robot: Robot, locked: Locked | None, by_arm_angle: bool) -> Structure:
    """What is known of the arm while tracing, for the algorithm that fits it."""
    joint = None
    if locked is not None:
        if not isinstance(locked, tuple) or len(locked) != 2:  # pyright: ignore
            raise TypeError(f"locked: expected (joint index, value), got {shown(locked)}")
        if by_arm_angle:
            raise ValueError("locked, arm_angle: expected one of the two, got both")
        joint = check_count("locked", locked[0], 0, robot.joints - 1)
    fitting = [
        plan for plan in robot.plans if plan.locked == joint and plan.by_arm_angle == by_arm_angle
    ]
    if by_arm_angle and not fitting:
        raise ValueError(
            f"arm_angle: {robot.name} has none; expected seven joints of which axes 1, 2, 3 meet "
            "in one point and 5, 6, 7 in another"
        )
    # A closed form is sooner than the scan.
    if fitting:
        if is_concrete(robot.screws):
            return fitting[0]
        return dataclasses.replace(fitting[0], is_exact=False)
    if robot.offset_wrist is not None and joint is None:
        return robot.offset_wrist
    if robot.is_general and joint is None:
        return ByClosure()
    plans = (*robot.plans, *robot.ends)
    possible = sorted({plan.locked for plan in plans if plan.locked is not None})
    by_closure = ByClosure(joint)
    if joint is not None and by_closure in robot.ends:
        return by_closure
    if joint is not None:
        raise ValueError(
            f"locked: joint {joint} of {robot.name} cannot be locked; those that can, so that all "
            f"solutions of the others are found: {possible or 'none'}"
        )
    if possible:
        raise ValueError(
            f"method 'complete' needs a joint of {robot.name} to be locked, one of {possible}"
        )
    raise ValueError(
        "method 'complete' needs an arm that a closed form solves (docs/families.md), or six "
        f"revolute joints; {robot.name} has neither"
    )


@functools.partial(jax.jit, static_argnums=1)
def _cut(answer: IKSolutions, batch: tuple[int, ...]) -> IKSolutions:
    return answer.map(lambda x: cut_rows(x, batch))
