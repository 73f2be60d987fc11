"""What velocity inverse kinematics returns."""

from __future__ import annotations

import dataclasses

import jax

from niryo_jax.codes import Code


class VelocityStatus(Code):
    """What became of a twist."""

    REACHED = 0, "The tool moves as asked."
    LIMITED = 1, "Limits keep the tool from moving as asked; no rates within them come nearer."
    SINGULAR = 2, "The arm is nearly singular: what would ask for high rates is left out in part."
    IMPOSSIBLE = 3, "The arm has no such motion; no rates come nearer."
    UNDECIDED = 4, "The rates keep the limits, but are not proved to come nearest to the twist."
    INVALID = 5, "A number is not finite; the rates are 0."


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class VelocityResult:
    """Joint rates for twists.

    Attributes:
        rate: (..., n) rad/s (m/s for prismatic joints), within the limits.
        residual: (..., 6) the twist asked for less the one that the rates give, in the frame that
            was named; 0 in what the task does not bind, infinite where not finite was given.
        saturated: (..., n) whether a limit holds a joint.
        scale: (...,) with `keep_direction` the share of the rates that the limits leave, else 1.
        smallest_singular_value: (...,) of the rows that are bound, weighted, in the tool frame;
            near 0 the arm is singular. In error by the square root of rounding.
        damping: (...,) that was taken.
        optimality: (...,) by how much the rates miss the conditions of an optimum (Karush, Kuhn
            and Tucker), rad/s.
        status: (...,) a `VelocityStatus` code.
    """

    rate: jax.Array
    residual: jax.Array
    saturated: jax.Array
    scale: jax.Array
    smallest_singular_value: jax.Array
    damping: jax.Array
    optimality: jax.Array
    status: jax.Array

    @property
    def ok(self) -> jax.Array:
        """(...,) whether the rates are proved to come nearest to the twist."""
        return self.status < VelocityStatus.UNDECIDED
