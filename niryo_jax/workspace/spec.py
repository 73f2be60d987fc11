"""What a capability map is of: all that its numbers depend on."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from niryo_jax._version import __version__
from niryo_jax.arguments import check_choice, check_count, check_number
from niryo_jax.collision import CollisionCheck
from niryo_jax.ik import Method, method_for
from niryo_jax.ik.results.solutions import SLOTS
from niryo_jax.robot import Robot
from niryo_jax.workspace.description import robot_from, robot_text
from niryo_jax.workspace.extent import box
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.measures import check_collisions, check_length, check_robot
from niryo_jax.workspace.orientations import Orientations, orientations, rotations_of
from niryo_jax.workspace.variables import VOXELS, Variable, variables

Bounds = tuple[ArrayLike, ArrayLike]
"""Lower and upper corner (3,) of a box, metres."""

_CHUNK = 16
_POSES_OF_CHUNK = 2_000_000


class Chunk(NamedTuple):
    """A block of voxels that is computed and stored at once: its number and its place."""

    number: int
    place: tuple[slice, slice, slice]

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many voxels along each axis."""
        x, y, z = (part.stop - part.start for part in self.place)
        return x, y, z


@dataclass(frozen=True, eq=False)
class MapSpec:
    """A robot, a grid of voxels, a set of orientations, and what is to be said of them.

    Attributes:
        robot: the arm.
        grid: the voxels.
        orientations: the set of orientations that are tested at the centre of each.
        quaternions: (M, 4) these as unit quaternions (w, x, y, z), from which all is computed.
        dexterous: smallest singular value from which on a posture counts as clear of singularities.
        length: metres by which the linear rows of the Jacobian are divided for singular values.
        method: how poses are solved.
        full: whether the numbers of every single pose are kept.
        collisions: what a solution has to stay clear of to count, or None.
    """

    robot: Robot
    grid: Grid
    orientations: Orientations
    quaternions: np.ndarray
    dexterous: float
    length: float
    method: Method
    full: bool
    collisions: CollisionCheck | None = None

    @classmethod
    def of(
        cls,
        robot: Robot,
        voxel: float = 0.025,
        bounds: Bounds | None = None,
        orientation_set: int | Orientations = 200,
        dexterous: float = 0.05,
        length: float = 1.0,
        method: Method | None = None,
        full: bool = False,
        collisions: CollisionCheck | None = None,
    ) -> MapSpec:
        """What the arguments of `capability_map` ask for.

        Raises:
            ValueError, TypeError: as `capability_map`.
        """
        check_robot(robot)
        check_length(length)
        check_collisions(robot, collisions)
        check_number("dexterous", dexterous, "a number of at least 0", lambda x: 0 <= x < math.inf)
        if method is not None:
            check_choice("method", method, get_args(Method))
        grid = box(robot, bounds, voxel)
        chosen = orientation_set
        if not isinstance(chosen, Orientations):
            chosen = orientations(check_count("orientations", chosen, 1, sys.maxsize))
        return cls(
            robot,
            grid,
            chosen,
            chosen.quaternions,
            float(dexterous),
            float(length),
            method or method_for(robot),
            full,
            # As a store gives it back, so that both compute with the same bits.
            None if collisions is None else CollisionCheck.from_text(collisions.text()),
        )

    @property
    def poses(self) -> int:
        """How many poses are tested."""
        return self.grid.size * len(self.orientations)

    @property
    def rotations(self) -> np.ndarray:
        """(M, 3, 3) the orientations of the tool, the same bits from a store as from arguments."""
        return rotations_of(self.quaternions)

    @property
    def variables(self) -> dict[str, Variable]:
        """What is stored."""
        return variables(self.full, self.collisions is not None)

    @property
    def sizes(self) -> dict[str, int]:
        """The length of each axis of the variables."""
        return {
            **dict(zip(VOXELS, self.grid.shape)),
            "chunk": self.chunk_count,
            "orientation": len(self.quaternions),
            "solutions": SLOTS + 1,
        }

    @property
    def chunk_edge(self) -> int:
        """Voxels along the edge of a chunk: fewer where each has many poses."""
        edge = _CHUNK
        while edge > 1 and edge**3 * len(self.orientations) > _POSES_OF_CHUNK:
            edge //= 2
        return edge

    def chunks(self) -> Iterator[Chunk]:
        """The chunks of the grid, z fastest."""
        edge = self.chunk_edge
        counts = [-(-size // edge) for size in self.grid.shape]
        for number, index in enumerate(np.ndindex(*counts)):
            x, y, z = (
                slice(i * edge, min((i + 1) * edge, size))
                for i, size in zip(index, self.grid.shape)
            )
            yield Chunk(number, (x, y, z))

    @property
    def chunk_count(self) -> int:
        """How many chunks there are."""
        return math.prod(-(-size // self.chunk_edge) for size in self.grid.shape)

    def share(self, index: int, count: int) -> list[Chunk]:
        """The chunks of one of so many processes: each gets about as many voxels."""
        voxels, mine = [0] * count, list[Chunk]()
        for chunk in sorted(self.chunks(), key=lambda chunk: -math.prod(chunk.shape)):
            least = voxels.index(min(voxels))
            voxels[least] += math.prod(chunk.shape)
            if least == index:
                mine.append(chunk)
        return sorted(mine)

    def attributes(self) -> dict[str, Any]:
        """All that the numbers depend on, as JSON holds it."""
        chosen, collisions = self.orientations, self.collisions
        title = f"Capability map of {self.robot.name}"
        return {
            "title": title if collisions is None else f"{title}, free of collisions",
            "robot_name": self.robot.name,
            "robot": robot_text(self.robot),
            "voxel": self.grid.voxel,
            "first_voxel": list(self.grid.first),
            "shape": list(self.grid.shape),
            "orientations": len(chosen),
            "orientation_kind": chosen.kind,
            "orientation_seed": chosen.seed,
            "orientation_rolls": chosen.rolls,
            "orientation_axis": None if chosen.axis is None else list(chosen.axis),
            "dexterous": self.dexterous,
            "length": self.length,
            "method": self.method,
            "exact": int(self.method == "complete"),
            "full": int(self.full),
            "collisions": None if collisions is None else collisions.text(),
            "dtype": str(jnp.result_type(float)),
            "platform": jax.default_backend(),
            "niryo_jax": __version__,
            "jax": jax.__version__,
        }

    @classmethod
    def from_attributes(cls, attributes: Mapping[str, Any], quaternions: np.ndarray) -> MapSpec:
        """What the attributes of a map and its quaternions (M, 4) say.

        Raises:
            ValueError: an attribute is missing.
        """
        try:
            x, y, z = attributes["first_voxel"]
            nx, ny, nz = attributes["shape"]
            axis = attributes["orientation_axis"]
            # Not an attribute of maps that were made before collisions were looked at.
            collisions = attributes.get("collisions")
            chosen = Orientations(
                rotations_of(quaternions),
                attributes["orientation_kind"],
                attributes["orientation_seed"],
                attributes["orientation_rolls"],
                None if axis is None else tuple(axis),
            )
            return cls(
                robot_from(attributes["robot"]),
                Grid(attributes["voxel"], (x, y, z), (nx, ny, nz)),
                chosen,
                quaternions,
                attributes["dexterous"],
                attributes["length"],
                attributes["method"],
                bool(attributes["full"]),
                None if collisions is None else CollisionCheck.from_text(collisions),
            )
        except KeyError as error:
            raise ValueError(f"map: expected the attribute {error} of a capability map") from None
        except (TypeError, AttributeError) as error:
            raise ValueError(f"map: its attributes are damaged: {error}") from None
