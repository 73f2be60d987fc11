"""Every root of the one condition of an offset-wrist arm, by subdivision with a proof.

Each interval of the curve is halved until it is proved (`remainder_bound`) to hold no root or one,
so that work goes where the function bends: near the edges of reach, near axis 1, and where roots
nearly touch. The intervals of all poses wait on one stack; every step takes the top of it, so that
the program has fixed shapes while the depth is as large as a pose asks.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.compaction import append, at_once, tally
from niryo_jax.ik.offset_wrist import condition
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.posture import Posture, posture_or_crossing
from niryo_jax.ik.offset_wrist.remainder_bound import (
    Rounding,
    pose_rounding,
    proves,
    remainder_bound,
)
from niryo_jax.ik.offset_wrist.wrist_circle import WristCircle
from niryo_jax.lanes import Lane, RecordRows
from niryo_jax.tolerances import (
    AT_SHOULDER,
    CONDITION_ROUNDING,
    NARROWEST,
    ON_AXIS_1,
    SQUARE_ROOT_END,
    VANISHING,
)

_WIDTH = 512
_DEPTH = 48
# Most poses look at 500 intervals and meet 12 roots; next to axis 1 some look at 60,000 and meet
# the same roots 500 times.
_ITEMS = 1 << 17
_ROOTS = 1024
_ROOM, _MORE_ROOM = 64, 16384
_REFINEMENTS = 9
BRACKET, TOUCHING, CROSSING, SELF_MOTION, FOLDED = 0, 1, 2, 3, 4


class Roots(NamedTuple):
    """Where the roots of many poses are, in one list.

    Attributes:
        pose: (r,) the row each belongs to; out of range behind the last.
        intervals: (r, 6) what `posture_of` makes a posture of.
        number: how many there are, unless it is more than there are places.
        complete: (rows,) whether the roots of a row are proved to be all.
    """

    pose: jax.Array
    intervals: jax.Array
    number: jax.Array
    complete: jax.Array

    @property
    def kind(self) -> jax.Array:
        """(r,) `BRACKET`, `TOUCHING`, `CROSSING` (of axis 1), `SELF_MOTION`, or `FOLDED` (the
        wrist at the shoulder)."""
        return self.intervals[:, 1].astype(jnp.int32) // 4


class _State(NamedTuple):
    """Intervals that wait, roots that are found, and what each pose has had of both.

    Attributes:
        stack, size: rows (pose, kind * 4 + branch, low, high, f(low), f(high)), of which the first
            `size` wait.
        roots, number: the same of roots.
        spent: (rows,) intervals that were looked at for each pose.
        held: (rows,) roots that were found for each pose.
    """

    stack: jax.Array
    size: jax.Array
    roots: jax.Array
    number: jax.Array
    spent: jax.Array
    held: jax.Array


def find_roots(
    arm: OffsetWristParameters, circles: RecordRows[WristCircle], live: jax.Array
) -> Roots:
    """All roots of the condition for a set of poses.

    Args:
        arm: the numbers of the arm.
        circles: the circle of each pose.
        live: (rows,) which rows to solve.
    """
    rows, dtype = len(circles.array), circles.array.dtype
    # Few poses have few intervals that are open at once.
    width = min(at_once(_WIDTH, 2 * rows), 64 * rows)
    # What one step finds may be more than a pose is given.
    most = min(_ROOTS * rows, _ROOM * rows + _MORE_ROOM) + 2 * width
    first, certain, start = _first_intervals(arm, circles, live)
    stack = jnp.zeros((first.shape[0] + width * (_DEPTH + 1), 6), dtype)
    stack, size = append(stack, jnp.int32(0), first, ~certain)
    roots = jnp.full((most + 2 * width, 6), -1.0, dtype)
    roots, count = append(roots, jnp.int32(0), first, start)
    nothing = jnp.zeros(rows, jnp.int32)
    held = tally(nothing, first[:, 0], start)
    state = _State(stack, size, roots, count, nothing, held)
    state = jax.lax.while_loop(
        lambda state: state.size > 0, lambda state: _step(arm, circles, width, state), state
    )
    roots, count = state.roots[:most], state.number
    pose = jnp.where(jnp.arange(most) < count, roots[:, 0].astype(jnp.int32), rows)
    # What is left when a pose's share of the work runs out is not proved.
    complete = live & ~_given_up(state.spent, state.held) & (count <= most)
    return Roots(pose, roots, count, complete)


def _given_up(spent: jax.Array, held: jax.Array) -> jax.Array:
    """Whether a pose has had its share of the work."""
    return (spent > _ITEMS) | (held > _ROOTS)


def posture_of(arm: OffsetWristParameters, circle: WristCircle, intervals: jax.Array) -> Posture:
    """The posture of each root (r, 6), given the circle of the pose it belongs to."""
    code = intervals[:, 1].astype(jnp.int32)
    kind = code // 4
    signs = condition.branch_signs(code % 4, intervals.dtype)
    t = _refine(arm, circle, signs, kind == BRACKET, intervals)
    if not arm.is_planar:
        return condition.at(arm, circle, signs, t, near_shoulder=True).posture.materialised()
    sin, cos = lanes.sincos(Lane(t))
    sin_cos = lanes.materialise(sin), lanes.materialise(cos)
    folded = kind == FOLDED
    crossing = folded | (kind == CROSSING)
    return posture_or_crossing(arm, circle, sin_cos, *signs, crossing, folded).materialised()


def _first_intervals(
    arm: OffsetWristParameters, circles: RecordRows[WristCircle], live: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The intervals to begin with, (i, 6), which of them are settled, which hold a root."""
    rows, dtype = len(circles.array), circles.array.dtype
    f, certain = condition.scan(arm, circles[:], rows, dtype, dtype)
    before, after = f[:, :-1], f[:, 1:]
    number = np.arange(condition.NODES)[:, None]
    fields = [
        jnp.arange(rows, dtype=dtype),
        jnp.arange(4, dtype=dtype).reshape(4, 1, 1),
        *(jnp.asarray(condition.node(n), dtype) for n in (number, number + 1)),
        before,
        after,
    ]
    # Where the condition vanishes all along a branch, the arm moves while the tool rests: one
    # posture stands for all.
    still = jnp.max(jnp.abs(f), axis=1, keepdims=True) < VANISHING.of(dtype)
    one = still & (number == 0)
    start = live & ((certain & ((before > 0) != (after > 0)) & ~still) | one)
    fields[1] = fields[1] + 4 * SELF_MOTION * one.astype(dtype)
    items = jnp.stack([jnp.broadcast_to(x, before.shape) for x in fields], -1).reshape(-1, 6)
    return items, (certain | still | ~live).reshape(-1), start.reshape(-1)


def _step(
    arm: OffsetWristParameters, circles: RecordRows[WristCircle], width: int, state: _State
) -> _State:
    """Take the top intervals off the stack, prove what can be proved, push halves of the rest.

    Each pose has its share of the work, so that one that needs no end of it (an arm that moves
    while the tool rests) takes nothing from its neighbours. Beyond it no interval is halved again;
    a change of sign is still a root.
    """
    dtype = circles.array.dtype
    start = jnp.maximum(state.size - width, 0)
    items = jax.lax.dynamic_slice_in_dim(state.stack, start, width)
    live = start + jnp.arange(width) < state.size
    pose, code, low, high, f_low, f_high = (lane.array for lane in lanes.contiguous_lanes(items))
    branch = code % 4
    signs = condition.branch_signs(branch.astype(jnp.int32), dtype)
    spent = tally(state.spent, pose, live)
    row = jnp.clip(pose.astype(jnp.int32), 0, len(state.spent) - 1)
    given_up = _given_up(spent[row], state.held[row])
    middle, reach = 0.5 * (low + high), 0.5 * (high - low)
    circle = circles[pose.astype(jnp.int32)]
    f_middle, found, t = condition.at(arm, circle, signs, middle, near_shoulder=True)
    bound = remainder_bound(arm, circle, found, t, Lane(reach))
    # |dE/dt| is at most 2.
    sine = abs(found.elbow[1]) - Lane(2.0 * reach)
    allowed = pose_rounding(arm, sine, bound.lever, dtype)
    remainder, *allowed = (
        lanes.materialise(x, by=Lane(f_middle)).array for x in (bound.remainder, *allowed)
    )
    rounding = Rounding(*allowed)
    # Where the arm is off, an interval that is flat may be wide, and f vary by thrice as much.
    whole = rounding.whole if arm.off.is_known(0.0) else 4.0 * rounding.whole
    touching = jnp.abs(f_middle) < jnp.maximum(SQUARE_ROOT_END, whole)
    crossing = folded = jnp.zeros_like(live)
    if arm.is_planar:
        distance = lanes.materialise(found.from_axis_1 + arm.radius * 2.0 * reach)
        near = ON_AXIS_1.of(dtype) * arm.radius
        crossing = jnp.asarray(distance < near)
        folded = crossing & jnp.asarray(abs(found.reach[0]) < AT_SHOULDER.of(dtype) * arm.radius)

    halves, certain, roots = list[jax.Array](), list[jax.Array](), list[jax.Array]()
    for a, b, f_a, f_b in ((low, middle, f_low, f_middle), (middle, high, f_middle, f_high)):
        change = (f_a > 0) != (f_b > 0)
        proved, sag = proves(remainder, reach, f_a, f_b, rounding)
        flat = sag + reach * reach * 1e-2 < rounding.turn
        narrow = flat | (reach < NARROWEST.of(dtype))
        # Each half of a crossing stands for one of its two roots, on whatever branch it is met.
        of_root = 2 * (branch // 2) + len(halves) + 4 * jnp.where(folded, FOLDED, CROSSING)
        code = branch + 4 * jnp.where(proved, BRACKET, TOUCHING).astype(dtype)
        code = jnp.where(crossing, of_root, code)
        halves.append(jnp.stack([pose, code, a, b, f_a, f_b], -1))
        ends = jnp.where(proved | given_up, change, narrow & touching)
        roots.append(live & (crossing | ends))
        certain.append(proved | narrow | crossing | given_up | ~live)
    if not arm.is_planar:
        nowhere = live & _is_infeasible(arm, found, t, circle, reach)
        roots = [root & ~nowhere for root in roots]
        certain = [done | nowhere for done in certain]
    both, is_root, is_open = (
        jnp.concatenate(halves),
        jnp.concatenate(roots),
        ~jnp.concatenate(certain),
    )
    held = tally(state.held, both[:, 0], is_root)
    stack, size = append(state.stack, start, both, is_open)
    has_room = jnp.tile(state.held[row] <= _ROOTS, 2)
    found_roots, count = append(state.roots, state.number, both, is_root & has_room)
    return _State(stack, size, found_roots, count, spent, held)


def _is_infeasible(
    arm: OffsetWristParameters,
    found: Posture,
    t: tuple[Lane, Lane],
    circle: WristCircle,
    reach: jax.Array,
) -> jax.Array:
    """Whether the wrist is so near axis 1 all over the interval that no theta_1 reaches it."""
    r, step = arm.radius, arm.radius * 2.0 * reach
    slope = abs(arm.shoulder_angle[0]) / arm.shoulder_angle[1]
    aside = abs(found.out_of_plane) + slope * step
    rate = 2.0 * r * ((found.from_axis_1 + step) + aside * slope)
    return jnp.asarray(found.inside + rate * (2.0 * reach) < 0.0)


def _refine(
    arm: OffsetWristParameters,
    circle: WristCircle,
    signs: tuple[Lane, Lane],
    bracket: jax.Array,
    intervals: jax.Array,
) -> jax.Array:
    """The root in each bracket (regula falsi, Anderson and Bjoerck's weights), or its middle."""
    _, _, low, high, f_low, f_high = (lane.array for lane in lanes.contiguous_lanes(intervals))
    middle = 0.5 * (low + high)
    rounding = CONDITION_ROUNDING.of(intervals.dtype)

    def body(
        _: int, state: tuple[jax.Array, jax.Array, jax.Array, jax.Array]
    ) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        # b is the newest point; the root lies between a and b.
        a, b, f_a, f_b = state
        slope = f_b - f_a
        # At rounding level the weights would throw a converged root back towards the other end.
        stay = (slope == 0) | (jnp.abs(f_b) < 0.25 * rounding)
        c = jnp.where(stay, b, b - f_b * (b - a) / jnp.where(stay, 1.0, slope))
        f_c = condition.at(arm, circle, signs, c, near_shoulder=True).f
        same = (f_c > 0) == (f_b > 0)
        weight = 1.0 - f_c / jnp.where(f_b == 0, 1.0, f_b)
        weight = jnp.where(weight > 0, weight, 0.5)
        return (
            jnp.where(same, a, b),
            c,
            jnp.where(same, f_a * jnp.where(same, weight, 1.0), f_b),
            f_c,
        )

    _, t, _, _ = jax.lax.fori_loop(0, _REFINEMENTS, body, (low, high, f_low, f_high))
    return jnp.where(bracket, t, middle)
