"""Paths of poses that are no straight lines: arcs of circles, and polylines with round corners."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_finite, check_fits, check_motion, check_positive
from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape
from niryo_jax.lie import so3
from niryo_jax.motion.paths import cartesian_trajectory
from niryo_jax.motion.spline import before, looked_up, norm
from niryo_jax.tolerances import ARC_SINE


def arc(start: ArrayLike, via: ArrayLike, end: ArrayLike, samples: int) -> jax.Array:
    """Poses along the arc of a circle, equally spaced, while the rotation follows its geodesic.

    Args:
        start, end: (..., 4, 4) poses in the space frame, metres; batch axes broadcast.
        via: (..., 3) a point of the arc between them, metres.
        samples: k, 2 or more.

    Returns:
        (..., k, 4, 4), for `best_path` or `follow`; `retime` says when they are taken. Traced
        points on one line give the straight line from start to end.

    Raises:
        ValueError: wrong shapes, poses that are no rigid motions, three points on one line.
        TypeError: a number of samples that is no integer.
    """
    first, last, point = (
        as_floating(name, x) for name, x in (("start", start), ("end", end), ("via", via))
    )
    check_shape("via", point, (3,))
    check_finite("via", point)
    line = cartesian_trajectory(first, last, 1.0, samples, lambda u: u).pose
    batch = broadcast_batch(("start, end", line, 3), ("via", point, 1))
    dtype = jnp.result_type(line, point)
    p, q = (line[..., i, :3, 3] for i in (0, -1))
    way, bent = _arc(p.astype(dtype), point.astype(dtype), q.astype(dtype), line.shape[-3])
    if is_concrete(bent) and not np.all(bent):
        raise ValueError(
            f"via: expected a point off the line through both ends, all three apart, got {point}"
        )
    line = jnp.broadcast_to(line.astype(dtype), (*batch, *line.shape[-3:]))
    position = jnp.where(bent[..., None, None], way, line[..., :3, 3])
    return line.at[..., :3, 3].set(position)


def _arc(p: jax.Array, via: jax.Array, q: jax.Array, count: int) -> tuple[jax.Array, jax.Array]:
    """Points (..., count, 3) from p through via to q, and whether the three make a circle."""
    a, b = via - p, q - p
    normal = jnp.cross(a, b)
    square = jnp.sum(normal * normal, axis=-1)
    aa, bb = (jnp.sum(x * x, axis=-1) for x in (a, b))
    bent = square > ARC_SINE.of(p.dtype) ** 2 * aa * bb
    safe = jnp.where(bent, square, 1.0)[..., None]
    # The circle through three points; it is run through anticlockwise about the normal.
    centre = aa[..., None] * jnp.cross(b, normal) + bb[..., None] * jnp.cross(normal, a)
    centre = centre / (2.0 * safe)
    axis = normal / jnp.sqrt(safe)
    spoke, other = -centre, b - centre
    sine = jnp.sum(axis * jnp.cross(spoke, other), axis=-1)
    cosine = jnp.sum(spoke * other, axis=-1)
    angle = jnp.arctan2(jnp.where(bent, sine, 0.0), jnp.where(bent, cosine, 1.0))
    angle = jnp.where(angle < 0, angle + 2.0 * math.pi, angle)
    turn = (angle[..., None] * jnp.linspace(0.0, 1.0, count, dtype=p.dtype))[..., None]
    spoke, side = (x[..., None, :] for x in (spoke, jnp.cross(axis, spoke)))
    way = (p + centre)[..., None, :] + jnp.cos(turn) * spoke + jnp.sin(turn) * side
    return way, bent


class _Pieces(NamedTuple):
    """Parabolas of positions and of rotations, one after the other; (..., pieces, ...) each.

    Attributes:
        points: three control points (3, 3).
        turns: the rotations (3, 3, 3) at these.
        length: metres, of parabolas between those of the chord and of the control polygon.
    """

    points: jax.Array
    turns: jax.Array
    length: jax.Array


def blend(poses: ArrayLike, radius: float, samples: int) -> jax.Array:
    """Poses along straight lines from pose to pose, with corners rounded by parabolas.

    A corner is left `radius` before it, or where half of a shorter line is done, and the next line
    is met as far after it. The tangent is continuous, and so is the axis about which the tool
    turns: de Casteljau's construction of the parabola, with geodesics in the place of chords for
    the rotations. The corner itself is passed by at half the radius at most.

    Args:
        poses: (..., k, 4, 4) corners in the space frame, metres; the first and the last are met.
        radius: metres, positive.
        samples: 2 or more; about equally spaced.

    Returns:
        (..., samples, 4, 4), for `best_path` or `follow`; `retime` says when they are taken.

    Raises:
        ValueError: wrong shapes, poses that are no rigid motions, or stay where the one before is;
            a radius that is not positive.
        TypeError: a number of samples that is no integer, a radius that is no number.
    """
    corners = as_floating("poses", poses)
    if corners.ndim < 3 or corners.shape[-2:] != (4, 4) or corners.shape[-3] < 2:
        raise ValueError(f"poses: expected shape (..., k, 4, 4) with k >= 2, got {corners.shape}")
    check_motion("poses", corners)
    check_positive("radius", radius, "a positive number of metres")
    count = check_fits("samples", samples, 2, 64 * max(math.prod(corners.shape[:-3]), 1))
    p, turns = corners[..., :3, 3], corners[..., :3, :3]
    chords = p[..., 1:, :] - p[..., :-1, :]
    if is_concrete(chords) and not np.all(np.any(np.asarray(chords) != 0, axis=-1)):
        raise ValueError("poses: expected each position to differ from the one before it")
    return _sampled(_pieces(p, turns, float(radius)), count)


@jax.jit
def _pieces(p: jax.Array, turns: jax.Array, radius: jax.Array | float) -> _Pieces:
    chords = p[..., 1:, :] - p[..., :-1, :]
    lengths = norm(chords)
    safe = jnp.where(lengths > 0, lengths, 1.0)
    way = so3.log(jnp.swapaxes(turns[..., :-1, :, :], -1, -2) @ turns[..., 1:, :, :])
    cut = jnp.minimum(radius, 0.5 * jnp.minimum(lengths[..., 1:], lengths[..., :-1]))
    none = jnp.zeros_like(lengths[..., :1])
    # Shares of each line at which it begins and ends.
    begin = jnp.concatenate([none, cut], axis=-1) / safe
    end = 1.0 - jnp.concatenate([cut, none], axis=-1) / safe

    def on_line(share: jax.Array) -> tuple[jax.Array, jax.Array]:
        turned = so3.exp(way * share[..., None])
        return p[..., :-1, :] + chords * share[..., None], turns[..., :-1, :, :] @ turned

    ends = on_line(begin), on_line(0.5 * (begin + end)), on_line(end)
    lines, line_turns = (jnp.stack(parts, axis=-i) for parts, i in zip(zip(*ends), (2, 3)))
    corner = (
        jnp.stack([lines[..., :-1, 2, :], p[..., 1:-1, :], lines[..., 1:, 0, :]], axis=-2),
        jnp.stack(
            [line_turns[..., :-1, 2, :, :], turns[..., 1:-1, :, :], line_turns[..., 1:, 0, :, :]],
            axis=-3,
        ),
    )

    def woven(line: jax.Array, corner: jax.Array, axis: int) -> jax.Array:
        """Line, corner, line, ..."""
        first, rest = jnp.split(line, [1], axis=axis)
        pairs = jnp.stack([corner, rest], axis=axis)
        shape = [*corner.shape]
        shape[axis] *= 2
        return jnp.concatenate([first, pairs.reshape(shape)], axis=axis)

    points, rotations = woven(lines, corner[0], -3), woven(line_turns, corner[1], -4)
    steps = norm(points[..., 1:, :] - points[..., :-1, :])
    chord = norm(points[..., 2, :] - points[..., 0, :])
    return _Pieces(points, rotations, (2.0 * chord + jnp.sum(steps, axis=-1)) / 3.0)


@functools.partial(jax.jit, static_argnums=1)
def _sampled(pieces: _Pieces, count: int) -> jax.Array:
    """Poses (..., count, 4, 4) at equal shares of the length of all pieces."""
    length = pieces.length
    ends = jnp.cumsum(length, axis=-1)
    starts = jnp.concatenate([jnp.zeros_like(ends[..., :1]), ends], axis=-1)
    way = ends[..., -1:] * jnp.linspace(0.0, 1.0, count, dtype=length.dtype)
    piece = jnp.clip(before(starts, way, "left"), 0, length.shape[-1] - 1)
    numbers = [starts[..., :-1, None], length[..., None]]
    numbers += [x.reshape(*length.shape, -1) for x in (pieces.points, pieces.turns)]
    rows = looked_up(jnp.concatenate(numbers, axis=-1), piece)
    start, whole, points, turns = jnp.split(rows, [1, 2, 11], axis=-1)
    u = jnp.clip((way[..., None] - start) / jnp.where(whole > 0, whole, 1.0), 0.0, 1.0)
    a, b, c = jnp.split(points, 3, axis=-1)
    position = (1.0 - u) ** 2 * a + 2.0 * u * (1.0 - u) * b + u * u * c
    first, middle, last = (x.reshape(*x.shape[:-1], 3, 3) for x in jnp.split(turns, 3, axis=-1))

    def between(a: jax.Array, b: jax.Array) -> jax.Array:
        return a @ so3.exp(u * so3.log(jnp.swapaxes(a, -1, -2) @ b))

    rotation = between(between(first, middle), between(middle, last))
    bottom = jnp.broadcast_to(jnp.asarray([0.0, 0.0, 0.0, 1.0], u.dtype), (*u.shape[:-1], 1, 4))
    upper = jnp.concatenate([rotation, position[..., None]], axis=-1)
    return jnp.concatenate([upper, bottom], axis=-2)
