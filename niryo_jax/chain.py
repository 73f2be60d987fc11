"""Forward kinematics of open chains: the product of exponentials.

T(q) = exp([S1] q1) ... exp([Sn] qn) M, with the screws S in the space frame and M the home pose
(Lynch & Park, *Modern Robotics*, eq. 4.14; Murray, Li & Sastry, eq. 3.3).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating, on_joints
from niryo_jax.lie import se3, so3
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised


def forward_kinematics(robot: Robot, q: ArrayLike, *, batch_last: bool = False) -> jax.Array:
    """The pose of the tool frame in the space frame.

    Args:
        robot: the arm.
        q: (..., n) joint vector, radians (metres for prismatic joints).
        batch_last: whether the batch axes come last, (n, ...) -> (4, 4, ...), which is faster.

    Returns:
        (..., 4, 4) poses exp([S1] q1) ... exp([Sn] qn) M (Lynch & Park, eq. 4.14).

    Raises:
        ValueError: q does not have n joints.
    """
    return _forward_kinematics(robot, q, batch_last=batch_last)


@specialised
def _forward_kinematics(geometry: Geometry, q: ArrayLike, batch_last: bool) -> jax.Array:
    return on_joints(
        lambda q: se3.assemble(*tool_motion(geometry, q)),
        q,
        geometry.joints,
        batch_last=batch_last,
    )


def link_poses(robot: Robot, q: ArrayLike, homes: ArrayLike | None = None) -> jax.Array:
    """The pose of a frame on every link.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        homes: (n, 4, 4) pose of a frame on each link at q = 0; the space frame where not given,
            so that the answer is how each link has moved from its home place.

    Returns:
        (..., n, 4, 4) poses exp([S1] q1) ... exp([Si] qi) home_i, i = 1..n.

    Raises:
        ValueError: q does not have n joints, or homes has another shape.
    """
    check_is_robot(robot)
    q = as_floating("q", q)
    if homes is None:
        homes = jnp.broadcast_to(jnp.eye(4, dtype=q.dtype), (robot.joints, 4, 4))
    return _link_poses(robot, q, homes)


@specialised
def _link_poses(geometry: Geometry, q: ArrayLike, homes: ArrayLike) -> jax.Array:
    def poses(q: Lanes, homes: Lanes) -> Lanes:
        motions = link_motions(geometry, q)
        return np.stack(
            [se3.assemble(*compose(m, se3.split(home))) for m, home in zip(motions, homes)]
        )

    n = geometry.joints
    return on_joints(poses, q, n, ("homes", homes, (n, 4, 4)))


Motion = tuple[Lanes, Lanes]
"""A rigid motion as rotation (3, 3) and position (3,) lanes."""


def joint_motion(
    geometry: Geometry, joint: int, angle: Lane, *, materialise: bool = False
) -> Motion:
    """exp([S_i] q_i), by the cheapest formula that what is known of the joint allows.

    `materialise` keeps sine and cosine in memory, for programs in which many loops need them.
    """
    screw, kind = geometry.screws[joint], geometry.kinds[joint]
    w, v = screw[:3], screw[3:]
    if kind == "any":
        return se3.exp_lanes(screw * angle)
    if kind == "prismatic":
        return lanes.identity(3), v * angle
    sin, cos = lanes.sincos(angle)
    if materialise:
        sin, cos = lanes.materialise(sin), lanes.materialise(cos)
    position = sin * v + (1.0 - cos) * lanes.cross(w, v)
    if kind == "helical":
        position = position + ((angle - sin) * (w @ v)) * w
    return so3.rotation_about(w, sin, cos), position


def compose(a: Motion, b: Motion) -> Motion:
    """The motion a b."""
    return a[0] @ b[0], a[0] @ b[1] + a[1]


def link_motions(geometry: Geometry, q: Lanes, *, materialise: bool = False) -> list[Motion]:
    """exp([S1] q1) ... exp([Si] qi) for i = 1..n: how each link has moved from its home place.

    `materialise` keeps each motion in memory (`lanes.materialise`), for programs with many results.
    """
    motions: list[Motion] = []
    for joint, angle in enumerate(q):
        motion = joint_motion(geometry, joint, angle, materialise=materialise)
        if motions:
            motion = compose(motions[-1], motion)
        if materialise:
            rotation, position = (lanes.materialised(part) for part in motion)
            motion = rotation, position
        motions.append(motion)
    return motions


def tool_motion(geometry: Geometry, q: Lanes) -> Motion:
    """The pose of the tool frame."""
    return compose(link_motions(geometry, q)[-1], se3.split(geometry.home))
