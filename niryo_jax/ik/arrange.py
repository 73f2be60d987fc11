"""From candidates to slots: turns within the limits, labels, and the order best first; on lanes."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.candidates import in_slots
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.tolerances import LIMIT_ROUNDING


class Slots(NamedTuple):
    """Solutions of many poses, in the order in which users see them.

    Attributes:
        q: (batch, slots, n), zeros where there is no solution.
        found, within: (batch, slots).
        position_error, rotation_error: (batch, slots), infinite where there is no solution.
        label: (batch, slots), -1 where there is no solution.
        singularity: (batch, slots) codes.
    """

    q: jax.Array
    found: jax.Array
    within: jax.Array
    position_error: jax.Array
    rotation_error: jax.Array
    label: jax.Array
    singularity: jax.Array


class Answer(NamedTuple):
    """What the solver says of a batch of poses.

    Attributes:
        slots: the solutions.
        reach: (batch,) an `Obstacle`: whether every point of the wrist's circle is too far or near.
        proved: (batch,) whether the solutions are proved to be all.
    """

    slots: Slots
    reach: jax.Array
    proved: jax.Array


Limits = tuple[jax.Array, jax.Array]
"""Lower and upper (n,)."""


def arrange(
    q: Lanes,
    found: jax.Array,
    errors: tuple[jax.Array, jax.Array],
    label: jax.Array,
    singularity: jax.Array,
    limits: Limits,
    periodic: tuple[bool, ...],
    slots: int,
) -> Slots:
    """Order the candidates (slots first, or for `in_slots`) of a batch into so many slots.

    A `label` of `branch_label` that is met again counts as one more sheet: 8 is added to it.
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
        angle = in_slots(lanes.store(Lane(angle)).array, found.shape)
        angles.append(angle)
        margin = jnp.minimum(margin, jnp.minimum(angle - lower, upper - angle))
    worth = lanes.store(Lane(jnp.where(found, margin, -jnp.inf)), by=Lane(angles[0])).array
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

    rank = tally(lambda i: (worth[i] > worth) | ((worth[i] == worth) & (i < number)))
    rank = jnp.where(found, rank, count)
    label = label.astype(dtype)
    sheet = tally(lambda i: (label[i] == label) & (worth[i] > -jnp.inf) & (i < number))
    within = worth >= -rounding
    # One small number for all that is not a real one.
    code = label + 8 * sheet + 1 + 256 * singularity.astype(dtype)
    code = code + 4096 * as_number(found) + 8192 * as_number(within)
    fields = [*angles, *errors, code]
    batch = found.shape[1]
    table = jnp.stack([x.reshape(-1) for x in fields], axis=-1)
    nothing = jnp.array([0.0] * len(angles) + [jnp.inf, jnp.inf, 0.0], dtype)
    table = jnp.concatenate([table, nothing[None]])
    filled = min(count, slots)
    place = jnp.arange(filled, dtype=dtype)[:, None]
    slot = tally(lambda i: rank[i] == place, weight=1).astype(jnp.int32)
    row = jnp.where(slot > 0, (slot - 1) * batch + jnp.arange(batch), count * batch)
    ordered = table[row.T]
    empty = jnp.broadcast_to(nothing, (batch, slots - filled, len(nothing)))
    ordered = jnp.concatenate([ordered, empty], axis=1) if empty.shape[1] else ordered
    code = ordered[..., -1].astype(jnp.int32)
    return Slots(
        q=ordered[..., : len(angles)],
        found=code >= 4096,
        within=code >= 8192,
        position_error=ordered[..., -3],
        rotation_error=ordered[..., -2],
        label=code % 256 - 1,
        singularity=code // 256 % 16,
    )
