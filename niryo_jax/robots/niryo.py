"""The Niryo arms, as data with a named source.

Geometry, limits, speeds and tools of the Niryo arms are facts read from NiryoRobotics/ned_ros
v5.6.3 (robot description, MoveIt joint limits, arm commander) and, for tools, v4.1.1; the screws
and home pose of the Niryo One equal Table 3.2 of Todorovic et al., "Application of Screw Theory
and its Implementation in Python for Controlling a Niryo One Manipulator" (2024).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from niryo_jax.arguments import check_text
from niryo_jax.robot import Robot


@dataclasses.dataclass(frozen=True)
class NiryoModel:
    """What is known of one Niryo arm. Lengths in metres, angles in degrees, speeds in rad/s.

    Attributes:
        name: identifier, as in `robots.niryo_one`.
        shoulder, elbow, wrist: axis 2, axis 3 and the meeting point of axes 4 and 5 in the
            x-z plane of the space frame at q = 0: (x, z).
        axis_6_height: z of axis 6 at q = 0; differs from the wrist's by the wrist offset L8.
        tool: (x, z) of the home position of the tool frame.
        limits_deg: source name -> ((lower, upper), ...) per joint. The first is the default.
        max_velocity: largest speed of each joint (MoveIt configuration of the robot).
        max_acceleration: rad/s^2, of the same source.
        position_bounds: source ranges ((low, high), ...) of x, y, z that the robot's own command
            validation accepts for the tool frame.
        tools: tool name -> translation of the tool centre point in the tool frame.
        source: where the numbers come from.
    """

    name: str
    shoulder: tuple[float, float]
    elbow: tuple[float, float]
    wrist: tuple[float, float]
    axis_6_height: float
    tool: tuple[float, float]
    limits_deg: Mapping[str, tuple[tuple[float, float], ...]]
    max_velocity: tuple[float, ...]
    max_acceleration: tuple[float, ...]
    position_bounds: tuple[tuple[float, float], ...]
    tools: Mapping[str, tuple[float, float, float]]
    source: str = "NiryoRobotics/ned_ros v5.6.3"

    def robot(self, limits: str | None = None) -> Robot:
        """The arm as a `Robot`, with the joint limits of the named source."""
        if limits is not None:
            check_text("limits", limits)
        source = next(iter(self.limits_deg)) if limits is None else limits
        if source not in self.limits_deg:
            known = ", ".join(self.limits_deg)
            raise ValueError(f"limits: {source!r} is not a source of {self.name}; known: {known}")
        lower, upper = np.deg2rad(np.array(self.limits_deg[source])).T
        (sx, sz), (ex, ez), (wx, wz) = self.shoulder, self.elbow, self.wrist
        home = np.eye(4)
        home[[0, 2], 3] = self.tool
        screws = [
            [0, 0, 1, 0, 0, 0],
            [0, -1, 0, sz, 0, -sx],
            [0, -1, 0, ez, 0, -ex],
            [1, 0, 0, 0, wz, 0],
            [0, -1, 0, wz, 0, -wx],
            [1, 0, 0, 0, self.axis_6_height, 0],
        ]
        return Robot.from_screws(screws, home, lower=lower, upper=upper, name=self.name)


NIRYO_ONE = NiryoModel(
    name="niryo_one",
    shoulder=(0.0, 0.183),
    elbow=(0.0, 0.393),
    wrist=(0.2215, 0.423),
    axis_6_height=0.4175,
    tool=(0.2452, 0.4175),
    limits_deg={
        "ned_ros": (
            (-175.0, 175.0),
            (-109.44, 36.67),
            (-79.89, 89.96),
            (-174.76, 175.0),
            (-100.0, 110.01),
            (-144.96, 144.96),
        ),
        "niryo_one_ros": (
            (-175.0, 175.0),
            (-110.0, 36.68),
            (-80.07, 90.0),
            (-175.0, 175.0),
            (-100.0, 110.0),
            (-147.5, 147.5),
        ),
    },
    max_velocity=(2.2, 2.0, 2.0, 2.0, 2.0, 2.0),
    max_acceleration=(1.5, 1.5, 1.4, 1.3, 1.5, 1.0),
    position_bounds=((-0.5, 0.5), (-0.5, 0.5), (-0.15, 0.65)),
    tools={
        "none": (0.0, 0.0, 0.0),
        "gripper_1": (0.085, 0.0, -0.0075),
        "gripper_2": (0.117, 0.0, -0.015),
        "gripper_3": (0.13, 0.0, -0.0175),
        "electromagnet_1": (0.032, 0.0, 0.025),
        "vacuum_pump_1": (0.041, 0.0, -0.01),
    },
)

NIRYO_NED = NiryoModel(
    name="niryo_ned",
    shoulder=(0.0, 0.1715),
    elbow=(0.012, 0.3925),
    wrist=(0.247, 0.425),
    axis_6_height=0.43425,
    tool=(0.2882, 0.43425),
    limits_deg={
        "ned_ros": (
            (-170.0, 170.0),
            (-109.44, 34.96),
            (-76.78, 89.96),
            (-119.75, 119.75),
            (-110.01, 60.17),
            (-144.96, 144.96),
        ),
    },
    max_velocity=(2.4, 1.6, 1.7, 3.14, 3.14, 3.14),
    max_acceleration=(2.2, 1.5, 1.6, 3.0, 3.0, 4.0),
    position_bounds=((-0.5, 0.5), (-0.5, 0.5), (-0.15, 0.6)),
    tools={
        "none": (0.0, 0.0, 0.0),
        "gripper_1": (0.085, 0.0, 0.0),
        "gripper_2": (0.113, 0.0, 0.0),
        "gripper_3": (0.1215, 0.0, 0.0),
        "electromagnet_1": (0.0225, 0.0, 0.0),
        "vacuum_pump_1": (0.047, 0.0, 0.0),
    },
)

NIRYO_NED2 = NiryoModel(
    name="niryo_ned2",
    shoulder=(0.0, 0.1663),
    elbow=(0.012, 0.3873),
    wrist=(0.247, 0.4198),
    axis_6_height=0.42905,
    tool=(0.2952, 0.42905),
    limits_deg={
        "ned_ros": (
            (-171.88, 171.88),
            (-105.0, 34.96),
            (-76.78, 89.96),
            (-119.75, 119.75),
            (-110.01, 110.17),
            (-144.96, 144.96),
        ),
    },
    max_velocity=(1.57, 1.047, 1.57, 3.14, 3.14, 3.14),
    max_acceleration=(2.0, 0.8, 2.0, 3.0, 3.0, 3.0),
    position_bounds=((-0.5, 0.5), (-0.5, 0.5), (-0.15, 0.6)),
    tools={
        "none": (0.0, 0.0, 0.0),
        "gripper_1": (0.085, 0.0, 0.0),
        "gripper_2": (0.11, 0.0, 0.0),
        "gripper_3": (0.114, 0.0, 0.0),
        "electromagnet_1": (0.027, 0.0, 0.0),
        "vacuum_pump_1": (0.045, 0.0, 0.0),
        "vacuum_pump_2": (0.035, 0.0, 0.0),
    },
)

MODELS: Mapping[str, NiryoModel] = {m.name: m for m in (NIRYO_ONE, NIRYO_NED, NIRYO_NED2)}


def niryo_one(limits: str = "ned_ros") -> Robot:
    """The Niryo One.

    `limits` names their source: "ned_ros" (as in the paper's Table 3.1), or "niryo_one_ros", the
    command validation of the robot's original system, hardware version 2.
    """
    return NIRYO_ONE.robot(limits)


def niryo_ned() -> Robot:
    """The Niryo Ned."""
    return NIRYO_NED.robot()


def niryo_ned2() -> Robot:
    """The Niryo Ned2."""
    return NIRYO_NED2.robot()
