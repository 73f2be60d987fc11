"""What an arm may not touch, and how near it may come: in one record, and as text."""

from __future__ import annotations

import dataclasses
import functools
import json
from typing import Any

import jax
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.collision.clearance import (
    Distances,
    check_fits,
    check_margin,
    clearance,
    distances,
)
from niryo_jax.collision.model import CollisionModel, check_is_model
from niryo_jax.collision.tree import Record
from niryo_jax.collision.verdict import Free, free
from niryo_jax.collision.world import World, check_is_world
from niryo_jax.ik import IKSolutions
from niryo_jax.robot import Robot


@dataclasses.dataclass(frozen=True, eq=False)
class CollisionCheck:
    """The shape of an arm, what stands around it, and the margin to keep.

    Attributes:
        model: the shape of the arm.
        world: what stands around it, or None.
        margin: metres by which all is to be apart.

    Raises:
        ValueError, TypeError: no model, no world, no finite margin.
    """

    model: CollisionModel
    world: World | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        check_is_model(self.model)
        check_is_world(self.world)
        object.__setattr__(self, "margin", check_margin(self.margin))

    def clearance(self, robot: Robot, q: ArrayLike) -> jax.Array:
        """`clearance` of joint vectors (..., n): (...,) metres, the margin not taken off."""
        return clearance(robot, self.model, q, self.world)

    def distances(self, robot: Robot, q: ArrayLike) -> Distances:
        """`distances` of joint vectors (..., n)."""
        return distances(robot, self.model, q, self.world)

    def keeps(self, robot: Robot, q: ArrayLike) -> jax.Array:
        """(...,) whether joint vectors (..., n) keep the margin; False where a joint is NaN."""
        return self.clearance(robot, q) > self.margin

    def free(self, robot: Robot, solutions: IKSolutions) -> Free:
        """`free` of solutions of inverse kinematics."""
        return free(robot, self.model, solutions, self.world, self.margin)

    def check_arm(self, robot: Robot) -> None:
        """Raise a ValueError unless the arm has all links of the model."""
        check_fits(robot, self.model)

    def text(self) -> str:
        """All of it as a JSON document, from which `from_text` makes it again to the last bit.

        Raises:
            TypeError: something of it is traced.
        """
        world = None if self.world is None else _fields(self.world)
        document = {"model": _fields(self.model), "world": world, "margin": self.margin}
        return json.dumps(document, allow_nan=False)

    @classmethod
    def from_text(cls, text: str) -> CollisionCheck:
        """What a JSON document says: one record for one text, so that programs are made once.

        Raises:
            ValueError: the text is not such a document.
        """
        return _from_text(text)


@functools.lru_cache(maxsize=16)
def _from_text(text: str) -> CollisionCheck:
    try:
        document = json.loads(text)
        world = document["world"]
        return CollisionCheck(
            CollisionModel(**_record(document["model"])),
            None if world is None else World(**_record(world)),
            document["margin"],
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(
            f"expected the JSON document of a collision check, got {str(text)[:80]!r}"
        ) from error


def _fields(record: Record) -> dict[str, Any]:
    """The fields of a record for JSON; arrays with their shapes, for they may be empty."""
    if not is_concrete(*jax.tree.leaves(record)):
        raise TypeError(
            f"collisions: expected a concrete {type(record).__name__}, got a traced one"
        )
    out = dict[str, Any]()
    for field in dataclasses.fields(record):  # pyright: ignore[reportArgumentType]
        value = getattr(record, field.name)
        if not isinstance(value, tuple):
            array = np.asarray(value, np.float64)
            value = {"shape": list(array.shape), "numbers": array.ravel().tolist()}
        out[field.name] = value
    return out


def _record(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a record as it takes them."""
    return {
        name: np.reshape(np.array(value["numbers"], np.float64), value["shape"])
        if isinstance(value, dict)
        else _tuples(value)
        for name, value in fields.items()
    }


def _tuples(value: Any) -> Any:
    """Lists of JSON as the tuples they were."""
    return tuple(_tuples(one) for one in value) if isinstance(value, list) else value
