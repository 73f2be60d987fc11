"""The robots of the founding documents: those of Pardos-Gotor's book, and one of a report.

The book's two editions draw some arms differently: some joints are counted the other way and the
tool frame has other axes. The 2022 edition is the default; `edition=2018` gives the other drawing
of the same arm. Limits belong to the arm: a joint counted the other way has its range mirrored.
"""

from __future__ import annotations

import dataclasses
from typing import Literal, get_args

import numpy as np

from niryo_jax.arguments import check_choice
from niryo_jax.robot import Robot
from niryo_jax.robots.book_arms import (
    IIWA14,
    IIWA14_BENT,
    IIWA14_SIDE_TOOL,
    IRB120,
    IRB120_UP,
    IRB910SC,
    IRB1600,
    IRB6620LX,
    RTTR,
    UR16E,
)
from niryo_jax.robots.niryo import NIRYO_ONE

Edition = Literal[2018, 2022]
Tool = Literal["down", "up"]
Up = Literal["y", "z"]
Home = Literal["upright", "bent", "side_tool"]

_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""The turn about x that brings z up to y up."""


def abb_irb120(tool: Tool = "down", *, up: Up = "z", edition: Edition = 2022) -> Robot:
    """The ABB IRB120: six joints, a spherical shoulder and a spherical wrist.

    Args:
        tool: whether the tool points down at q = 0, or up. Both have their zeros where the book
            draws them, and the limits that it gives for them.
        up: the axis of the space frame that points up. The book has z up in its kinematics of
            2022 and y up elsewhere.
        edition: 2018 counts joints 2, 3 and 5 the other way. The tool-up exercise of
            2022 (4.4.3) still does so: it is `abb_irb120("up", up="y", edition=2018)`.

    Raises:
        ValueError: an unknown tool, axis or edition.
    """
    _check("tool", tool, Tool)
    _check("up", up, Up)
    _check("edition", edition, Edition)
    model = IRB120 if tool == "down" else IRB120_UP
    if edition == 2018:
        model = model.redrawn((1, 2, 4), ("-y", "-x", "-z") if tool == "down" else model.tool)
    robot = model.robot()
    return robot if up == "z" else _turned(robot, _Y_UP)


def abb_irb1600(limits: str | None = None) -> Robot:
    """The ABB IRB1600: six joints, a shoulder offset of 150 mm, a spherical wrist.

    Args:
        limits: the exercise of 2022 that they are read from: "exercise 7.2.4a" where not given,
            "exercise 6.2.4" or "exercise 5.3.11".

    Raises:
        ValueError: an unknown source of limits.
    """
    return IRB1600.robot(limits)


def abb_irb6620lx(*, edition: Edition = 2022) -> Robot:
    """The ABB IRB6620LX: a gantry, of which joint 1 slides along z; y is up.

    The travel of 1.8 to 33 m is that of exercise 6.2.5; two other exercises end it at 3.3 and 3 m.

    Args:
        edition: 2018 counts joints 2, 3 and 5 the other way.

    Raises:
        ValueError: an unknown edition.
    """
    _check("edition", edition, Edition)
    redrawn = IRB6620LX.redrawn((1, 2, 4), ("-z", "y", "x"))
    return (redrawn if edition == 2018 else IRB6620LX).robot()


def abb_irb910sc(*, edition: Edition = 2022) -> Robot:
    """The ABB IRB910SC: a SCARA of four joints, of which joint 3 slides along y, which is up.

    Args:
        edition: 2018 counts joint 3 downwards.

    Raises:
        ValueError: an unknown edition.
    """
    _check("edition", edition, Edition)
    redrawn = IRB910SC.redrawn((2,), ("x", "z", "-y"))
    return (redrawn if edition == 2018 else IRB910SC).robot()


def kuka_iiwa14(home: Home = "upright") -> Robot:
    """The KUKA LBR iiwa 14 R820: seven joints, a spherical shoulder and a spherical wrist.

    Args:
        home: how the arm stands at q = 0: "upright", as the manufacturer counts the angles;
            "side_tool", with joint 6 at 90 degrees; "bent", with joint 4 at -90 and joint 6
            at 90 degrees, which the 2018 book draws with y up. Their limits are those of the
            upright home, counted from the new zeros.

    Raises:
        ValueError: an unknown home.
    """
    _check("home", home, Home)
    models = {"upright": IIWA14, "bent": IIWA14_BENT, "side_tool": IIWA14_SIDE_TOOL}
    return models[home].robot()


def ur16e() -> Robot:
    """The Universal Robots UR16e: six joints, of which 2, 3 and 4 are parallel."""
    return UR16E.robot()


def rttr() -> Robot:
    """The exercise robot of 2018: four joints, of which 2 and 3 slide; without limits."""
    return RTTR.robot()


def niryo_one_report() -> Robot:
    """The Niryo One as A. Jnadi's report models it (2021, eq. 1 to 4): with a spherical wrist.

    Axis 6 passes through the wrist's centre, and the 5.5 mm from there to the tool turn with it.
    It is the Niryo One at theta_6 = 0 and has its rotation always; its position differs
    by 11 sin(theta_6 / 2) mm.

    The signs are those of the robot and of `niryo_one`. The report counts joints 2, 3 and 5 the
    other way: theta = (1, -1, -1, 1, -1, 1) * theta of the report.
    """
    (_, height) = NIRYO_ONE.wrist
    return dataclasses.replace(NIRYO_ONE, name="niryo_one_report", axis_6_height=height).robot()


def _turned(robot: Robot, rotation: np.ndarray) -> Robot:
    """The robot with its whole drawing turned about the origin."""
    screws = np.asarray(robot.screws).reshape(-1, 3) @ rotation.T
    home = np.array(robot.home)
    home[:3] = rotation @ home[:3]
    return dataclasses.replace(robot, screws=screws.reshape(-1, 6), home=home)


def _check(name: str, value: object, choices: object) -> None:
    check_choice(name, value, get_args(choices))
