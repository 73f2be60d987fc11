"""The one result type of inverse kinematics, its statuses, and angles within limits."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from enum import IntEnum

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.jacobian import manipulability
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot
from niryo_jax.tolerances import LIMIT_ROUNDING

SLOTS = 16
"""The most that are returned; a six-axis arm has at most 16 isolated solutions (Manseur & Doty)."""


class IKStatus(IntEnum):
    """What became of one pose."""

    SOLVED = 0
    OUTSIDE_LIMITS = 1
    UNREACHABLE = 2
    UNDECIDED = 3
    INVALID_POSE = 4

    @property
    def message(self) -> str:
        """The meaning, as a sentence."""
        return _STATUS[self]


_STATUS = {
    IKStatus.SOLVED: "At least one solution lies within the joint limits.",
    IKStatus.OUTSIDE_LIMITS: "The pose can be reached, but only outside the joint limits.",
    IKStatus.UNREACHABLE: "The pose cannot be reached, whatever the joint angles.",
    IKStatus.UNDECIDED: "No solution was found, and it is not proved that there is none.",
    IKStatus.INVALID_POSE: "The pose is not a rigid motion: an entry is not finite, the last row "
    "is not (0, 0, 0, 1), or the rotation block is too far from a rotation; or the value of a "
    "locked joint is not finite.",
}


class Obstacle(IntEnum):
    """Why a pose is out of reach."""

    NONE = 0
    TOO_FAR = 1
    TOO_NEAR = 2
    NO_ROOT = 3
    NO_SOLUTION = 4

    @property
    def message(self) -> str:
        """The meaning, as a sentence."""
        return _OBSTACLE[self]


_OBSTACLE = {
    Obstacle.NONE: "Nothing proves that the pose is out of reach.",
    Obstacle.TOO_FAR: "Wherever the wrist may be for this pose, it is farther from the shoulder "
    "than the stretched arm is long.",
    Obstacle.TOO_NEAR: "Wherever the wrist may be for this pose, it is nearer to the shoulder than "
    "the folded arm can bring it.",
    Obstacle.NO_ROOT: "The wrist can be placed, but axes 4 and 5 can then never supply the rest of "
    "the rotation: the condition for it has no root, by a bound on how fast it varies.",
    Obstacle.NO_SOLUTION: "The equations of the closed form have no real solution: the pose is too "
    "far away, or none that an arm of fewer than six joints or with a locked joint can take.",
}


class Singularity(IntEnum):
    """Why a solution's derivatives are not those of an isolated solution."""

    NONE = 0
    SHOULDER = 1
    ELBOW = 2
    WRIST = 3
    MERGED = 4
    SELF_MOTION = 5

    @property
    def message(self) -> str:
        """The meaning, as a sentence."""
        return _SINGULARITY[self]


_SINGULARITY = {
    Singularity.NONE: "The solution is regular.",
    Singularity.SHOULDER: "The wrist point lies on axis 1, which can turn without moving it: one "
    "of infinitely many solutions.",
    Singularity.ELBOW: "The arm is stretched or folded: two solutions are one here.",
    Singularity.WRIST: "Two axes are aligned (4 and 6 of six with a spherical wrist) and can turn "
    "against each other: one of infinitely many solutions.",
    Singularity.MERGED: "Two solutions are one here, or nearly: the Jacobian is singular.",
    Singularity.SELF_MOTION: "The arm can move while the tool rests: one of infinitely many "
    "solutions.",
}


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class IKSolutions:
    """All solutions found for a batch of poses, best first.

    Attributes:
        q: (..., slots, n) joint vectors; angles in (-pi, pi], or the 2 pi turn within the limits.
            Slots that are not `found` hold zeros.
        found: (..., slots) whether the slot holds a solution.
        within_limits: (..., slots) whether it is also within the joint limits.
        position_error, rotation_error: (..., slots) metres and radians by which forward kinematics
            of q misses the pose; infinite where not `found`.
        label: (..., slots) which solution this is: 1 if the wrist reaches behind axis 1 (along
            P2 of docs/theory/complete-ik.md), plus 2 if the elbow angle is positive, plus 4 if
            theta_5 is, plus 8 times the number of solutions before it that are alike in all three
            (which can change along a path); for the other families the number of the choice of
            roots; -1 where not `found`, or where the method has none.
        singularity: (..., slots) a `Singularity`; derivatives there are the least that follow the
            pose, and not those of an isolated solution.
        status: (...,) an `IKStatus`.
        obstacle: (...,) an `Obstacle`: what proves that an UNREACHABLE pose is.
        complete: (...,) whether it is proved that there are no other solutions (for the value of
            the joint that is locked, if one is).
        count: (...,) the number of solutions found.
        pose_distance: (...,) distance of the pose as given from the rigid motion that was
            solved for (Frobenius norm).
        lower, upper: (n,) the joint limits used.
        periodic: n flags, True for a joint that returns to its place after 2 pi; static.

    Solutions within the limits come first, those with the largest margin to the limits
    before the others.
    """

    q: jax.Array
    found: jax.Array
    within_limits: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array
    label: jax.Array
    singularity: jax.Array
    status: jax.Array
    obstacle: jax.Array
    complete: jax.Array
    count: jax.Array
    pose_distance: jax.Array
    lower: jax.Array
    upper: jax.Array
    periodic: tuple[bool, ...] = dataclasses.field(metadata={"static": True})

    def map(self, function: Callable[[jax.Array], jax.Array]) -> IKSolutions:
        """The answers with a function applied to every array that has the batch axes in front.

        For example `solutions.map(lambda x: x[0])` for the first pose of a batch.
        """
        return map_solutions(function, self)

    def message(self, index: int | tuple[int, ...] = ()) -> str:
        """What became of one pose, in words."""
        status = IKStatus(int(self.status[index]))
        if status is IKStatus.UNREACHABLE:
            return f"{status.message} {Obstacle(int(self.obstacle[index])).message}"
        codes = {int(x) for x in np.asarray(self.singularity[index])[np.asarray(self.found[index])]}
        notes = [Singularity(code).message for code in sorted(codes - {Singularity.NONE})]
        if status in (IKStatus.SOLVED, IKStatus.OUTSIDE_LIMITS) and not self.complete[index]:
            notes.append("There may be more solutions than were found.")
        return " ".join([status.message, *notes])

    def farthest_from_limits(self) -> tuple[jax.Array, jax.Array]:
        """The solution farthest within the limits: (..., n), and (...,) whether there is one."""
        return self.q[..., 0, :], self.within_limits[..., 0]

    def most_manipulable(self, robot: Robot) -> tuple[jax.Array, jax.Array]:
        """The solution of greatest `manipulability` within the limits, and whether there is one.

        Args:
            robot: the arm that was solved for.
        """
        measure = jnp.where(self.within_limits, manipulability(robot, self.q), -1.0)
        best = jnp.argmax(measure, axis=-1)[..., None]
        chosen = jnp.take_along_axis(self.q, best[..., None], axis=-2)[..., 0, :]
        return chosen, jnp.any(self.within_limits, axis=-1)

    def nearest(self, q_ref: ArrayLike) -> tuple[jax.Array, jax.Array]:
        """The solution within the limits that is nearest to a joint vector, 2 pi turns considered.

        Args:
            q_ref: (..., n) reference joint vectors, radians.

        Returns:
            (..., n) the joint vectors whose largest joint difference from q_ref is least, and
            (...,) whether there is one; where there is none, q_ref is returned.
        """
        reference = as_floating("q_ref", q_ref).astype(self.q.dtype)
        check_shape("q_ref", reference, (self.q.shape[-1],))
        return _nearest(self, reference)


jax.export.register_pytree_node_serialization(
    IKSolutions,
    serialized_name="niryo_jax.IKSolutions",
    serialize_auxdata=lambda aux: json.dumps(aux).encode(),
    deserialize_auxdata=lambda text: tuple(map(tuple, json.loads(text))),
)


def map_solutions(function: Callable[..., jax.Array], *parts: IKSolutions) -> IKSolutions:
    """`jax.tree.map` of the arrays with the batch axes in front; the rest is that of the first."""
    batched = {
        field.name: function(*(getattr(part, field.name) for part in parts))
        for field in dataclasses.fields(IKSolutions)
        if field.name not in ("lower", "upper", "periodic")
    }
    return dataclasses.replace(parts[0], **batched)


@jax.jit
def _nearest(solutions: IKSolutions, reference: jax.Array) -> tuple[jax.Array, jax.Array]:
    target = reference[..., None, :]
    limits = solutions.lower, solutions.upper
    turned = nearest_turn(solutions.q, target, *limits, solutions.periodic)
    distance = jnp.max(jnp.abs(turned - target), axis=-1)
    distance = jnp.where(solutions.within_limits & jnp.isfinite(distance), distance, jnp.inf)
    best = jnp.argmin(distance, axis=-1)[..., None]
    ok = jnp.isfinite(jnp.take_along_axis(distance, best, axis=-1))[..., 0]
    chosen = jnp.take_along_axis(solutions.q, best[..., None], axis=-2)[..., 0, :]
    chosen = nearest_turn(chosen, reference, *limits, solutions.periodic)
    return jnp.where(ok[..., None], chosen, reference), ok


def nearest_turn(
    q: jax.Array, target: jax.Array, lower: jax.Array, upper: jax.Array, periodic: tuple[bool, ...]
) -> jax.Array:
    """q shifted by whole turns to lie as near to `target` as the limits allow.

    A joint that no turn brings within its limits comes as near to `target` as a turn can.
    """
    turns = jnp.round((target - q) / (2 * jnp.pi))
    rounding = LIMIT_ROUNDING.of(q.dtype)
    most = jnp.floor((upper - q + rounding) / (2 * jnp.pi))
    least = jnp.ceil((lower - q - rounding) / (2 * jnp.pi))
    allowed = jnp.where(most >= least, jnp.clip(turns, least, most), turns)
    return q + jnp.where(jnp.array(periodic), 2 * jnp.pi * allowed, 0.0)


def wrap_into_limits(
    q: jax.Array, lower: jax.Array, upper: jax.Array, periodic: tuple[bool, ...]
) -> jax.Array:
    """Angles in (-pi, pi], or the turn nearest to that range which lies within the limits.

    Todorovic et al., eq. 2.
    """
    wrapped = q - 2 * jnp.pi * jnp.ceil((q - jnp.pi) / (2 * jnp.pi))
    # Rounding can leave the angle a hair outside on either side; zero turns is then the answer.
    wrapped = jnp.where(jnp.array(periodic), wrapped, q)
    inside = (wrapped >= lower) & (wrapped <= upper)
    turned = nearest_turn(wrapped, jnp.zeros_like(q), lower, upper, periodic)
    return jnp.where(inside, wrapped, turned)


def less_turns(difference: jax.Array, periodic: tuple[bool, ...]) -> jax.Array:
    """Differences (..., n) of joint vectors less the whole turns in them."""
    turns = jnp.round(difference / (2 * jnp.pi))
    return difference - jnp.where(jnp.array(periodic), 2 * jnp.pi * turns, 0.0)


def limit_margin(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """(..., n) -> (...,): the least distance of a joint to a limit, negative outside, radians."""
    return jnp.min(jnp.minimum(q - lower, upper - q), axis=-1)


def are_within_limits(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """(..., n) -> (...,): whether every joint lies within its limits, up to rounding."""
    return limit_margin(q, lower, upper) >= -LIMIT_ROUNDING.of(q.dtype)
