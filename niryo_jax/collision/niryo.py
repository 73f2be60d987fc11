"""Capsules for the Niryo arms.

Ends of capsules lie on the joint axes and flanges of `niryo_jax.robots` (NiryoRobotics/ned_ros
v5.6.3; L1 to L8 of Todorovic et al. for the Niryo One). Cross-sections are not among these facts:
radii are estimates, bounded above by the poses at rest, in which the hand lies beside the shoulder.
They are meant to enclose the arm, and have not been held against its meshes: keep a margin. Which
links are looked at is what Niryo's own motion planner is set to (the SRDF of its MoveIt
configuration calls the others adjacent, or never in collision).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from niryo_jax.arguments import check_choice, check_number
from niryo_jax.collision.model import CollisionModel
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.robots import MODELS, NIRYO_NED, NIRYO_NED2, NIRYO_ONE, NiryoModel

_RADII: Mapping[str, float] = {
    "base": 0.1,
    "shoulder": 0.045,
    "upper_arm": 0.045,
    "elbow": 0.045,
    "forearm": 0.035,
    "wrist": 0.03,
    "hand": 0.025,
    "tool": 0.025,
}
"""Metres: the base has a footprint of about 0.2 m; the others are estimates."""

_BASE_HEIGHT = 0.02
"""Of the centre of the sphere around the base, which ends below the shoulder joint."""

_ELBOW, _WRIST = 0.0415, 0.03
"""Where the forearm begins behind the elbow (L5 of the Niryo One), and ends before the wrist."""

_LOOKED_AT = (
    *(("base", link) for link in ("forearm", "wrist", "hand")),
    *(("shoulder", link) for link in ("wrist", "hand")),
)
"""Pairs of links of the arm that can touch."""

_TOOL_LOOKED_AT = ("base", "shoulder", "upper_arm")
"""The links that a tool can touch."""


def niryo_one(tool: str | float | None = None) -> CollisionModel:
    """The shape of the Niryo One: eight capsules at most, on all of its links.

    Args:
        tool: the name of a tool of `robots.NIRYO_ONE.tools`, or the length of one along the x-axis
            of the flange, metres; no tool where not given. A tool is as long as its tool centre
            point is away, with a radius of 25 mm or less.

    Raises:
        ValueError: an unknown tool, a length that is not positive.
        TypeError: neither a name nor a number.
    """
    return _model(NIRYO_ONE, tool)


def niryo_ned(tool: str | float | None = None) -> CollisionModel:
    """The shape of the Niryo Ned; argument and errors as `niryo_one`."""
    return _model(NIRYO_NED, tool)


def niryo_ned2(tool: str | float | None = None) -> CollisionModel:
    """The shape of the Niryo Ned2; argument and errors as `niryo_one`."""
    return _model(NIRYO_NED2, tool)


SHAPES: Mapping[str, Callable[[str | float | None], CollisionModel]] = {
    "niryo_one": niryo_one,
    "niryo_ned": niryo_ned,
    "niryo_ned2": niryo_ned2,
}
"""The shapes that come with the package, by the names of the arms."""

_ALIKE = 0.05
"""Radians and metres by which the axes of an arm may be worn, or calibrated, and have its shape."""


def shipped(robot: Robot, tool: str | float | None = None) -> CollisionModel:
    """The shape that comes with the package for an arm: a Niryo, known by its name and its axes.

    Args:
        robot: the arm, concrete.
        tool: as for `niryo_one`.

    Raises:
        ValueError: no shape comes for this arm, an unknown tool.
        TypeError: no robot, a traced robot, a tool that is neither a name nor a number.
    """
    check_is_robot(robot)
    robot.known_screws()
    if robot.name in SHAPES and axes_alike(robot, MODELS[robot.name].robot()):
        return SHAPES[robot.name](tool)
    raise ValueError(
        f"robot: expected an arm whose shape comes with the package ({', '.join(SHAPES)}), got "
        f"{robot.name}"
    )


def axes_alike(robot: Robot, other: Robot) -> bool:
    """Whether two concrete arms have their axes in the same places, wear aside."""
    first, second = robot.known_screws(), other.known_screws()
    return first.shape == second.shape and bool(np.all(np.abs(first - second) < _ALIKE))


def _model(arm: NiryoModel, tool: str | float | None) -> CollisionModel:
    shoulder, elbow = arm.shoulder[1], arm.elbow[0] + _ELBOW
    (wrist_x, wrist_z), (flange_x, flange_z) = arm.wrist, arm.tool
    ends = {
        "base": ((0.0, _BASE_HEIGHT), (0.0, _BASE_HEIGHT)),
        "shoulder": ((0.0, _BASE_HEIGHT + _RADII["base"]), (0.0, shoulder)),
        "upper_arm": (arm.shoulder, arm.elbow),
        "elbow": (arm.elbow, (elbow, wrist_z)),
        "forearm": ((elbow, wrist_z), (wrist_x - _WRIST, wrist_z)),
        "wrist": (arm.wrist, arm.wrist),
        "hand": ((wrist_x, flange_z), (flange_x - 0.5 * _RADII["hand"], flange_z)),
    }
    start, end = (
        np.array([[x, 0.0, z] for x, z in (pair[i] for pair in ends.values())]) for i in (0, 1)
    )
    model = CollisionModel.from_capsules(
        start,
        end,
        np.array([_RADII[name] for name in ends]),
        range(len(ends)),
        names=list(ends),
        pairs=_LOOKED_AT,
    )
    offset = _offset(arm, tool)
    if offset is None:
        return model
    flange, length = np.array([flange_x, 0.0, flange_z]), float(np.linalg.norm(offset))
    # The round end of the capsule is the end of the tool.
    radius = min(_RADII["tool"], length / 2)
    tip = flange + offset * (1 - radius / length)
    whole = model.attach([flange], [tip], [radius], [6], names=["tool"])
    return whole.allow([(name, "tool") for name in ends if name not in (*_TOOL_LOOKED_AT, "hand")])


def _offset(arm: NiryoModel, tool: str | float | None) -> np.ndarray | None:
    """From the flange to the tip of a tool in the axes of the flange, metres."""
    if tool is None:
        return None
    if isinstance(tool, str):
        check_choice("tool", tool, arm.tools)
        offset = np.array(arm.tools[tool])
        return offset if np.any(offset) else None
    length = check_number("tool", tool, "a positive length or a name", lambda x: 0 < x < np.inf)
    return np.array([length, 0.0, 0.0])
