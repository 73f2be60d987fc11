"""The solutions of an arm with one joint to spare, as curves."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.codes import Code
from niryo_jax.ik.results.limits import nearest_turn
from niryo_jax.lanes.batching import as_floating, check_shape


class CurveEnd(Code):
    """What happens at an end of a curve of solutions."""

    CLOSED = 0, "Nothing: the curve returns to where it began."
    LIMIT = 1, "A joint comes to its limit."
    SINGULAR = 2, "The curve cannot be followed farther: it turns too sharply."
    CUT_SHORT = 3, "The curve goes on, but was followed no farther."


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SolutionCurves:
    """All solutions that were found within the joint limits, as curves of points.

    Attributes:
        q: (..., curves, points, n) joint vectors in the order of the curve, no joint of which moves
            farther than the step from one to the next, nor by whole turns. Zeros where not `valid`.
        valid: (..., curves, points) whether there is such a point; those of a curve come first.
        position_error, rotation_error: (..., curves, points) metres and radians by which forward
            kinematics of q misses the pose; infinite where not `valid`.
        limit_margin: (..., curves, points) the least distance of a joint to its limit, radians.
        manipulability: (..., curves, points) sqrt(det(J J^T)) (Yoshikawa, 1985).
        found: (..., curves) whether there is such a curve, the longest first.
        length: (..., curves) the way along it in joint space, radians.
        ends: (..., curves, 2) what happens at the first and the last point, a `CurveEnd`.
        end_joint: (..., curves, 2) the index of the joint that is at its limit there, or -1.
        status: (...,) an `IKStatus`.
        count: (...,) the number of curves.
        lower, upper: (n,) the joint limits used.
        periodic: n flags, True for a joint that returns to its place after 2 pi; static.

    A curve that is CLOSED goes on from its last point to its first, perhaps by whole turns of
    joints without limits.
    """

    q: jax.Array
    valid: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array
    limit_margin: jax.Array
    manipulability: jax.Array
    found: jax.Array
    length: jax.Array
    ends: jax.Array
    end_joint: jax.Array
    status: jax.Array
    count: jax.Array
    lower: jax.Array
    upper: jax.Array
    periodic: tuple[bool, ...] = dataclasses.field(metadata={"static": True})

    def map(self, function: Callable[[jax.Array], jax.Array]) -> SolutionCurves:
        """The curves with a function applied to every array that has the batch axes in front."""
        fields = {field.name for field in dataclasses.fields(self)} - {"lower", "upper", "periodic"}
        return dataclasses.replace(self, **{x: function(getattr(self, x)) for x in fields})

    def farthest_from_limits(self) -> tuple[jax.Array, jax.Array]:
        """The point farthest within the limits: (..., n), and (...,) whether there is one."""
        return self._best(self.limit_margin)

    def most_manipulable(self) -> tuple[jax.Array, jax.Array]:
        """The point of greatest manipulability: (..., n), and (...,) whether there is one."""
        return self._best(self.manipulability)

    def nearest(self, q_ref: ArrayLike) -> tuple[jax.Array, jax.Array]:
        """The point nearest to joint vectors (..., n), radians, whole turns considered.

        Returns:
            (..., n) the point whose largest joint difference from q_ref is least, and (...,)
            whether there is one; where there is none, q_ref is returned.
        """
        reference = as_floating("q_ref", q_ref).astype(self.q.dtype)
        check_shape("q_ref", reference, (self.q.shape[-1],))
        reference = jnp.broadcast_to(reference, (*self.status.shape, reference.shape[-1]))
        turned = nearest_turn(
            self.q, reference[..., None, None, :], self.lower, self.upper, self.periodic
        )
        away = jnp.max(jnp.abs(turned - reference[..., None, None, :]), axis=-1)
        chosen, ok = self._best(-away)
        chosen = nearest_turn(chosen, reference, self.lower, self.upper, self.periodic)
        return jnp.where(ok[..., None], chosen, reference), ok

    def _best(self, score: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The point of the highest score (..., curves, points)."""
        batch = self.status.shape
        score = jnp.where(self.valid, score, -jnp.inf).reshape(*batch, -1)
        points = self.q.reshape(*batch, -1, self.q.shape[-1])
        best = jnp.argmax(score, axis=-1)[..., None, None]
        return jnp.take_along_axis(points, best, axis=-2)[..., 0, :], self.count > 0
