"""Two rotations in turn, exp([S1] t1) exp([S2] t2) p = k, through a point between.

The first rotation to act carries p along its circle about axis 2 to a point c, the second carries c
along the circle of k about axis 1 to k: the answers are where the two circles cross.
"""

from __future__ import annotations

from typing import NamedTuple

from niryo_jax import lanes
from niryo_jax.lanes import Condition, Lane, Lanes
from niryo_jax.subproblems.axes import Axis, Scale, angle_about, off_axis, rotate, wrap
from niryo_jax.subproblems.circles import Crossing
from niryo_jax.subproblems.result import Solved, answer
from niryo_jax.tolerances import SUBPROBLEM_PARALLEL


def are_parallel(first: Axis, second: Axis, scale: Scale) -> Condition:
    """Whether two axes have the same or the opposite direction."""
    normal = lanes.cross(first.direction, second.direction)
    sine = SUBPROBLEM_PARALLEL.of(scale.dtype)
    return normal @ normal <= sine * sine


def is_on(axis: Axis, point: Lanes, scale: Scale) -> Condition:
    """Whether a point is on an axis."""
    return lanes.norm(off_axis(axis, point)[0]) <= scale.coincidence


class Turns(NamedTuple):
    """Two answers (t1, t2), by how much each misses, and what is special about them."""

    angles: list[list[Lane]]
    residual: list[Lane]
    tangent: Condition
    infinite: Condition


def turns_through(
    first: Axis,
    second: Axis,
    p: Lanes,
    k: Lanes,
    crossing: Crossing,
    parallel: Condition,
    scale: Scale,
) -> Turns:
    """The angles that carry p to k by way of each point of a crossing.

    Where an angle is free it is 0; for axes that coincide t2 is 0.
    """
    coincident = parallel & is_on(first, second.point, scale)
    p_on_axis, k_on_axis = is_on(second, p, scale), is_on(first, k, scale)
    # Stored, because each of the four results would compute the whole chain again.
    tangent = lanes.materialise(crossing.overlap) <= scale.coincidence
    middle = lanes.materialised(crossing.middle)
    half = lanes.materialised(lanes.choose(tangent, crossing.half * 0.0, crossing.half))
    angles: list[list[Lane]] = []
    residual: list[Lane] = []
    for c in (middle - half, middle + half):
        # Where p or k does not move under its own rotation, the point between is known exactly.
        c = lanes.choose(coincident | p_on_axis, p, lanes.choose(k_on_axis, k, c))
        c = lanes.materialised(c)
        t2 = lanes.select(coincident | p_on_axis, 0.0, wrap(angle_about(second, p, c)))
        t1 = lanes.select(k_on_axis & ~coincident, 0.0, wrap(angle_about(first, c, k)))
        t1, t2 = lanes.materialise(t1), lanes.materialise(t2)
        missed = lanes.norm(rotate(first, t1, rotate(second, t2, p)) - k)
        angles.append([t1, t2])
        residual.append(lanes.materialise(missed))
    return Turns(angles, residual, tangent, coincident | p_on_axis | k_on_axis)


def listed(turns: Turns, scale: Scale) -> Solved:
    """The answer in two slots, of which the first holds what is found once only."""
    single = turns.tangent | turns.infinite
    near, far = (missed <= scale.residual for missed in turns.residual)
    return answer(
        turns.angles,
        [near, far & ~single],
        turns.residual,
        tangent=turns.tangent,
        infinite=turns.infinite,
    )
