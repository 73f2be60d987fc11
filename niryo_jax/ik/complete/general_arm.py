"""Six revolute joints of any geometry: all solutions by the roots of one polynomial.

The roots are isolated by halving a few times, in the way of elimination that suits the arm best.
Of poses that this leaves open the solutions of poses next to them are tried: where solutions have
the kept angle in common, as where an arm is stretched out in a plane, they cannot be told apart,
and have it apart a tenth of a radian farther. Then arcs are halved until rounding ends it, in every
other way, and in the best one again, which knows what the others found; one of them is proof
enough. All of it is one loop over parts of the batch, so that the program holds its body once.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.compaction import at_once, for_each_chunk, tally
from niryo_jax.execution.padding import is_small
from niryo_jax.ik.complete.polish import MOST, is_rough
from niryo_jax.ik.general.isolation import A_LITTLE, FAR, Effort, Roots, isolated, refined
from niryo_jax.ik.general.polynomial import Equations, equations_and_polynomial
from niryo_jax.ik.general.recovery import joint_vectors
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.pose_error import extent, pose_errors, small_twist, within_tolerance
from niryo_jax.ik.results.candidates import JointVectors
from niryo_jax.ik.results.deduplicate import distinct
from niryo_jax.ik.results.limits import Limits, without_whole_turns
from niryo_jax.ik.results.ranking import Answer, rank
from niryo_jax.ik.results.status import Singularity, UnreachableReason
from niryo_jax.ik.trig_polynomial import Polynomial
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batch_last import kept
from niryo_jax.lie import se3, so3
from niryo_jax.specialise import Geometry
from niryo_jax.structure.closure import ClosureNumbers, unflattened
from niryo_jax.tolerances import DEPENDENT_ROW

_PART = 256
_RECOVERED, _IMPROVED, _COMPARED = 256, 128, 16
_STEPS, _MORE_STEPS = 4, 19
_LARGEST_STEP = 0.3
_AS_WELL, _ROUNDING = 4.0, 16.0
"""What lies half way takes a pose as well as its neighbours up to so many times their miss, and so
many units of rounding."""
_ASIDE = 0.1
_DIRECTION = 0.60, -0.51, 0.62, -0.30, 0.80, 0.52
"""How far a pose is moved aside, in radians and sizes of the arm, and in which unit twist."""
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


def _turns(ways: int) -> list[tuple[int, int, bool]]:
    """What is done one after the other: the index of the way of elimination, to which side poses
    are moved, 0 for neither, and whether arcs are halved until rounding ends it."""
    aside = [(side % ways, side, False) for side in (1, 2)]
    others = [(way, 0, True) for way in range(1, ways)]
    return [(0, 0, False), *aside, *others, (0, 0, True)]


def _aside(size: jax.Array) -> jax.Array:
    """(3, 4, 4) no motion, and one to either side, of an arm of a size."""
    twists = _ASIDE * np.outer([0.0, 1.0, -1.0], _DIRECTION)
    return se3.from_rotation_and_position(so3.exp(twists[:, :3]), size * twists[:, 3:])


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

    turns = jnp.asarray(_turns(len(numbers)))
    aside = _aside(unflattened(numbers[0]).size).astype(dtype)

    def by_one_way(index: jax.Array, found: _Found) -> _Found:
        which, side, far = turns[index]
        way, move, proves = numbers[which], aside[side], side == 0
        effort = Effort(*(jnp.where(far, b, a) for a, b in zip(A_LITTLE, FAR)))
        steps = jnp.where(index == 0, _STEPS, _MORE_STEPS)

        def solve(found: _Found, at: jax.Array, its: jax.Array) -> _Found:
            at = jnp.minimum(at, rows - 1)
            known = jax.tree.map(lambda x: x[at], found)
            arm, its_goal = geometry.at(at), goal[at]
            near = jnp.where(proves, its_goal, its_goal @ move)
            goals = its_goal, near
            new = _solved(arm, way, goals, its, proves, effort, steps, known, is_small(rows))
            where = jnp.where(its, at, rows)
            return jax.tree.map(lambda x, y: x.at[where].set(y, mode="drop"), found, new)

        return for_each_chunk(live & ~found.proved, part, solve, found)

    found = jax.lax.fori_loop(0, len(turns), by_one_way, start)
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
    goals: tuple[jax.Array, jax.Array],
    live: jax.Array,
    proves: jax.Array,
    effort: Effort,
    steps: jax.Array,
    known: _Found,
    small: bool,
) -> _Found:
    """What one way of elimination adds to what is known of poses (rows, 4, 4), of which the first
    are live, from the solutions of poses next to them or, where it `proves`, of themselves."""
    goal, near = goals
    rows = len(goal)
    way = unflattened(numbers)
    equations, g = equations_and_polynomial(way, geometry, near, live)
    roots = isolated(g, effort)
    room = len(roots.owner)
    real, poses = roots.owner < rows, jnp.minimum(roots.owner, rows - 1)
    solved = _joint_vectors(geometry, way, goal, equations, g, roots, steps, small)
    q, position, rotation = without_whole_turns(solved[:6].T, _PERIODIC), solved[6], solved[7]
    good = real & within_tolerance(position, rotation, size=extent(goal)[poses])
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
    sure = (roots.most == 1) & proves
    parts = (q, known.q), (position, known.position), (rotation, known.rotation), (sure, known.sure)
    vectors, metres, radians, sure = (with_known(*part)[taken] for part in parts)
    angle = jnp.sum(jnp.where(way.order == 0, vectors, 0.0), axis=-1)
    proved = are_proved(roots, jnp.where(exists, angle, jnp.inf).T) & ~crowded & proves
    clustered = tally(jnp.zeros(rows, jnp.int32), roots.owner, roots.most > 1) > 0
    doubtful = live & proved & clustered
    misses = metres, radians
    proved = proved & ~_with_twins(geometry, goal, vectors, misses, exists, doubtful, small)
    return _Found(vectors, exists, metres, radians, sure | proved[:, None], known.proved | proved)


def _joint_vectors(
    geometry: Geometry,
    way: ClosureNumbers,
    goal: jax.Array,
    equations: jax.Array,
    g: Polynomial,
    roots: Roots,
    steps: jax.Array,
    small: bool,
) -> jax.Array:
    """(8, roots) joint vectors, and by how many metres and radians they miss."""
    rows, room = len(goal), len(roots.owner)
    real, poses = roots.owner < rows, jnp.minimum(roots.owner, rows - 1)
    missed = rolled.pose_errors if small else _missed

    def recover(state: jax.Array, at: jax.Array, its: jax.Array) -> jax.Array:
        owner = poses[at]
        angle = refined(g, owner, roots.near[at])
        q = joint_vectors(way, Equations.from_rows(equations[owner]), angle)
        errors = missed(geometry.at(owner), lanes.contiguous_lanes(goal[owner], 2), q)
        new = jnp.concatenate([q, jnp.stack(errors)])
        return state.at[:, jnp.where(its, at, room)].set(new, mode="drop")

    def improve(state: jax.Array, at: jax.Array, its: jax.Array) -> jax.Array:
        owner = poses[at]
        goals = lanes.contiguous_lanes(goal[owner], 2)
        # What stands for no root is exact, so that the others need not wait for it.
        old = jnp.where(its, state[:, at], 0.0)
        new = _improved(geometry.at(owner), goals, old, steps, small)
        return state.at[:, jnp.where(its, at, room)].set(new, mode="drop")

    chunk = min(room, max(min(at_once(_RECOVERED, room), _ROOTS_OF_A_POSE * rows), 16))
    solved = for_each_chunk(real, chunk, recover, jnp.zeros((8, room), goal.dtype))
    # Most are exact to rounding as they are.
    rough = real & is_rough(*solved[6:])
    return for_each_chunk(rough, min(chunk, at_once(_IMPROVED, room)), improve, solved)


def _improved(
    geometry: Geometry, goal: Lanes, solved: jax.Array, steps: jax.Array, small: bool
) -> jax.Array:
    """The best of what is `solved` and of where so many steps of Newton's method lead from there,
    joint vectors and by how many metres and radians they miss, (8, r): where solutions merge a step
    can lead away."""
    newton_step, missed = (_rolled_step, rolled.pose_errors) if small else (_fast_step, _missed)

    def step(state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        count, q, best = state
        rough = is_rough(*best[6:])
        q = kept(q + jnp.clip(newton_step(geometry, goal, q), -_LARGEST_STEP, _LARGEST_STEP))
        new = jnp.concatenate([q, jnp.stack(missed(geometry, goal, q))])
        # A root that is done stays as it is, however long its neighbours take.
        better = rough & (new[6] + new[7] < best[6] + best[7])
        return count + 1, q, jnp.where(better, new, best)

    def goes_on(state: tuple[jax.Array, ...]) -> jax.Array:
        count, _, best = state
        return (count < steps) & jnp.any(is_rough(*best[6:]))

    return jax.lax.while_loop(goes_on, step, (jnp.int32(0), solved[:6], solved))[2]


def _with_twins(
    geometry: Geometry,
    goal: jax.Array,
    q: jax.Array,
    misses: tuple[jax.Array, jax.Array],
    exists: jax.Array,
    which: jax.Array,
    small: bool,
) -> jax.Array:
    """(rows,) in which of some rows two joint vectors (rows, 16, 6) may be one solution, met twice,
    and would count as two: what lies half way between neighbours takes the pose as well as they do.
    Next to singular postures a solution is known to no more than its miss over the smallest
    singular value."""
    rows = len(q)
    missed = rolled.pose_errors if small else _missed

    def compare(twins: jax.Array, at: jax.Array, its: jax.Array) -> jax.Array:
        ours, there = q[at], exists[at]
        away = without_whole_turns(ours[:, None] - ours[:, :, None], _PERIODIC)
        apart = jnp.max(jnp.abs(away), axis=-1)
        pairs = there[:, None] & there[:, :, None] & ~jnp.eye(MOST, dtype=bool)
        nearest = jnp.argmin(jnp.where(pairs, apart, jnp.inf), axis=-1)
        to_it = jnp.take_along_axis(away, nearest[..., None, None], axis=2)[:, :, 0]
        owner = jnp.repeat(at, MOST)
        goals = lanes.contiguous_lanes(goal[owner], 2)
        errors = missed(geometry.at(owner), goals, (ours + 0.5 * to_it).reshape(-1, 6).T)
        twin = jnp.any(pairs, axis=-1)
        for error, miss, size in zip(errors, misses, (extent(goal[at]), jnp.ones(len(at)))):
            own = miss[at]
            larger = jnp.maximum(own, jnp.take_along_axis(own, nearest, axis=1))
            rounding = _ROUNDING * jnp.finfo(q.dtype).eps * size[:, None]
            twin &= error.reshape(-1, MOST) < _AS_WELL * larger + rounding
        return twins.at[jnp.where(its, at, rows)].set(jnp.any(twin, axis=-1), mode="drop")

    return for_each_chunk(which, min(rows, _COMPARED), compare, jnp.zeros(rows, bool))


def _missed(geometry: Geometry, goal: Lanes, q: jax.Array) -> tuple[jax.Array, ...]:
    """`rolled.pose_errors` by a program that is fast."""
    errors = pose_errors(geometry, goal, lanes.lanes_of([Lane(x) for x in q]))
    return tuple(jnp.broadcast_to(error, q.shape[1:]) for error in errors)


def _rolled_step(geometry: Geometry, goal: Lanes, q: jax.Array) -> jax.Array:
    """The step (6, r), by a program that is small."""
    twist, jacobian, _ = rolled.near_twist(geometry, goal, q)
    inverse = rolled.pseudo_inverse(jacobian, DEPENDENT_ROW.of(q.dtype))
    return rolled.added(inverse * twist[None], 1)


def _fast_step(geometry: Geometry, goal: Lanes, q: jax.Array) -> jax.Array:
    """The same by a program that is fast."""
    angles = lanes.lanes_of([Lane(x) for x in q])
    pose, jacobian = pose_and_jacobian(geometry, angles, "body", materialise=True)
    twist, jacobian = lanes.materialised(small_twist(pose, goal)), lanes.materialised(jacobian)
    move = lanes.solve(jacobian, twist, 0.0, DEPENDENT_ROW.of(q.dtype))
    return jnp.stack([jnp.broadcast_to(x.array, q.shape[1:]) for x in move])


def are_proved(roots: Roots, kept: jax.Array) -> jax.Array:
    """Of which poses all solutions are met, those whose kept joints are at (16, rows), infinite
    where there is none: each arc has as many of them as it has roots at most."""
    rows = kept.shape[1]
    row = jnp.minimum(roots.owner, rows - 1)
    low, high = roots.arc
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    off = jnp.abs(without_whole_turns(kept[:, row] - middle, (True,)))
    count = jnp.sum(off <= half, axis=0, dtype=jnp.int32)
    lost = jnp.where(count == roots.most, rows, roots.owner)
    return roots.listed.at[lost].set(False, mode="drop")
