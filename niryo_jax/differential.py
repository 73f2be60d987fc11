"""Differential kinematics: from joint rates to the velocity of the tool, and back.

A velocity has six rows (omega, v). Which point v belongs to is what its frame says:

- "space": the spatial twist; v is the velocity of the tool's body at the origin of the space frame.
- "body": the body twist; the velocity of the tool's origin, in the axes of the tool frame.
- "tool_point": the velocity of the tool's origin, in the axes of the space frame.

The first two are twists (Lynch & Park, *Modern Robotics*, section 3.3.2). The third is what
trajectories of a tool are given in, and what Pardos-Gotor's book, which orders (v, omega), calls
the velocity of the tool.
"""

from __future__ import annotations

import functools
from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_choice
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import Edge, as_floating, check_shape, on_joints, on_lanes
from niryo_jax.robot import Robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.tolerances import DEPENDENT_ROW

VelocityFrame = Literal["space", "body", "tool_point"]


def tool_velocity(
    robot: Robot, q: ArrayLike, rates: ArrayLike, *, frame: VelocityFrame = "tool_point"
) -> jax.Array:
    """The velocity of the tool that joint rates give, V = J(q) dq/dt (Lynch & Park, eq. 5.5).

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        rates: (..., n) joint rates, rad/s (m/s for prismatic joints). Batch axes broadcast.
        frame: which velocity, as the module describes.

    Returns:
        (..., 6) rows (omega, v), rad/s and m/s.

    Raises:
        ValueError: wrong shapes, an unknown frame.
    """
    check_frame(frame)
    return _tool_velocity(robot, q, as_floating("rates", rates), frame=frame)


@specialised
def _tool_velocity(
    geometry: Geometry, q: ArrayLike, rates: ArrayLike, frame: VelocityFrame
) -> jax.Array:
    def velocity(q: Lanes, rates: Lanes) -> Lanes:
        return frame_jacobian(geometry, q, frame, materialise=False) @ rates

    n = geometry.joints
    return on_joints(velocity, q, n, ("rates", rates, (n,)))


def joint_rates(
    robot: Robot,
    q: ArrayLike,
    velocity: ArrayLike,
    *,
    damping: ArrayLike = 0.0,
    frame: VelocityFrame = "tool_point",
) -> jax.Array:
    """The joint rates that give the tool a velocity, as nearly as the arm can.

    The rates minimise |J rates - velocity|^2 + damping^2 |rates|^2, that is
    J^T (J J^T + damping^2 I)^-1 velocity (Nakamura & Hanafusa, 1986), with radians and metres
    counted alike. Without damping they are the least squares for n < 6, and the least of all that
    give the velocity for n >= 6. The least rates and the least squares depend on the frame.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        velocity: (..., 6) rows (omega, v), rad/s and m/s.
        damping: (...,) 0 or more. It bounds the rates by |velocity| / (2 damping), at the price of
            an error where the arm moves less well than that. Batch axes broadcast.
        frame: which velocity, as the module describes.

    Returns:
        (..., n) rad/s (m/s for prismatic joints). Finite even at a singular configuration: there,
        without damping, a row of the velocity (for n < 6, a joint) that depends on
        those before it is left out.

    Raises:
        ValueError: wrong shapes, an unknown frame, damping that is negative or not a number.
    """
    check_frame(frame)
    q, velocity, d = (
        as_floating(name, value)
        for name, value in (("q", q), ("velocity", velocity), ("damping", damping))
    )
    # An array that is made inside a caller's jit is not known, but what it is made of may be.
    known = is_concrete(damping)
    if known and not np.all(np.asarray(damping) >= 0):
        raise ValueError(f"damping: expected 0 or more, got {damping}")
    damped = not known or bool(np.any(np.asarray(damping) > 0))
    check_shape("velocity", velocity, (6,))
    dtype = jnp.result_type(q, velocity)
    arrays = (x.astype(dtype) for x in (q, velocity, d))
    return _joint_rates(robot, *arrays, frame=frame, damped=damped)


@specialised
def _joint_rates(
    geometry: Geometry,
    q: jax.Array,
    velocity: jax.Array,
    damping: jax.Array,
    frame: VelocityFrame,
    damped: bool,
) -> jax.Array:
    n = geometry.joints
    jacobian = on_joints(
        lambda q: lanes.materialised(frame_jacobian(geometry, q, frame, materialise=True)), q, n
    )
    solve = _tall if n < 6 else _wide
    return solve(damped, jacobian, velocity, damping)


def _tall(damped: bool, jacobian: jax.Array, velocity: jax.Array, damping: jax.Array) -> jax.Array:
    """The least squares of [J; d I] x = (V, 0)."""
    tolerance = DEPENDENT_ROW.of(velocity.dtype)
    n = jacobian.shape[-1]

    def solve(jacobian: Lanes, velocity: Lanes, damping: Lanes) -> Lanes:
        if not damped:
            return lanes.solve(jacobian, velocity, 0.0, tolerance)
        matrix = np.vstack([jacobian, lanes.identity(n) * damping[0]])
        rhs = np.concatenate([velocity, lanes.lanes_of(np.zeros(n))])
        return lanes.solve(matrix, rhs, 0.0, tolerance)

    return on_lanes(solve, *_edges(jacobian, velocity, damping))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _wide(damped: bool, jacobian: jax.Array, velocity: jax.Array, damping: jax.Array) -> jax.Array:
    """J^T (J J^T + d^2 I)^-1 V."""
    return _wide_with_multipliers(damped, jacobian, velocity, damping)[0]


def _wide_with_multipliers(
    damped: bool, jacobian: jax.Array, velocity: jax.Array, damping: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """The x of the least (x, y) with [J, d I] (x, y) = V, and m with J^T m = x and d m = y."""
    tolerance = DEPENDENT_ROW.of(velocity.dtype)
    n = jacobian.shape[-1]

    def solve(jacobian: Lanes, velocity: Lanes, damping: Lanes) -> tuple[Lanes, Lanes]:
        scaled = lanes.identity(6) * damping[0]
        matrix = np.hstack([jacobian, scaled]) if damped else jacobian
        x = lanes.solve(matrix, velocity, 0.0, tolerance)
        return x[:n], lanes.solve(matrix.T, x, 0.0, tolerance)

    x, multipliers = on_lanes(solve, *_edges(jacobian, velocity, damping))
    return x, multipliers


@_wide.defjvp
def _wide_jvp(
    damped: bool,
    primals: tuple[jax.Array, jax.Array, jax.Array],
    tangents: tuple[jax.Array, jax.Array, jax.Array],
) -> tuple[jax.Array, jax.Array]:
    # From x = J^T m and (J J^T + d^2 I) m = V; a far smaller program than the derivative of the
    # factorisation. A square J has x = J^-1 V.
    (jacobian, _, damping), (jacobian_rate, velocity_rate, damping_rate) = primals, tangents
    if not damped and jacobian.shape[-1] == 6:
        x = _wide(damped, *primals)
        return x, _wide(damped, jacobian, velocity_rate - _times(jacobian_rate, x), damping)
    x, multipliers = _wide_with_multipliers(damped, *primals)
    turned = _times(jnp.swapaxes(jacobian_rate, -1, -2), multipliers)
    rate = velocity_rate - _times(jacobian_rate, x) - _times(jacobian, turned)
    rate = rate - (2 * damping * damping_rate)[..., None] * multipliers
    return x, turned + _wide(damped, jacobian, rate, damping)


def _edges(jacobian: jax.Array, velocity: jax.Array, damping: jax.Array) -> tuple[Edge, ...]:
    return (
        ("jacobian", jacobian, jacobian.shape[-2:]),
        ("velocity", velocity, (6,)),
        ("damping", damping[..., None], (1,)),
    )


def _times(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """The product (..., m, n) (..., n) -> (..., m)."""
    return jnp.sum(matrix * vector[..., None, :], axis=-1)


def frame_jacobian(
    geometry: Geometry, q: Lanes, frame: VelocityFrame, *, materialise: bool
) -> Lanes:
    """The (6, n) Jacobian of the velocity in a frame; `materialise` as in `pose_and_jacobian`."""
    if frame != "tool_point":
        return pose_and_jacobian(geometry, q, frame, materialise=materialise)[1]
    (_, position), jacobian = pose_and_jacobian(geometry, q, "space", materialise=materialise)
    # The velocity of the point at p is v + omega x p.
    return np.stack(
        [np.concatenate([c[:3], c[3:] + lanes.cross(c[:3], position)]) for c in jacobian.T], axis=1
    )


def check_frame(frame: VelocityFrame) -> None:
    """Raise a ValueError unless it is the name of a frame."""
    check_choice("frame", frame, get_args(VelocityFrame))
