"""Parallel axes, and the arms of few joints that are made of them, in closed form on lanes.

exp(S1 q1) P exp(Sn qn) = G, with P a motion of the plane across parallel axes. P never turns their
direction w and never moves a point along it, so q1 and qn are where

    R1^-1 R Rn^-1 w = w    and    w . exp(-S1 q1) G p = w . p  for any point p on axis n.
"""

from __future__ import annotations

from niryo_jax import lanes
from niryo_jax.chain import Motion, compose
from niryo_jax.ik.closed_form import joint_motion
from niryo_jax.ik.closed_form.joint_motion import (
    Move,
    Roots,
    Signs,
    Solution,
    away_from,
    line_of,
    turn_between,
)
from niryo_jax.ik.closed_form.position import circles
from niryo_jax.ik.closed_form.srs import across
from niryo_jax.ik.closed_form.trig_roots import sinusoid_root
from niryo_jax.ik.results.status import Singularity
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.structure.families import PlanarArm

_CURVATURE = 1e-4


def planar_arm(family: PlanarArm, screws: Lanes, motion: Motion, signs: Signs) -> Solution:
    """The joints of a planar arm on a turning base, for a motion that they nearly supply."""
    w, last = screws[1, :3], 1 + len(family.turns)
    rotation, _ = motion
    roots = list[tuple[Singularity, Roots]]()
    if family.roll:
        move_1, of_base = _base_turn(screws, motion, signs)
        roots.append((Singularity.MERGED, of_base))
    else:
        move_1 = turn_between(screws[0, :3], w, rotation @ w)
    move_1 = lanes.materialised(move_1)
    left = compose(motion_of(screws[0], joint_motion.back(move_1)), motion)
    behind = list[Move]()
    if family.roll:
        seen = rotation.T @ (joint_motion.rotation(screws[0], move_1) @ w)
        roll = lanes.materialised(turn_between(screws[last, :3], seen, w))
        left = compose(left, motion_of(screws[last], joint_motion.back(roll)))
        behind.append(roll)
    if len(family.turns) == 3:
        moves, elbow = planar(screws[1:last], family.turns, left, signs)
        roots.append((Singularity.ELBOW, elbow))
    else:
        moves = _two(screws[1:last], family.turns, left)
    return [move_1, *moves, *behind], roots


def _base_turn(screws: Lanes, motion: Motion, signs: Signs) -> tuple[Lanes, Roots]:
    """The turn about axis 1 by whichever of the two equations tells it better.

    The direction of the last axis tells nothing where it is parallel to axis 1 (the tool straight
    down), and the place of a point on it nothing where that point is on axis 1.
    """
    base, roll, w = line_of(screws[0]), line_of(screws[-1]), screws[1, :3]
    rotation, position = motion
    wrist = joint_motion.nearest_points(line_of(screws[-2]), roll)[1]
    links = away_from(line_of(screws[1]), line_of(screws[-2]).point)
    size = lanes.norm(links) + lanes.norm(away_from(line_of(screws[1]), wrist))
    aims = []
    for seen, fixed, scale in (
        (rotation @ roll.direction, roll.direction, Lane(1.0)),
        (rotation @ wrist + position - base.point, wrist - base.point, size),
    ):
        per = 1.0 / scale
        along = (base.direction @ seen) * base.direction
        x = seen - along
        y = lanes.cross(base.direction, x)
        gap = along - fixed
        far = (lanes.norm(x) + lanes.norm(gap)) * per
        aim = lanes.lanes_of([w @ x * per, -(w @ y) * per, w @ gap * per, far])
        aims.append(lanes.materialised(aim))
    by_direction, by_place = aims
    steeper = _steepness(by_place) > _steepness(by_direction)
    p, q, constant, scale = lanes.materialised(lanes.choose(steeper, by_place, by_direction))
    return sinusoid_root(p, q, constant, signs(), lanes.maximum(scale, 1.0))


def _steepness(aim: Lanes) -> Lane:
    """The square of the slope of a sinusoid where it is zero; even a double root, where it has
    none, tells a turn better than a sinusoid that vanishes."""
    p, q, constant, _ = aim
    square = p * p + q * q
    return lanes.maximum(square - constant * constant, 0.0) + _CURVATURE * square


def planar(
    screws: Lanes, turns: tuple[int, ...], motion: Motion, signs: Signs
) -> tuple[list[Move], Roots]:
    """Three parallel axes that supply a motion of the plane across them (Pardos-Gotor 8)."""
    rotation, position = lanes.materialised(motion[0]), lanes.materialised(motion[1])
    point = line_of(screws[2]).point
    goal = lanes.materialised(rotation @ point + position)
    first, second, roots = circles(screws[0], screws[1], point, goal, True, signs)
    before = joint_motion.after(first, _same(second, turns[1]))
    third = _rest(screws[0, :3], before, rotation, turns[2])
    return [first, second, third], roots


def _two(screws: Lanes, turns: tuple[int, ...], motion: Motion) -> list[Move]:
    """Two parallel axes that supply a motion of the plane across them."""
    rotation, position = lanes.materialised(motion[0]), lanes.materialised(motion[1])
    first_axis, point = line_of(screws[0]), line_of(screws[1]).point
    goal = rotation @ point + position
    start, end = away_from(first_axis, point), away_from(first_axis, goal)
    first = lanes.materialised(turn_between(first_axis.direction, start, end))
    return [first, _rest(screws[0, :3], first, rotation, turns[1])]


def _rest(w: Lanes, before: Lanes, rotation: Lanes, sign: int) -> Lanes:
    """The turn of a last parallel axis, behind others that turn about w by `before`."""
    side = lanes.materialised(across(w))
    whole = turn_between(w, side, rotation @ side)
    return _same(joint_motion.after(whole, joint_motion.turn_back(before)), sign)


def _same(turn: Lanes, sign: int) -> Lanes:
    """A turn about an axis, as one about an axis that points the same way or the other."""
    return turn if sign > 0 else joint_motion.turn_back(turn)


def motion_of(screw: Lanes, move: Move) -> Motion:
    """exp([S] q)."""
    if isinstance(move, Lane):
        return lanes.identity(3), screw[3:] * move
    rotation = joint_motion.rotation(screw, move)
    centre = line_of(screw).point
    return rotation, centre - rotation @ centre
