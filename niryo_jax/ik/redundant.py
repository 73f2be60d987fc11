"""Inverse kinematics of arms with a joint to spare: complete sets for many values of that joint."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.families import Plan
from niryo_jax.ik.batches import in_chunks
from niryo_jax.ik.collect import collect, limits_of
from niryo_jax.ik.complete import solve_complete
from niryo_jax.ik.newton import NewtonResult
from niryo_jax.ik.solutions import IKSolutions
from niryo_jax.ik.target import make_target
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot


def solve_sampled(robot: Robot, pose: ArrayLike, samples: int = 16) -> IKSolutions:
    """The best of the complete sets for evenly spread values of the joint to spare.

    An arm of seven joints reaches a pose in infinitely many ways, a curve or more of them. What is
    returned are the 16 solutions farthest within the limits out of those at `samples` values of
    `robot.plans[0].locked`, spread evenly over its limits (one turn where it has none).

    Args:
        robot: an arm with plans that lock a joint.
        pose: (..., 4, 4) targets in the space frame, metres; projected to SE(3) first.
        samples: how many values.

    Returns:
        `IKSolutions` with 16 slots. Never `complete`; UNDECIDED where nothing is found.

    Raises:
        ValueError: a wrong shape, an arm without such plans, fewer samples than one.
    """
    if samples < 1:
        raise ValueError(f"samples: expected 1 or more, got {samples}")
    plan = spare(robot)
    if plan is None or plan.locked is None:
        raise ValueError(
            "method 'sampled' needs seven joints of which one can be locked, so that the others "
            f"are solved in closed form; {robot.name} is no such arm"
        )
    joint = plan.locked
    pose = as_floating("pose", pose)
    check_shape("pose", pose, (4, 4))
    limits = limits_of(robot.lower, robot.upper, pose.dtype)
    low, high = (
        jnp.where(jnp.isfinite(limit[joint]), limit[joint], turn)
        for limit, turn in zip(limits, (-np.pi, np.pi))
    )
    values = low + (high - low) * jnp.asarray((np.arange(samples) + 0.5) / samples, pose.dtype)
    periodic = (*plan.periodic[:joint], plan.locked_turns, *plan.periodic[joint:])
    slots = 2**plan.family.signs

    def some(part: jax.Array) -> IKSolutions:
        target = make_target(part)
        found = solve_complete(robot, target.pose[:, None], (joint, values))

        def together(x: jax.Array) -> jax.Array:
            return x[:, :, :slots].reshape(len(part), samples * slots, *x.shape[3:])

        q, exists, position, rotation = map(
            together, (found.q, found.found, found.position_error, found.rotation_error)
        )
        steps = jnp.zeros(exists.shape, jnp.int32)
        return collect(NewtonResult(q, exists, steps, position, rotation), target, limits, periodic)

    return in_chunks(some, pose)


def spare(robot: Robot) -> Plan | None:
    """The plan for an arm with a joint to spare; None for others."""
    return next((plan for plan in robot.plans if plan.locked is not None), None)
