"""The closest approach of the circle of p about axis 2 and that of k about axis 1, in space.

It has no closed form: its equation is of degree eight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.subproblems.axes import Axis, angle_about, off_axis, rotate, wrap

_NODES = 32
_STEPS = 6


class _Profile(NamedTuple):
    """Half the squared distance of a turning point from a circle, but for a constant.

    The squared distance from the centre of the circle and the height above its plane are sinusoids
    a + b cos(t) + c sin(t).
    """

    square: Lanes
    height: Lanes
    radius: Lane

    def value(self, cos: Lane, sin: Lane) -> Lane:
        """f(t)."""
        wave = lanes.lanes_of([1.0, cos, sin])
        square, height = self.square @ wave, self.height @ wave
        return 0.5 * square - self.radius * lanes.sqrt(square - height * height)

    def rates(self, cos: Lane, sin: Lane) -> tuple[Lane, Lane]:
        """f'(t) and f''(t)."""
        wave, slope = lanes.lanes_of([1.0, cos, sin]), lanes.lanes_of([0.0, -sin, cos])
        square, height = self.square @ wave, self.height @ wave
        square_1, height_1 = self.square @ slope, self.height @ slope
        square_2, height_2 = self.square[0] - square, self.height[0] - height
        reach = lanes.sqrt(square - height * height)
        share = 1.0 / lanes.select(reach > 0.0, reach, 1.0)
        reach_1 = (0.5 * square_1 - height * height_1) * share
        reach_2 = 0.5 * square_2 - height_1 * height_1 - height * height_2 - reach_1 * reach_1
        return 0.5 * square_1 - self.radius * reach_1, (
            0.5 * square_2 - self.radius * reach_2 * share
        )


def closest_turns(first: Axis, second: Axis, p: Lanes, k: Lanes) -> tuple[Lane, Lane]:
    """The angles (t1, t2) that bring exp([S1] t1) exp([S2] t2) p as close to k as it can come.

    A point runs round the smaller of the two circles, and the nearest point of the other is known:
    that leaves a function of one angle, of which two valleys at most have been seen. They are
    found on a grid and followed to their floors. Not differentiable.
    """
    (u, _), (v, _) = off_axis(second, p), off_axis(first, k)
    swap = u @ u > v @ v
    up, around = (
        lanes.choose(swap, a.direction, b.direction) for a, b in ((second, first), (first, second))
    )
    radius, still = lanes.choose(swap, v, u), lanes.choose(swap, u, v)
    away = (p - u) - (k - v)
    away = lanes.choose(swap, -away, away)
    across = lanes.cross(around, radius)
    square = [away @ away + radius @ radius, 2.0 * (away @ radius), 2.0 * (away @ across)]
    numbers = [*square, up @ away, up @ radius, up @ across, lanes.norm(still)]
    arrays = jnp.broadcast_arrays(*(lanes.materialise(x).array for x in numbers))
    kept = lanes.lanes_of([Lane(x) for x in arrays])
    turn = Lane(_lowest(_Profile(kept[:3], kept[3:6], kept[6]), arrays[0]))
    t1, t2 = -turn, turn
    from_p = wrap(angle_about(first, rotate(second, t2, p), k))
    from_k = wrap(angle_about(second, p, rotate(first, -t1, k)))
    return lanes.select(swap, wrap(t1), from_p), lanes.select(swap, from_k, wrap(t2))


def _lowest(profile: _Profile, like: jax.Array) -> jax.Array:
    """Where a profile is lowest."""
    grid = np.linspace(-math.pi, math.pi, _NODES, endpoint=False)
    nodes = jnp.asarray(grid, like.dtype).reshape(_NODES, *[1] * like.ndim)
    f = profile.value(Lane(jnp.cos(nodes)), Lane(jnp.sin(nodes))).array
    valley = (f <= jnp.roll(f, 1, axis=0)) & (f <= jnp.roll(f, -1, axis=0))
    number = jnp.arange(_NODES).reshape(nodes.shape)
    best = jnp.argmin(f, axis=0)
    other = jnp.argmin(jnp.where(valley & (number != best), f, jnp.inf), axis=0)
    t = jnp.asarray(grid, like.dtype)[jnp.stack([best, other])]
    width = 2 * math.pi / _NODES

    def step(_: int, state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        t, low, high = state
        sin, cos = lanes.sincos(Lane(t))
        # Stored, so that all that is decided by them is decided by the same rounding.
        slope, bend = (lanes.materialise(rate).array for rate in profile.rates(cos, sin))
        low, high = jnp.where(slope > 0, low, t), jnp.where(slope > 0, t, high)
        newton = t - slope / jnp.where(bend > 0, bend, 1.0)
        inside = (bend > 0) & (newton >= low) & (newton <= high)
        return jnp.where(inside, newton, 0.5 * (low + high)), low, high

    t = lax.fori_loop(0, _STEPS, step, (t, t - width, t + width))[0]
    sin, cos = lanes.sincos(Lane(t))
    floor = profile.value(cos, sin).array
    return jnp.where(floor[1] < floor[0], t[1], t[0])


def constant(values: Lanes) -> Lanes:
    """The same without derivatives."""
    return lanes.map_lanes(lambda x: x if x.known else Lane(lax.stop_gradient(x.array)), values)


class Step(NamedTuple):
    """A step of Newton's method, from angles at which the two circles are a distance apart.

    The sine is squared, and that of the angle between the circles there.
    """

    angles: Lanes
    distance: Lane
    sine: Lane


def newton_step(first: Axis, second: Axis, p: Lanes, k: Lanes, angles: list[Lane]) -> Step:
    """Towards the least |x - y|, with x = exp([S2] t2) p and y = exp(-[S1] t1) k.

    At the closest approach it is 0 with the derivatives of the angles, by the implicit function
    theorem. Where it is not determined it is 0 without derivatives.
    """
    t1, t2 = angles
    x, y = rotate(second, t2, p), rotate(first, -t1, k)
    apart = lanes.materialised(x - y)
    along_1 = lanes.materialised(lanes.cross(first.direction, y - first.point))
    along_2 = lanes.materialised(lanes.cross(second.direction, x - second.point))
    slope_1, slope_2 = apart @ along_1, apart @ along_2
    square_1, square_2, mixed = along_1 @ along_1, along_2 @ along_2, along_1 @ along_2
    bend_1 = square_1 - apart @ lanes.cross(first.direction, along_1)
    bend_2 = square_2 + apart @ lanes.cross(second.direction, along_2)
    determinant = bend_1 * bend_2 - mixed * mixed
    determined = determinant > 0.0
    share = lanes.select(determined, 1.0 / lanes.select(determined, determinant, 1.0), 0.0)
    product = square_1 * square_2
    steps = [mixed * slope_2 - bend_2 * slope_1, mixed * slope_1 - bend_1 * slope_2]
    return Step(
        lanes.materialised(np.array(steps, dtype=object) * share),
        lanes.norm(apart),
        1.0 - mixed * mixed / lanes.select(product > 0.0, product, 1.0),
    )
