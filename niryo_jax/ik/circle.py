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
from niryo_jax.ik.arm import Arm, as_type
from niryo_jax.ik.solutions import Obstacle
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


class Circle(NamedTuple):
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

    def astype(self, dtype: DTypeLike) -> Circle:
        """The same numbers in a dtype."""
        return _circle_from(as_type(circle_columns(self), dtype))


def wrist_circle(arm: Arm, target: Lanes) -> Circle:
    """The circle of a target pose, (4, 4) lanes."""
    rotation, position = se3.split(target)
    rotation = lanes.stored(arm.base @ rotation)
    centre = lanes.stored(rotation @ arm.centre + arm.base @ (position - arm.shoulder))
    spoke, axis = lanes.stored(rotation @ arm.spoke), lanes.stored(rotation @ arm.axis_6)
    a, b, r, d = arm.upper_arm, arm.forearm, arm.radius, arm.sideways
    if arm.is_spherical:
        side, start, height = spoke, lanes.lanes_of([1.0, 0.0]), Lane(0.0)
    else:
        along = lanes.store(centre @ axis)
        level = centre - along * axis
        height = lanes.store(lanes.norm(level))
        aside = height > _TINY
        side = lanes.choose(aside, level / lanes.select(aside, height, 1.0), spoke)
        side = lanes.stored(side)
        start = np.array([spoke @ side, spoke @ lanes.cross(axis, side)], dtype=object)
    second = lanes.stored(lanes.cross(axis, side))
    square = lanes.store(centre @ centre)
    # sin^2(E/2) = e + m sin^2(u/2), since the law of cosines is linear in cos E and in cos u.
    scale = 4.0 * a * b
    m = lanes.store(4.0 * r * height / scale)
    e = lanes.store(((a + b) * (a + b) + d * d - square - r * (r + 2.0 * height)) / scale)
    top = lanes.store(e + m)
    e_rest = lanes.store((square + r * (r + 2.0 * height) - d * d - (a - b) * (a - b)) / scale)
    top_rest = lanes.store(e_rest - m)
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
    return Circle(
        centre,
        np.stack([side, second, axis]),
        start,
        HalfAngle(*(lanes.store(x) for x in elbow)),
        HalfAngle(*(lanes.store(x) for x in position_of)),
        lanes.select(cut_near, 1.0, 0.0),
        -top,
        -e_rest,
    )


def circle_columns(circle: Circle) -> Lanes:
    """The numbers of a circle in one vector of lanes."""
    return lanes.lanes_of(
        [
            *circle.centre,
            *circle.axes.ravel(),
            *circle.start,
            *circle.elbow,
            *circle.position,
            circle.inner,
            circle.excess,
            circle.shortfall,
        ]
    )


def read_circle(rows: jax.Array) -> Circle:
    """The circles of rows (..., c) of columns, each number contiguous in memory."""
    return _circle_from(lanes.columns(rows))


def _circle_from(columns: Lanes) -> Circle:
    return Circle(
        columns[:3],
        columns[3:12].reshape(3, 3),
        columns[12:14],
        HalfAngle(*columns[14:18]),
        HalfAngle(*columns[18:22]),
        *columns[22:25],
    )


def obstacle(circle: Circle, batch: int, dtype: np.dtype) -> jax.Array:
    """(batch,) an `Obstacle`: whether every point of the circle is too far or too near."""
    rounding = REACH_ROUNDING.of(dtype)
    far = jnp.broadcast_to(circle.excess > rounding, (batch,))
    near = jnp.broadcast_to(circle.shortfall > rounding, (batch,))
    codes = [jnp.int32(Obstacle.TOO_FAR), jnp.int32(Obstacle.TOO_NEAR)]
    return jnp.select([far, near], codes, jnp.int32(Obstacle.NONE))
