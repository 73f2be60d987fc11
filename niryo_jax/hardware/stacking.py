"""Four stacked blocks moved into a layout of two by two, as a lab report's third section has it.

The strategy is the report's (Morillo, Mussato and Goncalves, 2021, section 4): vertical approaches
at 5 % of the largest speed, 25 % elsewhere, two stops on the long way, as few joints as possible
moving at once. It leaves the size of its blocks to its figures, but for the height; here they are
30 mm wide, and the cells of the layout as much wider as its margin of 1 mm on each side.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from niryo_jax.chain import forward_kinematics
from niryo_jax.hardware.pick_and_place import AT_REST, Step
from niryo_jax.hardware.simulated.things import footprint
from niryo_jax.lie.rpy import pose_from_rpy, rpy_from_pose
from niryo_jax.robots import NiryoModel

Vector = NDArray[np.float64]

FREE, CAREFUL = 25, 5
"""Percent of the largest speed: on the way, and along the vertical at a stack or a cell."""

PAUSE = 1.0
"""Seconds between two actions."""

TOOL = "gripper_1"

STOPS = 2
"""On the way from above the stack to above the layout."""

_CLEARANCE = 0.02
_PIECE = 0.015
_DOWN = np.array([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)])


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where blocks are stacked, and the cells that they are moved to; metres, space frame.

    Attributes:
        stack: (x, y) of the stack.
        target: (x, y) of the middle of the layout.
        size: of a block along its axes.
        margin: by which a cell is wider than a block, on each side.
    """

    stack: tuple[float, float] = (0.15, -0.15)
    target: tuple[float, float] = (0.15, 0.15)
    size: tuple[float, float, float] = (0.03, 0.03, 0.033)
    margin: float = 1e-3

    @property
    def stacked(self) -> Vector:
        """(4, 4, 4) poses of the middles of the blocks' bases, from the top of the stack down."""
        heights = self.size[2] * np.arange(3, -1, -1)
        return np.array([_upright((*self.stack, z), _azimuth(self.stack)) for z in heights])

    @property
    def cells(self) -> Vector:
        """(4, 4, 4) poses in which the blocks should come to lie, in the same order.

        The cell farthest from the base is filled first, so that the tool never reaches across a
        block that lies already.
        """
        middle = _upright((*self.target, 0.0), _azimuth(self.target))
        return np.array([middle @ _upright((*place, 0.0), 0.0) for place in self.places])

    @property
    def places(self) -> Vector:
        """(4, 2) the middles of the cells seen from that of the layout, x away from the base."""
        signs = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
        return signs * (np.array(self.size[:2]) / 2 + self.margin)


@dataclasses.dataclass(frozen=True)
class Placed:
    """Where a block came to lie, seen from its cell.

    Attributes:
        position: (3,) of the middle of its base in the frame of the cell, metres.
        turn: by which it is turned, radians.
        inside: whether it lies on the table with all of its corners in the cell.
    """

    position: Vector
    turn: float
    inside: bool


def steps_for(layout: Layout, model: NiryoModel, tool: str = TOOL) -> tuple[Step, ...]:
    """The steps that move the blocks, for `pick_and_place.plan`.

    Args:
        layout: what is to be done.
        model: the arm, whose nominal rest it leaves from and returns to.
        tool: on the arm, held upside down, its centre point at the middle of a block.
    """
    rest = np.array(AT_REST)
    turned = np.array([_azimuth(layout.stack), *rest[1:]])
    begin, towards = np.asarray(forward_kinematics(model.robot(), np.stack([rest, turned])), float)
    return (
        Step("Rest", pose=begin, percent=FREE),
        # Joint 1 alone.
        Step("Turn to the stack", pose=towards, percent=FREE),
        *_moves(layout, np.array(model.tools[tool])),
        Step("Rest", pose=begin, percent=FREE),
    )


def judged(layout: Layout, blocks: ArrayLike) -> tuple[Placed, ...]:
    """How the blocks lie.

    Args:
        layout: what was to be done.
        blocks: (4, 4, 4) poses of the middles of their bases, from the top of the stack down.
    """
    room = np.array(layout.size[:2]) / 2 + layout.margin
    out = list[Placed]()
    for cell, block in zip(layout.cells, np.asarray(blocks, float), strict=True):
        seen = np.linalg.inv(cell) @ block
        reach = np.abs(footprint(layout.size, seen)).max(axis=0)
        flat = abs(seen[2, 3]) < layout.size[2] / 2
        out.append(
            Placed(seen[:3, 3], rpy_from_pose(seen)[5], bool(flat and np.all(reach <= room)))
        )
    return tuple(out)


def _moves(layout: Layout, tool: Vector) -> Iterator[Step]:
    """From above the stack to above the stack, four times."""
    centre = _upright(tool, 0.0)
    half = np.array([0.0, 0.0, layout.size[2] / 2])
    height = layout.size[2] * 4 + _CLEARANCE

    def at(place: Vector, turn: float) -> Vector:
        """The tool frame's pose where a block held upright has the middle of its base there."""
        down = _upright(place + half, turn)
        down[:3, :3] = down[:3, :3] @ _DOWN
        return down @ np.linalg.inv(centre)

    def lifted(place: Vector, up: float) -> Vector:
        return np.array([*place[:2], up])

    def along(title: str, place: Vector, turn: float, begin: float, end: float) -> Iterator[Step]:
        """Straight up or down, in pieces so short that the tool hardly leaves the vertical."""
        for z in np.linspace(begin, end, 1 + int(np.ceil(abs(end - begin) / _PIECE)))[1:]:
            yield Step(title, pose=at(lifted(place, float(z)), turn), percent=CAREFUL)

    stack = np.array([*layout.stack, 0.0])
    shares = np.linspace(0, 1, STOPS + 2)
    # About axis 1, so that joints 4 and 6 rest and joint 1 does nearly all.
    turns, lengths = (
        begin + shares * (end - begin)
        for begin, end in (
            (_azimuth(layout.stack), _azimuth(layout.target)),
            (np.hypot(*layout.stack), np.hypot(*layout.target)),
        )
    )
    way = [
        at(np.array([r * np.cos(turn), r * np.sin(turn), height]), turn)
        for r, turn in zip(lengths, turns)
    ]
    for number, (block, cell) in enumerate(zip(layout.stacked, layout.cells), start=1):
        low, turn = float(block[2, 3]), _azimuth(layout.target)
        yield Step(f"Above the stack, block {number}", pose=way[0], percent=FREE)
        yield from along("Descend to the block", stack, turns[0], height, low)
        yield Step("Grip the block", "grasp")
        yield from along("Lift the block", stack, turns[0], low, height)
        for stop in way[1:-1]:
            yield Step("Stop on the way", pose=stop, percent=FREE)
        yield Step("Above the layout", pose=way[-1], percent=FREE)
        place = cell[:3, 3]
        yield Step("Above the cell", pose=at(lifted(place, height), turn), percent=FREE)
        yield from along("Descend to the cell", place, turn, height, 0.0)
        yield Step("Release the block", "release")
        yield from along("Ascend from the cell", place, turn, 0.0, height)
        yield Step("Above the layout", pose=way[-1], percent=FREE)
        for stop in way[-2:0:-1]:
            yield Step("Stop on the way", pose=stop, percent=FREE)


def _upright(place: Sequence[float] | Vector, turn: float) -> Vector:
    return pose_from_rpy((*place, 0.0, 0.0, turn))


def _azimuth(place: tuple[float, float]) -> float:
    return float(np.arctan2(place[1], place[0]))
