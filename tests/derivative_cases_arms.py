"""How chains and Jacobians are differentiated, by the geometry too."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pose_sets
from derivatives import Case, NoDerivative, Tier, motion
from support import product_of_exponentials

import niryo_jax as nj

NIRYO = nj.robots.niryo_one()
SPHERICAL = pose_sets.robot("irb120")
IIWA = nj.robots.kuka_iiwa14()
UR = nj.robots.ur16e()

Q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
Q7 = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8, 0.2])
# The tool axis of the Niryo One lies on axis 1: joints 1 and 6 turn against each other.
ON_AXIS_1 = np.array([[0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0.5], [0, 0, 0, 1.0]])
FAR = np.array([[1, 0, 0, 5.0], [0, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1]])
NO_MOTION = np.diag([2.0, 1.0, 1.0, 1.0])
RATES = np.array([0.2, -0.5, 0.3, 0.7, -0.1, 0.4])
VELOCITY = np.array([0.3, -0.2, 0.1, 0.05, 0.02, -0.04])
GEOMETRY = {"screws": "screw", "home": "motion"}
LEAST = "the least that follow"

# Programs of traced screws take long to compile: two joints, one of them helical.
SMALL = nj.Robot.from_screws(
    [[0, 0, 1, 0, 0, 0], [0, 1, 0, -0.2, 0.05, 0.3]],
    motion(0.3, 0.2, -0.4, 0.5, 0.1, 0.2).astype(float),
)
OF_SMALL = SMALL.screws, SMALL.home
Q2 = np.array([0.3, 1.1])
SMOOTH = {"a posture": (Q2,), "home": (np.zeros(2),), "whole turns": (Q2 + 2 * np.pi,)}
WRIST = np.array([0.3, -0.4, 0.5, 0.6, 0.0, 0.8])


def built(screws: Any, home: Any, like: nj.Robot = SMALL) -> nj.Robot:
    """An arm of this geometry."""
    return dataclasses.replace(like, screws=screws, home=home)


def of_geometry(function: Callable[..., Any], like: nj.Robot = SMALL) -> Callable[..., Any]:
    """A function of a robot as one of its screws and its home pose."""
    return lambda screws, home, *rest: function(built(screws, home, like), *rest)


def pose_of(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(4, 4) of joints (n,), in extended precision."""
    return product_of_exponentials(robot.screws, robot.home, q)


def _by_all(name: str, tier: Tier = "heavy") -> Case:
    """A smooth function of an arm and joints, by both."""
    function = of_geometry(getattr(nj, name))
    return Case(name, function, GEOMETRY | {"q": "free"}, SMOOTH, shared=OF_SMALL, tier=tier)


def _by_joints(name: str, given: str) -> list[Case]:
    """A measure of the Jacobian, which has no derivative where the arm is singular."""
    function = getattr(nj, name)
    measure = (lambda *x: 1.0 / function(*x)) if name == "condition_number" else function
    edges = {
        "home, singular": NoDerivative((np.zeros(6),), given),
        "wrist singular": NoDerivative((WRIST,), given),
    }
    return [
        Case(
            name,
            functools.partial(measure, SPHERICAL),
            {"q": "free"},
            {"a posture": (Q,)},
            edges,
            tier="heavy",
        ),
        Case(
            name,
            of_geometry(measure),
            GEOMETRY | {"q": "free"},
            {"a posture": (Q2,)},
            shared=OF_SMALL,
            note="by the geometry",
            tier="slow",
        ),
        Case(
            name,
            functools.partial(measure, IIWA),
            {"q": "free"},
            {"a posture": (Q7,)},
            {"stretched": NoDerivative((np.zeros(7),), given)},
            note="seven joints",
            tier="slow",
        ),
    ]


CHAINS = [
    _by_all("forward_kinematics"),
    _by_all("link_poses"),
    _by_all("space_jacobian"),
    _by_all("body_jacobian", "slow"),
    _by_all("autodiff_space_jacobian", "slow"),
    Case(
        "tool_velocity",
        of_geometry(nj.tool_velocity),
        GEOMETRY | {"q": "free", "rates": "free"},
        {name: (*at, Q2) for name, at in SMOOTH.items()},
        shared=OF_SMALL,
        tier="slow",
    ),
    Case(
        "joint_rates",
        functools.partial(nj.joint_rates, NIRYO),
        {"q": "free", "velocity": "free"},
        {"a posture": (Q, VELOCITY)},
        {"home, singular": NoDerivative((np.zeros(6), VELOCITY), LEAST)},
        tier="heavy",
    ),
    Case(
        "joint_rates",
        lambda s, m, q, v, d: nj.joint_rates(built(s, m), q, v, damping=d),
        GEOMETRY | {"q": "free", "velocity": "free", "damping": "free"},
        {"a posture": (Q2, VELOCITY, 0.1), "home": (np.zeros(2), VELOCITY, 0.1)},
        shared=OF_SMALL,
        note="damped, by the geometry",
        tier="slow",
    ),
    Case(
        "joint_rates",
        functools.partial(nj.joint_rates, IIWA),
        {"q": "free", "velocity": "free"},
        {"a posture": (Q7, VELOCITY)},
        {"stretched": NoDerivative((np.zeros(7), VELOCITY), LEAST)},
        note="seven joints",
        tier="slow",
    ),
    *_by_joints("manipulability", "that of one side"),
    *_by_joints("singular_values", "that of the order they are in"),
    *_by_joints("condition_number", "that of one side, 0 where it is infinite"),
    *_by_joints("free_direction", "that with equals held fixed"),
    Case(
        "arm_angle",
        functools.partial(nj.arm_angle, IIWA),
        {"q": "free"},
        {"a posture": (Q7,)},
        {"stretched": NoDerivative((np.zeros(7),), "0")},
        turns=True,
        tier="heavy",
    ),
]
