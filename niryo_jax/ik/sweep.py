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
from niryo_jax.ik import condition
from niryo_jax.ik.arm import Arm
from niryo_jax.ik.candidates import Candidates, different, in_slots
from niryo_jax.ik.circle import Circle
from niryo_jax.ik.posture import Posture, branch_label, joint_angles, spherical_posture
from niryo_jax.ik.solutions import Singularity
from niryo_jax.lanes import Lane
from niryo_jax.tolerances import CLOSED_FORM, SECANT, SINGULAR_ANGLE

_ROUGH_SECANTS = 3
_SECANTS = 2
_MARGIN = 1e-3


class _Brackets(NamedTuple):
    """A change of sign in each of the slots: (2, 4, batch), the last change before the first."""

    exists: jax.Array
    low: jax.Array
    f_low: jax.Array
    f_high: jax.Array


def sweep(arm: Arm, circle: Circle, batch: int, dtype: np.dtype) -> Candidates:
    """The candidates of a batch of poses, two for each branch."""
    # The scan asks for no more than the signs of f and a bound with an allowance for rounding.
    rough, rough_circle = arm.astype(np.float32), circle.astype(np.float32)
    proved, brackets = _brackets(*condition.scan(rough, rough_circle, batch, np.float32, dtype))
    exists, *ends = (x.reshape(8, batch) for x in brackets)
    signs = condition.branch_signs(jnp.tile(jnp.arange(4), 2)[:, None], np.float32)
    root = _secants(
        lambda t: condition.at(rough, rough_circle, signs, t).f, _start(*ends), _ROUGH_SECANTS
    )
    root = _Root(*(x.astype(dtype) for x in root))
    elbow, shoulder = (sign.astype(dtype) for sign in signs)
    root = _secants(lambda t: condition.at(arm, circle, (elbow, shoulder), t).f, root, _SECANTS)
    found = condition.at(arm, circle, (elbow, shoulder), root.t).posture.stored()
    q = lanes.stored(joint_angles(arm, circle, found))
    # What is proved here has simple roots.
    regular = jnp.zeros((8, batch), jnp.int32)
    return Candidates(q, exists, branch_label(found, q[4]), regular, proved)


def _brackets(f: jax.Array, sure: jax.Array) -> tuple[jax.Array, _Brackets]:
    """Whether two roots at most are proved for each branch, and the first and last sign change."""
    before, after = f[:, :-1], f[:, 1:]
    change = (before > 0) != (after > 0)
    count = jnp.sum(change, axis=1, dtype=jnp.int32)
    proved = jnp.all(sure, axis=(0, 1)) & jnp.all(count <= 2, axis=0)
    number = jnp.arange(condition.NODES, dtype=jnp.int32)[:, None]
    last = jnp.max(jnp.where(change, number, 0), axis=1)
    most = condition.NODES - 1
    first = most - jnp.max(jnp.where(change, most - number, 0), axis=1)
    chosen = jnp.stack([last, first])

    def pick(values: jax.Array) -> jax.Array:
        return jnp.sum(jnp.where(number == chosen[:, :, None], values, 0.0), axis=2)

    low = -np.pi / 2 + condition.WIDTH * chosen.astype(f.dtype)
    exists = jnp.stack([count > 0, count > 1])
    return proved, _Brackets(exists, low, pick(before), pick(after))


class _Root(NamedTuple):
    """A root t between `low` and `high`, and the slope of f there, roughly."""

    t: jax.Array
    slope: jax.Array
    low: jax.Array
    high: jax.Array


_State = tuple[_Root, jax.Array, jax.Array]


def _start(low: jax.Array, f_low: jax.Array, f_high: jax.Array) -> _Root:
    slope = (f_high - f_low) / condition.WIDTH
    # A node so near a root that its sign is rounding may be on the wrong side of it.
    return _Root(low - _over(f_low, slope), slope, low - _MARGIN, low + condition.WIDTH + _MARGIN)


def _secants(f_at: Callable[[jax.Array], jax.Array], root: _Root, steps: int) -> _Root:
    """The root by secants, which cannot leave its bracket."""

    def step(_: int, state: _State) -> _State:
        root, before, f_before = state
        f, move = f_at(root.t), root.t - before
        told = jnp.abs(move) > SECANT.of(move.dtype)
        slope = jnp.where(told, _over(f - f_before, move), root.slope)
        t = jnp.clip(root.t - _over(f, slope), root.low, root.high)
        return root._replace(t=t, slope=slope), root.t, f

    # No point is known before the first; the slope is.
    start = root, root.t, jnp.zeros_like(root.t)
    return jax.lax.fori_loop(0, steps, step, start)[0]


def _over(numerator: jax.Array, denominator: jax.Array) -> jax.Array:
    return numerator / jnp.where(denominator == 0, 1.0, denominator)


def spherical(arm: Arm, circle: Circle, batch: int, dtype: np.dtype) -> Candidates:
    """The candidates of a batch of poses of an arm with a spherical wrist, in closed form."""
    # Each sign on an axis of its own: what a sign does not change is computed once for both.
    signs = jnp.array([1.0, -1.0], dtype)
    root, shoulder, elbow = (Lane(signs.reshape(2, *[1] * axes)) for axes in (3, 2, 1))
    found = spherical_posture(arm, circle, elbow, shoulder, root).stored()
    q = lanes.stored(joint_angles(arm, circle, found))
    miss = abs(found.dot - arm.wrist_angle)
    exists = (miss < CLOSED_FORM.of(dtype)) & (found.inside >= 0.0)
    exists = different(jnp.broadcast_to(exists, (2, 2, 2, batch)), q, (True,) * 6, dtype)
    label, singularity = branch_label(found, q[4]), _singularity(arm, found, dtype)
    exists, label, singularity = (in_slots(x, (8, batch)) for x in (exists, label, singularity))
    return Candidates(q, exists, label, singularity, jnp.ones(batch, bool))


def _singularity(arm: Arm, found: Posture, dtype: np.dtype) -> jax.Array:
    """Which singularity of a spherical-wrist arm a posture is at."""
    near = SINGULAR_ANGLE.of(dtype)
    along = found.axis_4 @ found.axis_6
    square = found.reach @ found.reach
    at_shoulder = found.from_axis_1 * found.from_axis_1 < (near * near) * square
    which = [
        (Singularity.WRIST, 1.0 - along * along < near * near),
        (Singularity.SHOULDER, at_shoulder & np.bool_(arm.is_planar)),
        (Singularity.ELBOW, abs(found.elbow[1]) < near),
    ]
    code = Lane(float(Singularity.NONE))
    for name, here in reversed(which):
        code = lanes.select(here, float(name), code)
    return lanes.store(code, by=along).array.astype(jnp.int32)
