"""By how much a joint vector misses a pose."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import Motion, compose, joint_motion
from niryo_jax.geometry import Geometry
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3

Frame = Literal["body", "space"]


def error_twist(
    geometry: Geometry, target: Lanes, q: Lanes, frame: Frame
) -> tuple[Lanes, Lanes, Lane]:
    """The twist from tool to target, the Jacobian in the same frame, and the position error."""
    (rotation, position), jacobian = pose_and_jacobian(geometry, q, frame, stored=True)
    goal_rotation, goal = se3.split(target)
    away = goal - position
    turn = lanes.map_lanes(lanes.store, rotation.T @ goal_rotation)
    twist = se3.log_lanes(turn, rotation.T @ away)
    if frame == "space":
        w, v = rotation @ twist[:3], rotation @ twist[3:]
        twist = np.concatenate([w, v + lanes.cross(position, w)])
    return twist, jacobian, lanes.norm(away)


def pose_errors(geometry: Geometry, target: Lanes, q: Lanes) -> tuple[Lane, Lane]:
    """Metres and radians by which a joint vector that nearly reaches a target misses it."""
    motion: Motion | None = None
    for joint, angle in enumerate(q):
        step = joint_motion(geometry, joint, angle, stored=True)
        motion = step if motion is None else compose(motion, step)
        if joint == geometry.joints // 2:
            # Both errors need the whole chain; half of it is kept rather than computed twice.
            rotation, position = (lanes.map_lanes(lanes.store, part) for part in motion)
            motion = rotation, position
    home = se3.split(geometry.home)
    rotation, position = home if motion is None else compose(motion, home)
    goal_rotation, goal = se3.split(target)
    away = (rotation - goal_rotation).ravel()
    # The Frobenius norm is 2 sqrt(2) sin(angle / 2): the angle itself where that matters.
    return lanes.norm(position - goal), lanes.norm(away) * math.sqrt(0.5)
