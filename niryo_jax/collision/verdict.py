"""Which solutions of inverse kinematics are free of collisions, and what that says of a pose."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.arguments import shown
from niryo_jax.codes import Code
from niryo_jax.collision.clearance import check_margin, clearance
from niryo_jax.collision.model import CollisionModel
from niryo_jax.collision.world import World
from niryo_jax.ik import IKSolutions, Singularity
from niryo_jax.lanes.batching import check_shape
from niryo_jax.robot import Robot, check_is_robot


class FreeStatus(Code):
    """What becomes of a pose where the arm may not collide; to collide is not to keep a margin."""

    FREE = 0, "A solution within the joint limits is free of collisions."
    COLLIDING_WITHIN_LIMITS = (
        1,
        "Every solution found within the joint limits collides; one outside them does not.",
    )
    COLLIDING = 2, "Solutions were found, and every one of them collides."
    OUTSIDE_LIMITS = (
        3,
        "No solution was found within the joint limits; one outside them is free of collisions.",
    )
    NOT_FOUND = 4, "No solution was found."


_PROVED = "There are no others: it is proved, for the shapes given."
_UNPROVED = "There may be more solutions than were found."
_ENDLESS = "One stands for infinitely many, of which others may be free."
_OF_A_FAMILY = Singularity.SHOULDER, Singularity.WRIST, Singularity.SELF_MOTION


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Free:
    """Which solutions of inverse kinematics are free of collisions.

    Attributes:
        clear: (..., slots) whether the slot holds a solution that keeps the margin, whether or not
            it is within the joint limits.
        clearance: (..., slots) metres; minus infinity where no solution was found.
        status: (...,) a `FreeStatus`: the verdict on each pose.
        proved: (...,) whether it is proved that the arm has no other solutions than these: the set
            is complete, and none of them stands for infinitely many. What `status` says of those
            that were found then holds of all that there are, for the shapes given.
        solutions: what was looked at.
    """

    clear: jax.Array
    clearance: jax.Array
    status: jax.Array
    proved: jax.Array
    solutions: IKSolutions

    @property
    def within(self) -> jax.Array:
        """(..., slots) the solutions that the arm can take: clear, and within the joint limits."""
        return self.clear & self.solutions.within_limits

    @property
    def all_collide(self) -> jax.Array:
        """(...,) whether it is proved that each solution of a pose collides, and there are some."""
        return self.proved & (self.status == FreeStatus.COLLIDING)

    def message(self, index: int | tuple[int, ...] = ()) -> str:
        """What becomes of one pose, in words; where nothing was found, why."""
        status = FreeStatus(int(self.status[index]))
        if status is FreeStatus.NOT_FOUND:
            return self.solutions.message(index)
        if status is FreeStatus.FREE:
            return status.message
        if self.proved[index]:
            known = _PROVED
        else:
            known = _ENDLESS if self.solutions.complete[index] else _UNPROVED
        return f"{status.message} {known}"

    def nearest(self, q_ref: ArrayLike) -> tuple[jax.Array, jax.Array]:
        """The solution nearest to a joint vector of those that are clear and within the limits.

        Whole turns are considered, for they change no distance. Of infinitely many solutions those
        in the slots alone are, for others were not looked at.

        Args:
            q_ref: (..., n) reference joint vectors, radians.

        Returns:
            (..., n) and (...,) as `IKSolutions.nearest`.
        """
        # Joints that are free to the task keep the values for which clearance was found.
        some = dataclasses.replace(self.solutions, within_limits=self.within, free=())
        return some.nearest(q_ref)

    def clearest(self) -> tuple[jax.Array, jax.Array]:
        """The solution of greatest clearance of those that are clear and within the limits.

        Returns:
            (..., n) the joint vectors, the first of several, and (...,) whether there is one; where
            there is none, that of the first slot is returned.
        """
        room = jnp.where(self.within, self.clearance, -jnp.inf)
        best = jnp.argmax(room, axis=-1)[..., None, None]
        chosen = jnp.take_along_axis(self.solutions.q, best, axis=-2)[..., 0, :]
        return chosen, jnp.any(self.within, axis=-1)


def free(
    robot: Robot,
    model: CollisionModel,
    solutions: IKSolutions,
    world: World | None = None,
    margin: float = 0.0,
) -> Free:
    """Which solutions of inverse kinematics are free of collisions, and the verdict on each pose.

    Args:
        robot: the arm that was solved for.
        model, world: as for `clearance`.
        solutions: what `inverse_kinematics` returned, batch axes (...).
        margin: metres by which all is to be apart.

    Returns:
        A `Free`. Where it says that every solution collides, that is a proof where `proved` is
        True: for capsules and obstacles as given, and up to the tolerances of inverse kinematics.
        Joints that are free to a task (`solutions.free`) are looked at where they stand.

    Raises:
        ValueError, TypeError: as `collides`; solutions that are none, or of another arm.
    """
    if not isinstance(solutions, IKSolutions):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"solutions: expected IKSolutions, got {shown(solutions)}")
    margin = check_margin(margin)
    check_is_robot(robot)
    check_shape("solutions", solutions.q, (robot.joints,))
    apart = clearance(robot, model, solutions.q, world)
    clear, apart, status, proved = _judged(apart, solutions, margin)
    return Free(clear, apart, status, proved, solutions)


@jax.jit
def _judged(
    apart: jax.Array, solutions: IKSolutions, margin: float
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """What `Free` says of solutions, of which this is the clearance."""
    apart = jnp.where(solutions.found, apart, -jnp.inf)
    clear = solutions.found & (apart > margin)
    within = solutions.within_limits

    def some(which: jax.Array) -> jax.Array:
        return jnp.any(which, axis=-1)

    status = jnp.select(
        [some(clear & within), ~some(solutions.found), ~some(clear), some(within)],
        [
            jnp.int32(FreeStatus.FREE),
            jnp.int32(FreeStatus.NOT_FOUND),
            jnp.int32(FreeStatus.COLLIDING),
            jnp.int32(FreeStatus.COLLIDING_WITHIN_LIMITS),
        ],
        jnp.int32(FreeStatus.OUTSIDE_LIMITS),
    )
    endless = some(solutions.found & jnp.isin(solutions.singularity, jnp.array(_OF_A_FAMILY)))
    proved = solutions.complete & ~endless & (not solutions.free)
    return clear, apart, status, proved
