"""Robots from URDF descriptions, and URDF descriptions of robots.

The elements mean what the URDF specification says (ROS wiki, urdf/XML/joint): the frame of a joint
is that of its child link; `origin` places it in the frame of the parent link, with
R = Rz(yaw) Ry(pitch) Rx(roll); `axis` is given in it.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from niryo_jax.arguments import check_path
from niryo_jax.lie.rpy import rpy_from_pose
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.robots import description
from niryo_jax.robots.frames import robot_from_frames
from niryo_jax.structure import axes

_UNLIMITED = sys.float_info.max
"""Stands for no bound where URDF demands one."""


def from_urdf(
    path: str | os.PathLike[str],
    base: str | None = None,
    tip: str | None = None,
    *,
    name: str | None = None,
) -> Robot:
    """Read the chain between two links of a URDF description.

    The space frame is the frame of the base link, the tool frame that of the tip link. Revolute,
    continuous and prismatic joints of the chain become joints of the robot, fixed ones part of its
    geometry. Inertias, shapes and meshes are not read: mesh files need not exist.

    A continuous joint has no limits, whatever its `limit` says. Nor has a revolute or prismatic
    joint without `limit`, or whose `limit` gives neither bound; where it gives one, the other is 0,
    as URDF defines it. The largest float64 stands for no bound, as in `to_urdf`.

    Args:
        path: a URDF file, or its text, which starts with "<".
        base: the link that the chain starts at; the root of the tree where not given.
        tip: the link that the chain ends at; where not given, the one leaf below the base.
        name: the robot's name; that in the description where not given.

    Raises:
        ImportError: the parser, yourdfpy, is not installed.
        FileNotFoundError: there is no such file.
        ValueError: no XML, no URDF description, or one whose links are not one tree; base or tip
            is no link of it, or tip is not below base; several leaves to choose from; a joint on
            the chain that is planar, floating or of an unknown type, that mimics another, whose
            axis is zero, or whose limits are in the wrong order; no joint on the chain that moves.
    """
    model = description.parse(path)
    pose, frames, moving = np.eye(4), list[np.ndarray](), list[Any]()
    for joint in description.chain(model, base, tip):
        if joint.origin is not None:
            pose = pose @ joint.origin
        if joint.type != "fixed":
            frames.append(pose)
            moving.append(joint)
    lower, upper = np.transpose([_limits(joint) for joint in moving])
    return robot_from_frames(
        np.stack(frames),
        np.stack([_axis(joint) for joint in moving]),
        pose,
        prismatic=[joint.type == "prismatic" for joint in moving],
        lower=lower,
        upper=upper,
        joint_names=[joint.name for joint in moving],
        name=model.name if name is None else name,
    )


def _axis(joint: Any) -> np.ndarray:
    """The axis of a joint, scaled so that its square neither overflows nor vanishes."""
    largest = np.max(np.abs(joint.axis))
    if largest == 0:
        raise ValueError(f"path: joint {joint.name!r}: expected an axis that is not zero")
    return joint.axis / largest


def _limits(joint: Any) -> tuple[float, float]:
    given = joint.limit
    if joint.type == "continuous" or given is None or given.lower is given.upper is None:
        return -np.inf, np.inf
    lower, upper = (0.0 if bound is None else bound for bound in (given.lower, given.upper))
    if lower > upper:
        raise ValueError(f"path: joint {joint.name!r}: lower {lower} exceeds upper {upper}")
    return _bound(lower), _bound(upper)


def _bound(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) >= _UNLIMITED else value


def to_urdf(robot: Robot, path: str | os.PathLike[str] | None = None) -> str:
    """Write a robot as a URDF description, which `from_urdf` reads as the same robot.

    The links are "base", "link_1" ... and "tool"; at q = 0 all frames but the tool's are parallel
    to the space frame. Numbers are written in full. A revolute joint without limits becomes a
    continuous one; elsewhere the largest float64 stands for a missing bound. Effort and velocity,
    which URDF demands and a `Robot` does not know, are written as 1.

    Args:
        robot: the arm, concrete.
        path: the file to write as well, where given.

    Returns:
        The description as text.

    Raises:
        TypeError: the robot is traced.
        ValueError: a helical joint, which URDF does not have; joint names that are empty or not
            distinct; a batch of robots.
        OSError: the file cannot be written.
    """
    check_is_robot(robot)
    if path is not None:
        check_path("path", path)
    screws, home, names = robot.known_screws(), np.asarray(robot.home, float), robot.joint_names
    if screws.ndim != 2:
        raise ValueError(f"robot: expected one robot, got screws of shape {screws.shape}")
    kinds = axes.joint_kinds(screws)
    if "helical" in kinds:
        name = names[kinds.index("helical")]
        raise ValueError(f"robot: joint {name!r} is helical; URDF has no such joint")
    if not all(names):
        raise ValueError(f"robot: expected a name for every joint, got {names}")
    description.check_distinct("robot: joint", names)
    root = Element("robot", name=robot.name)
    links = ["base", *(f"link_{i + 1}" for i in range(len(names))), "tool"]
    for link in links:
        SubElement(root, "link", name=link)
    place = np.zeros(3)
    limits = np.stack([robot.lower, robot.upper], axis=1).astype(float)
    for i, (name, kind, screw, bounds) in enumerate(zip(names, kinds, screws, limits)):
        slides = kind == "prismatic"
        point = place if slides else axes.axis_point(screw)
        endless = not slides and bool(np.all(bounds == (-np.inf, np.inf)))
        joint = _add_joint(root, name, "continuous" if endless else kind, links[i : i + 2])
        SubElement(joint, "origin", xyz=_text(point - place))
        SubElement(joint, "axis", xyz=_text(screw[3:] if slides else screw[:3]))
        if not endless:
            lower, upper = (_text([bound]) for bound in np.clip(bounds, -_UNLIMITED, _UNLIMITED))
            SubElement(joint, "limit", lower=lower, upper=upper, effort="1", velocity="1")
        place = point
    mounting = _add_joint(root, _unused("tool_joint", names), "fixed", links[-2:])
    position, turn = home[:3, 3] - place, rpy_from_pose(home)[3:]
    SubElement(mounting, "origin", xyz=_text(position), rpy=_text(turn))
    indent(root)
    text = f'<?xml version="1.0"?>\n{tostring(root, encoding="unicode")}\n'
    if path is not None:
        Path(path).write_text(text, encoding="utf-8")
    return text


def _add_joint(root: Element, name: str, kind: str, links: Sequence[str]) -> Element:
    joint = SubElement(root, "joint", name=name, type=kind)
    for end, link in zip(("parent", "child"), links):
        SubElement(joint, end, link=link)
    return joint


def _unused(name: str, names: Sequence[str]) -> str:
    while name in names:
        name += "_"
    return name


def _text(numbers: Iterable[float]) -> str:
    """Numbers in full; adding 0.0 turns a negative zero into a positive one."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)
