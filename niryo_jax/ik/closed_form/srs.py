"""The arm angle of arms with a spherical shoulder and a spherical wrist."""

from __future__ import annotations

from typing import NamedTuple

import jax
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.chain import link_motions
from niryo_jax.ik.closed_form.joint_motion import away_from, line_of, meeting_point
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import on_joints
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.tolerances import MERGED_ROOT, VANISHING_LENGTH

ELBOW = 3
"""The number of the joint between shoulder and wrist."""


def arm_angle(robot: Robot, q: ArrayLike) -> jax.Array:
    """The angle by which the elbow is turned about the line from shoulder to wrist.

    It is counted from the half-plane that holds the direction of axis 1 to the one that holds the
    elbow, which is the point of axis 4 nearest to the shoulder; positive is the right-hand turn
    about the direction from shoulder to wrist. It has no value where the wrist is on axis 1 or the
    arm is stretched.

    Args:
        robot: an arm of seven joints of which axes 1, 2, 3 meet, and 5, 6, 7.
        q: (..., 7) joint vector.

    Returns:
        (...,) radians in [-pi, pi].

    Raises:
        ValueError: an arm without an arm angle, or q of another shape.
    """
    check_is_robot(robot)
    if not any(plan.by_arm_angle for plan in robot.plans):
        raise ValueError(
            "robot: expected seven joints of which axes 1, 2, 3 meet in one point and 5, 6, 7 in "
            f"another; {robot.name} is no such arm"
        )
    return _arm_angle(robot, q)


@specialised
def _arm_angle(geometry: Geometry, q: ArrayLike) -> jax.Array:
    return angle_of(geometry, q)


def angle_of(geometry: Geometry, q: ArrayLike) -> jax.Array:
    """`arm_angle` of a geometry."""

    def angle(q: Lanes) -> Lane:
        along, elbow = _forearm(geometry, q)
        _, reference, beside = frame(along, geometry.screws[0, :3]).T
        return lanes.atan2(beside @ elbow, reference @ elbow)

    return on_joints(angle, q, geometry.joints)


def has_angle(geometry: Geometry, q: ArrayLike) -> jax.Array:
    """(..., 7) -> (...,) whether `arm_angle` has a value, as far as rounding can tell."""

    def least_sine(q: Lanes) -> Lane:
        along, elbow = (_unit(x) for x in _forearm(geometry, q))
        off_axis, off_elbow = lanes.cross(along, geometry.screws[0, :3]), lanes.cross(along, elbow)
        return lanes.minimum(lanes.norm(off_axis), lanes.norm(off_elbow))

    return on_joints(least_sine, q, geometry.joints) > MERGED_ROOT.of(jax.numpy.result_type(q))


def _forearm(geometry: Geometry, q: Lanes) -> tuple[Lanes, Lanes]:
    """The vectors from the shoulder to the wrist and to the elbow."""
    arm = srs_points(geometry.screws)
    *_, (upper, _), (rotation, position) = link_motions(geometry, q[:4], materialise=True)
    return rotation @ arm.wrist + position - arm.shoulder, upper @ arm.elbow


class SrsPoints(NamedTuple):
    """Shoulder and wrist at home, and the vector from the shoulder to the elbow."""

    shoulder: Lanes
    wrist: Lanes
    elbow: Lanes


def srs_points(screws: Lanes) -> SrsPoints:
    """The points of an arm that its seven screws tell."""
    shoulder = meeting_point(screws[0], screws[1])
    elbow = lanes.materialised(-away_from(line_of(screws[ELBOW]), shoulder))
    return SrsPoints(shoulder, meeting_point(screws[4], screws[5]), elbow)


def frame(along: Lanes, beside: Lanes) -> Lanes:
    """(3, 3) unit vectors as columns: along one vector, towards another, and across both.

    Where one is parallel to the other, or zero, any direction across it is as good.
    """
    x = _unit(along)
    towards = lanes.materialised(beside - (x @ beside) * x)
    # Next to x little is left but rounding, along x too, which this takes away.
    towards = towards - (x @ towards) * x
    y = lanes.materialised(_unit(lanes.choose(_is_short(towards), across(x), towards)))
    return np.stack([x, y, lanes.cross(x, y)], axis=1)


def across(unit: Lanes) -> Lanes:
    """A unit vector at right angles to a unit vector."""
    x, y, z = unit
    zero = Lane(0.0)
    near_z = np.array([-z, zero, x], dtype=object)
    return _unit(lanes.choose(abs(z) > 0.8, near_z, np.array([-y, x, zero], dtype=object)))


def _is_short(vector: Lanes) -> lanes.Condition:
    square = vector @ vector
    shortest = VANISHING_LENGTH.of(jax.numpy.result_type(square.value))
    return square <= shortest * shortest


def _unit(vector: Lanes) -> Lanes:
    square = vector @ vector
    none = square <= 0.0
    return lanes.materialised(vector * lanes.reciprocal_root(lanes.select(none, 1.0, square)))
