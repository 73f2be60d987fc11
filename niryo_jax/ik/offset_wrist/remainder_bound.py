"""How far the condition of an offset-wrist arm can be from a sinusoid: what makes a scan a proof.

With u the angle on the wrist's circle, f'' + u'^2 f is small: the condition would be a sinusoid in
u if the wrist point stood still. Over an interval of width h on which |f'' + u'^2 f| <= m, with
u' h <= 0.45, f has no root if both ends have one sign and are farther from zero than 0.14 m h^2;
and it has just the roots that the signs of its ends tell if they differ by more than 0.62 m h^2.
The bound m follows from the rates at which the arm's plane and its forearm can turn while the
wrist point moves along its circle: docs/theory/complete-ik.md, section "Proof".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from niryo_jax import lanes
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.posture import Posture
from niryo_jax.ik.offset_wrist.wrist_circle import HalfAngle, WristCircle
from niryo_jax.lanes import Lane
from niryo_jax.tolerances import AXIS_1_ROUNDING, CONDITION_ROUNDING, ELBOW_ROUNDING

# Its power 1.5 must not underflow in float32.
_TINY = 1e-20


class Bound(NamedTuple):
    """What is known of the condition next to a point of the curve.

    Attributes:
        remainder: m with |f'' + u'^2 f| <= m; infinite where none is known.
        lever: the least distance of the wrist from where theta_1 would not move it, metres; 0 where
            none is known.
    """

    remainder: Lane
    lever: Lane


def _rates(half: HalfAngle, sin_square: Lane, cos_square: Lane) -> tuple[Lane, Lane]:
    """Bounds of |dx/dt| and |d2x/dt2| where sin^2 t and cos^2 t are at least what is given.

    With s = sin t, c = cos t and sin^2(x/2) = l s^2 + h c^2,
    x' = -4 (h - l) s c / sin x and x'' = -2 (h - l) (h (1-h) c^4 - l (1-l) s^4) / (sin x / 2)^3.
    """
    low, high, low_rest, high_rest = half
    spread = high - low
    high_root = 1.0 / lanes.sqrt(lanes.maximum(high, _TINY))
    rest_root = 1.0 / lanes.sqrt(lanes.maximum(low_rest, _TINY))
    near_middle = lanes.maximum(high_rest + spread * sin_square, _TINY)
    near_end = lanes.maximum(low + spread * cos_square, _TINY)
    middle = high_rest * high_root / (near_middle * lanes.sqrt(near_middle))
    end = low * rest_root / (near_end * lanes.sqrt(near_end))
    return 2.0 * spread * high_root * rest_root, 2.0 * spread * (middle + end)


def remainder_bound(
    arm: OffsetWristParameters,
    circle: WristCircle,
    found: Posture,
    t: tuple[Lane, Lane],
    reach: Lane | float,
) -> Bound:
    """What is known of the condition on the curve within `reach` of t.

    Args:
        found: the posture at t.
        t: sine and cosine of t.
        reach: how far from t the bound must hold, radians.
    """
    sin_square, cos_square = (_square(lanes.maximum(abs(x) - reach, 0.0)) for x in t)
    e1, e2 = _rates(circle.elbow, sin_square, cos_square)
    u1, u2 = _rates(circle.position, sin_square, cos_square)
    r, a, b = arm.radius, arm.upper_arm, arm.forearm
    step = r * u1 * reach
    near = found.from_axis_1 - step
    v, h = found.reach
    distance = lanes.sqrt(v * v + h * h)
    if arm.is_planar:
        least = lanes.maximum(distance - step, abs(a - b))
        known = near > 0.0
        lever = near
        near = lanes.select(known, near, 1.0)
        plane_1 = r / near
        plane_2 = plane_1 + plane_1 * plane_1
        reach_1, reach_2 = r, r + r * plane_1
    else:
        whole = lanes.sqrt(distance * distance + arm.sideways * arm.sideways)
        left = distance * distance - 2.0 * (whole + step) * step
        least = lanes.maximum(lanes.sqrt(left), abs(a - b))
        far = found.from_axis_1 + step
        slope = abs(arm.shoulder_angle[0]) / arm.shoulder_angle[1]
        w1 = r * slope
        w = abs(found.out_of_plane) + w1 * step / lanes.maximum(r, _TINY)
        inside = near * near - w * w
        known = (near > 0.0) & (inside > 0.0)
        near = lanes.select(known, near, 1.0)
        h = lever = lanes.sqrt(lanes.select(known, inside, 1.0))
        h1 = (far * r + w * w1) / h
        h2 = (r * r + far * r + w1 * w1 + w * w1 + h1 * h1) / h
        per = r / near
        lag_1 = (w * h1 + far * w1) / (near * near)
        plane_1 = per + lag_1
        plane_2 = (
            per + 2.0 * per * per + (w * h2 + far * w1 + 2.0 * h1 * w1) / (near * near)
        ) + 2.0 * lag_1 * (per + h1 / near)
        v1 = r / arm.shoulder_angle[1]
        reach_1, reach_2 = lanes.sqrt(h1 * h1 + v1 * v1), lanes.sqrt(h2 * h2 + v1 * v1)
    least = lanes.maximum(least, _TINY)
    tilt_1 = reach_1 / least
    tilt_2 = reach_2 / least + tilt_1 * tilt_1
    # The angle of the forearm to the line from shoulder to wrist, as a function of E.
    unequal = abs(a * a - b * b) / (least * least)
    bend_1 = 0.5 * (1.0 + unequal)
    sin_elbow = lanes.minimum(abs(found.elbow[1]) + e1 * reach, 1.0)
    bend_2 = unequal * a * b * sin_elbow / (least * least)
    turn_1, turn_2 = plane_1 * u1, plane_2 * u1 * u1 + plane_1 * u2
    pitch_1 = tilt_1 * u1 + bend_1 * e1
    pitch_2 = tilt_2 * u1 * u1 + tilt_1 * u2 + bend_2 * e1 * e1 + bend_1 * e2
    rate = turn_1 + pitch_1
    rate_2 = turn_2 + pitch_2 + turn_1 * pitch_1
    spread = lanes.sqrt(1.0 - arm.hand[0] * arm.hand[0])
    along = found.axis_4 @ found.axis_6
    across = lanes.minimum(lanes.sqrt(1.0 - along * along) + rate * reach, 1.0)
    level = abs(arm.hand[0] * along - arm.wrist_angle) + abs(arm.hand[0]) * rate * reach
    bound = rate_2 + rate * rate + 2.0 * rate * spread * u1 + spread * across * u2 + level * u1 * u1
    return Bound(lanes.select(known, bound, math.inf), lanes.select(known, lever, 0.0))


def _square(x: Lane) -> Lane:
    return x * x


class Rounding(NamedTuple):
    """How far f can be from that of a pose within rounding of the one that is given.

    Attributes:
        turn: without what the elbow adds.
        whole: with it. That is the same for all of an interval, and makes no root of its own.
    """

    turn: jax.Array
    whole: jax.Array


def pose_rounding(
    arm: OffsetWristParameters, sin_elbow: Lane, lever: Lane, given: DTypeLike
) -> tuple[Lane, Lane]:
    """The entries of a `Rounding`.

    The target fixes sin^2(E/2), so that its rounding moves E by more the nearer sin E is to zero;
    and theta_1 by more the nearer the wrist is to axis 1.

    Args:
        arm: the numbers of the arm.
        sin_elbow: the least |sin E| of what is asked about.
        lever: the least of the wrist's distances from where theta_1 would not move it, metres; 0
            where none is known, and nothing else of f either.
        given: the dtype in which the pose is given.
    """
    dtype = sin_elbow.array.dtype
    share = (AXIS_1_ROUNDING.of(dtype) + arm.moved) * (arm.upper_arm + arm.forearm)
    known = lever > 0.0
    turn = lanes.select(known, share / lanes.select(known, lever, 1.0), 0.0)
    turn = CONDITION_ROUNDING.of(dtype) + arm.moved + turn
    elbow = ELBOW_ROUNDING.of(given)
    least = float(jnp.finfo(given).eps) ** 0.5
    if not arm.off.is_known(0.0):
        least = lanes.sqrt(float(jnp.finfo(given).eps) + arm.moved)
        return turn, turn + (elbow + arm.moved) / lanes.maximum(sin_elbow, least)
    if elbow / least < CONDITION_ROUNDING.of(dtype):
        # In a coarser dtype than that of the pose it is hardly more wherever the elbow is.
        return turn, turn + elbow / least
    return turn, turn + elbow / lanes.maximum(sin_elbow, least)


def proves(
    remainder: jax.Array,
    width: jax.Array | float,
    f_low: jax.Array,
    f_high: jax.Array,
    rounding: Rounding,
) -> tuple[jax.Array, jax.Array]:
    """What the bound proves of intervals no wider than 0.22.

    Args:
        remainder: m of `remainder_bound`, for the whole interval.
        width: of the interval.
        f_low, f_high: the condition at its ends.
        rounding: what separates f from zero must be more than this.

    Returns:
        Whether it is proved that the interval holds one root if its ends differ in sign and none
        otherwise; and how far the condition can be from its chord.
    """
    sag = remainder * (width * width)
    change = (f_low > 0) != (f_high > 0)
    # What moves f as a whole moves its root, and does not make another.
    monotone = jnp.abs(f_high - f_low) > 0.62 * sag + rounding.turn
    least = jnp.minimum(jnp.abs(f_low), jnp.abs(f_high))
    return monotone | (~change & (least > 0.14 * sag + rounding.whole)), sag
