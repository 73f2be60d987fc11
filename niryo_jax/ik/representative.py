"""Which of infinitely many solutions stands for a self-motion.

Where an arm can move while the tool rests, at a singularity or since it has a joint to spare, a
method finds some of its joint vectors, anywhere. Here they give way to others within the joint
limits, or to the one nearest to a reference. That takes a program of its own, which only poses that
need it ever run; inside a caller's transformation it is part of the caller's program.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax._jax import is_concrete
from niryo_jax.execution.compaction import at_once, for_each_chunk
from niryo_jax.execution.padding import program_size
from niryo_jax.ik.closed_form.srs import has_angle
from niryo_jax.ik.newton.held import Held
from niryo_jax.ik.newton.newton_raphson import newton_raphson
from niryo_jax.ik.newton.pose_error import extent
from niryo_jax.ik.newton.self_motion import WALKERS, best_of_self_motion
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import duplicates
from niryo_jax.ik.results.limits import (
    Limits,
    are_within_limits,
    limit_margin,
    nearest_turn,
    wrap_into_limits,
)
from niryo_jax.ik.results.ranking import Ranked, rank
from niryo_jax.ik.results.solutions import IKSolutions
from niryo_jax.ik.results.status import IKStatus, Singularity
from niryo_jax.ik.target import make_target
from niryo_jax.robot import Robot
from niryo_jax.specialise import Geometry, specialised, specialised_for_any_tool
from niryo_jax.tolerances import AT_REST

_AT_ONCE, _FEW = 16, 64
_COMFORTABLE = 0.1
_EXACT = 1e-9
_OUTSIDE = 100.0


def within_limits(
    robot: Robot, pose: jax.Array, answer: IKSolutions, held: Held = None
) -> IKSolutions:
    """The answer, with a representative within the limits where a self-motion has one.

    Args:
        robot: the arm.
        pose: (..., 4, 4) as they were given.
        answer: to these poses.
        held: what does not move, if anything.
    """
    answer = _with_free_angle(robot, answer, held)
    return _replaced(robot, pose, answer, _endless_outside(answer), None, held)


def within_limits_along_curves(robot: Robot, pose: jax.Array, answer: IKSolutions) -> IKSolutions:
    """The answer of an arm with joints to spare: where none of its solutions is within the limits,
    others of the same curves stand for them that are, if there are any.

    Args:
        robot: the arm.
        pose: (..., 4, 4) as they were given.
        answer: to these poses, by a method that knows some solutions of infinitely many.
    """
    still_robot, still_pose, still = jax.lax.stop_gradient((robot, pose, answer))
    walked = _replaced(still_robot, still_pose, still, _all_outside(still), None, spare=True)
    if is_concrete(pose, answer.q, *jax.tree.leaves(robot)):
        return walked
    # What is new has the derivatives of any solution.
    moving = newton_raphson(robot, pose[..., None, :, :], walked.q).q
    found = walked.found[..., None]
    same = found & jnp.all(walked.q == still.q, axis=-1, keepdims=True)
    q = jnp.where(same, answer.q, jnp.where(found, moving, walked.q))
    return dataclasses.replace(walked, q=q, pose_distance=answer.pose_distance)


def near_reference(
    robot: Robot, pose: jax.Array, answer: IKSolutions, q_ref: jax.Array, held: Held = None
) -> IKSolutions:
    """The answer, with the representatives of self-motions that are nearest to joint vectors.

    Args:
        robot: the arm.
        pose: (..., 4, 4) as they were given.
        answer: to these poses.
        q_ref: (..., n) joint vectors, whose batch is that of the poses.
        held: what does not move, if anything.
    """
    answer = _with_free_angle(robot, answer, held)
    wanted = is_endless(answer)
    return _replaced(robot, pose, answer, (wanted, jnp.any(wanted)), q_ref, held)


def _with_free_angle(robot: Robot, answer: IKSolutions, held: Held) -> IKSolutions:
    """The answer, where what is held is an arm angle that has no value, and so holds nothing: the
    upper arm turns while the tool rests."""
    if held != "arm angle":
        return answer
    free = answer.found & ~_has_angle(robot, answer.q)
    named = jnp.where(free, jnp.int32(Singularity.SELF_MOTION), answer.singularity)
    return dataclasses.replace(answer, singularity=named)


@specialised
def _has_angle(geometry: Geometry, q: jax.Array) -> jax.Array:
    return has_angle(geometry, q)


@jax.jit
def _endless_outside(answer: IKSolutions) -> tuple[jax.Array, jax.Array]:
    """Which solutions are to be replaced by others within the limits, and whether any is."""
    wanted = is_endless(answer) & ~answer.within_limits
    return wanted, jnp.any(wanted)


@jax.jit
def _all_outside(answer: IKSolutions) -> tuple[jax.Array, jax.Array]:
    """The same for all solutions of poses that have none within the limits."""
    wanted = answer.found & ~jnp.any(answer.within_limits, axis=-1, keepdims=True)
    return wanted, jnp.any(wanted)


@jax.jit
def is_endless(answer: IKSolutions) -> jax.Array:
    """(..., slots) which solutions may be some of infinitely many.

    Where rounding hides that they are, there are too many for a proof that all are found.
    """
    names = Singularity.WRIST, Singularity.SHOULDER, Singularity.SELF_MOTION
    named = jnp.isin(answer.singularity, np.array(names, np.int32))
    return answer.found & (named | ~answer.complete[..., None])


def _replaced(
    robot: Robot,
    pose: jax.Array,
    answer: IKSolutions,
    which: tuple[jax.Array, jax.Array],
    reference: jax.Array | None,
    held: Held = None,
    spare: bool = False,
) -> IKSolutions:
    """The answer, with others of their self-motions for some solutions: (..., slots) which, and
    whether any. All solutions of an arm with joints to spare are on self-motions."""
    wanted, some = which
    concrete = is_concrete(wanted, pose, *jax.tree.leaves(robot))
    if concrete and not some:
        return answer
    batch, joints = answer.status.shape, answer.q.shape[-1]
    count = math.prod(batch)

    def in_a_row(x: jax.Array) -> jax.Array:
        return x.reshape(count, *x.shape[len(batch) :])

    rows = (
        np.nonzero(np.asarray(in_a_row(wanted)).any(axis=-1))[0] if concrete else np.arange(count)
    )
    size = program_size(len(rows)) if concrete else count
    index = np.pad(rows, (0, size - len(rows)))
    flat = answer.map(in_a_row)
    if reference is None:
        reference = jnp.zeros((*batch, 0), answer.q.dtype)
    else:
        reference = jnp.clip(reference, answer.lower, answer.upper)
        reference = jnp.broadcast_to(reference, (*batch, joints)).astype(answer.q.dtype)
    ranked = _searched(
        robot,
        in_a_row(make_target(pose).pose)[index],
        JointVectors(*(getattr(flat, name)[index] for name in JointVectors._fields)),
        in_a_row(wanted)[index] & (np.arange(size) < len(rows))[:, None],
        in_a_row(reference)[index],
        answer.lower,
        answer.upper,
        periodic=answer.periodic,
        held=held,
        spare=spare,
        quick=size <= _FEW,
    )
    changed = ranked.as_fields()
    solved = jnp.any(ranked.within, axis=-1)
    changed["count"] = jnp.sum(ranked.found, axis=-1, dtype=jnp.int32)
    changed["status"] = jnp.where(solved, jnp.int32(IKStatus.SOLVED), flat.status[index])
    before = {name: getattr(flat, name) for name in changed}
    place = np.pad(rows, (0, size - len(rows)), constant_values=count)
    flat = dataclasses.replace(flat, **_with_rows(before, changed, place))
    return flat.map(lambda x: x.reshape(*batch, *x.shape[1:]))


@jax.jit
def _with_rows(
    arrays: dict[str, jax.Array], others: dict[str, jax.Array], place: jax.Array
) -> dict[str, jax.Array]:
    """Arrays with the rows of others in their places; those beyond the end are left out."""
    return jax.tree.map(lambda x, rows: x.at[place].set(rows, mode="drop"), arrays, others)


@specialised_for_any_tool
def _searched(
    geometry: Geometry,
    pose: jax.Array,
    vectors: JointVectors,
    wanted: jax.Array,
    reference: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    periodic: tuple[bool, ...],
    held: Held,
    spare: bool,
) -> Ranked:
    """The solutions of poses (rows, 4, 4), with others of their self-motions for those `wanted`.

    The `reference` is (rows, n), or (rows, 0) for solutions within the limits.
    """
    rows, slots = vectors.found.shape
    limits = lower, upper
    size = extent(pose)
    starts, to_reference = vectors.q, reference.shape[-1] > 0
    if to_reference:
        # A walker that starts at the reference is the first to find what is next to it.
        starts = jnp.concatenate([starts, reference[:, None]], axis=1)
        wanted = jnp.concatenate([wanted, jnp.any(wanted, axis=1, keepdims=True)], axis=1)
    each = starts.shape[1]
    start = starts.reshape(rows * each, -1)
    far = jnp.full(rows * each, jnp.inf, pose.dtype)

    def search(
        state: tuple[jax.Array, ...], at: jax.Array, live: jax.Array
    ) -> tuple[jax.Array, ...]:
        row = jnp.minimum(jnp.repeat(at, WALKERS) // each, rows - 1)
        wish = _Wish(limits, periodic, reference[row] if to_reference else None)
        new, *errors = best_of_self_motion(
            geometry,
            lanes.unpack(pose[row], 2),
            start[at],
            live,
            wish.score,
            wish.enough,
            size[row],
            held,
            wish.pull if to_reference else None,
        )
        where = jnp.where(live, at, rows * each)
        return tuple(x.at[where].set(y, mode="drop") for x, y in zip(state, (new, *errors)))

    chunk = min(at_once(_AT_ONCE, 4096), rows * each)
    found = for_each_chunk(wanted.reshape(-1), chunk, search, (start, far, far))
    q, position, rotation = (x.reshape(rows, each, *x.shape[1:]) for x in found)
    wish = _Wish(limits, periodic, reference[:, None] if to_reference else None)
    old, new = wish.score(vectors.q), jnp.where(jnp.isfinite(position), wish.score(q), -jnp.inf)
    if to_reference:
        # What was found from the reference is on the self-motion that comes nearest to it.
        nearest = jnp.where(wanted[:, :slots], jnp.maximum(new[:, :slots], old), -jnp.inf)
        best = jnp.argmax(nearest, axis=1)[:, None]
        mine = (jnp.arange(slots) == best) & (new[:, slots:] > new[:, :slots])

        def chosen(x: jax.Array) -> jax.Array:
            pick = mine.reshape(*mine.shape, *[1] * (x.ndim - 2))
            return jnp.where(pick, x[:, slots:], x[:, :slots])

        q, position, rotation, new = map(chosen, (q, position, rotation, new))
    better = wanted[:, :slots] & (new > old)
    if not spare:
        # An isolated solution next to which the tool hardly moves is not one of infinitely many.
        better = better & (position + rotation <= AT_REST.of(pose.dtype) * size[:, None])
    vectors = vectors._replace(
        q=jnp.where(better[..., None], q, vectors.q),
        position_error=jnp.where(better, position, vectors.position_error),
        rotation_error=jnp.where(better, rotation, vectors.rotation_error),
    )
    if spare:
        # From many places of a curve the same one is reached.
        repeated = duplicates(vectors.q, vectors.found, periodic)
        vectors = vectors._replace(found=vectors.found & ~repeated)
    else:
        named = better & (vectors.singularity == Singularity.NONE)
        names = jnp.where(named, jnp.int32(Singularity.SELF_MOTION), vectors.singularity)
        vectors = vectors._replace(singularity=names)
    return rank(vectors, limits, periodic, slots)


class _Wish(NamedTuple):
    """What is wished of a representative: to be within the limits, or near to a `reference`."""

    limits: Limits
    periodic: tuple[bool, ...]
    reference: jax.Array | None

    @property
    def enough(self) -> float:
        """A score that needs no better one."""
        return _COMFORTABLE if self.reference is None else -_EXACT

    def score(self, q: jax.Array) -> jax.Array:
        """(..., n) -> (...,), larger is better."""
        if self.reference is None:
            return limit_margin(wrap_into_limits(q, *self.limits, self.periodic), *self.limits)
        away = jnp.linalg.norm(self.pull(q), axis=-1)
        inside = are_within_limits(self.reference - self.pull(q), *self.limits)
        return jnp.where(inside, 0.0, -_OUTSIDE) - away

    def pull(self, q: jax.Array) -> jax.Array:
        """The way from the turns of joint vectors (..., n) that are nearest to the reference."""
        assert self.reference is not None
        return self.reference - nearest_turn(q, self.reference, *self.limits, self.periodic)
