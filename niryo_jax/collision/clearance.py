"""How far a robot is from itself and from what stands around it.

The signed distance of two capsules is that of their segments less their radii: negative where they
penetrate. Clearance is the least over all pairs (Lynch & Park, *Modern Robotics*, section 10.2.2).
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.arguments import check_number
from niryo_jax.collision.model import CollisionModel, check_is_model
from niryo_jax.collision.program import Layout, Shapes, all_distances, least_distance, shapes_of
from niryo_jax.collision.world import World, check_is_world
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot, check_is_robot


def clearance(
    robot: Robot, model: CollisionModel, q: ArrayLike, world: World | None = None
) -> jax.Array:
    """The least signed distance of an arm to itself and to the world.

    Args:
        robot: the arm.
        model: its shape.
        q: (..., n) joint vector, radians (metres for prismatic joints).
        world: what stands around it.

    Returns:
        (...,) metres, in the precision of q; negative where something penetrates, infinite where
        the model has no pair and there is no world, NaN where a joint is.

    It can be differentiated once, in both modes, by the joints, the geometry of the arm, the model
    and the world: the derivative is that of the nearest pair at its nearest points, and never NaN.
    Where several pairs are equally near it is that of the first of them, own pairs before those
    with the world; where segments cross it is 0.

    Raises:
        ValueError: q does not have n joints, the model has links that the arm does not.
        TypeError: no robot, model, world or array of real numbers.
    """
    q, shapes, layout = _checked(robot, model, q, world)
    return least_distance(robot, q, shapes, layout=layout)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Distances:
    """The signed distances of all pairs.

    Attributes:
        distance: (..., p) metres; negative where the two penetrate.
        pairs: of each the names of the capsule and of the other capsule, or of the obstacle; those
            of the arm with itself come first; static.
    """

    distance: jax.Array
    pairs: tuple[tuple[str, str], ...] = dataclasses.field(metadata={"static": True})

    @property
    def nearest(self) -> jax.Array:
        """(...,) the index of the pair of least distance, the first of them where several are."""
        return jnp.argmin(self.distance, axis=-1)

    def nearest_pair(self, index: int | tuple[int, ...] = ()) -> tuple[str, str]:
        """The names of the pair of least distance, of one joint vector of the batch."""
        return self.pairs[int(self.nearest[index])]


def distances(
    robot: Robot, model: CollisionModel, q: ArrayLike, world: World | None = None
) -> Distances:
    """The signed distance of every pair that `clearance` is the least of.

    Arguments, derivatives and errors are those of `clearance`.
    """
    q, shapes, layout = _checked(robot, model, q, world)
    names = list(model.pair_names())
    if world is not None:
        names += [
            (capsule, obstacle)
            for obstacle, ignored in zip(world.names, world.ignored)
            for capsule, link in zip(model.names, model.links)
            if link not in ignored
        ]
    return Distances(all_distances(robot, q, shapes, layout=layout), tuple(names))


def collides(
    robot: Robot,
    model: CollisionModel,
    q: ArrayLike,
    world: World | None = None,
    margin: float = 0.0,
) -> jax.Array:
    """Whether an arm comes as near to itself or to the world as a margin, or nearer.

    Args:
        robot, model, q, world: as for `clearance`.
        margin: metres; 0 is a touch.

    Returns:
        (...,) truths; True where a joint is NaN.

    Raises:
        ValueError, TypeError: as `clearance`; a margin that is no finite number.
    """
    margin = check_margin(margin)
    return ~(clearance(robot, model, q, world) > margin)


def check_margin(margin: Any) -> float:
    """A margin, which is a finite number of metres.

    Raises:
        ValueError, TypeError: it is none.
    """
    return check_number("margin", margin, "a finite number", lambda x: bool(np.isfinite(x)))


def check_fits(robot: Robot, model: CollisionModel) -> None:
    """Raise a ValueError unless the arm has all links of the model."""
    if max(model.links) > robot.joints:
        raise ValueError(
            f"model: expected links of an arm of {robot.joints} joints, got link {max(model.links)}"
        )


def _checked(
    robot: Robot, model: CollisionModel, q: ArrayLike, world: World | None
) -> tuple[jax.Array, Shapes, Layout]:
    """The joint vectors, and the shapes in their precision."""
    check_is_robot(robot)
    check_is_model(model)
    check_is_world(world)
    q = as_floating("q", q)
    check_shape("q", q, (robot.joints,))
    check_fits(robot, model)
    return q, *shapes_of(model, world, q)
