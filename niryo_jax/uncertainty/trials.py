"""Errors of joints drawn many times, and what forward kinematics makes of them: Monte Carlo."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax import lanes
from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_fits, check_number, shown
from niryo_jax.chain import forward_kinematics, tool_motion
from niryo_jax.lanes import Lanes
from niryo_jax.lanes.batching import as_floating, check_shape, on_joints
from niryo_jax.lanes.matrices import product
from niryo_jax.lie import se3, so3
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.specialise import Geometry, specialised
from niryo_jax.uncertainty.checks import check_key
from niryo_jax.uncertainty.ellipsoid import Ellipsoid, ellipsoid_of, positive_root
from niryo_jax.uncertainty.noise import Noise, check_noise

PERCENTILES = (50.0, 95.0, 99.0)

_ROWS = 65_536
"""Joint vectors of one chunk: they stay in the caches of a core."""

_NUMBERS = 2
"""Kept of each draw: a norm, and once more where percentiles are found."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MonteCarlo:
    """What many draws of the errors of the joints made of the pose of the tool.

    The error of a draw has six rows: the rotation vector of R(q + d) R(q)^T, radians, and the
    displacement of the tool's origin, metres, both in the axes of the space frame ("tool_point").

    Attributes:
        mean: (..., 6) mean of the errors.
        covariance: (..., 6, 6) their covariance, about their mean, with samples - 1.
        rms: (...,) root mean square of the norm of the displacement, metres.
        mean_norm: (...,) mean of that norm, metres: the e_t of the lab report.
        percentiles: (..., k) of that norm, metres, at `levels`.
        levels: the k percents; static.
        samples: the number of draws; static.
    """

    mean: jax.Array
    covariance: jax.Array
    rms: jax.Array
    mean_norm: jax.Array
    percentiles: jax.Array
    levels: tuple[float, ...] = dataclasses.field(metadata={"static": True})
    samples: int = dataclasses.field(metadata={"static": True})

    @property
    def position_covariance(self) -> jax.Array:
        """(..., 3, 3) of the displacement of the tool's origin, m^2, axes of the space frame."""
        return self.covariance[..., 3:, 3:]

    @property
    def mean_shift(self) -> jax.Array:
        """(..., 3) mean displacement of the tool's origin, metres, axes of the space frame."""
        return self.mean[..., 3:]

    def ellipsoid(self, probability: float | None = None) -> Ellipsoid:
        """The position ellipsoid; argument and errors are those of `position_ellipsoid`."""
        return ellipsoid_of(self.position_covariance, probability)


class _Draws(NamedTuple):
    """What is drawn from: a model of noise whose parameters are arrays, and a key."""

    noise: Noise
    key: Any


def monte_carlo(
    robot: Robot,
    q: ArrayLike,
    noise: Noise,
    key: ArrayLike,
    samples: int,
    *,
    percentiles: Sequence[float] = PERCENTILES,
) -> MonteCarlo:
    """Draw errors of the joints, and see where the tool goes.

    Draws are made in chunks, so that of each no more than a norm is kept. The same key gives the
    same answer, at any one shape of batch; each configuration of a batch has draws of its own.

    Args:
        robot: the arm.
        q: (..., n) joint vector.
        noise: the model of the errors (`Gaussian`, `Uniform`, ..., and sums of them).
        key: of `jax.random`.
        samples: how many draws for each joint vector, 2 or more; each number makes a program.
        percentiles: percents from 0 to 100, of the norm of the position error.

    Returns:
        A `MonteCarlo`, in the dtype of q. It can be differentiated: the draws are fixed by the
        key and the errors are functions of q and of the parameters of the noise.

    Raises:
        ValueError: wrong shapes, fewer than 2 samples or more than there is memory for,
            percents outside of 0 to 100.
        TypeError: a noise that is no model, no key, a number of samples that is no integer.
    """
    check_is_robot(robot)
    q = as_floating("q", q)
    check_shape("q", q, (robot.joints,))
    check_noise("noise", noise)
    noise.mean(q)  # Says what does not fit.
    check_key("key", key)
    count = check_fits("samples", samples, 2, _NUMBERS * math.prod(q.shape[:-1]))
    levels = _levels(percentiles)
    chunk = min(count, max(1, _ROWS // max(1, math.prod(q.shape[:-1]))))
    cast = jax.tree.map(lambda x: jnp.asarray(x, q.dtype), noise)
    nominal = forward_kinematics(robot, q)
    mean, covariance, norms = _tried(
        robot, q, nominal, _Draws(cast, key), samples=count, chunk=chunk
    )
    rms, mean_norm = _norms(norms)
    percents = _percentiles(norms, levels)
    return MonteCarlo(mean, covariance, rms, mean_norm, percents, levels, count)


def _levels(percentiles: Sequence[float]) -> tuple[float, ...]:
    given: Any = percentiles
    if isinstance(given, str) or not isinstance(given, (Sequence, np.ndarray)):
        raise TypeError(f"percentiles: expected percents, got {shown(given)}")
    what = "percents from 0 to 100"
    return tuple(
        check_number("percentiles", level, what, lambda x: 0.0 <= x <= 100.0) for level in given
    )


def _percentiles(norms: jax.Array, levels: tuple[float, ...]) -> jax.Array:
    """(..., k) with linear interpolation between order statistics."""
    if is_concrete(norms) and norms.size:
        # Numpy does not sort it all, and XLA sorts slowly on a CPU.
        found = np.percentile(np.asarray(norms), levels, axis=-1)
        return jnp.asarray(np.moveaxis(found, 0, -1), norms.dtype)
    found = jnp.percentile(norms, jnp.asarray(levels, norms.dtype), axis=-1)
    return jnp.moveaxis(found, 0, -1)


@jax.jit
def _norms(norms: jax.Array) -> tuple[jax.Array, jax.Array]:
    return positive_root(jnp.mean(norms * norms, axis=-1)), jnp.mean(norms, axis=-1)


@specialised
def _tried(
    geometry: Geometry,
    q: jax.Array,
    nominal: jax.Array,
    draws: _Draws,
    samples: int,
    chunk: int,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Mean and covariance of the errors, and (..., samples) norms of the displacements."""
    batch, dtype = q.shape[:-1], q.dtype

    def error(q: Lanes, nominal: Lanes) -> Lanes:
        rotation, position = tool_motion(geometry, q)
        before, start = se3.split(nominal)
        moved = position - start
        turn = so3.log_lanes(rotation @ before.T)
        return np.concatenate([turn, moved, lanes.lanes_of([lanes.norm(moved)])])

    # Moments of the chunks are put together as Chan, Golub & LeVeque (1979) do, stably.
    @jax.checkpoint
    def merge(
        carry: tuple[jax.Array, jax.Array], number: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
        mean, scatter = carry
        before = (number * chunk).astype(dtype)
        within = (number * chunk + jnp.arange(chunk) < samples).astype(dtype)
        more = jnp.sum(within)
        d = draws.noise.sample(jax.random.fold_in(draws.key, number), q, chunk)
        edge = ("nominal", nominal[..., None, :, :], (4, 4))
        rows = on_joints(error, q[..., None, :] + d, geometry.joints, edge)
        errors, norms = rows[..., :6], rows[..., 6]
        weight = within[:, None]
        here = jnp.sum(errors * weight, axis=-2) / more
        rest = (errors - here[..., None, :]) * weight
        scatter = scatter + product(jnp.swapaxes(rest, -1, -2), rest)
        apart, share = here - mean, more / (before + more)
        scatter = scatter + product(apart[..., :, None], apart[..., None, :]) * before * share
        return (mean + apart * share, scatter), norms

    start = jnp.zeros((*batch, 6), dtype), jnp.zeros((*batch, 6, 6), dtype)
    numbers = jnp.arange(-(-samples // chunk))
    (mean, scatter), norms = jax.lax.scan(merge, start, numbers)
    norms = jnp.moveaxis(norms, 0, -2).reshape(*batch, len(numbers) * chunk)[..., :samples]
    return mean, scatter / (samples - 1), norms
