"""Sine, cosine and their inverses as polynomials that vectorise.

XLA calls a scalar library for sin, cos, atan2 and acos on the CPU; these routines are an order of
magnitude faster at errors of one or two units in the last place. The polynomials are minimax fits
(Remez) of our own; the reduction by pi/2 splits it into parts whose products with the quotient are
exact (Cody & Waite). Derivatives are custom rules, so that they are exact and of any order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from niryo_jax.lanes.scalar import Lane, as_lane, maximum, minimum, select


class _Coefficients(NamedTuple):
    half_pi_parts: tuple[float, ...]
    largest_quotient: float
    sin: tuple[float, ...]
    cos: tuple[float, ...]
    atan: tuple[float, ...]


# sin(r) = r + r z S(z), cos(r) = 1 - z/2 + z^2 C(z) for |r| <= pi/4, atan(t) = t + t z A(z) for
# |t| <= tan(pi/8), with z the square of the argument.
_FLOAT64 = _Coefficients(
    half_pi_parts=(
        float.fromhex("0x1.921fb4p+0"),
        float.fromhex("0x1.4442dp-24"),
        float.fromhex("0x1.846988p-48"),
        float.fromhex("0x1.8cc51701b839ap-72"),
    ),
    largest_quotient=2.0**52,
    sin=(
        -0.16666666666666632,
        0.008333333333322316,
        -0.00019841269829725248,
        2.7557313662073704e-06,
        -2.5050753267154146e-08,
        1.589650510336794e-10,
    ),
    cos=(
        0.0416666666666666,
        -0.001388888888887399,
        2.4801587289394964e-05,
        -2.7557314326041323e-07,
        2.0875719560148176e-09,
        -1.135944875604154e-11,
    ),
    atan=(
        -0.333333333333332,
        0.19999999999953239,
        -0.14285714280159056,
        0.11111110781468239,
        -0.0909089769711192,
        0.07692059077208513,
        -0.06663090440166095,
        0.05847785371397178,
        -0.05038814553036282,
        0.03805156502151118,
        -0.01789240051311683,
    ),
)
_FLOAT32 = _Coefficients(
    half_pi_parts=(
        float.fromhex("0x1.92p+0"),
        float.fromhex("0x1.fbp-12"),
        float.fromhex("0x1.51p-22"),
        float.fromhex("0x1.0b4612p-34"),
    ),
    largest_quotient=2.0**22,
    sin=(-0.16666654873507078, 0.008332173545165375, -0.00019516656091917415),
    cos=(0.04166664664785078, -0.001388736145392718, 2.4437730530611244e-05),
    atan=(
        -0.33333315341789327,
        0.19998478556319635,
        -0.1424362871304409,
        0.10594277859455944,
        -0.0607886039043288,
    ),
)
_TAN_PI_8 = math.sqrt(2.0) - 1.0
_PI_REST = 1.2246467991473532e-16  # pi minus its float64


def _coefficients(dtype: np.dtype) -> _Coefficients:
    return _FLOAT64 if dtype == np.float64 else _FLOAT32


def _polynomial(z: Lane, coefficients: Sequence[float]) -> Lane:
    value = Lane(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = value * z + coefficient
    return value


def _two_parts(value: float, dtype: np.dtype) -> tuple[float, float]:
    """A multiple of pi by a power of two: as a number of the dtype, and the rest it rounds off."""
    high = float(np.asarray(value, dtype))
    return high, (value - high) + value * (_PI_REST / math.pi)


@jax.custom_jvp
def _sincos(x: jax.Array) -> tuple[jax.Array, jax.Array]:
    c = _coefficients(x.dtype)
    angle = Lane(x)
    quotient = Lane(lax.round((angle * (2 / math.pi)).array, lax.RoundingMethod.TO_NEAREST_EVEN))
    r = angle
    for part in c.half_pi_parts:
        r = r - quotient * part
    # Beyond this the spacing of floating-point numbers exceeds the period: no answer is right.
    r = select(abs(quotient) <= c.largest_quotient, r, math.nan)
    z = r * r
    sin = r + r * (z * _polynomial(z, c.sin))
    cos = 1.0 - (0.5 * z - z * z * _polynomial(z, c.cos))
    # The quarter turns, modulo 4: 0 to 3.
    quadrant = (quotient - 4.0 * Lane(lax.floor((quotient * 0.25).array))).array
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    sin_r, cos_r = select(odd, cos, sin), select(odd, sin, cos)
    sin_x = select(quadrant >= 2.0, -sin_r, sin_r)
    return (
        select(x == 0, angle, sin_x).array,  # keeps the sign of zero
        select((quadrant == 1.0) | (quadrant == 2.0), -cos_r, cos_r).array,
    )


@_sincos.defjvp
def _sincos_jvp(
    primals: tuple[jax.Array], tangents: tuple[jax.Array]
) -> tuple[tuple[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]:
    sin, cos = _sincos(*primals)
    return (sin, cos), (cos * tangents[0], -sin * tangents[0])


@jax.custom_jvp
def _atan2(y: jax.Array, x: jax.Array) -> jax.Array:
    dtype = x.dtype
    quarter, quarter_rest = _two_parts(math.pi / 4, dtype)
    half, half_rest = _two_parts(math.pi / 2, dtype)
    pi, pi_rest = _two_parts(math.pi, dtype)
    width, height = abs(Lane(x)), abs(Lane(y))
    large, small = maximum(width, height), minimum(width, height)
    # Scaled so that neither the sum below nor a quotient of huge or tiny numbers overflows.
    huge, diagonal = large > 1.0, small >= math.inf
    large, small = (
        select(diagonal, 1.0, select(huge, 0.25 * length, length)) for length in (large, small)
    )
    upper = small > _TAN_PI_8 * large
    numerator = select(upper, small - large, small)
    denominator = select(upper, small + large, large)
    t = numerator / select(denominator <= 0.0, 1.0, denominator)
    z = t * t
    angle = t + t * (z * _polynomial(z, _coefficients(dtype).atan))
    angle = select(upper, quarter + (angle + quarter_rest), angle)
    angle = select(height > width, half - (angle - half_rest), angle)
    angle = select(jnp.signbit(x), pi - (angle - pi_rest), angle)
    return select(jnp.signbit(y), -angle, angle).array


@_atan2.defjvp
def _atan2_jvp(
    primals: tuple[jax.Array, jax.Array], tangents: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, jax.Array]:
    y, x = primals
    scale = jnp.maximum(jnp.abs(x), jnp.abs(y))
    scale = jnp.where((scale > 0) & (scale < jnp.inf), scale, 1.0)
    u, w = y / scale, x / scale
    square = u * u + w * w
    # At the origin the angle has no derivative; 0 keeps a branch that is not taken free of NaN.
    square = jnp.where(square == 0, 1.0, square) * scale
    return _atan2(y, x), (w / square) * tangents[0] - (u / square) * tangents[1]


class Angle(Lane):
    """A lane whose sine and cosine have been computed already."""

    __slots__ = ("turn",)

    def __init__(self, angle: Lane, sin: Lane, cos: Lane) -> None:
        super().__init__(angle.value)
        self.turn = sin, cos


def sincos(angle: Lane) -> tuple[Lane, Lane]:
    """Sine and cosine together.

    Within one or two units in the last place while |angle| is below 1e9 (float64) or 2e4 (float32);
    beyond, the error is that of changing the angle by an ulp. NaN for NaN, infinity, and angles
    whose ulp exceeds a radian.
    """
    if isinstance(angle, Angle):
        return angle.turn
    if isinstance(angle.value, float):
        known = angle.value if math.isfinite(angle.value) else math.nan
        return Lane(math.sin(known)), Lane(math.cos(known))
    sin, cos = _sincos(angle.array)
    return Lane(sin), Lane(cos)


def atan2(y: Lane | float, x: Lane | float) -> Lane:
    """The angle of (x, y) in [-pi, pi], with the signed zeros and infinities of C's atan2.

    Its derivative at the origin, where there is none, is given as 0.
    """
    y, x = as_lane(y), as_lane(x)
    if isinstance(y.value, float) and isinstance(x.value, float):
        return Lane(math.atan2(y.value, x.value))
    dtype = jnp.result_type(y.value, x.value)
    shape = jnp.broadcast_shapes(jnp.shape(y.value), jnp.shape(x.value))
    y_array, x_array = (
        jnp.broadcast_to(jnp.asarray(value, dtype), shape) for value in (y.value, x.value)
    )
    return Lane(_atan2(y_array, x_array))


def acos(x: Lane) -> Lane:
    """The arc cosine in [0, pi], accurate near +-1; NaN outside [-1, 1].

    Its derivative at +-1, where it is infinite, is given as 0.
    """
    return atan2(_sine_of_cosine(x), x)


def asin(x: Lane) -> Lane:
    """The arc sine in [-pi/2, pi/2], accurate near +-1; NaN outside [-1, 1].

    Its derivative at +-1, where it is infinite, is given as 0.
    """
    return atan2(x, _sine_of_cosine(x))


def _sine_of_cosine(x: Lane) -> Lane:
    if isinstance(x.value, float):
        known = (1.0 - x.value) * (1.0 + x.value)
        return Lane(math.sqrt(known) if known >= 0 else math.nan)
    radicand = (1.0 - x.value) * (1.0 + x.value)
    root = jnp.sqrt(jnp.where(radicand == 0, 1.0, radicand))
    return Lane(jnp.where(radicand == 0, 0.0, root))
