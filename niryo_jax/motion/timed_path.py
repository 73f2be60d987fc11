"""A path of joint vectors and how it is run through in time."""

from __future__ import annotations

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from niryo_jax.lanes.batching import as_floating, broadcast_batch, check_shape
from niryo_jax.motion.paths import JointTrajectory
from niryo_jax.motion.spline import Spline, before, looked_up, place_at
from niryo_jax.motion.time_scaling import quintic
from niryo_jax.motion.times import every_step

Method = Literal["fastest", "quintic"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class TimedPath:
    """Paths from rest to rest.

    Attributes:
        spline: the paths, by the share s of the length that is done.
        time: (..., m) seconds, rising, from 0 to the duration.
        s: (..., m) at these times, from 0 to 1.
        rate: (..., m) ds/dt at these times, 1/s.
        method: how s goes from one of these times to the next; static. "fastest": at constant
            acceleration. "quintic": by `quintic_time_scaling`, from rest to rest.
    """

    spline: Spline
    time: jax.Array
    s: jax.Array
    rate: jax.Array
    method: Method = dataclasses.field(metadata={"static": True})

    @property
    def duration(self) -> jax.Array:
        """(...,) seconds; 0 where there is no way to go."""
        return self.time[..., -1]

    def at(self, time: ArrayLike) -> JointTrajectory:
        """Joint vectors and rates at times (k,) or (..., k), seconds; at rest outside of the path.

        Raises:
            ValueError: a shape that does not broadcast against that of the paths.
            TypeError: no numbers.
        """
        t = as_floating("time", time).astype(self.spline.q.dtype)
        check_shape("time", t, (-1,))
        batch = broadcast_batch(("time", t, 1), ("paths", self.duration, 0))
        if batch != self.duration.shape:
            raise ValueError(
                f"time: expected batch axes of {self.duration.shape}, as the paths, got {t.shape}"
            )
        return JointTrajectory(t, *_at(self, jnp.broadcast_to(t, (*batch, t.shape[-1]))))

    def every(self, step: float) -> JointTrajectory:
        """The paths every so many seconds, from 0 to the first step at or after the longest's end.

        Raises:
            ValueError: a step that is not positive, or more samples than memory has room for.
            TypeError: no number; a duration that is traced.
        """
        last = self.spline.q.shape[-1]
        return self.at(every_step(step, self.duration, self.duration.size * last))


@jax.jit
def _at(path: TimedPath, t: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    times = path.time
    pieces = (times, path.s, path.rate)
    table = jnp.stack(
        [x[..., i : times.shape[-1] - 1 + i] for i in (0, 1) for x in pieces], axis=-1
    )
    row = jnp.clip(before(times, t, "right"), 0, table.shape[-2] - 1)
    start, s0, r0, end, s1, r1 = jnp.moveaxis(looked_up(table, row), -1, 0)
    whole = end - start
    moves = whole > 0
    whole = jnp.where(moves, whole, 1.0)
    inside = moves & (t > 0) & (t < path.duration[..., None])
    past = jnp.where(inside, t - start, 0.0)
    if path.method == "quintic":
        law = quintic(past / whole)
        s, rate, acceleration = law.s, law.rate / whole, law.acceleration / whole**2
    else:
        acceleration = (r1 - r0) / whole
        rate = r0 + past * acceleration
        s = jnp.minimum(s0 + past * (r0 + 0.5 * past * acceleration), s1)
    s = jnp.where(inside, s, jnp.where(t > 0, 1.0, 0.0))
    rate, acceleration = (jnp.where(inside, x, 0.0)[..., None] for x in (rate, acceleration))
    place = place_at(path.spline, s)
    return place.q, place.slope * rate, place.slope * acceleration + place.bend * rate**2
