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
from niryo_jax.ik.arm import Arm
from niryo_jax.ik.circle import Circle, HalfAngle
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

    def stored(self) -> Posture:
        """The same, each number computed once and kept (`lanes.store`)."""

        def keep(part: Any) -> Any:
            return lanes.stored(part) if isinstance(part, np.ndarray) else lanes.store(part)

        return Posture(*map(keep, self))

    def where(self, condition: Condition, other: Posture) -> Posture:
        """The other posture where the condition holds, this one elsewhere."""

        def pick(mine: Any, its: Any) -> Any:
            choose: Any = lanes.choose if isinstance(mine, np.ndarray) else lanes.select
            return choose(condition, its, mine)

        return Posture(*map(pick, self, other))


def posture(
    arm: Arm, circle: Circle, t: tuple[Lane, Lane], elbow: Lane | float, shoulder: Lane | float
) -> Posture:
    """The arm at a point of the curve.

    Args:
        arm: the numbers of the arm.
        circle: the numbers of the target.
        t: sine and cosine of t.
        elbow: 1 or -1: the sign of E, or where the circle is `inner` that of u.
        shoulder: 1 or -1: the sign of the reach along P2.
    """
    return _posture(arm, circle, *_on_circle(circle, t, elbow), shoulder)


def _on_circle(circle: Circle, t: tuple[Lane, Lane], elbow: Lane | float) -> tuple[Lanes, Lanes]:
    """Cosine and sine of the elbow angle, and of the angle on the circle."""
    sin_elbow, cos_elbow = _full_angle(circle.elbow, t)
    sin_u, cos_u = _full_angle(circle.position, t)
    forward = lanes.select(t[0] < 0.0, -1.0, 1.0)
    # The cosine of one of the two half angles vanishes in the middle of the curve and changes sign.
    inner = circle.inner > 0.5
    sin_elbow = sin_elbow * lanes.select(inner, forward, elbow)
    sin_u = sin_u * lanes.select(inner, elbow, forward)
    return (
        lanes.stored(np.array([cos_elbow, sin_elbow], dtype=object)),
        lanes.stored(np.array([cos_u, sin_u], dtype=object)),
    )


def _full_angle(half: HalfAngle, t: tuple[Lane, Lane]) -> tuple[Lane, Lane]:
    """|sin x| and cos x."""
    s2, c2 = t[0] * t[0], t[1] * t[1]
    square = half.low * s2 + half.high * c2
    rest = half.low_rest * s2 + half.high_rest * c2
    return 2.0 * lanes.sqrt(square * rest), rest - square


def spherical_posture(arm: Arm, circle: Circle, elbow: Lane, shoulder: Lane, root: Lane) -> Posture:
    """A posture of a spherical wrist that satisfies the condition; `root` is 1 or -1.

    The wrist point does not move with u, so that f is a sinusoid in u, solved in closed form;
    where it has no root, its extremum is returned.
    """
    half = circle.elbow
    bend = 2.0 * lanes.sqrt(half.low * half.low_rest)
    bent = np.array([half.low_rest - half.low, bend * elbow], dtype=object)
    at_zero = _posture(arm, circle, bent, lanes.lanes_of([1.0, 0.0]), shoulder)
    side, second = (_in_frame(arm, at_zero.turn, axis) for axis in circle.axes[:2])
    h0, h1, h2 = arm.hand
    x, y = at_zero.axis_4 @ side, at_zero.axis_4 @ second
    p, q = h1 * x + h2 * y, h1 * y - h2 * x
    constant = h0 * (at_zero.axis_4 @ at_zero.axis_6) - arm.wrist_angle
    return _with_circle(arm, circle, at_zero, _sinusoid_root(p, q, constant, root))


def crossing_posture(
    arm: Arm, circle: Circle, t: tuple[Lane, Lane], elbow: Lane, root: Lane
) -> Posture:
    """A posture with the wrist point on axis 1, at the root of f as a sinusoid in theta_1.

    Args:
        arm: the numbers of a planar arm.
        circle, t, elbow: as of `posture`, at a point of the curve where the wrist is on axis 1.
        root: 1 or -1: which of the two roots.
    """
    bent, u = _on_circle(circle, t, elbow)

    def at(cos: Lane | jax.Array, sin: Lane | jax.Array) -> Posture:
        turn = np.array([lanes.as_lane(cos), lanes.as_lane(sin)], dtype=object)
        return _posture(arm, circle, bent, u, root, turn)

    # f is affine in the cosine and sine of theta_1: three points of the plane determine it.
    dtype = bent[0].array.dtype
    cos, sin = (jnp.array(values, dtype)[:, None] for values in ([0, 1, 0], [0, 0, 1]))
    three = lanes.store(at(cos, sin).dot - arm.wrist_angle).array
    constant, along_x, along_y = (Lane(value) for value in three)
    turn = _sinusoid_root(along_x - constant, along_y - constant, constant, root)
    return at(*turn)


def _sinusoid_root(p: Lane, q: Lane, constant: Lane, sign: Lane | float) -> Lanes:
    """Cosine and sine of a root x of p cos x + q sin x + constant; of an extremum if none."""
    square = p * p + q * q
    some = square > _TINY
    per = lanes.select(some, 1.0 / lanes.select(some, square, 1.0), 0.0)
    rest = sign * lanes.sqrt(square - constant * constant)
    cos, sin = (-constant * p - rest * q) * per, (-constant * q + rest * p) * per
    length = lanes.norm(np.array([cos, sin], dtype=object))
    some = length > 0.1
    per = lanes.select(some, 1.0 / lanes.select(some, length, 1.0), 0.0)
    return np.array([lanes.select(some, cos * per, 1.0), sin * per], dtype=object)


def _posture(
    arm: Arm,
    circle: Circle,
    elbow: Lanes,
    u: Lanes,
    shoulder: Lane | float,
    turn: Lanes | None = None,
) -> Posture:
    d, (lean, upright) = arm.sideways, arm.lean
    wrist = circle.centre
    if not arm.is_spherical:
        wrist = wrist + (arm.radius * u[0]) * circle.axes[0] + (arm.radius * u[1]) * circle.axes[1]
        wrist = lanes.stored(wrist)
    x, y, z = wrist
    v = z if arm.is_planar else (z - d * lean) / upright
    w = d * upright - v * lean
    square = x * x + y * y
    inside = square - w * w
    h = shoulder * lanes.sqrt(inside)
    some = square > _TINY
    per = lanes.select(some, 1.0 / lanes.select(some, square, 1.0), 0.0)
    if turn is None:
        turn = lanes.stored(np.array([(x * w - y * h) * per, (y * w + x * h) * per], dtype=object))
    reach = np.array([v, h], dtype=object)
    a, b = arm.upper_arm, arm.forearm
    ahead, aside = a * elbow[0] + b, a * elbow[1]
    per = lanes.store(1.0 / lanes.maximum(v * v + h * h, _TINY))
    forearm = np.array([(ahead * v - aside * h) * per, (ahead * h + aside * v) * per], dtype=object)
    axis_6 = _in_frame(arm, turn, circle.axes[2])
    found = Posture(
        turn=turn,
        elbow=elbow,
        circle=u,
        reach=reach,
        forearm=forearm,
        axis_4=_on_forearm(arm.axis_4, forearm),
        axis_5=axis_6,
        axis_6=axis_6,
        from_axis_1=lanes.sqrt(square),
        out_of_plane=w,
        inside=inside,
    )
    return found if arm.is_spherical else _with_circle(arm, circle, found, u)


def _with_circle(arm: Arm, circle: Circle, found: Posture, u: Lanes) -> Posture:
    """The posture with axis 5 for the angle u on the circle."""
    h0, h1, h2 = arm.hand
    cos_u, sin_u = u
    side, second, axis_6 = circle.axes
    axis_5 = h0 * axis_6 + (h1 * cos_u - h2 * sin_u) * side + (h1 * sin_u + h2 * cos_u) * second
    return found._replace(circle=u, axis_5=lanes.stored(_in_frame(arm, found.turn, axis_5)))


def _in_frame(arm: Arm, turn: Lanes, vector: Lanes) -> Lanes:
    """A vector of the base frame along axis 2, P1 and P2."""
    (cos, sin), (lean, upright) = turn, arm.lean
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


def joint_angles(arm: Arm, circle: Circle, found: Posture) -> Lanes:
    """The six joint angles of a posture, each in [-pi, pi]."""
    theta_1 = lanes.atan2(found.turn[1], found.turn[0])
    upper = found.reach - arm.forearm * found.forearm
    cos, sin = arm.raised
    theta_2 = lanes.atan2(upper[1] * cos - upper[0] * sin, upper[0] * cos + upper[1] * sin)
    (cos_elbow, sin_elbow), (cos, sin) = found.elbow, arm.bent
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
    return lanes.store(ahead + 2.0 * bent + 4.0 * raised, by=theta_5).array.astype(jnp.int32)
