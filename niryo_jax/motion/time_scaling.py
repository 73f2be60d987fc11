"""Time scalings s(t): how far along a path one is at a time (Lynch & Park, section 9.2.2)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_fits
from niryo_jax.lanes.batching import as_floating, check_shape


class TimeScaling(NamedTuple):
    """A time scaling and its derivatives.

    Attributes:
        s: (...) share of the path, 0 at its start and 1 at its end.
        rate: (...) ds/dt, 1/s.
        acceleration: (...) d2s/dt2, 1/s^2.
    """

    s: jax.Array
    rate: jax.Array
    acceleration: jax.Array


Scaling = Literal["cubic", "quintic"] | Callable[[jax.Array], ArrayLike] | ArrayLike
"""A name, a function from the share of the duration to that of the path, or samples of it."""


def cubic_time_scaling(t: ArrayLike, duration: ArrayLike) -> TimeScaling:
    """s = 3 (t/T)^2 - 2 (t/T)^3, which starts and ends at rest (Lynch & Park, section 9.2.2).

    Args:
        t: (...) times, seconds. Before 0 the path rests at its start and after T at its end.
        duration: T, seconds, positive; it broadcasts against t.

    Returns:
        A `TimeScaling` in the dtype of t. The rate is at most 3 / (2 T), the acceleration 6 / T^2;
        the acceleration jumps at both ends.

    Raises:
        ValueError: a duration that is not positive and finite.
    """
    return _clamped(_cubic, t, duration)


def quintic_time_scaling(t: ArrayLike, duration: ArrayLike) -> TimeScaling:
    """s = 10 (t/T)^3 - 15 (t/T)^4 + 6 (t/T)^5, whose acceleration is continuous, 0 at both ends.

    Arguments, result and errors as `cubic_time_scaling` (Lynch & Park, section 9.2.2). The rate
    is at most 15 / (8 T), the acceleration 10 / (sqrt(3) T^2).
    """
    return _clamped(quintic, t, duration)


def sampled(
    scaling: Scaling, duration: ArrayLike, samples: int, dtype: np.dtype, numbers: int
) -> tuple[jax.Array, TimeScaling]:
    """Equally spaced times (..., k) from 0 to a duration (...), and a scaling at these times.

    `numbers` is how many numbers a sample takes of a path that runs for one duration.

    Raises:
        ValueError: a duration that is not positive and finite, fewer than two samples, an unknown
            name, a function whose value is no number, samples of another number or not in [0, 1].
        TypeError: a number of samples that is no integer.
    """
    total = _checked_duration(duration).astype(dtype)[..., None]
    count = check_fits("samples", samples, 2, numbers * max(total.size, 1))
    share = jnp.linspace(0.0, 1.0, count, dtype=dtype)
    if isinstance(scaling, str):
        if scaling not in _POLYNOMIALS:
            expected = " or ".join(map(repr, _POLYNOMIALS))
            raise ValueError(
                f"scaling: expected {expected}, a function or an array, got {scaling!r}"
            )
        law = _POLYNOMIALS[scaling](share)
    elif callable(scaling):
        law = _of_function(scaling, share)
    else:
        law = _of_samples(as_floating("scaling", scaling).astype(dtype), count)
    return _per_second(law, share, total)


@jax.jit
def _per_second(
    law: TimeScaling, share: jax.Array, total: jax.Array
) -> tuple[jax.Array, TimeScaling]:
    """Times, and the scaling with its derivatives per share of the duration made per second."""
    parts = law.s, law.rate / total, law.acceleration / total**2
    return total * share, TimeScaling(*jnp.broadcast_arrays(*parts))


@jax.jit
def _cubic(u: jax.Array) -> TimeScaling:
    return TimeScaling(u * u * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u), 6.0 - 12.0 * u)


@jax.jit
def quintic(u: jax.Array) -> TimeScaling:
    """The scaling of shares u of a duration in [0, 1], and its derivatives by u."""
    rest = u * (1.0 - u)
    s = u * u * u * (10.0 - u * (15.0 - 6.0 * u))
    return TimeScaling(s, 30.0 * rest * rest, 60.0 * rest * (1.0 - 2.0 * u))


_POLYNOMIALS = {"cubic": _cubic, "quintic": quintic}


def _clamped(
    polynomial: Callable[[jax.Array], TimeScaling], t: ArrayLike, duration: ArrayLike
) -> TimeScaling:
    t = as_floating("t", t)
    total = _checked_duration(duration).astype(t.dtype)
    before, after = t < 0.0, t > total
    # Selected, not clipped: at both ends the derivative is that of the inside.
    law = polynomial(jnp.where(before, 0.0, jnp.where(after, 1.0, t / total)))
    rests = before | after
    return TimeScaling(
        law.s,
        jnp.where(rests, 0.0, law.rate / total),
        jnp.where(rests, 0.0, law.acceleration / total**2),
    )


def _of_function(function: Callable[[jax.Array], ArrayLike], share: jax.Array) -> TimeScaling:
    """A function of one number and its derivatives by autodiff."""

    def value(u: jax.Array) -> jax.Array:
        s = as_floating("scaling", function(u))
        if s.shape != ():
            raise ValueError(
                f"scaling: expected a function from a number to a number, got shape {s.shape}"
            )
        return s.astype(u.dtype)

    def first(u: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.jvp(value, (u,), (jnp.ones_like(u),))

    def law(u: jax.Array) -> TimeScaling:
        (s, rate), (_, acceleration) = jax.jvp(first, (u,), (jnp.ones_like(u),))
        return TimeScaling(s, rate, acceleration)

    result = jax.vmap(law)(share)
    _check_share(result.s)
    return result


def _of_samples(s: jax.Array, count: int) -> TimeScaling:
    """Equally spaced samples (..., k) and the derivatives of the parabola through three of them."""
    check_shape("scaling", s, (count,))
    _check_share(s)
    if count == 2:
        rate = jnp.broadcast_to(s[..., 1:] - s[..., :1], s.shape)
        return TimeScaling(s, rate, jnp.zeros_like(s))
    middle = np.clip(np.arange(count), 1, count - 2)
    before, here, after = (s[..., middle + i] for i in (-1, 0, 1))
    second = after - 2.0 * here + before
    offset = jnp.asarray(np.arange(count) - middle, s.dtype)
    first = 0.5 * (after - before) + offset * second
    return TimeScaling(s, first * (count - 1), second * (count - 1) ** 2)


def _checked_duration(duration: ArrayLike) -> jax.Array:
    seconds = as_floating("duration", duration)
    if is_concrete(seconds) and not np.all((numbers := np.asarray(seconds)) > 0) & np.all(
        np.isfinite(numbers)
    ):
        raise ValueError(f"duration: expected a positive number of seconds, got {seconds}")
    return seconds


def _check_share(s: jax.Array) -> None:
    if not is_concrete(s):
        return
    rounding = 16 * float(jnp.finfo(s.dtype).eps)
    numbers = np.asarray(s)
    if not np.all((numbers >= -rounding) & (numbers <= 1 + rounding)):
        raise ValueError(
            "scaling: expected shares of the path in [0, 1], "
            f"got {numbers.min()} to {numbers.max()}"
        )
