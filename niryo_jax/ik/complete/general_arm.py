"""Six revolute joints of any geometry: all solutions by the roots of one polynomial.

The roots are isolated by halving a few times, in the way of elimination that suits the arm best.
What that leaves open is halved until rounding ends it, in every other way, and in the best one
again, which then knows what the others found; one of them is proof enough. All of it is one loop
over parts of the batch, so that the program holds its body once.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.execution.compaction import at_once, for_each_chunk
from niryo_jax.execution.padding import is_small
from niryo_jax.ik.complete.polish import MOST
from niryo_jax.ik.general.isolation import A_LITTLE, FAR, Effort, Roots, isolated
from niryo_jax.ik.general.polynomial import equations_of, polynomial
from niryo_jax.ik.general.recovery import joint_vectors
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.pose_error import extent, miss, within_tolerance
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import distinct
from niryo_jax.ik.results.limits import Limits, without_whole_turns
from niryo_jax.ik.results.ranking import Answer, rank
from niryo_jax.ik.results.status import Singularity, UnreachableReason
from niryo_jax.ik.task import POSE
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.specialise import Geometry
from niryo_jax.structure.closure import unflattened
from niryo_jax.tolerances import DEPENDENT_ROW, IK_POLISH

_PART = 64
_STEPS, _MORE_STEPS = 5, 20
_LARGEST_STEP = 0.3
_ROOTS_OF_A_POSE = 4
_FEW = 8
_PERIODIC = (True,) * 6


class _Found(NamedTuple):
    """What is known of poses so far.

    Attributes:
        q: (rows, 16, 6) different joint vectors; found: (rows, 16) which there are.
        position, rotation: (rows, 16) metres and radians by which they miss.
        sure: (rows, 16) whether it belongs to a simple root.
        proved: (rows,) whether there are no others.
    """

    q: jax.Array
    found: jax.Array
    position: jax.Array
    rotation: jax.Array
    sure: jax.Array
    proved: jax.Array


def solve_general_arm(
    geometry: Geometry, numbers: jax.Array, goal: jax.Array, live: jax.Array, limits: Limits
) -> Answer:
    """The answers of poses (rows, 4, 4) of an arm, from its numbers for each way of elimination;
    its home pose may differ from row to row."""
    rows, dtype = goal.shape[0], goal.dtype
    part = min(at_once(_PART, rows), rows)
    none = jnp.zeros((rows, MOST), dtype)
    nothing = jnp.zeros((rows, MOST), bool)
    start = _Found(
        jnp.zeros((rows, MOST, 6), dtype), nothing, none, none, nothing, jnp.zeros(rows, bool)
    )

    def by_one_way(turn: jax.Array, found: _Found) -> _Found:
        first = turn == 0
        way = numbers[turn % len(numbers)]
        effort = Effort(*(jnp.where(first, a, b) for a, b in zip(A_LITTLE, FAR)))
        steps = jnp.where(first, _STEPS, _MORE_STEPS)

        def solve(found: _Found, at: jax.Array, its: jax.Array) -> _Found:
            at = jnp.minimum(at, rows - 1)
            known = jax.tree.map(lambda x: x[at], found)
            arm = geometry.at(at)
            new = _solved(arm, way, goal[at], effort, steps, known, is_small(rows))
            where = jnp.where(its, at, rows)
            return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), found, new)

        return for_each_chunk(live & ~found.proved, part, solve, found)

    found = jax.lax.fori_loop(0, len(numbers) + 1, by_one_way, start)
    names = jnp.int32(Singularity.NONE), jnp.int32(Singularity.UNKNOWN)
    label = jnp.full((rows, MOST), -1, jnp.int32)
    errors = found.position, found.rotation
    singularity = jnp.where(found.sure, *names)
    vectors = JointVectors(found.q, found.found, *errors, label, singularity)
    reason = jnp.full(rows, UnreachableReason.NONE, jnp.int32)
    return Answer(rank(vectors, limits, _PERIODIC, MOST), reason, found.proved)


def _solved(
    geometry: Geometry,
    numbers: jax.Array,
    goal: jax.Array,
    effort: Effort,
    steps: jax.Array,
    known: _Found,
    small: bool,
) -> _Found:
    """What one way of elimination adds to what is known of poses (rows, 4, 4)."""
    rows, dtype = goal.shape[0], goal.dtype
    way = unflattened(numbers)
    equations = equations_of(way, lanes.contiguous_lanes(goal, 2), geometry.home, rows)
    roots = isolated(polynomial(way, equations), effort)
    room = len(roots.owner)
    size = extent(goal)

    def recover(state: jax.Array, at: jax.Array, its: jax.Array) -> jax.Array:
        owner = jnp.minimum(roots.owner[at], rows - 1)
        q = joint_vectors(way, equations, owner, roots.angle[at])
        q, *errors = _improved(geometry.at(owner), goal[owner], q, steps, small)
        return state.at[:, jnp.where(its, at, room)].set(
            jnp.concatenate([q, jnp.stack(errors)]), mode="drop"
        )

    chunk = min(room, max(_ROOTS_OF_A_POSE * rows, 16))
    solved = for_each_chunk(roots.owner < rows, chunk, recover, jnp.zeros((8, room), dtype))
    q, position, rotation = without_whole_turns(solved[:6].T, _PERIODIC), solved[6], solved[7]
    row = jnp.minimum(roots.owner, rows - 1)
    good = (roots.owner < rows) & within_tolerance(position, rotation, size=size[row])
    owner = jnp.where(good, roots.owner, rows)
    before = jnp.broadcast_to(jnp.arange(rows)[:, None], known.found.shape)
    before = jnp.where(known.found, before, rows)

    def with_known(new: jax.Array, old: jax.Array, size: int = room) -> jax.Array:
        return jnp.concatenate([old.reshape(-1, *old.shape[2:]), new[:size]])

    def different(size: int) -> tuple[jax.Array, jax.Array]:
        vectors, owners = with_known(q, known.q, size), with_known(owner, before, size)
        return distinct(vectors, owners, rows, MOST)

    # Sorting room for all roots that there might be would cost more than all the rest.
    few = _FEW * rows
    table, crowded = jax.lax.cond(
        roots.number <= few, lambda: different(few), lambda: different(room)
    )
    table = table.T
    exists, taken = table >= 0, jnp.maximum(table, 0)
    sure = roots.most == 1
    parts = (q, known.q), (position, known.position), (rotation, known.rotation), (sure, known.sure)
    vectors, metres, radians, sure = (with_known(*part)[taken] for part in parts)
    kept = jnp.sum(jnp.where(way.order == 0, vectors, 0.0), axis=-1)
    proved = are_proved(roots, jnp.where(exists, kept, jnp.inf).T) & ~crowded
    return _Found(vectors, exists, metres, radians, sure | proved[:, None], known.proved | proved)


def _improved(
    geometry: Geometry, goal: jax.Array, q: jax.Array, steps: jax.Array, small: bool
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The best of joint vectors (6, r) and of where so many steps of Newton's method less one lead,
    and by how many metres and radians they miss: where solutions merge a step can lead away."""
    its = lanes.contiguous_lanes(goal, 2)
    newton_step = _rolled_step if small else _written_out_step
    tolerance = IK_POLISH.of(q.dtype)

    def step(state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        count, q, *best = state
        move, position, rotation = newton_step(geometry, its, q)
        better = position + rotation < best[1] + best[2]
        best = [jnp.where(better, x, y) for x, y in zip((q, position, rotation), best)]
        done = (best[1] <= tolerance) & (best[2] <= tolerance)
        moved = q + jnp.clip(move, -_LARGEST_STEP, _LARGEST_STEP)
        return count + 1, jnp.where(done, q, moved), *best

    far = jnp.full(q.shape[1], jnp.inf, q.dtype)

    def goes_on(state: tuple[jax.Array, ...]) -> jax.Array:
        count, *_, position, rotation = state
        return (count < steps) & jnp.any((position > tolerance) | (rotation > tolerance))

    start = jnp.int32(0), q, q, far, far
    _, _, q, position, rotation = jax.lax.while_loop(goes_on, step, start)
    return lanes.materialise(Lane(q)).array, position, rotation


def _rolled_step(geometry: Geometry, goal: Lanes, q: jax.Array) -> tuple[jax.Array, ...]:
    """The step (6, r), and metres and radians (r,) missed before it, by a program that is small."""
    twist, jacobian, errors = rolled.near_twist(geometry, goal, q)
    inverse = rolled.pseudo_inverse(jacobian, DEPENDENT_ROW.of(q.dtype))
    return rolled.added(inverse * twist[None], 1), *errors


def _written_out_step(geometry: Geometry, goal: Lanes, q: jax.Array) -> tuple[jax.Array, ...]:
    """The same by a program that is fast."""
    angles = lanes.lanes_of([Lane(x) for x in q])
    twist, jacobian, *errors = miss(geometry, goal, angles, "body", POSE)
    jacobian, twist = lanes.materialised(jacobian), lanes.materialised(twist)
    move = lanes.solve(jacobian, twist, 0.0, DEPENDENT_ROW.of(q.dtype))
    moves = jnp.stack([jnp.broadcast_to(x.array, q.shape[1:]) for x in move])
    return moves, *(jnp.broadcast_to(x.array, q.shape[1:]) for x in errors)


def are_proved(roots: Roots, kept: jax.Array) -> jax.Array:
    """Of which poses all solutions are met, those whose kept joints are at (16, rows), infinite
    where there is none: each arc has as many of them as it has roots at most."""
    rows = kept.shape[1]
    row = jnp.minimum(roots.owner, rows - 1)
    low, high = roots.arc
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    count = jnp.zeros(row.shape, jnp.int32)
    for angle in kept:
        off = jnp.abs(without_whole_turns(angle[row] - middle, (True,)))
        count = count + (off <= half)
    lost = jnp.where(count == roots.most, rows, roots.owner)
    return roots.listed.at[lost].set(False, mode="drop")
