"""The arms of Pardos-Gotor's book, as data with a named source.

Axes, home poses and limits are facts read from J. M. Pardos-Gotor, "Screw Theory for Robotics"
(2018) and "Screw Theory in Robotics" (2022), and from the exercises published with them, by the
numbers of which the sources are named. The geometry is that of 2022 where nothing else is said.
"""

from __future__ import annotations

import dataclasses

from niryo_jax.robots.book_model import BookModel

IRB120 = BookModel(
    name="abb_irb120",
    joints=(
        ("z", (0.0, 0.0, 0.0)),
        ("y", (0.0, 0.0, 0.29)),
        ("y", (0.0, 0.0, 0.56)),
        ("x", (0.302, 0.0, 0.63)),
        ("y", (0.302, 0.0, 0.63)),
        ("-z", (0.302, 0.0, 0.63)),
    ),
    tool=("-x", "y", "-z"),
    tool_point=(0.302, 0.0, 0.47),
    limits={
        "exercise 7.2.2a": (
            (-165.0, 165.0),
            (-110.0, 110.0),
            (-110.0, 70.0),
            (-160.0, 160.0),
            (-120.0, 120.0),
            (-400.0, 400.0),
        ),
    },
    source="exercise 4.4.2a of 2022",
)

IRB120_UP = dataclasses.replace(
    IRB120,
    name="abb_irb120_up",
    joints=(*IRB120.joints[:5], ("z", (0.302, 0.0, 0.63))),
    tool=("-x", "-y", "z"),
    tool_point=(0.302, 0.0, 0.79),
    limits={"exercise 7.2.3a": IRB120.limits["exercise 7.2.2a"]},
    source="exercise 4.4.3 of 2022, with joints 2, 3 and 5 counted as in exercise 4.4.2a",
)

IRB1600 = BookModel(
    name="abb_irb1600",
    joints=(
        ("z", (0.0, 0.0, 0.0)),
        ("y", (0.15, 0.0, 0.4865)),
        ("y", (0.15, 0.0, 0.9615)),
        ("x", (0.75, 0.0, 0.9615)),
        ("y", (0.75, 0.0, 0.9615)),
        ("x", (0.75, 0.0, 0.9615)),
    ),
    tool=("-z", "y", "x"),
    tool_point=(0.9, 0.0, 0.9615),
    limits={
        "exercise 7.2.4a": (
            (-180.0, 180.0),
            (-63.0, 136.0),
            (-235.0, 55.0),
            (-200.0, 200.0),
            (-115.0, 115.0),
            (-400.0, 400.0),
        ),
        "exercise 6.2.4": (
            (-180.0, 180.0),
            (-90.0, 150.0),
            (-245.0, 65.0),
            (-190.0, 190.0),
            (-115.0, 115.0),
            (-400.0, 400.0),
        ),
        "exercise 5.3.11": (
            (-180.0, 180.0),
            (-90.0, 120.0),
            (-245.0, 65.0),
            (-200.0, 200.0),
            (-115.0, 115.0),
            (-400.0, 400.0),
        ),
    },
    source="exercise 4.4.4 of 2022",
)

IRB6620LX = BookModel(
    name="abb_irb6620lx",
    joints=(
        ("z", None),
        ("-z", (1.468, 2.5, 0.0)),
        ("-z", (2.443, 2.5, 0.0)),
        ("-y", (2.643, 1.613, 0.0)),
        ("-z", (2.643, 1.613, 0.0)),
        ("x", (2.643, 1.613, 0.0)),
    ),
    tool=("-y", "-z", "x"),
    tool_point=(3.0, 1.613, 0.0),
    limits={
        "exercise 6.2.5": (
            (1.8, 33.0),
            (-125.0, 125.0),
            (-180.0, 70.0),
            (-300.0, 300.0),
            (-130.0, 130.0),
            (-300.0, 300.0),
        ),
    },
    source="exercise 4.4.5 of 2022",
)

IRB910SC = BookModel(
    name="abb_irb910sc",
    joints=(
        ("y", (0.0, 0.0, 0.0)),
        ("y", (0.4, 0.0, 0.0)),
        ("y", None),
        ("-y", (0.65, 0.0, 0.0)),
    ),
    tool=("-x", "-z", "-y"),
    tool_point=(0.65, 0.125, 0.0),
    limits={
        "exercise 6.2.6": ((-140.0, 140.0), (-150.0, 150.0), (-0.18, 0.0), (-400.0, 400.0)),
    },
    source="exercise 4.4.6a of 2022",
)

IIWA14 = BookModel(
    name="kuka_iiwa14",
    joints=(
        ("z", (0.0, 0.0, 0.0)),
        ("y", (0.0, 0.0, 0.36)),
        ("z", (0.0, 0.0, 0.36)),
        ("-y", (0.0, 0.0, 0.78)),
        ("z", (0.0, 0.0, 0.78)),
        ("y", (0.0, 0.0, 1.18)),
        ("z", (0.0, 0.0, 1.18)),
    ),
    tool=("x", "y", "z"),
    tool_point=(0.0, 0.0, 1.38),
    limits={
        "exercise 5.3.15": (
            (-170.0, 170.0),
            (-120.0, 120.0),
            (-170.0, 170.0),
            (-120.0, 120.0),
            (-170.0, 170.0),
            (-120.0, 120.0),
            (-175.0, 175.0),
        ),
    },
    source="exercise 4.4.8 of 2022",
)

# theta_6 = 90 degrees - theta_6 of the upright home, and its range likewise.
IIWA14_SIDE_TOOL = dataclasses.replace(
    IIWA14,
    joints=(*IIWA14.joints[:5], ("-y", (0.0, 0.0, 1.18)), ("x", (0.0, 0.0, 1.18))),
    tool=("-z", "y", "x"),
    tool_point=(0.2, 0.0, 1.18),
    limits={
        "exercise 5.3.15": (
            *IIWA14.limits["exercise 5.3.15"][:5],
            (-30.0, 210.0),
            (-175.0, 175.0),
        ),
    },
    source="exercise 3.3.9 of 2022",
)

# Y is up. theta_4 = theta_4 of the upright home + 90 degrees; theta_6 as with the side tool.
IIWA14_BENT = dataclasses.replace(
    IIWA14,
    joints=(
        ("y", (0.0, 0.36, 0.0)),
        ("-z", (0.0, 0.36, 0.0)),
        ("y", (0.0, 0.36, 0.0)),
        ("z", (0.0, 0.78, 0.0)),
        ("x", (0.4, 0.78, 0.0)),
        ("z", (0.4, 0.78, 0.0)),
        ("-y", (0.4, 0.78, 0.0)),
    ),
    tool=("z", "-x", "-y"),
    tool_point=(0.4, 0.58, 0.0),
    limits={
        "exercise 5.3.15": (
            *IIWA14.limits["exercise 5.3.15"][:3],
            (-30.0, 210.0),
            (-170.0, 170.0),
            (-30.0, 210.0),
            (-175.0, 175.0),
        ),
    },
    source="exercise E060 80 of 2018",
)

UR16E = BookModel(
    name="ur16e",
    joints=(
        ("z", (0.0, 0.0, 0.0)),
        ("y", (0.0, 0.0, 0.181)),
        ("y", (0.478, 0.0, 0.181)),
        ("y", (0.838, 0.174, 0.181)),
        ("-z", (0.838, 0.174, 0.061)),
        ("y", (0.838, 0.364, 0.061)),
    ),
    tool=("-x", "z", "y"),
    tool_point=(0.838, 0.364, 0.061),
    limits={"exercise 6.2.7": ((-360.0, 360.0),) * 6},
    source="exercise 4.4.7 of 2022",
)

RTTR = BookModel(
    name="rttr",
    joints=(
        ("z", (0.0, 0.0, 0.0)),
        ("z", None),
        ("x", None),
        ("x", (0.0, 0.0, 1.0)),
    ),
    tool=("y", "z", "x"),
    tool_point=(4.0, 0.0, 1.0),
    limits={},
    source="exercise E030 02 of 2018",
)
