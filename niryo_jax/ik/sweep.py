"""The common case of the complete solver: a coarse scan, proved complete, and its roots.

Most poses have at most two roots on each of the four branches, and a scan of a few nodes is enough
to prove it (`bounds`). They are solved here in one straight pass over the batch; a pose for which
the proof fails is left to `subdivide`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.arm import Arm
from niryo_jax.ik.bounds import proves, remainder_bound
from niryo_jax.ik.reduction import (
    Circle,
    Posture,
    joint_angles,
    posture,
    spherical_posture,
)
from niryo_jax.ik.solutions import Singularity
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.tolerances import CLOSED_FORM, SAME_SOLUTION, SINGULAR_ANGLE

_NODES = 16
_SEGMENTS = 4
_SECANTS = 5


class Candidates(NamedTuple):
    """Joint vectors of many poses, slots first.

    Attributes:
        q: n lanes of shape (slots, batch).
        exists: (slots, batch) whether a slot holds a candidate.
        singularity: (slots, batch) a `Singularity`.
        proved: (batch,) whether the candidates are proved to be all there can be.
    """

    q: Lanes
    exists: jax.Array
    singularity: jax.Array
    proved: jax.Array


class _Brackets(NamedTuple):
    """A change of sign in each of the slots: (2, 2, 2, batch), the last change before the first."""

    exists: jax.Array
    low: jax.Array
    f_low: jax.Array
    f_high: jax.Array


def sweep(arm: Arm, circle: Circle, batch: int, dtype: np.dtype) -> Candidates:
    """The candidates of a batch of poses, two for each branch."""
    nodes = np.linspace(-np.pi / 2, np.pi / 2, _NODES + 1)
    sin, cos = np.sin(nodes), np.cos(nodes)
    # The ends of the curve are where an arc's ends meet: exactly there, not almost.
    cos[[0, -1]] = 0.0

    def at(which: np.ndarray) -> tuple[Lane, Lane]:
        sin_at, cos_at = (Lane(jnp.asarray(x[which, None], dtype)) for x in (sin, cos))
        return sin_at, cos_at

    signs = jnp.array([1.0, -1.0], dtype)
    shoulder, elbow = Lane(signs[:, None, None, None]), Lane(signs[:, None, None])
    f = posture(arm, circle, at(np.arange(_NODES + 1)), elbow, shoulder).dot - arm.wrist_angle
    f = jnp.broadcast_to(lanes.store(f).array, (2, 2, _NODES + 1, batch))
    share = _NODES // _SEGMENTS
    middles = at(np.arange(share // 2, _NODES, share))
    middle = posture(arm, circle, middles, elbow, shoulder)
    remainder = remainder_bound(arm, circle, middle, middles, np.pi / 2 / _SEGMENTS)
    remainder = lanes.store(remainder, by=middle.dot).array
    proved, found = _brackets(f, jnp.repeat(remainder, share, axis=2), nodes)
    slots = [x.reshape(8, batch) for x in found]
    exists, low, f_low, f_high = slots
    signs = signs[:, None]
    shoulder, elbow = Lane(jnp.tile(jnp.repeat(signs, 2, 0), (2, 1))), Lane(jnp.tile(signs, (4, 1)))

    def f_at(t: jax.Array) -> jax.Array:
        found = posture(arm, circle, _sincos(t), elbow, shoulder)
        return lanes.store(found.dot - arm.wrist_angle).array

    t = _secants(f_at, low, low + np.pi / _NODES, f_low, f_high)
    found = posture(arm, circle, _sincos(t), elbow, shoulder).stored()
    q = lanes.map_lanes(lanes.store, joint_angles(arm, circle, found))
    # What is proved here has simple roots.
    return Candidates(q, exists, jnp.zeros((8, batch), jnp.int32), proved)


def _sincos(t: jax.Array) -> tuple[Lane, Lane]:
    sin, cos = lanes.sincos(Lane(t))
    return lanes.store(sin), lanes.store(cos)


def _brackets(f: jax.Array, remainder: jax.Array, nodes: np.ndarray) -> tuple[jax.Array, _Brackets]:
    """Whether two roots at most are proved for each branch, and the first and last sign change."""
    start, width = float(nodes[0]), float(nodes[1] - nodes[0])
    before, after = f[..., :-1, :], f[..., 1:, :]
    change = (before > 0) != (after > 0)
    sure, _ = proves(remainder, width, before, after)
    count = jnp.sum(change, axis=2, dtype=jnp.int32)
    proved = jnp.all(sure, axis=(0, 1, 2)) & jnp.all(count <= 2, axis=(0, 1))
    number = jnp.arange(len(nodes) - 1, dtype=jnp.int32)[:, None]
    last = jnp.max(jnp.where(change, number, 0), axis=2)
    first = len(nodes) - 2 - jnp.max(jnp.where(change, len(nodes) - 2 - number, 0), axis=2)
    chosen = jnp.stack([last, first])

    def pick(values: jax.Array) -> jax.Array:
        return jnp.sum(jnp.where(number == chosen[..., None, :], values, 0.0), axis=3)

    low = start + width * chosen.astype(f.dtype)
    exists = jnp.stack([count > 0, count > 1])
    return proved, _Brackets(exists, low, pick(before), pick(after))


def _secants(
    f_at: Callable[[jax.Array], jax.Array],
    low: jax.Array,
    high: jax.Array,
    f_low: jax.Array,
    f_high: jax.Array,
) -> jax.Array:
    """The root in each bracket by secants, which cannot leave it."""

    def over(numerator: jax.Array, denominator: jax.Array) -> jax.Array:
        return numerator / jnp.where(denominator == 0, 1.0, denominator)

    closer = jnp.abs(f_low) < jnp.abs(f_high)
    t_before, f_before = jnp.where(closer, low, high), jnp.where(closer, f_low, f_high)
    t = low - f_low * over(high - low, f_high - f_low)
    for _ in range(_SECANTS):
        f = f_at(t)
        step = -f * over(t - t_before, f - f_before)
        t_before, f_before = t, f
        t = lanes.store(Lane(jnp.clip(t + step, low, high))).array
    return t


def spherical(arm: Arm, circle: Circle, batch: int, dtype: np.dtype) -> Candidates:
    """The candidates of a batch of poses of an arm with a spherical wrist, in closed form."""
    signs = jnp.array([1.0, -1.0], dtype)[:, None]
    root, shoulder, elbow = (
        Lane(jnp.tile(jnp.repeat(signs, 4 >> i, 0), (1 << i, 1))) for i in range(3)
    )
    found = spherical_posture(arm, circle, elbow, shoulder, root).stored()
    q = lanes.map_lanes(lanes.store, joint_angles(arm, circle, found))
    miss = abs(found.dot - arm.wrist_angle)
    exists = (miss < CLOSED_FORM.of(dtype)) & (found.inside >= 0.0)
    exists = jnp.broadcast_to(exists, (8, batch))
    exists = exists & ~_merged(q, batch, dtype)
    return Candidates(q, exists, _singularity(arm, found, batch, dtype), jnp.ones(batch, bool))


def _singularity(arm: Arm, found: Posture, batch: int, dtype: np.dtype) -> jax.Array:
    """Which singularity of a spherical-wrist arm a posture is at."""
    near = SINGULAR_ANGLE.of(dtype)
    along = found.axis_4 @ found.axis_6
    square = found.reach @ found.reach
    at_shoulder = found.from_axis_1 * found.from_axis_1 < (near * near) * square
    return jnp.select(
        [
            jnp.broadcast_to(1.0 - along * along < near * near, (8, batch)),
            jnp.broadcast_to(at_shoulder & np.bool_(arm.is_planar), (8, batch)),
            jnp.broadcast_to(abs(found.elbow[1]) < near, (8, batch)),
        ],
        [jnp.int32(x) for x in (Singularity.WRIST, Singularity.SHOULDER, Singularity.ELBOW)],
        jnp.int32(Singularity.NONE),
    )


def _merged(q: Lanes, batch: int, dtype: np.dtype) -> jax.Array:
    """Whether a solution is the same as the one that differs from it in one sign, and is later."""
    merged = jnp.zeros((2, 2, 2, batch), bool)
    for axis in range(3):
        same = jnp.ones((2, 2, batch), bool)
        for lane in q:
            pair = jnp.moveaxis(lane.array.reshape(2, 2, 2, batch), axis, 0)
            turn = jnp.abs(pair[1] - pair[0])
            same = same & (jnp.minimum(turn, 2 * np.pi - turn) < SAME_SOLUTION.of(dtype))
        later = jnp.stack([jnp.zeros_like(same), same], axis=axis)
        merged = merged | later
    return merged.reshape(8, batch)
