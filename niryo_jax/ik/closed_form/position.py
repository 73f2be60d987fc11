"""Three joints that bring a point to another, in closed form on lanes.

exp(S1 q1) exp(S2 q2) exp(S3 q3) p = k. Joints 2 and 3 keep p on a plane or on a sphere, whatever
their values, so q1 is where exp(-S1 q1) k is on it; then the circle of p about axis 3 and that of
the other point about axis 2 meet (Paden-Kahan 2, Pardos-Gotor 4 and 7; Murray, Li & Sastry, section
3.3.3). A slide in place of an axis gives a line in place of a circle.
"""

from __future__ import annotations

import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.ik.closed_form import joint_motion, pieper
from niryo_jax.ik.closed_form.joint_motion import (
    ONE_ROOT,
    Move,
    Roots,
    Signs,
    away_from,
    line_of,
    turn_between,
)
from niryo_jax.ik.closed_form.trig_roots import quadratic_root, sinusoid_root
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.structure.families import Shoulder
from niryo_jax.tolerances import SINGULAR_ANGLE


def place(
    shoulder: Shoulder, screws: Lanes, p: Lanes, k: Lanes, signs: Signs
) -> tuple[list[Move], list[Roots]]:
    """The moves of three joints (3, 6) that bring p to k, joint 1 first; and of one or two
    equations, that of the joint which is solved first before that of the others."""
    if shoulder.surface == "general":
        found, roots = pieper.place(screws, p, k, signs)
        return found, [roots]
    if shoulder.reverse:
        screws, p, k = screws[::-1], k, p
    surface = _surface(shoulder, screws, p)
    first, roots = on_surface(shoulder.kinds[0], screws[0], k, surface, signs)
    first = joint_motion.materialised(first)
    goal = lanes.materialised(joint_motion.carried(screws[0], joint_motion.back(first), k))
    second, third, others = _pair(shoulder, screws[1:], p, goal, signs)
    found = [first, joint_motion.materialised(second), joint_motion.materialised(third)]
    if shoulder.reverse:
        found = [joint_motion.back(move) for move in reversed(found)]
    return found, [roots, others]


Surface = tuple[Lanes, Lanes, Lane | None]
"""A normal and a point of a plane and None, or anything, the centre of a sphere and its radius."""


def _surface(shoulder: Shoulder, screws: Lanes, p: Lanes) -> Surface:
    second, third = screws[1:]
    if shoulder.surface == "sphere":
        centre = joint_motion.meeting_point(second, third)
        return p, centre, lanes.materialise(lanes.norm(p - centre))
    pair = shoulder.kinds[1:]
    if pair == ("prismatic", "prismatic"):
        normal = lanes.cross(second[3:], third[3:])
        return lanes.materialised(normal * (1.0 / lanes.norm(normal))), p, None
    return (second if pair[0] == "revolute" else third)[:3], p, None


def on_surface(
    kind: str, screw: Lanes, k: Lanes, surface: Surface, signs: Signs
) -> tuple[Move, Roots]:
    """The move of a joint with exp(-S q) k on a plane or on a sphere."""
    normal, point, radius = surface
    if kind == "revolute":
        axis = line_of(screw)
        x = away_from(axis, k)
        y = lanes.cross(screw[:3], x)
        foot = k - x - point
        scale = lanes.norm(x) + lanes.norm(foot)
        if radius is None:
            return sinusoid_root(normal @ x, -(normal @ y), normal @ foot, signs(), scale)
        gap = foot @ foot + x @ x - radius * radius
        return sinusoid_root(
            2.0 * (foot @ x), -2.0 * (foot @ y), gap, signs(), scale * (scale + radius)
        )
    slide, gap = screw[3:], k - point
    if radius is None:
        return (normal @ gap) / (normal @ slide), ONE_ROOT
    scale = lanes.norm(gap) + radius
    return quadratic_root(slide @ gap, gap @ gap - radius * radius, signs(), scale)


def _pair(
    shoulder: Shoulder, screws: Lanes, p: Lanes, k: Lanes, signs: Signs
) -> tuple[Move, Move, Roots]:
    """exp(S2 q2) exp(S3 q3) p = k for a k that is on the surface of p."""
    second, third = screws
    kinds = shoulder.kinds[1:]
    if kinds == ("prismatic", "prismatic"):
        return *combination(second[3:], third[3:], k - p), ONE_ROOT
    if kinds == ("revolute", "revolute"):
        return circles(second, third, p, k, shoulder.surface == "plane", signs)
    if kinds[0] == "revolute":
        return _turn_and_slide(second, third, p, k, signs)
    turn, slide, roots = _turn_and_slide(third, second, k, p, signs)
    return -slide, joint_motion.back(turn), roots


def combination(u: Lanes, v: Lanes, vector: Lanes) -> tuple[Lane, Lane]:
    """The lengths along two unit vectors that come nearest to a vector (Pardos-Gotor 2)."""
    cosine = u @ v
    per = 1.0 / (1.0 - cosine * cosine)
    ahead, aside = u @ vector, v @ vector
    return (ahead - cosine * aside) * per, (aside - cosine * ahead) * per


def _turn_and_slide(
    axis: Lanes, slide: Lanes, p: Lanes, k: Lanes, signs: Signs
) -> tuple[Lanes, Lane, Roots]:
    """exp(S q) (p + t v) = k for a slide at right angles to the axis."""
    line, v = line_of(axis), slide[3:]
    u, goal = away_from(line, p), away_from(line, k)
    scale = lanes.norm(u) + lanes.norm(goal)
    length, roots = quadratic_root(-(u @ v), u @ u - goal @ goal, signs(), scale)
    return turn_between(axis[:3], u + length * v, goal), length, roots


def circles(
    second: Lanes, third: Lanes, p: Lanes, k: Lanes, parallel: bool, signs: Signs
) -> tuple[Lanes, Lanes, Roots]:
    """exp(S2 q2) exp(S3 q3) p = k for two axes that are parallel or meet, and a k that fits them.

    What is left to satisfy is the distance from axis 2 where the axes are parallel, and the height
    along it where they meet.
    """
    a, b = line_of(second), line_of(third)
    x = away_from(b, p)
    y = lanes.cross(b.direction, x)
    foot = p - x
    goal = away_from(a, k)
    radius = lanes.norm(goal)
    if parallel:
        d = away_from(a, foot)
        scale = lanes.norm(d) + lanes.norm(x) + radius
        gap = d @ d + x @ x - goal @ goal
        turn, roots = sinusoid_root(2.0 * (d @ x), 2.0 * (d @ y), gap, signs(), scale * scale)
    else:
        w = a.direction
        scale = lanes.norm(x) + lanes.norm(k - a.point)
        turn, roots = sinusoid_root(w @ x, w @ y, w @ (foot - k), signs(), scale)
    # About an axis through it, k turns and stays where it is.
    near = SINGULAR_ANGLE.of(jnp.result_type(scale.value))
    share = radius / scale
    margin = lanes.minimum(roots.margin, share * share)
    roots = roots._replace(free=roots.free | (radius <= near * scale), margin=margin)
    turn = lanes.materialised(turn)
    between = foot + turn[0] * x + turn[1] * y
    return turn_between(a.direction, between - a.point, k - a.point), turn, roots
