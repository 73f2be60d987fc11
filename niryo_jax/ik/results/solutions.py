"""The one result type of inverse kinematics."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.ik.results.limits import nearest_turn
from niryo_jax.ik.results.status import IKStatus, Singularity, UnreachableReason
from niryo_jax.ik.task import BOUND, TaskName
from niryo_jax.jacobian import manipulability
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot

SLOTS = 16
"""The most that are returned; a six-axis arm has at most 16 isolated solutions (Manseur & Doty)."""


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
            of q misses what is bound of the pose; infinite where not `found`.
        label: (..., slots) which solution this is: 1 if the wrist reaches behind axis 1 (along
            P2 of docs/theory/complete-ik.md), plus 2 if the elbow angle is positive, plus 4 if
            theta_5 is, plus 8 times the number of solutions before it that are alike in all three
            (which can change along a path); for the other families the number of the choice of
            roots; -1 where not `found`, or where the method has none.
        singularity: (..., slots) a `Singularity`, UNKNOWN by methods that do not look; at a
            singularity derivatives are the least that follow the pose, and not those of an isolated
            solution.
        status: (...,) an `IKStatus`.
        unreachable_reason: (...,) an `UnreachableReason`: what proves that an UNREACHABLE pose is.
        complete: (...,) whether it is proved that there are no other solutions (for the value of
            the joint that is locked, if one is).
        count: (...,) the number of solutions found.
        pose_distance: (...,) distance of the pose as given from the rigid motion that was
            solved for (Frobenius norm).
        lower, upper: (n,) the joint limits used.
        periodic: n flags, True for a joint that returns to its place after 2 pi; static.
        task: what of the pose was bound (`niryo_jax.ik.task`); static.
        free: the joints of which no value matters to the task; static.

    Solutions within the limits come first, those with the largest margin to the limits
    before the others. Where a pose misses what an arm of fewer joints can do by less than the
    tolerance, they take the nearest pose that the arm can, and the errors say how far away it is.
    """

    q: jax.Array
    found: jax.Array
    within_limits: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array
    label: jax.Array
    singularity: jax.Array
    status: jax.Array
    unreachable_reason: jax.Array
    complete: jax.Array
    count: jax.Array
    pose_distance: jax.Array
    lower: jax.Array
    upper: jax.Array
    periodic: tuple[bool, ...] = dataclasses.field(metadata={"static": True})
    task: TaskName = dataclasses.field(default="pose", metadata={"static": True})
    free: tuple[int, ...] = dataclasses.field(default=(), metadata={"static": True})

    def map(self, function: Callable[[jax.Array], jax.Array]) -> IKSolutions:
        """The answers with a function applied to every array that has the batch axes in front.

        For example `solutions.map(lambda x: x[0])` for the first pose of a batch.
        """
        return map_solutions(function, self)

    def message(self, index: int | tuple[int, ...] = ()) -> str:
        """What became of one pose, in words."""
        status = IKStatus(int(self.status[index]))
        bound = BOUND[self.task][1]
        if status is IKStatus.UNREACHABLE:
            reason = UnreachableReason(int(self.unreachable_reason[index])).message
            return f"{status.message} {reason} Asked for: {bound}."
        codes = {int(x) for x in np.asarray(self.singularity[index])[np.asarray(self.found[index])]}
        silent = {Singularity.NONE, Singularity.UNKNOWN}
        notes = [Singularity(code).message for code in sorted(codes - silent)]
        if status in (IKStatus.SOLVED, IKStatus.OUTSIDE_LIMITS) and not self.complete[index]:
            notes.append("There may be more solutions than were found.")
        if codes:
            errors = self.position_error[index], self.rotation_error[index]
            metres, radians = (float(np.min(np.asarray(x))) for x in errors)
            turned = f" and {radians:.1g} rad" if self.task != "position" else ""
            notes.append(f"Within {metres:.1g} m{turned} of the {bound} asked for.")
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

        Where the arm can move while the tool rests, infinitely many solutions are considered, and
        q_ref itself is the nearest where it reaches the pose. An answer knows of these as
        `inverse_kinematics` returned it; one that went through a transformation of JAX has no more
        than its slots, and there `inverse_kinematics(..., q_ref=...)` looks at all of them. Joints
        that do not matter to the task (`free`) always take the values of q_ref, within the limits.

        Args:
            q_ref: (..., n) reference joint vectors, radians.

        Returns:
            (..., n) the joint vectors whose largest joint difference from q_ref is least, of joints
            that matter, and (...,) whether there is one; where there is none, q_ref is returned.
        """
        reference = as_floating("q_ref", q_ref).astype(self.q.dtype)
        check_shape("q_ref", reference, (self.q.shape[-1],))
        along = self.__dict__.get("_along")
        solutions = self
        if along is not None and is_concrete(self.q, reference):
            solutions = along(self, reference)
        return _nearest(solutions, reference)

    def remember(self, along: Callable[[IKSolutions, jax.Array], IKSolutions]) -> None:
        """Remember how to come near to reference joint vectors along self-motions.

        It is no part of the tree: what JAX makes of an answer does not know.
        """
        object.__setattr__(self, "_along", along)


def _static_fields(text: bytes | bytearray) -> tuple[tuple[bool, ...], TaskName, tuple[int, ...]]:
    periodic, task, free = json.loads(text)
    return tuple(periodic), task, tuple(free)


jax.export.register_pytree_node_serialization(
    IKSolutions,
    serialized_name="niryo_jax.IKSolutions",
    serialize_auxdata=lambda aux: json.dumps(aux).encode(),
    deserialize_auxdata=_static_fields,
)


def map_solutions(function: Callable[..., jax.Array], *parts: IKSolutions) -> IKSolutions:
    """`jax.tree.map` of the arrays with the batch axes in front; the rest is that of the first."""
    batched = {
        field.name: function(*(getattr(part, field.name) for part in parts))
        for field in dataclasses.fields(IKSolutions)
        if field.name not in ("lower", "upper", "periodic", "task", "free")
    }
    return dataclasses.replace(parts[0], **batched)


def with_free_joints_at(solutions: IKSolutions, q_ref: jax.Array) -> IKSolutions:
    """The solutions, with the joints that do not matter as near to those of joint vectors (..., n),
    one for each pose, as the limits let them be."""
    if not solutions.free:
        return solutions
    free = np.isin(np.arange(solutions.q.shape[-1]), solutions.free)
    placed = jnp.clip(q_ref, solutions.lower, solutions.upper)[..., None, :]
    q = jnp.where(solutions.found[..., None] & free, placed, solutions.q)
    return dataclasses.replace(solutions, q=q)


@jax.jit
def _nearest(solutions: IKSolutions, reference: jax.Array) -> tuple[jax.Array, jax.Array]:
    solutions = with_free_joints_at(solutions, reference)
    target = reference[..., None, :]
    limits = solutions.lower, solutions.upper
    turned = nearest_turn(solutions.q, target, *limits, solutions.periodic)
    # A joint that does not matter is as far from a reference beyond its limits in every solution.
    matters = ~np.isin(np.arange(turned.shape[-1]), solutions.free)
    distance = jnp.max(jnp.abs(turned - target), axis=-1, where=matters, initial=0.0)
    distance = jnp.where(solutions.within_limits & jnp.isfinite(distance), distance, jnp.inf)
    best = jnp.argmin(distance, axis=-1)[..., None]
    ok = jnp.isfinite(jnp.take_along_axis(distance, best, axis=-1))[..., 0]
    chosen = jnp.take_along_axis(solutions.q, best[..., None], axis=-2)[..., 0, :]
    chosen = nearest_turn(chosen, reference, *limits, solutions.periodic)
    return jnp.where(ok[..., None], chosen, reference), ok
