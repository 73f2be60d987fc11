"""Capsules for an arm of which nothing but its axes is known."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from niryo_jax.arguments import check_positive
from niryo_jax.collision.model import CollisionModel
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.structure.axes import axis_point, joint_kinds
from niryo_jax.tolerances import AXES_MEET, AXES_PARALLEL


def skeleton(robot: Robot, radius: float) -> CollisionModel:
    """Capsules along the joint axes and their common normals, from the base to the tool.

    A link runs along its axis from where the link before it arrives to the foot of the common
    normal with the next axis, and along that; the base from the origin of the space frame to the
    first axis, and along it where that joint is revolute; the last link to the origin of the tool
    frame. Real links are elsewhere: this tells arms that fold up, not arms that touch.

    Args:
        robot: the arm, concrete.
        radius: of all capsules, metres.

    Returns:
        A `CollisionModel` with "link_0"..., and the default pairs without those of capsules that
        follow each other. Where axes are nearer than two radii others always touch: see `prune`.

    Raises:
        ValueError: a radius that is not positive, a batch of robots, an arm of no extent.
        TypeError: the robot is traced, no robot, no number.
    """
    check_is_robot(robot)
    radius = check_positive("radius", radius, "a positive length")
    screws = robot.known_screws().astype(float)
    if screws.ndim != 2:
        raise ValueError(f"robot: expected one robot, got screws of shape {screws.shape}")
    kinds, tool = joint_kinds(screws), np.asarray(robot.home, float)[:3, 3]
    place, stops = np.zeros(3), list[list[np.ndarray]]()
    lines = list[tuple[np.ndarray, np.ndarray]]()
    for screw, kind in zip(screws, kinds):
        # A slide has a direction and no place: it starts where the link before it arrives.
        line = (screw[3:], place) if kind == "prismatic" else (screw[:3], axis_point(screw))
        leaves, arrives = _feet(lines[-1], line, place) if lines else (place, _foot(line, place))
        stops.append([place, leaves, arrives])
        lines.append(line)
        place = arrives
    stops.append([place, _foot(lines[-1], tool), tool])
    start, end, links = list[np.ndarray](), list[np.ndarray](), list[int]()
    for link, points in enumerate(stops):
        for part, (a, b) in enumerate(itertools.pairwise(points)):
            # What lies along the first axis stands still while its joint turns: a base on a table.
            column = (link, part) == (1, 0) and kinds[0] == "revolute"
            if np.linalg.norm(b - a) > AXES_MEET.float64:
                start.append(a)
                end.append(b)
                links.append(0 if column else link)
    if not links:
        raise ValueError("robot: expected axes apart from each other, got all in one point")
    model = CollisionModel.from_capsules(np.array(start), np.array(end), radius, links)
    # Capsules that follow each other meet on a joint axis, wherever the arm is.
    joined = set(itertools.pairwise(range(len(links))))
    return dataclasses.replace(model, pairs=tuple(x for x in model.pairs if x not in joined))


def _foot(line: tuple[np.ndarray, np.ndarray], point: np.ndarray) -> np.ndarray:
    """The point of a line (direction, point) that is nearest to a point."""
    direction, through = line
    return through + (direction @ (point - through)) * direction


def _feet(
    line: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray], near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nearest points of two lines; of parallel lines those nearest to a point of the first."""
    (u, a), (v, b) = line, other
    normal = np.cross(u, v)
    sine = np.linalg.norm(normal)
    if sine < AXES_PARALLEL.float64:
        return near, _foot(other, near)
    along = np.cross(b - a, v) @ normal / sine**2
    foot = a + along * u
    return foot, _foot(other, foot)
