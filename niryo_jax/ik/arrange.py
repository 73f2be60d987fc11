"""From candidates to slots: turns within the limits, labels, and the order best first; on lanes."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.arm import Arm
from niryo_jax.ik.solutions import SLOTS
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


def arrange(
    arm: Arm,
    q: Lanes,
    found: jax.Array,
    errors: tuple[jax.Array, jax.Array],
    singularity: jax.Array,
    limits: tuple[jax.Array, jax.Array],
) -> Slots:
    """Order the candidates (slots first) of a batch into `SLOTS` slots."""
    count, dtype = found.shape[0], errors[0].dtype
    rounding = LIMIT_ROUNDING.of(dtype)
    angles, margin = list[jax.Array](), jnp.full(found.shape, jnp.inf, dtype)
    for lane, lower, upper in zip(q, *limits):
        angle = lane.array
        # atan2 answers -pi where it may; the range is (-pi, pi].
        angle = jnp.where(angle <= -np.pi, np.pi, angle)
        up, down = angle + 2 * np.pi, angle - 2 * np.pi
        angle = jnp.where((angle < lower) & (up <= upper + rounding), up, angle)
        angle = jnp.where((angle > upper) & (down >= lower - rounding), down, angle)
        angle = lanes.store(Lane(angle)).array
        angles.append(angle)
        margin = jnp.minimum(margin, jnp.minimum(angle - lower, upper - angle))
    worth = lanes.store(Lane(jnp.where(found, margin, -jnp.inf)), by=Lane(angles[0])).array
    number = jnp.arange(count)[:, None]
    earlier = number < number[:, None]
    # Counting pairs vectorises over the batch, where sorting does not.
    before = (worth > worth[:, None]) | ((worth == worth[:, None]) & earlier)
    rank = jnp.sum(before, axis=1, dtype=jnp.int32)
    label = _labels(arm, q)
    alike = (label == label[:, None]) & found & earlier
    label = label + 8 * jnp.sum(alike, axis=1, dtype=jnp.int32)
    within = found & (margin >= -rounding)
    # One small number for all that is not a real one.
    code = (label + 1) + 256 * (singularity + 16 * (found + 2 * within))
    fields = [*angles, *errors, code.astype(dtype)]
    batch = found.shape[1]
    table = jnp.stack([x.reshape(-1) for x in fields], axis=-1)
    nothing = jnp.array([0.0] * len(angles) + [jnp.inf, jnp.inf, 0.0], dtype)
    table = jnp.concatenate([table, nothing[None]])
    place = jnp.arange(min(count, SLOTS), dtype=jnp.int32)[:, None, None]
    here = jnp.where((rank == place) & found, number + 1, 0)
    slot = jnp.sum(here, axis=1, dtype=jnp.int32)
    row = jnp.where(slot > 0, (slot - 1) * batch + jnp.arange(batch), count * batch)
    row = jnp.pad(row, ((0, SLOTS - len(row)), (0, 0)), constant_values=count * batch)
    ordered = table[row.T]
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


def _labels(arm: Arm, q: Lanes) -> jax.Array:
    """Shoulder (1), elbow (2) and wrist (4) of joint vectors, as the sum of what is positive."""
    (sin_2, cos_2), (sin_3, cos_3) = lanes.sincos(q[1]), lanes.sincos(q[2])
    cos_up, sin_up = arm.raised
    cos_bent, sin_bent = arm.bent
    cos_a, sin_a = cos_2 * cos_up - sin_2 * sin_up, sin_2 * cos_up + cos_2 * sin_up
    turn = arm.turn_3 * sin_3
    cos_e, sin_e = cos_3 * cos_bent - turn * sin_bent, turn * cos_bent + cos_3 * sin_bent
    outward = arm.upper_arm * sin_a + arm.forearm * (sin_a * cos_e + cos_a * sin_e)
    bits = [outward > 0.0, sin_e > 0.0, q[4] > 0.0]
    shoulder, elbow, wrist = (lanes.select(bit, 1.0, 0.0) for bit in bits)
    return lanes.store(shoulder + 2.0 * elbow + 4.0 * wrist, by=outward).array.astype(jnp.int32)
