"""From the covariance of the joints to that of the tool: first order, and its second-order shift.

With J_b,i the columns of the body Jacobian, T(q)^-1 T(q + d) = exp([J_b,1] d_1) ...
exp([J_b,n] d_n) exactly. The part of first order is the twist J d, so that covariances go through
J (Lynch & Park, eq. 5.5). The parts of second order are products [J_b,i] [J_b,j] d_i d_j with
i <= j, so that the tool's origin has d2p / dq_i dq_j = w_i x dp/dq_j.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.arguments import check_finite, shown
from niryo_jax.differential import VelocityFrame, check_frame, frame_jacobian
from niryo_jax.ik import IKSolutions
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import Edge, as_floating, check_shape, on_joints
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.uncertainty.checks import check_covariance, check_not_negative
from niryo_jax.uncertainty.ellipsoid import Ellipsoid, ellipsoid_of, positive_root


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Propagated:
    """What errors of the joints make of the pose of the tool.

    Attributes:
        covariance: (..., 6, 6) of the error of the pose, rows (omega, v), rad and m, in `frame`.
        position_covariance: (..., 3, 3) of the displacement of the tool's origin, m^2, in the axes
            of the space frame whatever `frame` is.
        mean_shift: (..., 3) the mean displacement of the tool's origin, metres, in the axes of the
            space frame, to second order.
        frame: "tool_point", "body" or "space", as the velocities of `niryo_jax.differential`;
            static.
    """

    covariance: jax.Array
    position_covariance: jax.Array
    mean_shift: jax.Array
    frame: VelocityFrame = dataclasses.field(metadata={"static": True})

    @property
    def rms(self) -> jax.Array:
        """(...,) root mean square of the position error about its mean, metres, to first order."""
        return _root_of_trace(self.position_covariance)

    def ellipsoid(self, probability: float | None = None) -> Ellipsoid:
        """The position ellipsoid; argument and errors are those of `position_ellipsoid`."""
        return ellipsoid_of(self.position_covariance, probability)


def propagate(
    robot: Robot,
    q: ArrayLike,
    covariance: ArrayLike,
    mean: ArrayLike | None = None,
    *,
    frame: VelocityFrame = "tool_point",
) -> Propagated:
    """The covariance of the tool, J covariance J^T, and the shift of its mean position.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        covariance: (..., n, n) of the errors of the joints, rad^2 (m^2 for prismatic joints); that
            of a model of noise is `noise.covariance(q)`. Batch axes broadcast.
        mean: (..., n) mean of the errors, zero unless given; that of a model is `noise.mean(q)`.
        frame: the frame of the 6x6 covariance: "tool_point" (the rotation vector and the
            displacement of the tool's origin, in the axes of the space frame), "body" (the same in
            the axes of the tool) or "space" (the spatial twist).

    Returns:
        A `Propagated`. The covariance is of first order in the covariance of the joints. The shift
        is sum_i m_i dp/dq_i + 1/2 sum_ij (C + m m^T)_ij d2p/dq_i dq_j.

    Raises:
        ValueError: wrong shapes, an unknown frame, a covariance that is not symmetric, positive
            semidefinite and finite, a mean that is not finite. Looking at a covariance for each
            of many configurations takes longer than propagating it; inside a caller's jit
            nothing is looked at.
        TypeError: no arrays of real numbers.
    """
    check_is_robot(robot)
    check_frame(frame)
    q, covariance = as_floating("q", q), as_floating("covariance", covariance)
    check_shape("q", q, (robot.joints,))
    check_covariance("covariance", covariance, robot.joints)
    arrays = [q, covariance]
    if mean is not None:
        arrays.append(as_floating("mean", mean))
        check_shape("mean", arrays[-1], (robot.joints,))
        check_finite("mean", arrays[-1])
    return Propagated(*_propagate(robot, *arrays, frame=frame), frame)


@specialised
def _propagate(
    geometry: Geometry,
    q: jax.Array,
    covariance: jax.Array,
    mean: jax.Array | None = None,
    *,
    frame: VelocityFrame,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    n = geometry.joints

    def jacobian(q: Lanes, frame: VelocityFrame) -> Lanes:
        # Kept once: what else is kept, on the way to it or from it, costs more than it saves.
        chain = frame != "tool_point"
        return lanes.materialised(frame_jacobian(geometry, q, frame, materialise=chain))

    def moments(q: Lanes, covariance: Lanes, *mean: Lanes) -> tuple[Lanes, ...]:
        point = jacobian(q, "tool_point")
        shift = _mean_shift(point, covariance, *mean)
        if frame == "tool_point":
            return _through(point, covariance), shift
        whole = _through(jacobian(q, frame), covariance)
        return whole, shift, _through(point[3:], covariance)

    edges: list[Edge] = [("covariance", covariance, (n, n))]
    if mean is not None:
        edges.append(("mean", mean, (n,)))
    whole, shift, *position = on_joints(moments, q, n, *edges)
    return whole, position[0] if position else whole[..., 3:, 3:], shift


def _through(jacobian: Lanes, covariance: Lanes) -> Lanes:
    """J C J^T, of which each entry is worked out once, so that it is symmetric to the last bit."""
    half = jacobian @ covariance
    out = np.empty((len(jacobian), len(jacobian)), dtype=object)
    for i in range(len(jacobian)):
        for j in range(i + 1):
            out[i, j] = out[j, i] = lanes.dot(half[i], jacobian[j])
    return out


def _mean_shift(jacobian: Lanes, covariance: Lanes, mean: Lanes | None = None) -> Lanes:
    """sum_j m_j p_j + (1/2 M_jj w_j + sum_{i<j} M_ij w_i) x p_j, p_j = dp/dq_j, M = C + m m^T."""
    second = covariance if mean is None else covariance + lanes.outer(mean, mean)
    omega, linear = jacobian[:3], jacobian[3:]
    out = lanes.lanes_of(np.zeros(3)) if mean is None else linear @ mean
    for j in range(jacobian.shape[1]):
        turn = omega[:, j] * (0.5 * second[j, j])
        for i in range(j):
            turn = turn + omega[:, i] * second[i, j]
        out = out + lanes.cross(turn, linear[:, j])
    return out


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """How far the tool goes for the error of each joint alone, to first order.

    Attributes:
        position: (..., n) displacement of the tool's origin, metres.
        rotation: (..., n) angle by which the tool turns, radians.
    """

    position: jax.Array
    rotation: jax.Array

    @property
    def millimetres(self) -> jax.Array:
        """(..., n) `position` in millimetres."""
        return 1e3 * self.position

    @property
    def milliradians(self) -> jax.Array:
        """(..., n) `rotation` in milliradians."""
        return 1e3 * self.rotation

    @property
    def ranking(self) -> jax.Array:
        """(..., n) numbers of the joints from 0, the one that moves the tool farthest first."""
        return jnp.argsort(-self.position, axis=-1)


def sensitivity(robot: Robot, q: ArrayLike, sigma: ArrayLike = 1.0) -> Sensitivity:
    """How far the tool is moved and turned by the error of each joint alone.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        sigma: () or (..., n) the error of each joint, radians (metres for prismatic joints), 0 or
            more. With 1 the answers are metres and radians a radian: mm and mrad a milliradian.

    Returns:
        A `Sensitivity`: the norms of the columns of the Jacobian times sigma. The root of the sum
        of their squares is the rms of `propagate` for independent joints.

    Raises:
        ValueError: wrong shapes, a sigma that is negative or not finite.
        TypeError: no arrays of real numbers.
    """
    check_is_robot(robot)
    q, sigma = as_floating("q", q), as_floating("sigma", sigma)
    check_shape("q", q, (robot.joints,))
    if sigma.ndim:
        check_shape("sigma", sigma, (robot.joints,))
    check_not_negative("sigma", sigma)
    of_each = jnp.broadcast_to(sigma, (*sigma.shape[:-1], robot.joints))
    return Sensitivity(*_sensitivity(robot, q, of_each))


@specialised
def _sensitivity(geometry: Geometry, q: jax.Array, sigma: jax.Array) -> tuple[jax.Array, jax.Array]:
    def norms(q: Lanes, sigma: Lanes) -> tuple[Lanes, Lanes]:
        jacobian = frame_jacobian(geometry, q, "tool_point", materialise=True)
        linear = lanes.lanes_of([lanes.norm(column) for column in jacobian[3:].T])
        angular = lanes.lanes_of([lanes.norm(column) for column in jacobian[:3].T])
        return linear * sigma, angular * sigma

    n = geometry.joints
    return on_joints(norms, q, n, ("sigma", sigma, (n,)))


def least_sensitive(
    robot: Robot, solutions: IKSolutions, covariance: ArrayLike
) -> tuple[jax.Array, jax.Array]:
    """The solution within the limits at which joint errors move the tool's origin least.

    Args:
        robot: the arm that was solved for.
        solutions: what `inverse_kinematics` returned, batch axes (...).
        covariance: (..., n, n) of the errors of the joints, rad^2 (m^2 for prismatic joints).

    Returns:
        (..., n) the joint vectors of least `Propagated.rms`, and (...,) whether there is one within
        the limits; where there is none, the first slot is returned.

    Raises:
        ValueError, TypeError: as `propagate`; solutions that are none, or of another arm.
    """
    check_is_robot(robot)
    if not isinstance(solutions, IKSolutions):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"solutions: expected IKSolutions, got {shown(solutions)}")
    check_shape("solutions", solutions.q, (robot.joints,))
    covariance = as_floating("covariance", covariance)
    check_covariance("covariance", covariance, robot.joints)
    spread = covariance.astype(solutions.q.dtype)[..., None, :, :]
    _, position, _ = _propagate(robot, solutions.q, spread, frame="tool_point")
    return _least(solutions, jnp.trace(position, axis1=-2, axis2=-1))


@jax.jit
def _least(solutions: IKSolutions, measure: jax.Array) -> tuple[jax.Array, jax.Array]:
    within = jnp.broadcast_to(solutions.within_limits, measure.shape)
    best = jnp.argmin(jnp.where(within, measure, jnp.inf), axis=-1)[..., None, None]
    q = jnp.broadcast_to(solutions.q, (*measure.shape, solutions.q.shape[-1]))
    return jnp.take_along_axis(q, best, axis=-2)[..., 0, :], jnp.any(within, axis=-1)


@jax.jit
def _root_of_trace(covariance: jax.Array) -> jax.Array:
    return positive_root(jnp.trace(covariance, axis1=-2, axis2=-1))
