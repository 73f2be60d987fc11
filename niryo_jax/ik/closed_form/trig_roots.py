"""Roots of the equations of closed forms, on lanes, two at most.

Next to a double root rounding decides whether there is one. So a root that is missing by less than
`CLOSED_FORM` counts, and whoever asks looks at how well the pose is reached.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.ik.closed_form.joint_motion import Roots, turn_of
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.tolerances import (
    CLOSED_FORM,
    DEGENERATE_ROOT,
    LOOSE_ROOT,
    SINGULAR_ANGLE,
    VANISHING_LENGTH,
)


def sinusoid_root(
    p: Lane,
    q: Lane,
    constant: Lane,
    sign: Lane | float,
    scale: Lane,
    inside: Lane | None = None,
) -> tuple[Lanes, Roots]:
    """A turn x with p cos x + q sin x + constant = 0; no turn where p and q vanish.

    Where there is no root, it is the turn that comes nearest to one.

    Args:
        p, q, constant: the sinusoid.
        sign: 1 or -1: which of its two roots.
        scale: the size of the quantities whose difference the sinusoid is.
        inside: p^2 + q^2 - constant^2, where a caller knows it without cancellation.
    """
    square, rest = p * p + q * q, constant * constant
    inside = square - rest if inside is None else inside
    dtype = jnp.result_type(scale.value, square.value)
    near, rounding = SINGULAR_ANGLE.of(dtype), CLOSED_FORM.of(dtype)
    length = lanes.sqrt(square)
    some = length > VANISHING_LENGTH.of(dtype)
    per = lanes.materialise(lanes.select(some, 1.0 / lanes.select(some, length, 1.0), 0.0))
    close = abs(constant) <= length + DEGENERATE_ROOT.of(dtype) * scale
    p, q, constant = p * per, q * per, constant * per
    far = sign * lanes.sqrt(inside * per * per)
    turn = turn_of(-constant * p - far * q, far * p - constant * q)
    free = length <= rounding * scale
    exist = inside >= -rounding * (square + rounding * scale * scale)
    loose = inside <= LOOSE_ROOT * scale * scale
    margin = inside / (scale * scale)
    return turn, Roots(exist, inside <= (near * near) * square, free, close, loose, margin)


def quadratic_root(half: Lane, rest: Lane, sign: Lane | float, scale: Lane) -> tuple[Lane, Roots]:
    """A length x with x^2 - 2 half x + rest = 0.

    Args:
        half, rest: the equation.
        sign: 1 or -1: which of its two roots.
        scale: the size of the lengths that the equation is about.
    """
    dtype = jnp.result_type(scale.value, half.value)
    near, rounding = SINGULAR_ANGLE.of(dtype), CLOSED_FORM.of(dtype)
    inside = half * half - rest
    root = half + sign * lanes.sqrt(inside)
    square = scale * scale
    exist = inside >= -rounding * square
    close = inside >= -DEGENERATE_ROOT.of(dtype) * square
    loose = inside <= LOOSE_ROOT * square
    double = inside <= (near * near) * square
    return root, Roots(exist, double, np.bool_(False), close, loose, inside / square)
