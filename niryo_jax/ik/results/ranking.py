"""The order of solutions, best first: whole turns within the limits, labels, and slots.

Those within the limits come first, those with the largest margin before the others.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.results.candidates import JointVectors, in_slots
from niryo_jax.ik.results.limits import Limits, limit_margin, wrap_into_limits
from niryo_jax.ik.results.status import Singularity
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.tolerances import LIMIT_ROUNDING, MERGED_ROOT


class Ranked(NamedTuple):
    """Solutions of many poses, in the order in which users see them.

    Attributes:
        q: (..., slots, n), zeros where there is no solution.
        found, within: (..., slots).
        position_error, rotation_error: (..., slots), infinite where there is no solution.
        label: (..., slots), -1 where there is no solution.
        singularity: (..., slots) codes.
    """

    q: jax.Array
    found: jax.Array
    within: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array
    label: jax.Array
    singularity: jax.Array

    def as_fields(self) -> dict[str, jax.Array]:
        """By their names in `IKSolutions`."""
        fields = self._asdict()
        fields["within_limits"] = fields.pop("within")
        return fields


class Answer(NamedTuple):
    """What a method says of a batch of poses.

    Attributes:
        solutions: best first.
        unreachable: (...,) an `UnreachableReason`.
        proved: (...,) whether the solutions are proved to be all.
    """

    solutions: Ranked
    unreachable: jax.Array
    proved: jax.Array


def rank(vectors: JointVectors, limits: Limits, periodic: tuple[bool, ...], slots: int) -> Ranked:
    """The best of any number of joint vectors (..., m, n), in so many slots.

    A `label` that is met again counts as one more sheet: 8 is added to it. Where there are more
    joint vectors than slots, they have no labels.
    """
    lower, upper = limits
    q, found = wrap_into_limits(vectors.q, lower, upper, periodic), vectors.found
    margin = jnp.where(found, limit_margin(q, lower, upper), -jnp.inf)
    label = vectors.label
    if label.shape[-1] <= slots:
        earlier = jnp.tri(label.shape[-1], k=-1, dtype=bool) & found[..., None, :]
        sheet = jnp.sum((label[..., :, None] == label[..., None, :]) & earlier, axis=-1)
        label = label + 8 * sheet.astype(label.dtype)
    order = jnp.argsort(-margin, axis=-1, stable=True)[..., :slots]
    missing = slots - order.shape[-1]

    def in_order(x: jax.Array, empty: float) -> jax.Array:
        axis = order.ndim - 1
        index = order.reshape(order.shape + (1,) * (x.ndim - order.ndim))
        x = jnp.take_along_axis(x, index, axis=axis)
        padding = [(0, 0)] * x.ndim
        padding[axis] = (0, missing)
        x = jnp.pad(x, padding, constant_values=empty) if missing else x
        some = kept.reshape(kept.shape + (1,) * (x.ndim - kept.ndim))
        return jnp.where(some, x, jnp.array(empty, x.dtype))

    kept = jnp.take_along_axis(found, order, axis=-1)
    kept = jnp.pad(kept, [(0, 0)] * (kept.ndim - 1) + [(0, missing)]) if missing else kept
    margin = in_order(margin, -jnp.inf)
    singularity = in_order(vectors.singularity, 0)
    return Ranked(
        q=in_order(q, 0.0),
        found=kept,
        within=kept & (margin >= -_allowance(singularity, q.dtype)),
        position_error=in_order(vectors.position_error, jnp.inf),
        rotation_error=in_order(vectors.rotation_error, jnp.inf),
        label=in_order(label, -1),
        singularity=singularity,
    )


def _allowance(singularity: jax.Array, dtype: np.dtype) -> jax.Array:
    """How far beyond a limit a joint is at it."""
    at = LIMIT_ROUNDING.of(dtype), MERGED_ROOT.of(dtype)
    exact, merged = (jnp.asarray(x, dtype) for x in at)
    isolated = (singularity == Singularity.NONE) | (singularity == Singularity.UNKNOWN)
    return jnp.where(isolated, exact, merged)


def rank_lanes(
    q: Lanes,
    found: jax.Array,
    errors: tuple[jax.Array, jax.Array],
    label: jax.Array,
    singularity: jax.Array,
    limits: Limits,
    periodic: tuple[bool, ...],
    slots: int,
    sheets: bool,
) -> Ranked:
    """`rank` on lanes, of a few candidates (slots first, or for `in_slots`) of each pose.

    With `sheets`, a `label` that is met again counts as one more sheet: 8 is added to it.
    """
    count, dtype = found.shape[0], errors[0].dtype
    rounding = LIMIT_ROUNDING.of(dtype)
    angles, margin = list[jax.Array](), jnp.full(found.shape, jnp.inf, dtype)
    for lane, lower, upper, turns in zip(q, *limits, periodic):
        angle = lane.array
        if turns:
            # atan2 answers -pi where it may; the range is (-pi, pi].
            angle = jnp.where(angle <= -np.pi, np.pi, angle)
            up, down = angle + 2 * np.pi, angle - 2 * np.pi
            angle = jnp.where((angle < lower) & (up <= upper + rounding), up, angle)
            angle = jnp.where((angle > upper) & (down >= lower - rounding), down, angle)
        angle = in_slots(lanes.materialise(Lane(angle)).array, found.shape)
        angles.append(angle)
        margin = jnp.minimum(margin, jnp.minimum(angle - lower, upper - angle))
    worth = lanes.materialise(Lane(jnp.where(found, margin, -jnp.inf)), by=Lane(angles[0])).array
    # Read off a number that is kept, rather than computed again for every pair.
    found = worth > -jnp.inf
    number = jnp.arange(count)[:, None]

    # Counting pairs vectorises over the batch, where sorting does not; so do sums that are written
    # out and numbers of one type, where reductions and integers beside them do not.
    def tally(pair: Callable[[int], jax.Array], weight: int = 0) -> jax.Array:
        terms = ((1 + i * weight) * as_number(pair(i)) for i in range(count))
        return functools.reduce(operator.add, terms)

    def as_number(truth: jax.Array) -> jax.Array:
        return jnp.where(truth, jnp.ones((), dtype), jnp.zeros((), dtype))

    label = label.astype(dtype)
    if sheets:
        earlier = tally(lambda i: (label[i] == label) & (worth[i] > -jnp.inf) & (i < number))
        label = label + 8 * earlier
    within = worth >= -_allowance(singularity, dtype)
    # One small number for all that is not a real one.
    code = label + 1 + 256 * singularity.astype(dtype)
    code = code + 4096 * as_number(found) + 8192 * as_number(within)
    code = lanes.materialise(Lane(code)).array
    # What is kept must be read twice: here, so that the code is not worked out where it is copied
    # to the table, element by element.
    found = code >= 4096
    rank = tally(lambda i: (worth[i] > worth) | ((worth[i] == worth) & (i < number)))
    rank = lanes.materialise(Lane(jnp.where(found, rank, count))).array
    fields = [*angles, *errors, code]
    batch = found.shape[1]
    table = jnp.stack([x.reshape(-1) for x in fields], axis=-1)
    nothing = jnp.array([0.0] * len(angles) + [jnp.inf, jnp.inf, 0.0], dtype)
    table = jnp.concatenate([table, nothing[None]])
    filled = min(count, slots)
    place = jnp.arange(filled, dtype=dtype)[:, None]
    slot = lanes.materialise(Lane(tally(lambda i: rank[i] == place, weight=1))).array
    full = slot > 0
    row = (slot.astype(jnp.int32) - 1) * batch + jnp.arange(batch)
    row = jnp.where(full, row, count * batch)
    ordered = table[row.T]
    empty = jnp.broadcast_to(nothing, (batch, slots - filled, len(nothing)))
    ordered = jnp.concatenate([ordered, empty], axis=1) if empty.shape[1] else ordered
    code = ordered[..., -1].astype(jnp.int32)
    return Ranked(
        q=ordered[..., : len(angles)],
        found=jnp.pad(full.T, ((0, 0), (0, slots - filled))),
        within=code >= 8192,
        position_error=ordered[..., -3],
        rotation_error=ordered[..., -2],
        label=code % 256 - 1,
        singularity=code // 256 % 16,
    )
