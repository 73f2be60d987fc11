"""Pardos-Gotor subproblems 6 to 8: two skew axes, three axes for a point, three for a pose.

Definitions: Pardos-Gotor, *Screw Theory in Robotics* (2022), chapter on canonical inverse
kinematics; the formulas here are derived from them.
"""

from __future__ import annotations

import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax.chain import compose
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import compiled
from niryo_jax.lie import se3
from niryo_jax.subproblems.axes import (
    Axis,
    angle_about,
    axis_of,
    motion_about,
    off_axis,
    rotate,
    scale_of,
    wrap,
)
from niryo_jax.subproblems.circles import (
    Crossing,
    choose_crossing,
    circle_and_plane,
    circles_in_a_plane,
    coplanar_circles,
)
from niryo_jax.subproblems.closest import closest_turns, constant, newton_step
from niryo_jax.subproblems.result import Solved, SubproblemSolutions, answer, solve
from niryo_jax.subproblems.turns import are_parallel, is_on, turns_through
from niryo_jax.tolerances import SUBPROBLEM_RESIDUAL, SUBPROBLEM_STEEP


@compiled
def pardos_gotor_6(
    screw_1: ArrayLike, screw_2: ArrayLike, p: ArrayLike, k: ArrayLike
) -> SubproblemSolutions:
    """Rotate a point to another about any two axes in turn: exp([S1] t1) exp([S2] t2) p = k.

    Args:
        screw_1, screw_2: (..., 6) rotation axes: skew, or of `paden_kahan_2` or `pardos_gotor_4`.
        p, k: (..., 3) points, metres.

    Returns:
        Two slots, two joints (t1, t2). Skew axes have at most one solution, in either slot; axes
        that meet or are parallel at most two. `TANGENT` where the circles touch, in the first slot;
        `INFINITE` as for `paden_kahan_2`. Where there is none, both slots hold the angles of the
        least distance that there is.

    Derivatives are those of the closest approach, by the implicit function theorem; they are right
    once, not twice, and 0 where the kind is `TANGENT` or `INFINITE`.

    Source: c = exp([S2] t2) p = exp(-[S1] t1) k is on the line w1 . c = w1 . k, w2 . c = w2 . p,
    and there on the circle of p and on that of k.
    """
    return solve(
        pardos_gotor_6_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
    )


@compiled
def pardos_gotor_7(
    screw_1: ArrayLike, screw_2: ArrayLike, screw_3: ArrayLike, p: ArrayLike, k: ArrayLike
) -> SubproblemSolutions:
    """Rotate a point to another about three axes: exp([S1] t1) exp([S2] t2) exp([S3] t3) p = k.

    Args:
        screw_1: (..., 6) rotation axis.
        screw_2, screw_3: (..., 6) rotation axes of equal or opposite directions.
        p, k: (..., 3) points, metres.

    Returns:
        Four slots, three joints (t1, t2, t3): the two choices of t1, and for each the two slots of
        `pardos_gotor_4`. `TANGENT` where two solutions coincide, in the earlier slot; `INFINITE`
        where k lies on axis 1 (t1 = 0), p on axis 3, axes 2 and 3 coincide, or all axes are
        parallel. Where there is no solution, t1 brings k as near as it can to the plane in which
        axes 2 and 3 move p, and they bring p as near as they can to that point.

    Source: c = exp([S2] t2) exp([S3] t3) p = exp(-[S1] t1) k is where the circle of k about axis 1
    crosses the plane w3 . c = w3 . p.
    """
    return solve(
        pardos_gotor_7_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("screw_3", screw_3, (6,)),
        ("p", p, (3,)),
        ("k", k, (3,)),
    )


@compiled
def pardos_gotor_8(
    screw_1: ArrayLike,
    screw_2: ArrayLike,
    screw_3: ArrayLike,
    pose_p: ArrayLike,
    pose_k: ArrayLike,
) -> SubproblemSolutions:
    """Move a pose to another about three parallel axes.

    exp([S1] t1) exp([S2] t2) exp([S3] t3) P = K.

    Args:
        screw_1, screw_2, screw_3: (..., 6) rotation axes of equal or opposite directions.
        pose_p, pose_k: (..., 4, 4) rigid motions P and K, metres.

    Returns:
        Two slots, three joints (t1, t2, t3). The residual is the square root of the sum of squares
        of the distance of the origins (metres) and of the misfit of the rotations (radians; the
        chord 2 sin(angle / 2)), and a slot is valid where each of the two is rounding. `TANGENT`
        and `INFINITE` as for `pardos_gotor_4` on a point of axis 3. Where there is no solution, the
        rotation is the nearest one about the axes, and t1 and t2 bring axis 3 as near as they can
        to its place.

    Source: K P^-1 carries a point of axis 3 to where exp([S1] t1) exp([S2] t2) does, which is
    `pardos_gotor_4`; it turns by t1 +- t2 +- t3 about w1, with the signs of w1 . w2 and w1 . w3.
    """
    return solve(
        pardos_gotor_8_lanes,
        ("screw_1", screw_1, (6,)),
        ("screw_2", screw_2, (6,)),
        ("screw_3", screw_3, (6,)),
        ("pose_p", pose_p, (4, 4)),
        ("pose_k", pose_k, (4, 4)),
    )


def pardos_gotor_6_lanes(screw_1: Lanes, screw_2: Lanes, p: Lanes, k: Lanes) -> Solved:
    """`pardos_gotor_6` on lanes."""
    problem = axis_of(screw_1), axis_of(screw_2), p, k
    # The angles are found without derivatives; those of the Newton step are added to them.
    given = [constant(x) for x in (screw_1, screw_2, p, k)]
    fixed = first, second, p, k = axis_of(given[0]), axis_of(given[1]), given[2], given[3]
    scale = scale_of(p, k, first.point, second.point)
    parallel = are_parallel(first, second, scale)
    of_k = circle_and_plane(first, k, second.direction, second.direction @ p, parallel)
    of_p = circle_and_plane(second, p, first.direction, first.direction @ k, parallel)
    # The circle that crosses the line at the greater angle tells where more accurately.
    skew = choose_crossing(of_k.overlap > of_p.overlap, of_k, of_p)
    crossing = choose_crossing(parallel, circles_in_a_plane(first, second, p, k), skew)
    turns = turns_through(first, second, p, k, crossing, parallel, scale)
    found = [missed <= scale.residual for missed in turns.residual]
    single = turns.tangent | turns.infinite
    missed = ~(found[0] | found[1] | parallel | turns.infinite)
    closest = closest_turns(*fixed)
    angles: list[list[Lane]] = []
    residual: list[Lane] = []
    for slot, exact in zip(turns.angles, found):
        # The line is badly known where the axes are nearly parallel; the answer need not be.
        step = newton_step(*fixed, slot)
        sure = exact & ~single & (step.sine > SUBPROBLEM_STEEP)
        slot = [t + lanes.select(sure, dt, 0.0) for t, dt in zip(slot, step.angles)]
        slot = [lanes.materialise(lanes.select(missed, new, t)) for new, t in zip(closest, slot)]
        step = newton_step(*problem, slot)
        rates = [lanes.select(single, 0.0, dt) for dt in step.angles - constant(step.angles)]
        angles.append([wrap(t + rate) for t, rate in zip(slot, rates)])
        residual.append(step.distance)
    near, far = (distance <= scale.residual for distance in residual)
    return answer(
        angles,
        [near, far & ~(single | missed)],
        residual,
        tangent=turns.tangent,
        infinite=turns.infinite,
    )


def pardos_gotor_7_lanes(
    screw_1: Lanes, screw_2: Lanes, screw_3: Lanes, p: Lanes, k: Lanes
) -> Solved:
    """`pardos_gotor_7` on lanes."""
    first, second, third = axis_of(screw_1), axis_of(screw_2), axis_of(screw_3)
    scale = scale_of(p, k, first.point, second.point, third.point)
    planar, parallel = are_parallel(first, third, scale), are_parallel(second, third, scale)
    k_on_axis = is_on(first, k, scale)
    level = third.direction @ p
    crossing = choose_crossing(
        planar,
        _within_reach(first, second, third, p, k),
        circle_and_plane(first, k, third.direction, level, planar),
    )
    touching = crossing.overlap <= scale.coincidence
    half = lanes.choose(touching, crossing.half * 0.0, crossing.half)
    angles, valid, residual = [], [], []
    tangent, infinite = np.False_, np.False_
    for branch, c in enumerate((crossing.middle - half, crossing.middle + half)):
        t1 = lanes.select(k_on_axis, 0.0, wrap(angle_about(first, c, k)))
        goal = rotate(first, -t1, k)
        turns = turns_through(
            second, third, p, goal, circles_in_a_plane(second, third, p, goal), parallel, scale
        )
        near, far = (missed <= scale.residual for missed in turns.residual)
        if branch == 1:
            near, far = near & ~(touching | k_on_axis), far & ~(touching | k_on_axis)
        tangent = tangent | (near & (turns.tangent | touching))
        infinite = infinite | (near & turns.infinite)
        valid += [near, far & ~(turns.tangent | turns.infinite)]
        angles += [[t1, *pair] for pair in turns.angles]
        residual += turns.residual
    return answer(angles, valid, residual, tangent=tangent, infinite=infinite | k_on_axis | planar)


def _within_reach(first: Axis, second: Axis, third: Axis, p: Lanes, k: Lanes) -> Crossing:
    """Where k, turned about axis 1, is as far from axis 2 as axes 2 and 3 can bring p.

    For three parallel axes: k stays where it is if it is within reach.
    """
    arm = lanes.norm(off_axis(third, p)[0])
    apart = lanes.norm(off_axis(second, third.point)[0])
    away, height = off_axis(second, k)
    distance = lanes.minimum(lanes.maximum(lanes.norm(away), abs(apart - arm)), apart + arm)
    around, _ = off_axis(first, k)
    return coplanar_circles(first, second, distance * distance, around @ around, height)


def pardos_gotor_8_lanes(
    screw_1: Lanes, screw_2: Lanes, screw_3: Lanes, pose_p: Lanes, pose_k: Lanes
) -> Solved:
    """`pardos_gotor_8` on lanes."""
    first, second, third = axis_of(screw_1), axis_of(screw_2), axis_of(screw_3)
    start, end = se3.split(pose_p), se3.split(pose_k)
    motion = compose(end, se3.inverse_lanes(*start))
    joint, goal = third.point, motion[0] @ third.point + motion[1]
    scale = scale_of(start[1], end[1], goal, first.point, second.point, third.point)
    parallel = are_parallel(first, second, scale)
    turns = turns_through(
        first, second, joint, goal, circles_in_a_plane(first, second, joint, goal), parallel, scale
    )
    w = first.direction
    trace = motion[0][0, 0] + motion[0][1, 1] + motion[0][2, 2]
    # 2 sin and 2 cos of the rotation about w that is nearest to that of the motion.
    total = lanes.atan2(2.0 * (w @ lanes.vee(motion[0])), trace - w @ motion[0] @ w)
    sign_2, sign_3 = (lanes.select(w @ axis.direction < 0.0, -1.0, 1.0) for axis in (second, third))
    rounding = SUBPROBLEM_RESIDUAL.of(scale.dtype)
    angles, valid, residual = [], [], []
    for t1, t2 in turns.angles:
        t3 = wrap(sign_3 * (total - t1 - sign_2 * t2))
        moved = motion_about(third, t3)
        for axis, angle in ((second, t2), (first, t1)):
            moved = compose(motion_about(axis, angle), moved)
        rotation, position = compose(moved, start)
        distance = lanes.norm(position - end[1])
        twist = lanes.norm((rotation - end[0]).ravel()) * (1.0 / np.sqrt(2.0))
        angles.append([t1, t2, t3])
        valid.append((distance <= scale.residual) & (twist <= rounding))
        residual.append(lanes.sqrt(distance * distance + twist * twist))
    valid[1] = valid[1] & ~(turns.tangent | turns.infinite)
    return answer(angles, valid, residual, tangent=turns.tangent, infinite=turns.infinite)
