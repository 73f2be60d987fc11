"""The one result type of inverse kinematics, its statuses, and angles within limits."""

from __future__ import annotations

import dataclasses
from enum import IntEnum

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.tolerances import LIMIT_ROUNDING

SLOTS = 16
"""A six-axis arm has at most 16 isolated solutions (Manseur & Doty)."""


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
    IKStatus.UNREACHABLE: "The pose cannot be reached: the wrist would be too far from the "
    "shoulder, or too near, whatever the joint angles.",
    IKStatus.UNDECIDED: "No solution was found, and this method cannot prove that there is none.",
    IKStatus.INVALID_POSE: "The pose is not a rigid motion: an entry is not finite, the last row "
    "is not (0, 0, 0, 1), or the rotation block is too far from a rotation.",
}


class BranchStatus(IntEnum):
    """What became of one branch, that is, of one slot."""

    SOLVED = 0
    OUTSIDE_LIMITS = 1
    DUPLICATE = 2
    NOT_CONVERGED = 3
    NO_GUESS = 4
    EMPTY = 5

    @property
    def message(self) -> str:
        """The meaning, as a sentence."""
        return _BRANCH[self]


_BRANCH = {
    BranchStatus.SOLVED: "A solution within the joint limits.",
    BranchStatus.OUTSIDE_LIMITS: "A solution, but a joint is outside its limits.",
    BranchStatus.DUPLICATE: "Dropped: Newton-Raphson ended at the solution of another branch.",
    BranchStatus.NOT_CONVERGED: "Dropped: Newton-Raphson did not converge from this guess.",
    BranchStatus.NO_GUESS: "Dropped: the arm with a spherical wrist has no solution in this "
    "branch, and Newton-Raphson did not converge from its closest approach.",
    BranchStatus.EMPTY: "No branch belongs to this slot.",
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
        branch: (..., slots) a `BranchStatus`: why the slot does not hold a solution within limits.
        status: (...,) an `IKStatus`.
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
    branch: jax.Array
    status: jax.Array
    count: jax.Array
    pose_distance: jax.Array
    lower: jax.Array
    upper: jax.Array
    periodic: tuple[bool, ...] = dataclasses.field(metadata={"static": True})

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
        target = reference[..., None, :]
        turned = nearest_turn(self.q, target, self.lower, self.upper, self.periodic)
        distance = jnp.max(jnp.abs(turned - target), axis=-1)
        distance = jnp.where(self.within_limits & jnp.isfinite(distance), distance, jnp.inf)
        best = jnp.argmin(distance, axis=-1)[..., None]
        ok = jnp.isfinite(jnp.take_along_axis(distance, best, axis=-1))[..., 0]
        chosen = jnp.take_along_axis(turned, best[..., None], axis=-2)[..., 0, :]
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


def limit_margin(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """(..., n) -> (...,): the least distance of a joint to a limit, negative outside, radians."""
    return jnp.min(jnp.minimum(q - lower, upper - q), axis=-1)


def are_within_limits(q: jax.Array, lower: jax.Array, upper: jax.Array) -> jax.Array:
    """(..., n) -> (...,): whether every joint lies within its limits, up to rounding."""
    return limit_margin(q, lower, upper) >= -LIMIT_ROUNDING.of(q.dtype)
