"""The second pass of the complete solver: poses that the first leaves open, a chunk at a time.

For arms with a wrist offset `subdivide` finds the roots with a proof; for spherical wrists what the
closed form leaves rough near singularities is polished.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.geometry import Geometry
from niryo_jax.ik.arm import Arm
from niryo_jax.ik.arrange import Answer, Limits, arrange
from niryo_jax.ik.batches import for_each_chunk
from niryo_jax.ik.candidates import Candidates, in_slots
from niryo_jax.ik.circle import circle_columns, obstacle, read_circle, wrist_circle
from niryo_jax.ik.distinct import distinct
from niryo_jax.ik.error import closes, extent, may_close, misses
from niryo_jax.ik.newton import refine
from niryo_jax.ik.posture import branch_label, joint_angles
from niryo_jax.ik.solutions import Singularity, less_turns
from niryo_jax.ik.subdivide import (
    BRACKET,
    CROSSING,
    SELF_MOTION,
    TOUCHING,
    Roots,
    find_roots,
    posture_of,
)
from niryo_jax.lanes import Lane
from niryo_jax.tolerances import IK_POLISH, IK_POSITION

_AT_ONCE = 2048
_POLISHED = 128
_POLISHING = 5
_MOST = 16
_FEW = 12
_NEARLY = 100.0


def by_subdivision(
    geometry: Geometry,
    arm: Arm,
    target: jax.Array,
    live: jax.Array,
    limits: Limits,
    slots: int,
) -> Answer:
    """The answers of the poses that the fast pass left open."""
    rows, dtype = target.shape[0], target.dtype
    circle = wrist_circle(arm, lanes.columns(target, 2))
    reach = obstacle(circle, rows, dtype)
    columns = lanes.pack(circle_columns(circle), (rows,), dtype)
    roots = find_roots(arm, columns, live & (reach == 0))
    periodic = (True,) * geometry.joints
    solved = _joint_vectors(geometry, arm, columns, target, roots)
    solved = _polish(geometry, target, solved, roots.pose, periodic)
    q, position, rotation = solved.q, solved.position, solved.rotation
    real = roots.pose < rows
    # A crossing's roots are met many times over; where two of them merge, only the best are alike.
    share = jnp.where(roots.kind == CROSSING, IK_POLISH.of(dtype) / IK_POSITION.of(dtype), 1.0)
    good = real & closes(position, rotation, share)

    # A root that is proved to be there and whose joint vector does not close is a solution lost;
    # one that touches zero to rounding and nearly closes may be.
    near = closes(position, rotation, _NEARLY)
    lost = real & ~good & ((roots.kind == BRACKET) | ((roots.kind == TOUCHING) & near))

    def some(size: int) -> tuple[jax.Array, jax.Array]:
        owner = jnp.where(good, roots.pose, rows)[:size]
        table, crowded = distinct(q[:size], owner, rows, _MOST)
        return table, crowded.at[jnp.where(lost, roots.pose, rows)[:size]].set(True, mode="drop")

    # Few poses have many roots, and sorting room for as many would cost more than all the rest.
    table, incomplete = jax.lax.cond(
        roots.number <= _FEW * rows,
        lambda: some(_FEW * rows),
        lambda: some(len(real)),
    )
    found, taken = table >= 0, jnp.maximum(table, 0)
    candidates = np.array([Lane(q[:, i][taken]) for i in range(q.shape[1])], dtype=object)
    kind = roots.kind[taken]
    singularity = jnp.select(
        [kind == SELF_MOTION, kind == TOUCHING],
        [jnp.int32(Singularity.SELF_MOTION), jnp.int32(Singularity.MERGED)],
        jnp.int32(Singularity.NONE),
    )
    errors = position[taken], rotation[taken]
    label = solved.label[taken]
    arranged = arrange(candidates, found, errors, label, singularity, limits, periodic, slots)
    proved = (reach > 0) | (roots.complete & ~incomplete)
    return Answer(arranged, reach, proved)


def by_polish(
    geometry: Geometry,
    candidates: Candidates,
    reach: jax.Array,
    target: jax.Array,
    live: jax.Array,
    limits: Limits,
    periodic: tuple[bool, ...],
    slots: int,
) -> Answer:
    """The answers of poses whose closed form is too rough: its candidates, polished."""
    rows, shape = target.shape[0], candidates.exists.shape
    which = jnp.broadcast_to(jnp.arange(rows), shape).reshape(-1)
    possible = (candidates.exists & live).reshape(-1)
    q = jnp.stack([in_slots(lane.array, shape).reshape(-1) for lane in candidates.q], axis=-1)
    errors = misses(geometry.at(which), target[which], lanes.unpack(q))
    solved = _Solved(q, *errors, candidates.label.reshape(-1))
    solved = _polish(geometry, target, solved, jnp.where(possible, which, rows), periodic)
    found = possible & closes(*solved.errors, size=extent(target)[which])
    lost = possible & ~found & may_close(geometry.joints, *solved.errors)
    q, position, rotation, label, found, lost = (
        x.reshape(*shape, *x.shape[1:]) for x in (*solved, found, lost)
    )
    arranged = arrange(
        lanes.unpack(q),
        found,
        (position, rotation),
        label,
        candidates.singularity,
        limits,
        periodic,
        slots,
    )
    return Answer(arranged, reach, ~jnp.any(lost, axis=0))


class _Solved(NamedTuple):
    """Joint vectors (r, n), the metres and radians by which they miss, and their branches."""

    q: jax.Array
    position: jax.Array
    rotation: jax.Array
    label: jax.Array

    @property
    def errors(self) -> tuple[jax.Array, jax.Array]:
        """Metres and radians by which they miss."""
        return self.position, self.rotation

    def replace(self, where: jax.Array, new: _Solved) -> _Solved:
        """With the rows `where` replaced; rows out of range are left out."""
        return _Solved(*(x.at[where].set(y, mode="drop") for x, y in zip(self, new)))


def _joint_vectors(
    geometry: Geometry, arm: Arm, columns: jax.Array, target: jax.Array, roots: Roots
) -> _Solved:
    """The joint vector of each root."""
    places, dtype = roots.pose.shape[0], target.dtype

    def some(state: _Solved, at: jax.Array, live: jax.Array) -> _Solved:
        pose = jnp.minimum(roots.pose[at], target.shape[0] - 1)
        circle = read_circle(columns[pose])
        found = posture_of(arm, circle, roots.intervals[at])
        q = lanes.stored(joint_angles(arm, circle, found))
        position, rotation = misses(geometry, target[pose], q)
        where = jnp.where(live, at, places)
        label = branch_label(found, q[4])
        return state.replace(
            where, _Solved(lanes.pack(q, at.shape, dtype), position, rotation, label)
        )

    nothing = jnp.zeros((places, geometry.joints), dtype)
    far = jnp.full(places, jnp.inf, dtype)
    start = _Solved(nothing, far, far, jnp.zeros(places, jnp.int32))
    filled = roots.pose < target.shape[0]
    return for_each_chunk(filled, min(_AT_ONCE, places), some, start)


def _polish(
    geometry: Geometry,
    target: jax.Array,
    solved: _Solved,
    pose: jax.Array,
    periodic: tuple[bool, ...],
) -> _Solved:
    """Newton's method on the full pose for the joint vectors that miss by more than rounding."""
    tolerance = IK_POLISH.of(solved.q.dtype)
    rough = (solved.position > tolerance) | (solved.rotation > tolerance)
    rough = rough & (pose < target.shape[0])

    def again(state: _Solved, at: jax.Array, live: jax.Array) -> _Solved:
        row = jnp.minimum(pose[at], target.shape[0] - 1)
        goal, its = target[row], geometry.at(row)
        q = less_turns(refine(its, goal, state.q[at], _POLISHING), periodic)
        position, rotation = misses(its, goal, lanes.unpack(q))
        better = live & (position + rotation < state.position[at] + state.rotation[at])
        where = jnp.where(better, at, pose.shape[0])
        return state.replace(where, _Solved(q, position, rotation, state.label[at]))

    return for_each_chunk(rough, min(_POLISHED, pose.shape[0]), again, solved)
