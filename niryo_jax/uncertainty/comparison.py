"""The formula and the trials, side by side."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp

from niryo_jax.arguments import check_positive, shown
from niryo_jax.uncertainty.ellipsoid import positive_root
from niryo_jax.uncertainty.propagation import Propagated
from niryo_jax.uncertainty.trials import MonteCarlo


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Comparison:
    """What was drawn against what was propagated, in the frame "tool_point".

    A standard error is how far an estimate of so many draws is from the truth in the mean square,
    for normal errors.

    Attributes:
        rms_ratio: (...,) root mean square of the position error about its mean: drawn over
            propagated.
        half_axes_ratio: (..., 3) half axes of the position ellipsoid: drawn over propagated.
        half_axes_standard_error: () of these ratios, 1 / sqrt(2 (samples - 1)).
        covariance_difference: (..., 6, 6) drawn less propagated, rad and m.
        covariance_standard_error: (..., 6, 6) sqrt((C_ii C_jj + C_ij^2) / (samples - 1)), of the
            propagated C.
        shift_difference: (..., 3) mean displacement, drawn less propagated, metres.
        shift_standard_error: (..., 3) sqrt(C_ii / samples), metres.
    """

    rms_ratio: jax.Array
    half_axes_ratio: jax.Array
    half_axes_standard_error: jax.Array
    covariance_difference: jax.Array
    covariance_standard_error: jax.Array
    shift_difference: jax.Array
    shift_standard_error: jax.Array

    def agrees(self, standard_errors: float = 3.0) -> jax.Array:
        """Whether covariance and shift differ by no more than so many standard errors.

        Args:
            standard_errors: a positive number. Of 24 numbers of normal errors one is farther than
                3 away in 1 of 17 comparisons.

        Returns:
            (...,) truth values.

        Raises:
            ValueError: a number that is not positive. TypeError: no number.
        """
        most = check_positive("standard_errors", standard_errors)
        covariance = jnp.abs(self.covariance_difference) <= most * self.covariance_standard_error
        shift = jnp.abs(self.shift_difference) <= most * self.shift_standard_error
        return jnp.all(covariance, axis=(-1, -2)) & jnp.all(shift, axis=-1)


def compare(propagated: Propagated, trials: MonteCarlo) -> Comparison:
    """Compare the formula with the trials.

    Args:
        propagated: of `propagate`, in the frame "tool_point".
        trials: of `monte_carlo`, at the same joint vectors with noise of the same mean and
            covariance. Batch axes broadcast.

    Returns:
        A `Comparison`. Ratios are NaN where nothing was propagated.

    Raises:
        ValueError: another frame. TypeError: arguments that are none of these.
    """
    _check_kind("propagated", propagated, Propagated)
    _check_kind("trials", trials, MonteCarlo)
    if propagated.frame != "tool_point":
        raise ValueError(
            f"propagated: expected the frame 'tool_point', got {propagated.frame!r}; trials are "
            "in no other"
        )
    return _compared(propagated, trials)


def _check_kind(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        raise TypeError(f"{name}: expected a {kind.__name__}, got {shown(value)}")


@jax.jit
def _compared(propagated: Propagated, trials: MonteCarlo) -> Comparison:
    ours, theirs = propagated.covariance, trials.covariance
    variance = jnp.diagonal(ours, axis1=-2, axis2=-1)
    products = variance[..., :, None] * variance[..., None, :] + ours * ours
    degrees = trials.samples - 1
    traces = (jnp.trace(x[..., 3:, 3:], axis1=-2, axis2=-1) for x in (theirs, ours))
    drawn, expected = map(positive_root, traces)
    return Comparison(
        rms_ratio=drawn / expected,
        half_axes_ratio=trials.ellipsoid().half_axes / propagated.ellipsoid().half_axes,
        half_axes_standard_error=jnp.asarray((2.0 * degrees) ** -0.5, ours.dtype),
        covariance_difference=theirs - ours,
        covariance_standard_error=positive_root(products / degrees),
        shift_difference=trials.mean_shift - propagated.mean_shift,
        shift_standard_error=positive_root(variance[..., 3:] / trials.samples),
    )
