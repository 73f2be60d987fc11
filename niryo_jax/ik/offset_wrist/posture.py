"""Inverse kinematics of an offset-wrist arm as one equation in one unknown, on lanes.

The tool's pose leaves the wrist point (where axes 4 and 5 meet) a circle about axis 6. A point of
that circle fixes the elbow (two ways) and the shoulder (two ways); what is left is one condition,
that axes 4 and 5 can supply the remaining rotation: f = a4 . a5 - e4 . e5 = 0, where a4, a5 are
the directions of these axes. The unknown t runs over [-pi/2, pi/2] such that f is smooth up to and
including both ends, also where only an arc of the circle is within reach.

Letters and derivations: docs/theory/complete-ik.md.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.closed_form.trig_roots import sinusoid_root
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.wrist_circle import HalfAngle, WristCircle
from niryo_jax.lanes import Condition, Lane, Lanes

_TINY = 1e-30


class Posture(NamedTuple):
    """The arm at one point of the curve, but for its wrist.

    Vectors have their components along axis 2, P1 and P2, the moving frame of the arm's plane.

    Attributes:
        turn: cosine and sine of theta_1.
        elbow: cosine and sine of E.
        circle: cosine and sine of u.
        reach: (2,) from the shoulder to the wrist, along P1 and P2.
        forearm: (2,) direction of the forearm, along P1 and P2.
        axis_4, axis_5, axis_6: (3,) directions.
        from_axis_1: distance of the wrist from axis 1.
        out_of_plane: the part of that at right angles to P2.
        inside: squared reach along P2 before it is clipped to 0; negative where there is none.
    """

    turn: Lanes
    elbow: Lanes
    circle: Lanes
    reach: Lanes
    forearm: Lanes
    axis_4: Lanes
    axis_5: Lanes
    axis_6: Lanes
    from_axis_1: Lane
    out_of_plane: Lane
    inside: Lane

    @property
    def dot(self) -> Lane:
        """The cosine of the angle between axes 4 and 5."""
        return self.axis_4 @ self.axis_5

    def materialised(self) -> Posture:
        """The same, each number computed once and kept (`lanes.materialise`)."""

        def keep(part: Any) -> Any:
            if isinstance(part, np.ndarray):
                return lanes.materialised(part)
            return lanes.materialise(part)

        return Posture(*map(keep, self))


def posture(
    arm: OffsetWristParameters,
    circle: WristCircle,
    t: tuple[Lane, Lane],
    elbow: Lane | float,
    shoulder: Lane | float,
    near_shoulder: bool = False,
) -> Posture:
    """The arm at a point of the curve.

    Args:
        arm: the numbers of the arm.
        circle: the numbers of the target.
        t: sine and cosine of t.
        elbow: 1 or -1: the sign of E, or where the circle is `inner` that of u.
        shoulder: 1 or -1: the sign of the reach along P2.
        near_shoulder: whether the wrist may be so near the shoulder that rounding tells.
    """
    return _posture(arm, circle, *_on_circle(circle, t, elbow), shoulder, near_shoulder)


def _on_circle(
    circle: WristCircle, t: tuple[Lane, Lane], elbow: Lane | float
) -> tuple[Lanes, Lanes]:
    """Cosine and sine of the elbow angle, and of the angle on the circle."""
    sin_elbow, cos_elbow = _full_angle(circle.elbow, t)
    sin_u, cos_u = _full_angle(circle.position, t)
    forward = lanes.select(t[0] < 0.0, -1.0, 1.0)
    # The cosine of one of the two half angles vanishes in the middle of the curve and changes sign.
    inner = circle.inner > 0.5
    sin_elbow = sin_elbow * lanes.select(inner, forward, elbow)
    sin_u = sin_u * lanes.select(inner, elbow, forward)
    return (
        lanes.materialised(np.array([cos_elbow, sin_elbow], dtype=object)),
        lanes.materialised(np.array([cos_u, sin_u], dtype=object)),
    )


def _full_angle(half: HalfAngle, t: tuple[Lane, Lane]) -> tuple[Lane, Lane]:
    """|sin x| and cos x."""
    s2, c2 = t[0] * t[0], t[1] * t[1]
    square = half.low * s2 + half.high * c2
    rest = half.low_rest * s2 + half.high_rest * c2
    return 2.0 * lanes.sqrt(square * rest), rest - square


def posture_or_crossing(
    arm: OffsetWristParameters,
    circle: WristCircle,
    t: tuple[Lane, Lane],
    elbow: Lane,
    sign: Lane,
    crossing: Condition,
    folded: Condition,
) -> Posture:
    """`posture`, but for where the wrist point is on axis 1, which theta_1 does not move there.

    Args:
        arm: the numbers of a planar arm.
        circle, t, elbow: as of `posture`.
        sign: 1 or -1: the shoulder; or which of the two roots of f as a sinusoid in theta_1.
        crossing: where the wrist is on axis 1.
        folded: where it is at the shoulder, which theta_2 does not move either: the forearm lies
            along P2 there.
    """
    bent, u = _on_circle(circle, t, elbow)

    # f is affine in the cosine and sine of theta_1: three points of the plane determine it.
    dtype = bent[0].array.dtype
    cos, sin = (Lane(jnp.array(values, dtype)[:, None]) for values in ([0, 1, 0], [0, 0, 1]))
    every = _Fixed(np.bool_(True), lanes.lanes_of([cos, sin]), folded)
    three = _posture(arm, circle, bent, u, sign, True, every)
    constant, along_x, along_y = map(Lane, lanes.materialise(three.dot - arm.wrist_angle).array)
    scale = 1.0 + abs(constant) + abs(along_x) + abs(along_y)
    root, _ = sinusoid_root(along_x - constant, along_y - constant, constant, sign, scale)
    return _posture(arm, circle, bent, u, sign, True, _Fixed(crossing, root, folded))


class _Fixed(NamedTuple):
    """What the wrist point does not tell: theta_1 `where` it is `turn`, the forearm if `folded`."""

    where: Condition
    turn: Lanes
    folded: Condition


def _posture(
    arm: OffsetWristParameters,
    circle: WristCircle,
    elbow: Lanes,
    u: Lanes,
    shoulder: Lane | float,
    near_shoulder: bool,
    fixed: _Fixed | None = None,
) -> Posture:
    """The arm at an elbow angle and an angle on the circle."""
    d, (lean, upright) = arm.sideways, arm.shoulder_angle
    side, second, axis_6 = circle.axes
    wrist = circle.centre + (arm.radius * u[0]) * side + (arm.radius * u[1]) * second
    wrist = lanes.materialised(wrist)
    x, y, z = wrist
    v = z if arm.is_planar else (z - d * lean) / upright
    w = d * upright - v * lean
    square = x * x + y * y
    inside = square - w * w
    h = shoulder * lanes.sqrt(inside)
    some = square > _TINY
    per = lanes.select(some, 1.0 / lanes.select(some, square, 1.0), 0.0)
    turn = np.array([(x * w - y * h) * per, (y * w + x * h) * per], dtype=object)
    turn = lanes.materialised(
        turn if fixed is None else lanes.choose(fixed.where, fixed.turn, turn)
    )
    reach = np.array([v, h], dtype=object)
    a, b = arm.upper_arm, arm.forearm
    ahead, aside = a * elbow[0] + b, a * elbow[1]
    away = lanes.maximum(v * v + h * h, _TINY)
    if near_shoulder:
        # Both are the distance from shoulder to wrist. Where links of equal length are folded the
        # elbow tells it to half of the digits, and the forearm would be no unit vector.
        bent = lanes.maximum(ahead * ahead + aside * aside, _TINY)
        away = lanes.sqrt(away) * lanes.sqrt(bent)
    per = lanes.materialise(1.0 / away)
    forearm = np.array([(ahead * v - aside * h) * per, (ahead * h + aside * v) * per], dtype=object)
    if fixed is not None:
        along = lanes.lanes_of([Lane(jnp.array(x, v.array.dtype)) for x in (0.0, 1.0)])
        forearm = lanes.choose(fixed.folded, along, forearm)
    # Axis 5 turns with the angle on the circle.
    h0, h1, h2 = arm.hand
    cos_u, sin_u = u
    axis_5 = h0 * axis_6 + (h1 * cos_u - h2 * sin_u) * side + (h1 * sin_u + h2 * cos_u) * second
    return Posture(
        turn=turn,
        elbow=elbow,
        circle=u,
        reach=reach,
        forearm=forearm,
        axis_4=_on_forearm(arm.axis_4, forearm),
        axis_5=lanes.materialised(_in_frame(arm, turn, axis_5)),
        axis_6=_in_frame(arm, turn, axis_6),
        from_axis_1=lanes.sqrt(square),
        out_of_plane=w,
        inside=inside,
    )


def _in_frame(arm: OffsetWristParameters, turn: Lanes, vector: Lanes) -> Lanes:
    """A vector of the base frame along axis 2, P1 and P2."""
    (cos, sin), (lean, upright) = turn, arm.shoulder_angle
    x, y, z = vector
    outward = cos * x + sin * y
    return np.array(
        [upright * outward + lean * z, upright * z - lean * outward, sin * x - cos * y],
        dtype=object,
    )


def _on_forearm(vector: Lanes, forearm: Lanes) -> Lanes:
    """A vector given on (axis 2, forearm, axis 2 x forearm), along axis 2, P1 and P2."""
    k0, k1, k2 = vector
    cos, sin = forearm
    return np.array([k0, k1 * cos - k2 * sin, k1 * sin + k2 * cos], dtype=object)


def joint_angles(arm: OffsetWristParameters, circle: WristCircle, found: Posture) -> Lanes:
    """The six joint angles of a posture, each in [-pi, pi]."""
    theta_1 = lanes.atan2(found.turn[1], found.turn[0])
    upper = found.reach - arm.forearm * found.forearm
    cos, sin = arm.upper_arm_angle
    theta_2 = lanes.atan2(upper[1] * cos - upper[0] * sin, upper[0] * cos + upper[1] * sin)
    (cos_elbow, sin_elbow), (cos, sin) = found.elbow, arm.elbow_angle
    theta_3 = lanes.atan2(
        arm.turn_3 * (sin_elbow * cos - cos_elbow * sin), cos_elbow * cos + sin_elbow * sin
    )
    a4, a5, a6 = found.axis_4, found.axis_5, found.axis_6
    zero = _on_forearm(arm.axis_5, found.forearm)
    theta_4 = lanes.atan2(a5 @ lanes.cross(a4, zero), a5 @ zero)
    normal = a6 @ lanes.cross(a4, a5)
    seen = np.array([a6 @ a4, a6 @ a5, normal], dtype=object)
    theta_5 = lanes.atan2(arm.twist[1] @ seen, arm.twist[0] @ seen)
    (cos_start, sin_start), (cos_u, sin_u) = circle.start, found.circle
    theta_6 = lanes.atan2(
        sin_start * cos_u - cos_start * sin_u, cos_start * cos_u + sin_start * sin_u
    )
    return np.array([theta_1, theta_2, theta_3, theta_4, theta_5, theta_6], dtype=object)


def branch_label(found: Posture, theta_5: Lane) -> jax.Array:
    """The branch of a posture: 1 where the wrist is ahead of the shoulder, that is on the side of
    P2, plus 2 where the elbow angle is positive, plus 4 where theta_5 is."""
    bits = [found.reach[1] > 0.0, found.elbow[1] > 0.0, theta_5 > 0.0]
    ahead, bent, raised = (lanes.select(bit, 1.0, 0.0) for bit in bits)
    return lanes.materialise(ahead + 2.0 * bent + 4.0 * raised, by=theta_5).array.astype(jnp.int32)
