"""The one condition of an offset-wrist arm along its curve: at a point, and at nodes of it all."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters
from niryo_jax.ik.offset_wrist.posture import Posture, posture
from niryo_jax.ik.offset_wrist.remainder_bound import (
    Rounding,
    pose_rounding,
    proves,
    remainder_bound,
)
from niryo_jax.ik.offset_wrist.wrist_circle import WristCircle
from niryo_jax.lanes import Lane

NODES = 16
SEGMENTS = 4
SHARE = NODES // SEGMENTS
WIDTH = np.pi / NODES


class Nodes(NamedTuple):
    """The condition at nodes, all along the curve.

    Attributes:
        f: (4, nodes + 1, batch) of each branch.
        rounding: (4, nodes + 1, batch) how far it can be from that of the pose.
    """

    f: jax.Array
    rounding: jax.Array


class Point(NamedTuple):
    """A point of the curve: the condition, the posture, and sine and cosine of t."""

    f: jax.Array
    posture: Posture
    sin_cos: tuple[Lane, Lane]


def branch_signs(branch: jax.Array, dtype: jax.typing.DTypeLike) -> tuple[Lane, Lane]:
    """The signs of elbow and shoulder of a branch 0..3."""
    one = jnp.ones(branch.shape, dtype)
    elbow, shoulder = branch < 2, branch % 2 == 0
    return Lane(jnp.where(elbow, one, -one)), Lane(jnp.where(shoulder, one, -one))


def at(
    arm: OffsetWristParameters,
    circle: WristCircle,
    signs: tuple[Lane, Lane],
    t: jax.Array,
    near_shoulder: bool = False,
) -> Point:
    """The condition at t, on the branch of the signs of elbow and shoulder; `near_shoulder` as of
    `posture`: nothing is proved there by the scan."""
    sin, cos = lanes.sincos(Lane(t))
    sin_cos = lanes.materialise(sin), lanes.materialise(cos)
    found = posture(arm, circle, sin_cos, *signs, near_shoulder)
    return Point(lanes.materialise(found.dot - arm.wrist_angle).array, found, sin_cos)


def at_nodes(
    arm: OffsetWristParameters,
    circle: WristCircle,
    batch: int,
    dtype: jax.typing.DTypeLike,
    given: jax.typing.DTypeLike,
    count: int,
) -> Nodes:
    """The condition at count + 1 nodes.

    Args:
        arm, circle: the numbers of the arm and of the targets.
        batch: how many targets.
        dtype: of the numbers.
        given: the dtype in which the targets are given.
        count: how many intervals the nodes make.
    """
    found = _posture_at(arm, circle, dtype, node(np.arange(count + 1), count))[0]
    f = found.dot - arm.wrist_angle
    values = _branches(f, f, count + 1, batch)
    _, rounding = pose_rounding(arm, abs(found.elbow[1]), abs(found.reach[1]), given)
    return Nodes(values, _branches(rounding, f, count + 1, batch))


def scan(
    arm: OffsetWristParameters,
    circle: WristCircle,
    batch: int,
    dtype: jax.typing.DTypeLike,
    given: jax.typing.DTypeLike,
) -> tuple[jax.Array, jax.Array]:
    """The condition all along the curve; arguments as of `at_nodes`.

    Returns:
        (4, NODES + 1, batch) f of each branch at the nodes; and (4, NODES, batch) of which
        intervals it `proves` what they hold, with one bound for each of SEGMENTS segments.
    """
    found = _posture_at(arm, circle, dtype, node(np.arange(NODES + 1)))[0]
    f = found.dot - arm.wrist_angle
    values, sine = (_branches(x, f, NODES + 1, batch) for x in (f, abs(found.elbow[1])))
    middles = node(SHARE * np.arange(SEGMENTS) + SHARE // 2)
    middle, sin_cos = _posture_at(arm, circle, dtype, middles)
    bound = remainder_bound(arm, circle, middle, sin_cos, np.pi / 2 / SEGMENTS)
    remainder, lever = (
        jnp.repeat(_branches(x, middle.dot, SEGMENTS, batch), SHARE, axis=1) for x in bound
    )
    # |sin E| is least at one end of an interval: sin^2(E/2) is monotone between nodes.
    sine = jnp.minimum(sine[:, :-1], sine[:, 1:])
    rounding = Rounding(*(x.array for x in pose_rounding(arm, Lane(sine), Lane(lever), given)))
    return values, proves(remainder, WIDTH, values[:, :-1], values[:, 1:], rounding)[0]


def _posture_at(
    arm: OffsetWristParameters,
    circle: WristCircle,
    dtype: jax.typing.DTypeLike,
    t: np.ndarray,
) -> tuple[Posture, tuple[Lane, Lane]]:
    """The postures at t on all branches, and sine and cosine of t."""
    # Elbow and shoulder on axes of their own: what one of them does not change is shared.
    one = jnp.array([1.0, -1.0], dtype)
    signs = Lane(one.reshape(2, 1, 1, 1)), Lane(one.reshape(2, 1, 1))
    # The ends of the curve are where an arc's ends meet: exactly there, not almost.
    cos = np.where(np.abs(t) > np.pi / 2 - 1e-9, 0.0, np.cos(t))
    sin_t, cos_t = (Lane(jnp.asarray(x[:, None], dtype)) for x in (np.sin(t), cos))
    return posture(arm, circle, (sin_t, cos_t), *signs), (sin_t, cos_t)


def _branches(lane: Lane, by: Lane, nodes: int, batch: int) -> jax.Array:
    array = jnp.broadcast_to(lanes.materialise(lane, by).array, (2, 2, nodes, batch))
    return array.reshape(4, nodes, batch)


def node(number: Any, count: int = NODES) -> Any:
    """t at the nodes 0..count."""
    return -np.pi / 2 + np.pi / count * number
