"""The common case of the complete solver: a coarse scan, proved complete, and its roots.

Most poses have at most two roots on each of the four branches (four where the wrist offset is
large), and a scan of a few nodes is enough to prove it. They are solved here in one straight pass
over the batch; a pose for which the proof fails is left to `subdivision`.
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
from niryo_jax.ik.offset_wrist.product import product_of_branches
from niryo_jax.ik.offset_wrist.wrist_circle import WristCircle, may_just_reach
from niryo_jax.ik.results.candidates import Candidates
from niryo_jax.ik.trig_polynomial import forms_on_arcs, most_roots
from niryo_jax.lanes import Lane
from niryo_jax.tolerances import SECANT

_FEW, _MANY = (2, 16), (4, 48)
"""How many roots of a branch are looked for, and in how many intervals."""

_ARCS = 16
_ROUGH_SECANTS = 3
_SECANTS = 2
_MARGIN = 1e-3


class _Brackets(NamedTuple):
    """A change of sign in each of the slots: (slots, 4, batch)."""

    exists: jax.Array
    low: jax.Array
    high: jax.Array
    f_low: jax.Array
    f_high: jax.Array


def scan_candidates(
    arm: OffsetWristParameters, circle: WristCircle, batch: int, dtype: np.dtype
) -> Candidates:
    """The candidates of a batch of poses, two or four for each branch."""
    # The scan asks for no more than the signs of f, with an allowance for rounding.
    rough, rough_circle = arm.astype(np.float32), circle.astype(np.float32)
    if dtype == np.float64:
        margin, (most, count) = 0.0, _MANY if arm.is_far else _FEW
        nodes = condition.at_nodes(rough, rough_circle, batch, np.float32, dtype, count)
        brackets, all_changes = _brackets(nodes.f, most)
        proved = all_changes & _are_all(arm, circle, nodes, brackets)
    else:
        # In float32 noise hides half of what the product tells.
        # A node so near a root that its sign is rounding may be on the wrong side of it.
        margin, most = _MARGIN, 2
        f, sure = condition.scan(rough, rough_circle, batch, np.float32, dtype)
        brackets, all_changes = _brackets(f, most)
        proved = all_changes & jnp.all(sure, axis=(0, 1))
    proved = proved & ~may_just_reach(arm, circle)
    slots = 4 * most
    brackets = _Brackets(*(x.reshape(slots, batch) for x in brackets))
    signs = condition.branch_signs(jnp.tile(jnp.arange(4), most)[:, None], np.float32)
    root = _secants(
        lambda t: condition.at(rough, rough_circle, signs, t).f,
        _start(brackets, margin),
        _ROUGH_SECANTS,
    )
    root = _Root(*(x.astype(dtype) for x in root))
    elbow, shoulder = (sign.astype(dtype) for sign in signs)
    root = _secants(lambda t: condition.at(arm, circle, (elbow, shoulder), t).f, root, _SECANTS)
    found = condition.at(arm, circle, (elbow, shoulder), root.t).posture.materialised()
    q = lanes.materialised(joint_angles(arm, circle, found))
    # What is proved here has simple roots.
    regular = jnp.zeros((slots, batch), jnp.int32)
    return Candidates(q, brackets.exists, branch_label(found, q[4]), regular, proved)


def _are_all(
    arm: OffsetWristParameters,
    circle: WristCircle,
    nodes: condition.Nodes,
    brackets: _Brackets,
) -> jax.Array:
    """Whether the product of all branches has no more roots than there are brackets, each of which
    holds one, since f is farther from zero at the nodes than rounding can move it."""
    product = product_of_branches(arm, circle)
    margin = Lane(product.margin) + arm.moved
    most, _ = most_roots(forms_on_arcs(product, _ARCS), margin.array)
    as_many = jnp.sum(most, axis=0) == jnp.sum(brackets.exists, axis=(0, 1), dtype=jnp.int32)
    return as_many & jnp.all(jnp.abs(nodes.f) > nodes.rounding, axis=(0, 1))


def _brackets(f: jax.Array, most: int) -> tuple[_Brackets, jax.Array]:
    """Changes of sign of each branch: the last, the first, the second, the last but one; and
    (batch,) whether no branch has more than these."""
    before, after = f[:, :-1], f[:, 1:]
    nodes = before.shape[1]
    change = (before > 0) != (after > 0)
    count = jnp.sum(change, axis=1, dtype=jnp.int32)
    number = jnp.arange(nodes, dtype=jnp.int32)[:, None]

    def last_of(which: jax.Array) -> jax.Array:
        return jnp.max(jnp.where(which, number, 0), axis=1)

    def first_of(which: jax.Array) -> jax.Array:
        return nodes - 1 - jnp.max(jnp.where(which, nodes - 1 - number, 0), axis=1)

    chosen = [last_of(change), first_of(change)]
    if most > 2:
        last, first = (x[:, None] for x in chosen)
        chosen += [first_of(change & (number > first)), last_of(change & (number < last))]
    places = jnp.stack(chosen)

    def pick(values: jax.Array) -> jax.Array:
        return jnp.sum(jnp.where(number == places[:, :, None], values, 0.0), axis=2)

    low, high = (condition.node(x.astype(f.dtype), nodes) for x in (places, places + 1))
    exists = jnp.stack([count > i for i in range(most)])
    whole = jnp.all(count <= most, axis=0)
    return _Brackets(exists, low, high, pick(before), pick(after)), whole


class _Root(NamedTuple):
    """A root t between `low` and `high`, and the slope of f there, roughly."""

    t: jax.Array
    slope: jax.Array
    low: jax.Array
    high: jax.Array


_State = tuple[_Root, jax.Array, jax.Array]


def _start(brackets: _Brackets, margin: float) -> _Root:
    _, low, high, f_low, f_high = brackets
    slope = (f_high - f_low) / (high - low)
    return _Root(low - _over(f_low, slope), slope, low - margin, high + margin)


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
