"""How the joints of a worn arm differ from what its encoders say."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]

# Joints told to move by less than this stay where they are, radians: it is rounding, far below a
# step of any encoder, and must not decide on which side of its play a joint lies.
_STILL = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class Wear:
    """Errors of the six joints, each one number or six; where encoders say q the joints are at

        q (1 + gears) + offsets - play / 2 * direction + noise.

    Attributes:
        offsets: by which a joint stands off its zero, radians.
        gears: the share by which it turns farther than it is told.
        play: of each gear, radians: a joint lags behind by half of it, on the side it came from.
        noise: standard deviation of where a joint comes to rest after each move, radians.
        seed: of the noise.

    Raises:
        ValueError: other shapes, numbers that are not finite, a negative play or noise.
    """

    offsets: ArrayLike = 0.0
    gears: ArrayLike = 0.0
    play: ArrayLike = 0.0
    noise: ArrayLike = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Keep each as (6,)."""
        for name in ("offsets", "gears", "play", "noise"):
            given = getattr(self, name)
            try:
                value = np.broadcast_to(np.asarray(given, float), (6,)).copy()
            except (ValueError, TypeError):
                raise ValueError(f"{name}: expected one number or six, got {given!r}") from None
            least = 0.0 if name in ("play", "noise") else -np.inf
            if not np.all(np.isfinite(value) & (value >= least)):
                wanted = "finite numbers" + ", none below zero" * (least == 0.0)
                raise ValueError(f"{name}: expected {wanted}, got {given!r}")
            value.setflags(write=False)
            object.__setattr__(self, name, value)


class WornJoints:
    """Where the joints of an arm stand, move after move."""

    def __init__(self, wear: Wear) -> None:
        self._wear = wear
        self._rng = np.random.default_rng(wear.seed)
        self._rest: Vector = np.zeros(6)
        self._direction: Vector = np.zeros(6)

    def move(self, path: Vector) -> None:
        """Note a move along joints (k, 6) as encoders say them, the first where it begins."""
        steps = np.diff(path, axis=0)
        moves = np.abs(steps) > _STILL
        for step, moved in zip(steps, moves):
            self._direction = np.where(moved, np.sign(step), self._direction)
        drawn = self._rng.normal(size=6) * np.asarray(self._wear.noise)
        self._rest = np.where(np.any(moves, axis=0), drawn, self._rest)

    def at(self, q: Vector) -> Vector:
        """(6,) where the joints stand when their encoders say q (6,)."""
        wear = self._wear
        lag = np.asarray(wear.play) / 2 * self._direction
        return q * (1.0 + np.asarray(wear.gears)) + np.asarray(wear.offsets) - lag + self._rest
