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
from niryo_jax.ik.offset_wrist import condition
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.posture import (
    branch_label,
    joint_angles,
)
from niryo_jax.ik.offset_wrist.wrist_circle import WristCircle
from niryo_jax.ik.results.candidates import Candidates
from niryo_jax.tolerances import SECANT

_ROUGH_SECANTS = 3
_SECANTS = 2
_MARGIN = 1e-3


class _Brackets(NamedTuple):
    """A change of sign in each of the slots: (2, 4, batch), the last change before the first."""

    exists: jax.Array
    low: jax.Array
    f_low: jax.Array
    f_high: jax.Array


def scan_candidates(
    arm: OffsetWristParameters, circle: WristCircle, batch: int, dtype: np.dtype
) -> Candidates:
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
    found = condition.at(arm, circle, (elbow, shoulder), root.t).posture.materialised()
    q = lanes.materialised(joint_angles(arm, circle, found))
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
