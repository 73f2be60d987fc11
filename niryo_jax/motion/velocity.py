"""Velocity inverse kinematics: from the twist that a tool should have to joint rates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import shown
from niryo_jax.differential import VelocityFrame, check_frame
from niryo_jax.ik.task import TaskName, task_of
from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape
from niryo_jax.motion.rate_box import RateLimits
from niryo_jax.motion.velocity_program import Asked, joint_rates_for
from niryo_jax.motion.velocity_result import VelocityResult
from niryo_jax.robot import Robot, check_is_robot

_FEW = 64
"""So many at a time are worked out by a program that is compiled fast rather than to run fast."""


def velocity_ik(
    robot: Robot,
    q: ArrayLike,
    twist: ArrayLike,
    *,
    frame: VelocityFrame = "tool_point",
    task: TaskName = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
    damping: ArrayLike = 0.02,
    threshold: ArrayLike = 0.01,
    weights: ArrayLike | None = None,
    null_motion: ArrayLike | None = None,
    rate_limits: ArrayLike | None = None,
    dt: ArrayLike | None = None,
    acceleration_limits: ArrayLike | None = None,
    previous_rate: ArrayLike | None = None,
    keep_direction: bool = False,
) -> VelocityResult:
    """Joint rates that give the tool a twist, as nearly as the arm and its limits let them.

    With A and b the rows of the body Jacobian and of the twist that the task binds, weighted, they
    minimise |A x - b|^2 + s |x - z|^2 within a box of rates. s is 0 unless the smallest singular
    value of A is below the threshold, then damping^2 (1 - (value / threshold)^2) (Chiaverini,
    Siciliano & Egeland, 1994). Of several such x an arm with joints to spare takes one near to z,
    the null motion less what of it the tool would see.

    All of it happens at the tool's origin: one motion, named in any frame, gets the same rates.

    Args:
        robot: the arm.
        q: (..., n) joint vector, radians (metres for prismatic joints).
        twist: (..., 6) rows (omega, v), rad/s and m/s.
        frame: which velocity that is: "tool_point" (of the tool's origin, in the axes of the space
            frame), "body" or "space"; `niryo_jax.differential` describes them.
        task: what of it binds: "pose" all, "direction" v and the motion of an axis of the tool,
            "position" v of the tool's origin.
        tool_axis: (3,) for "direction", in the tool frame.
        damping: (...,) the most that there is, 0 or more; it bounds rates by |b| / (2 damping)
            where the arm is singular.
        threshold: (...,) the smallest singular value below which there is damping, 0 or more.
        weights: (..., 6) above 0, of the rows (omega, v) in the axes of the tool: what counts where
            not all can be had. Those of "direction" are seen along the two turns that it binds.
        null_motion: (..., n) rates that are taken as far as the tool does not see them.
        rate_limits: (..., n) the fastest rates, above 0, rad/s (m/s).
        dt: (...,) seconds that the rates will be kept. With it the joints stay within the robot's
            `lower` and `upper`; a joint outside goes back as fast as the other limits let it.
        acceleration_limits: (..., n) above 0, rad/s^2 (m/s^2); with `previous_rate` and `dt`. The
            joints then slow down in time for their limits.
        previous_rate: (..., n) the rates before.
        keep_direction: slow all joints alike where one meets a limit, so that the tool moves in
            the direction that it would without limits, rather than coming nearest to the twist.

    Batch axes broadcast.

    Returns:
        A `VelocityResult`, in the precision of q and twist. Rates are finite whatever the posture.
        Derivatives by q, twist, the arm and all other arrays are those of a small change that
        leaves the limits which hold as they are.

    Raises:
        ValueError: wrong shapes; a number out of its range; an acceleration limit without
            `previous_rate` and `dt`, or the other way round.
        TypeError: no robot, or no array of real numbers.
    """
    check_is_robot(robot)
    check_frame(frame)
    bound = task_of(task, tool_axis)
    n = robot.joints
    q, twist = as_floating("q", q), as_floating("twist", twist)
    check_shape("q", q, (n,))
    check_shape("twist", twist, (6,))
    step = None if dt is None else _in_range("dt", dt, None)
    limits = RateLimits(
        None if rate_limits is None else _in_range("rate_limits", rate_limits, n),
        None
        if acceleration_limits is None
        else _in_range("acceleration_limits", acceleration_limits, n),
        None if previous_rate is None else _vector("previous_rate", previous_rate, n),
        step,
        *(None if step is None else jnp.asarray(x) for x in (robot.lower, robot.upper)),
    )
    _check_together(limits)
    asked = Asked(
        twist,
        _in_range("damping", damping, None, "of 0 or more"),
        _in_range("threshold", threshold, None, "of 0 or more"),
        None if weights is None else _in_range("weights", weights, 6),
        None if null_motion is None else _vector("null_motion", null_motion, n),
        limits if any(x is not None for x in limits) else None,
    )
    named: list[tuple[str, jax.Array | None, int]] = [
        ("q", q, 1),
        ("twist", twist, 1),
        ("damping", asked.damping, 0),
        ("threshold", asked.threshold, 0),
        ("weights", asked.weights, 1),
        ("null_motion", asked.null_motion, 1),
        ("rate_limits", limits.rate, 1),
        ("dt", step, 0),
        ("acceleration_limits", limits.acceleration, 1),
        ("previous_rate", limits.previous, 1),
    ]
    batch = broadcast_batch(*(each for each in named if each[1] is not None))
    dtype = jnp.result_type(q, twist)
    q, asked = jax.tree.map(lambda x: x.astype(dtype), (q, asked))
    return joint_rates_for(
        robot,
        q,
        asked,
        frame=frame,
        task=bound,
        keep_direction=bool(keep_direction),
        quick=math.prod(batch) <= _FEW,
    )


def _vector(name: str, value: ArrayLike, size: int) -> jax.Array:
    array = as_floating(name, value)
    check_shape(name, array, (size,))
    return array


def _in_range(name: str, value: ArrayLike, size: int | None, least: str = "above 0") -> jax.Array:
    """Numbers (..., size), or (...,) where there is no size, in a range; they may be infinite."""
    array = as_floating(name, value)
    if size is not None:
        check_shape(name, array, (size,))
    # An array that is made inside a caller's jit is not known, but what it is made of may be.
    if is_concrete(value):
        known = np.asarray(value, float)
        if not np.all(known > 0 if least == "above 0" else known >= 0):
            raise ValueError(f"{name}: expected numbers {least}, got {shown(value)}")
    return array


def _check_together(limits: RateLimits) -> None:
    given = limits.acceleration is not None, limits.previous is not None
    if given[0] != given[1]:
        raise ValueError(
            "acceleration_limits, previous_rate: expected both or neither, got "
            f"{'the first' if given[0] else 'the second'} alone"
        )
    if given[0] and limits.step is None:
        raise ValueError("dt: expected the seconds that rates are kept, with acceleration_limits")
