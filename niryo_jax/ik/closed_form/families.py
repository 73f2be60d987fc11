"""Closed forms of the families of arms (`niryo_jax.structure.families`), on lanes.

Each family is solved by one-joint equations in turn, each with two roots at most, so that all its
solutions are told apart by signs. The motion to supply is T M^-1 = exp(S1 q1) ... exp(Sn qn).
"""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

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
from niryo_jax.ik.closed_form.planar import motion_of, planar, planar_arm
from niryo_jax.ik.closed_form.position import combination, on_surface, place
from niryo_jax.ik.closed_form.srs import frame, srs_points
from niryo_jax.ik.closed_form.trig_roots import sinusoid_root
from niryo_jax.ik.results.candidates import Candidates, in_slots
from niryo_jax.ik.results.deduplicate import different
from niryo_jax.ik.results.status import Singularity
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3
from niryo_jax.specialise import Geometry
from niryo_jax.structure.families import (
    Family,
    PlanarArm,
    Schoenflies,
    SphericalShoulderAndWrist,
    SphericalWrist,
    ThreeParallel,
    TwoTurnsTwoSlides,
)
from niryo_jax.tolerances import AXES_OFF, IK_POLISH


def candidates(
    family: Family,
    geometry: Geometry,
    target: Lanes,
    angle: Lane | None,
    off: Lane,
    batch: int,
    dtype: np.dtype,
) -> Candidates:
    """The joint vectors of a batch of poses, (4, 4) lanes, that can be solutions.

    `angle` is the arm angle of the family that is given one, and `off` by how much the arm is not
    of the family.
    """
    motion = compose(se3.split(target), se3.inverse_lanes(*se3.split(geometry.home)))
    motion = lanes.materialised(motion[0]), lanes.materialised(motion[1])
    screws, reverse = geometry.screws, getattr(family, "reverse", False)
    if reverse:
        screws, motion = screws[::-1], se3.inverse_lanes(*motion)
    axes = itertools.count(1)

    def signs() -> Lane:
        return Lane(jnp.array([1.0, -1.0], dtype).reshape(2, *[1] * next(axes)))

    if isinstance(family, SphericalShoulderAndWrist):
        assert angle is not None
        found, roots = _spherical_shoulder_and_wrist(screws, motion, angle, signs)
    else:
        found, roots = _SOLVERS[type(family)](family, screws, motion, signs)
    if reverse:
        found = [joint_motion.back(move) for move in reversed(found)]
    q = lanes.materialised(lanes.lanes_of([joint_motion.joint_value(move) for move in found]))
    slots = 2**family.signs
    # Where a pose has fewer freedoms than it has coordinates, only forward kinematics tells.
    every = geometry.joints < 6
    exists, singular = jnp.bool_(True), jnp.int32(Singularity.NONE)
    merging = jnp.bool_(False)
    moved = AXES_OFF * off
    for i, (name, of_equation) in enumerate(roots):
        # A double root of one equation is off by the square root of rounding, which makes it look
        # to another equation as if that had no root.
        others = [other.loose for j, (_, other) in enumerate(roots) if j != i]
        loose = functools.reduce(operator.or_, others, np.bool_(False))
        exist = of_equation.exist
        if not off.is_known(0.0):
            # Of the arm as it is, two roots that all but merge may be apart, or none.
            merging = merging | (abs(of_equation.margin) <= moved)
            exist = exist | (of_equation.margin >= -moved)
        exists = exists & (every | exist | (of_equation.near & loose))
        named = name in (Singularity.WRIST, Singularity.SHOULDER)
        endless = name if named else Singularity.SELF_MOTION
        double = Singularity.MERGED if name is Singularity.SHOULDER else name
        singular = jnp.where(of_equation.double, jnp.int32(double), singular)
        singular = jnp.where(of_equation.free, jnp.int32(endless), singular)
    periodic = tuple(isinstance(move, np.ndarray) for move in found)
    shape = (2,) * family.signs + (batch,)
    exists = different(exists, q, periodic, shape, dtype)
    exists = lanes.kept_truth(exists, dtype)
    merging = jnp.broadcast_to(merging, shape).reshape(slots, batch)
    proved = ~jnp.any(merging, axis=0)
    exists, singular = (in_slots(x, (slots, batch)) for x in (exists, singular))
    label = jnp.broadcast_to(jnp.arange(slots, dtype=jnp.int32)[:, None], (slots, batch))
    return Candidates(q, exists, label, singular, proved)


def _spherical_wrist(
    family: SphericalWrist, screws: Lanes, motion: Motion, signs: Signs
) -> Solution:
    centre = joint_motion.meeting_point(screws[3], screws[4])
    rotation, position = motion
    goal = lanes.materialised(rotation @ centre + position)
    arm, roots = place(family.shoulder, screws[:3], centre, goal, signs)
    left = rotation
    for screw, move in zip(screws, arm):
        left = joint_motion.rotation(screw, joint_motion.back(move)) @ left
    wrist, last = _orient(screws[3:], lanes.materialised(left), signs)
    # Two roots of the others are a stretched arm; of the joint solved first, the wrist on axis 1.
    how = family.shoulder
    on_axis_1 = not (family.reverse or how.reverse or how.surface == "general")
    bends = how.kinds[1:] == ("revolute", "revolute")
    names = [
        Singularity.SHOULDER if on_axis_1 else Singularity.MERGED,
        Singularity.ELBOW if bends else Singularity.MERGED,
    ]
    return [*arm, *wrist], [*zip(names, roots), (Singularity.WRIST, last)]


def _orient(screws: Lanes, rotation: Lanes, signs: Signs) -> tuple[list[Move], Roots]:
    """exp([w1] t1) exp([w2] t2) exp([w3] t3) = R, for axes of which 1, 2 and 2, 3 are not parallel.

    t2 brings w3 to the angle with w1 that R w3 has, t1 turns it there, and t3 is what is left
    (Paden-Kahan 2 and 1).
    """
    w1, w2, w3 = (screw[:3] for screw in screws)
    goal = rotation @ w3
    foot = (w2 @ w3) * w2
    x = w3 - foot
    y = lanes.cross(w2, x)
    # The squared volume that the axes span, of which |w1 x goal|^2 = 1 - (w1 . goal)^2 is a part.
    side, a, d = lanes.cross(w1, goal), w1 @ w2, w2 @ w3
    inside = side @ side - a * a - d * d + 2.0 * a * d * (w1 @ goal)
    gap = w1 @ (foot - goal)
    middle, roots = sinusoid_root(w1 @ x, w1 @ y, gap, signs(), Lane(1.0), inside)
    middle = lanes.materialised(middle)
    first = lanes.materialised(turn_between(w1, foot + middle[0] * x + middle[1] * y, goal))
    # Any direction across axis 3 tells the last turn; the part of w2 there is never zero.
    across = w2 - (w2 @ w3) * w3
    seen = joint_motion.turned(w1, joint_motion.turn_back(first), rotation @ across)
    seen = joint_motion.turned(w2, joint_motion.turn_back(middle), seen)
    return [first, middle, turn_between(w3, across, seen)], roots


def _spherical_shoulder_and_wrist(
    screws: Lanes, motion: Motion, angle: Lane, signs: Signs
) -> Solution:
    """Joint 4 sets the distance from shoulder to wrist, the arm angle the upper arm's orientation,
    and the other joints supply it and the rest of the rotation."""
    rotation, position = motion
    arm = srs_points(screws)
    goal = lanes.materialised(rotation @ arm.wrist + position - arm.shoulder)
    axis = line_of(screws[3])
    x = away_from(axis, arm.wrist)
    y = lanes.cross(axis.direction, x)
    foot = arm.wrist - x - arm.shoulder
    gap = foot @ foot + x @ x - goal @ goal
    scale = lanes.norm(foot) + lanes.norm(x) + lanes.norm(goal)
    p, q = 2.0 * (foot @ x), 2.0 * (foot @ y)
    move_4, elbow = sinusoid_root(p, q, gap, signs(), scale * scale)
    move_4 = lanes.materialised(move_4)
    reach = foot + move_4[0] * x + move_4[1] * y
    sin, cos = lanes.sincos(angle)
    along, reference, beside = frame(goal, screws[0, :3]).T
    turned = np.stack([along, cos * reference + sin * beside, cos * beside - sin * reference], 1)
    upper = lanes.materialised(turned @ frame(reach, arm.elbow).T)
    first, shoulder_roots = _orient(screws[:3], upper, signs)
    left = joint_motion.rotation(screws[3], joint_motion.turn_back(move_4)) @ (upper.T @ rotation)
    last, wrist_roots = _orient(screws[4:], lanes.materialised(left), signs)
    roots = [
        (Singularity.WRIST, shoulder_roots),
        (Singularity.WRIST, wrist_roots),
        (Singularity.ELBOW, elbow),
    ]
    return [*first, move_4, *last], roots


def _three_parallel(family: ThreeParallel, screws: Lanes, motion: Motion, signs: Signs) -> Solution:
    rotation, position = motion
    w, w5, w6 = screws[1, :3], screws[4, :3], screws[5, :3]
    # The three parallel axes never move a point along them, and axes 5 and 6 never move this one.
    centre = joint_motion.meeting_point(screws[4], screws[5])
    goal = lanes.materialised(rotation @ centre + position)
    move_1, first = on_surface(family.kind, screws[0], goal, (w, centre, None), signs)
    move_1 = joint_motion.materialised(move_1)
    seen = lanes.materialised(rotation.T @ (joint_motion.rotation(screws[0], move_1) @ w))
    # exp(S5 q5) exp(S6 q6) must turn what is seen into w.
    x = seen - (w6 @ seen) * w6
    y = lanes.cross(w6, x)
    move_6, sixth = sinusoid_root(w5 @ x, w5 @ y, w5 @ (seen - x - w), signs(), Lane(1.0))
    move_6 = lanes.materialised(move_6)
    move_5 = lanes.materialised(turn_between(w5, seen - x + move_6[0] * x + move_6[1] * y, w))
    before = compose(motion_of(screws[0], joint_motion.back(move_1)), motion)
    # Where axis 6 is parallel to the three, any turn about it does: one within reach is taken.
    any_turn = lanes.norm(x) <= IK_POLISH.of(jnp.result_type(x[0].value))
    move_6 = lanes.choose(any_turn, _elbow_turn(screws, before, move_5), move_6)
    move_6 = lanes.materialised(move_6)
    left = before
    for screw, move in ((screws[5], move_6), (screws[4], move_5)):
        left = compose(left, motion_of(screw, joint_motion.back(move)))
    bends, elbow = planar(screws[1:4], family.turns, left, signs)
    roots = [(Singularity.MERGED, first), (Singularity.WRIST, sixth), (Singularity.ELBOW, elbow)]
    return [move_1, *bends, move_5, move_6], roots


def _elbow_turn(screws: Lanes, motion: Motion, move_5: Lanes) -> Lanes:
    """The turn about axis 6, where it is parallel to axes 2 to 4, that suits the elbow best.

    Each turn then leaves axis 4 at another distance from axis 2. This is the one for which the
    elbow is bent at a right angle, or comes nearest to it.
    """
    second, third, fourth, sixth = (line_of(screws[i]) for i in (1, 2, 3, 5))
    links = away_from(second, third.point), away_from(third, fourth.point)
    wanted = links[0] @ links[0] + links[1] @ links[1]
    point = joint_motion.carried(screws[4], joint_motion.back(move_5), fourth.point)
    rotation, position = se3.inverse_lanes(*motion)
    x = away_from(sixth, point)
    y = lanes.cross(sixth.direction, x)
    away = away_from(sixth, rotation @ second.point + position)
    gap = away @ away + x @ x - wanted
    scale = lanes.norm(x) + lanes.norm(away)
    p, q = -2.0 * (away @ x), 2.0 * (away @ y)
    return sinusoid_root(p, q, gap, 1.0, scale * scale)[0]


def _schoenflies(family: Schoenflies, screws: Lanes, motion: Motion, signs: Signs) -> Solution:
    slide = screws[family.slide, 3:]
    axes = np.delete(screws, family.slide, axis=0)
    rotation, position = motion
    point = line_of(axes[2]).point
    # The slide changes places with the turns about its own direction.
    length = slide @ (rotation @ point + position - point)
    moves, roots = planar(axes, family.turns, (rotation, position - length * slide), signs)
    moves.insert(family.slide, length)
    return moves, [(Singularity.ELBOW, roots)]


def _two_turns_two_slides(
    family: TwoTurnsTwoSlides, screws: Lanes, motion: Motion, signs: Signs
) -> Solution:
    del signs
    rotation, position = motion
    (a, b), (c, d) = family.turns, family.slides
    w1, w2 = screws[a, :3], screws[b, :3]
    first = lanes.materialised(turn_between(w1, w2, rotation @ w2))
    across = w1 - (w1 @ w2) * w2
    second = turn_between(
        w2, across, joint_motion.turned(w1, joint_motion.turn_back(first), rotation @ across)
    )
    turns = {a: first, b: lanes.materialised(second)}
    rest, directions = (lanes.identity(3), lanes.lanes_of([0.0, 0.0, 0.0])), list[Lanes]()
    for joint, screw in enumerate(screws):
        if joint in turns:
            rest = compose(rest, motion_of(screw, turns[joint]))
        else:
            directions.append(rest[0] @ screw[3:])
    lengths = combination(directions[0], directions[1], position - rest[1])
    slides = dict(zip((c, d), lengths))
    found = [turns[joint] if joint in turns else slides[joint] for joint in range(4)]
    return found, []


_SOLVERS: dict[type[Any], Callable[[Any, Lanes, Motion, Signs], Solution]] = {
    SphericalWrist: _spherical_wrist,
    ThreeParallel: _three_parallel,
    Schoenflies: _schoenflies,
    TwoTurnsTwoSlides: _two_turns_two_slides,
    PlanarArm: planar_arm,
}
