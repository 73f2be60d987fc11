"""The circle that a target leaves the wrist point of an offset-wrist arm, on lanes.

Letters and derivations: docs/theory/complete-ik.md.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from niryo_jax import lanes
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.results.status import UnreachableReason
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3
from niryo_jax.tolerances import REACH_ROUNDING

_TINY = 1e-30


class HalfAngle(NamedTuple):
    """An angle x on the curve: sin^2(x/2) = low sin^2 t + high cos^2 t.

    Attributes:
        low, high: see above.
        low_rest, high_rest: 1 - low and 1 - high, without cancellation.
    """

    low: Lane
    high: Lane
    low_rest: Lane
    high_rest: Lane


class WristCircle(NamedTuple):
    """What a target leaves the wrist point.

    Attributes:
        centre: (3,) centre of the circle, base frame.
        axes: (3, 3) rows: the direction from the shoulder to the centre at right angles to axis 6,
            axis 6 x that, axis 6. The wrist is at centre + r (cos u axes[0] + sin u axes[1]).
        start: cosine and sine of u at theta_6 = 0; u decreases as theta_6 grows.
        elbow: the elbow angle E (0: stretched) as a function of t.
        position: the angle u as a function of t.
        inner: 1 where the whole arm cannot fold as far as the near side of the circle asks.
        excess: by how much the nearest point of the circle is out of the arm's reach, in units of
            4 a b: positive where it is too far.
        shortfall: the same for the farthest point, positive where it is too near.
    """

    centre: Lanes
    axes: Lanes
    start: Lanes
    elbow: HalfAngle
    position: HalfAngle
    inner: Lane
    excess: Lane
    shortfall: Lane

    def astype(self, dtype: DTypeLike) -> WristCircle:
        """The same numbers in a dtype."""
        return lanes.astype(self, dtype)


def wrist_circle(arm: OffsetWristParameters, target: Lanes) -> WristCircle:
    """The circle of a target pose, (4, 4) lanes."""
    rotation, position = se3.split(target)
    rotation = lanes.materialised(arm.base @ rotation)
    centre = lanes.materialised(rotation @ arm.centre + arm.base @ (position - arm.shoulder))
    spoke, axis = (
        lanes.materialised(rotation @ arm.spoke),
        lanes.materialised(rotation @ arm.axis_6),
    )
    a, b, r, d = arm.upper_arm, arm.forearm, arm.radius, arm.sideways
    along = lanes.materialise(centre @ axis)
    level = lanes.materialised(centre - along * axis)
    # Next to axis 6 little is left but rounding, along the axis too, which this takes away.
    level = level - (level @ axis) * axis
    height = lanes.materialise(lanes.norm(level))
    aside = height > _TINY
    side = lanes.choose(aside, level / lanes.select(aside, height, 1.0), spoke)
    side = lanes.materialised(side)
    start = np.array([spoke @ side, spoke @ lanes.cross(axis, side)], dtype=object)
    second = lanes.materialised(lanes.cross(axis, side))
    square = lanes.materialise(centre @ centre)
    # sin^2(E/2) = e + m sin^2(u/2), since the law of cosines is linear in cos E and in cos u.
    scale = 4.0 * a * b
    m = lanes.materialise(4.0 * r * height / scale)
    e = lanes.materialise(((a + b) * (a + b) + d * d - square - r * (r + 2.0 * height)) / scale)
    top = lanes.materialise(e + m)
    e_rest = lanes.materialise(
        (square + r * (r + 2.0 * height) - d * d - (a - b) * (a - b)) / scale
    )
    top_rest = lanes.materialise(e_rest - m)
    cut_far, cut_near = e <= 0.0, top_rest <= 0.0
    elbow = HalfAngle(
        lanes.select(cut_far, 0.0, e),
        lanes.select(cut_near, 1.0, top),
        lanes.select(cut_far, 1.0, e_rest),
        lanes.select(cut_near, 0.0, top_rest),
    )
    whole = m > _TINY
    per = lanes.select(whole, 1.0 / lanes.select(whole, m, 1.0), 0.0)
    position_of = HalfAngle(
        lanes.select(cut_far, -e * per, 0.0),
        lanes.select(cut_near, e_rest * per, 1.0),
        lanes.select(cut_far, top * per, 1.0),
        lanes.select(cut_near, -top_rest * per, 0.0),
    )
    return WristCircle(
        centre,
        np.stack([side, second, axis]),
        start,
        HalfAngle(*(lanes.materialise(x) for x in elbow)),
        HalfAngle(*(lanes.materialise(x) for x in position_of)),
        lanes.select(cut_near, 1.0, 0.0),
        -top,
        -e_rest,
    )


def reason_out_of_reach(
    arm: OffsetWristParameters, circle: WristCircle, batch: int, dtype: np.dtype
) -> jax.Array:
    """(batch,) an `UnreachableReason`: whether every point of the circle is too far or too near."""
    rounding = REACH_ROUNDING.of(dtype) + arm.moved
    far = jnp.broadcast_to(circle.excess > rounding, (batch,))
    near = jnp.broadcast_to(circle.shortfall > rounding, (batch,))
    codes = [jnp.int32(UnreachableReason.TOO_FAR), jnp.int32(UnreachableReason.TOO_NEAR)]
    return jnp.select([far, near], codes, jnp.int32(UnreachableReason.NONE))


def may_just_reach(arm: OffsetWristParameters, circle: WristCircle) -> jax.Array:
    """(batch,) whether an arm that is off may reach what is just within or out of the reach of the
    arm that it is taken for: a part of the circle so small tells nothing."""
    if arm.off.is_known(0.0):
        return jnp.bool_(False)
    edge = lanes.maximum(circle.excess, circle.shortfall)
    return jnp.asarray(edge > -1.0 * arm.moved)
