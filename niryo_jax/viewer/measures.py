"""All that is shown of many joint vectors at once, in one program."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.chain import forward_kinematics, link_poses
from niryo_jax.collision import distances
from niryo_jax.jacobian import manipulability
from niryo_jax.robot import Robot
from niryo_jax.uncertainty import propagate
from niryo_jax.uncertainty.checks import check_covariance
from niryo_jax.viewer.shape import Shape


class Measures(NamedTuple):
    """What is known of k joint vectors, as numpy.

    Attributes:
        links: (k, n + 1, 4, 4) how each link has moved from its home place, the base first.
        tool: (k, 4, 4) poses of the tool frame in the space frame, metres.
        distances: (k, p) signed distances of the pairs of the collision model, metres.
        manipulability: (k,) Yoshikawa's measure.
        motion: (3, 3) J_v J_v^T of the first joint vector: how joint rates of length 1 move the
            tool's origin, in the axes of the space frame.
        error: (3, 3) covariance of the position of the tool's origin there, m^2.
    """

    links: np.ndarray
    tool: np.ndarray
    distances: np.ndarray
    manipulability: np.ndarray
    motion: np.ndarray
    error: np.ndarray


def measures_of(
    robot: Robot, shape: Shape, covariance: np.ndarray
) -> tuple[Callable[[np.ndarray], Measures], tuple[tuple[str, str], ...]]:
    """What measures joint vectors (k, n) of an arm, and the pairs whose distances it tells.

    Args:
        robot: the arm.
        shape: with or without a collision model.
        covariance: (n, n) of the errors of the joints, rad^2 (m^2 for prismatic joints).

    Raises:
        ValueError: a covariance that is none. TypeError: no array of real numbers.
    """
    model, world = shape.model, shape.world
    check_covariance("covariance", covariance, robot.joints)

    @jax.jit
    def measured(q: jax.Array) -> tuple[jax.Array, ...]:
        moved = link_poses(robot, q)
        base = jnp.broadcast_to(jnp.eye(4, dtype=q.dtype), (len(q), 1, 4, 4))
        apart = jnp.zeros((len(q), 0), q.dtype)
        if model is not None:
            apart = distances(robot, model, q, world).distance
        spread = (np.eye(robot.joints), covariance)
        motion, error = (propagate(robot, q[0], c).position_covariance for c in spread)
        return (
            jnp.concatenate([base, moved], axis=1),
            forward_kinematics(robot, q),
            apart,
            manipulability(robot, q),
            motion,
            error,
        )

    pairs: tuple[tuple[str, str], ...] = ()
    if model is not None:
        shaped = functools.partial(distances, robot, model, world=world)
        pairs = jax.eval_shape(shaped, jax.ShapeDtypeStruct((robot.joints,), float)).pairs
    return lambda q: Measures(*jax.device_get(measured(q))), pairs
