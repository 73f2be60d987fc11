"""Colours of the scene and of the panel beside it."""

from __future__ import annotations

from typing import TypeAlias

Colour: TypeAlias = tuple[int, int, int]

BRANCHES: tuple[Colour, ...] = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (213, 94, 0),
    (150, 140, 20),
    (110, 80, 160),
)
"""Of solutions by their branch, most of them told apart by all eyes (Okabe & Ito, 2008)."""

OUTSIDE: Colour = (160, 164, 170)
"""Of a solution outside the joint limits."""

LINKS: tuple[Colour, Colour] = (66, 74, 86), (222, 226, 232)
"""Of the links of the arm, in turn."""

LIVE: Colour = (238, 110, 30)
"""Of the arm that is read from a robot."""

FREE: Colour = (60, 160, 90)
NEAR: Colour = (235, 160, 30)
TOUCHING: Colour = (205, 50, 45)
"""Of capsules that are apart, nearly touch, or penetrate."""

MOTION: Colour = (40, 130, 220)
ERROR: Colour = (200, 60, 140)
"""Of the two ellipsoids."""

PATH: Colour = (30, 34, 40)
THING: Colour = (210, 140, 60)


def of_branch(branch: int) -> Colour:
    """The colour of a branch; that of its eighth neighbour is the same."""
    return BRANCHES[branch % len(BRANCHES)]


def as_css(colour: Colour) -> str:
    """A colour as a style sheet takes it."""
    return "#" + "".join(f"{part:02x}" for part in colour)
