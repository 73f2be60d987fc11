"""The second pass of the complete solver, which leaves no pose open: small batches, hard poses.

The candidates, however many there are, are verified; those that miss by more than rounding are
polished on the full pose; the different ones are ranked. Work is done a chunk at a time.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.execution.compaction import for_each_chunk
from niryo_jax.ik.complete.polish import MOST, POLISHED, Solved, chunk_of, polished
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.pose_error import (
    extent,
    may_take_pose,
    nearest_taken,
    within_tolerance,
)
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.posture import branch_label, joint_angles
from niryo_jax.ik.offset_wrist.subdivision import (
    BRACKET,
    CROSSING,
    FOLDED,
    SELF_MOTION,
    TOUCHING,
    Roots,
    find_roots,
    posture_of,
)
from niryo_jax.ik.offset_wrist.wrist_circle import (
    WristCircle,
    may_just_reach,
    reason_out_of_reach,
    wrist_circle,
)
from niryo_jax.ik.results.candidates import Candidates, JointVectors, in_slots
from niryo_jax.ik.results.deduplicate import distinct, duplicates
from niryo_jax.ik.results.limits import Limits, without_whole_turns
from niryo_jax.ik.results.ranking import Answer, rank
from niryo_jax.ik.results.status import Singularity, UnreachableReason
from niryo_jax.lanes import RecordRows
from niryo_jax.specialise import Geometry
from niryo_jax.tolerances import IK_POLISH, IK_POSITION

_AT_ONCE = 2048
_FEW = 12
_NEARLY = 100.0
_AWAY = 1e-2


def by_subdivision(
    geometry: Geometry,
    arm: OffsetWristParameters,
    target: jax.Array,
    live: jax.Array,
    limits: Limits,
    slots: int,
) -> Answer:
    """The answers of poses (rows, 4, 4) of an offset-wrist arm: roots with a proof, polished."""
    rows, dtype = target.shape[0], target.dtype
    circle = wrist_circle(arm, lanes.contiguous_lanes(target, 2))
    unreachable = reason_out_of_reach(arm, circle, rows, dtype)
    circles = lanes.RecordRows(circle, rows, dtype)
    roots = find_roots(arm, circles, live & (unreachable == UnreachableReason.NONE))
    periodic = (True,) * geometry.joints
    solved = _joint_vectors(geometry, arm, circles, target, roots)
    before = solved.q
    solved = polished(geometry, target, solved, roots.pose, periodic)
    real = roots.pose < rows
    # A crossing's roots are met many times over; where two of them merge, only the best are alike.
    # Where the condition touches zero, much that is no solution all but closes.
    endless = (roots.kind == SELF_MOTION) | (roots.kind == FOLDED)
    strict = (roots.kind == CROSSING) | (roots.kind == TOUCHING) | (roots.kind == FOLDED)
    share = jnp.where(strict, IK_POLISH.of(dtype) / IK_POSITION.of(dtype), 1.0)
    good = real & within_tolerance(*solved.errors, share)

    # A root that is proved to be there and whose joint vector does not close is a solution lost;
    # one that touches zero to rounding and nearly closes may be, and so may one of a condition
    # that vanishes all along a branch.
    near = within_tolerance(*solved.errors, _NEARLY)
    sure = (roots.kind == BRACKET) | endless
    lost = real & ~good & (sure | ((roots.kind == TOUCHING) & near))
    # With the wrist near the shoulder, but not at it, what is found from there is somewhere else.
    away = jnp.max(jnp.abs(without_whole_turns(solved.q - before, periodic)), axis=-1) > _AWAY
    lost = lost | (real & away & (roots.kind == FOLDED))
    if not arm.off.is_known(0.0):
        # Of the arm as it is, two roots that touch may be two that are apart, or none.
        lost = lost | (real & ((roots.kind == TOUCHING) | endless))

    def different(size: int) -> tuple[jax.Array, jax.Array]:
        owner = jnp.where(good, roots.pose, rows)[:size]
        table, crowded = distinct(solved.q[:size], owner, rows, MOST)
        return table, crowded.at[jnp.where(lost, roots.pose, rows)[:size]].set(True, mode="drop")

    if rows < POLISHED:
        table, incomplete = different(len(real))
    else:
        # Few poses have many roots, and sorting room for as many would cost more than all the rest.
        table, incomplete = jax.lax.cond(
            roots.number <= _FEW * rows,
            lambda: different(_FEW * rows),
            lambda: different(len(real)),
        )
    table = table.T
    taken = jnp.maximum(table, 0)
    singularity = jnp.select(
        [endless[taken], roots.kind[taken] == TOUCHING],
        [jnp.int32(Singularity.SELF_MOTION), jnp.int32(Singularity.MERGED)],
        jnp.int32(Singularity.NONE),
    )
    q, position, rotation, label = (x[taken] for x in solved)
    vectors = JointVectors(q, table >= 0, position, rotation, label, singularity)
    incomplete = incomplete | may_just_reach(arm, circle)
    proved = (unreachable != UnreachableReason.NONE) | (roots.complete & ~incomplete)
    return Answer(rank(vectors, limits, periodic, slots), unreachable, proved)


def by_polish(
    geometry: Geometry,
    candidates: Candidates,
    target: jax.Array,
    live: jax.Array,
    limits: Limits,
    periodic: tuple[bool, ...],
    slots: int,
    tolerance: jax.Array,
) -> Answer:
    """The answers of poses (rows, 4, 4) from the candidates of a closed form, polished."""
    rows, shape = target.shape[0], candidates.exists.shape
    pose = jnp.broadcast_to(jnp.arange(rows), shape).reshape(-1)
    possible = (candidates.exists & live).reshape(-1)
    q = jnp.stack([in_slots(lane.array, shape).reshape(-1) for lane in candidates.q], axis=-1)
    errors = rolled.pose_errors(geometry.at(pose), lanes.unpack(target[pose], 2), q.T)
    possible = possible & may_take_pose(geometry.joints, *errors, tolerance)
    solved = Solved(q, *errors, candidates.label.reshape(-1))
    solved = polished(geometry, target, solved, jnp.where(possible, pose, rows), periodic)

    def by_pose(x: jax.Array) -> jax.Array:
        return jnp.swapaxes(x.reshape(*shape, *x.shape[1:]), 0, 1)

    q, position, rotation, label = map(by_pose, solved)
    possible = by_pose(possible)
    exact = within_tolerance(position, rotation, size=extent(target)[:, None])
    if geometry.joints < 6:
        found, lost = nearest_taken(possible, exact, position, rotation, tolerance)
        found = found & ~duplicates(q, found, periodic)
    else:
        found = possible & exact
        lost = possible & ~found
    vectors = JointVectors(q, found, position, rotation, label, candidates.singularity.T)
    unreachable = jnp.full(rows, UnreachableReason.NONE, jnp.int32)
    proved = candidates.proved & ~jnp.any(lost, axis=1)
    return Answer(rank(vectors, limits, periodic, slots), unreachable, proved)


def _joint_vectors(
    geometry: Geometry,
    arm: OffsetWristParameters,
    circles: RecordRows[WristCircle],
    target: jax.Array,
    roots: Roots,
) -> Solved:
    """The joint vector of each root."""
    places, dtype, rows = roots.pose.shape[0], target.dtype, target.shape[0]

    def solve(state: Solved, at: jax.Array, live: jax.Array) -> Solved:
        pose = jnp.minimum(roots.pose[at], rows - 1)
        circle = circles[pose]
        posture = posture_of(arm, circle, roots.intervals[at])
        q = lanes.materialised(joint_angles(arm, circle, posture))
        rows_of_q = lanes.pack(q, at.shape, dtype)
        errors = rolled.pose_errors(geometry, lanes.unpack(target[pose], 2), rows_of_q.T)
        where = jnp.where(live, at, places)
        return state.replace(where, Solved(rows_of_q, *errors, branch_label(posture, q[4])))

    nothing = jnp.zeros((places, geometry.joints), dtype)
    far = jnp.full(places, jnp.inf, dtype)
    start = Solved(nothing, far, far, jnp.zeros(places, jnp.int32))
    chunk = min(chunk_of(rows, _AT_ONCE, MOST * rows), places)
    return for_each_chunk(roots.pose < rows, chunk, solve, start)
