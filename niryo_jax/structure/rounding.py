"""How far the axes of an arm are from lying as they are taken to lie.

Numbers that were written with ten digits leave axes that should meet a few picometres apart. Such
an arm is solved by the formulas of axes that do meet, and what is found is polished on the arm as
it is. But where two solutions all but merge, those of the one arm may be none of the other, which
a proof must know.
"""

from __future__ import annotations

import functools
import itertools
from types import ModuleType
from typing import Any

import numpy as np

from niryo_jax.structure.axes import distance_between, sine_between
from niryo_jax.tolerances import AXES_EXACT, AXES_MEET, AXES_PARALLEL


def off_by(screws: Any, xp: ModuleType = np) -> Any:
    """The largest of the sines and distances (metres) of axes, screws (n, 6), that are small enough
    to be taken for zero; 0 where all are zero to rounding.

    In float32 the allowances for rounding are as large as what is taken for zero, and this is 0.
    """
    if screws.dtype == np.float32:
        return xp.zeros((), screws.dtype)
    missed = [
        xp.where(size < limit, size, 0.0)
        for first, second in itertools.combinations(screws, 2)
        for size, limit in _sizes(first, second, xp)
    ]
    largest = functools.reduce(xp.maximum, missed, xp.zeros((), screws.dtype))
    return xp.where(largest < AXES_EXACT, 0.0, largest)


def concrete_off_by(screws: np.ndarray) -> float:
    """`off_by` of data, computed once for each arm."""
    return _concrete_off_by(screws.tobytes(), screws.dtype.type)


@functools.lru_cache(maxsize=256)
def _concrete_off_by(screws: bytes, dtype: type) -> float:
    return float(off_by(np.frombuffer(screws, dtype).reshape(-1, 6)))


def _sizes(first: Any, second: Any, xp: ModuleType) -> list[tuple[Any, float]]:
    """What would be zero of a pair of axes that lie in a special way, and what is taken for it."""
    parallel, meet = AXES_PARALLEL.of(first.dtype), AXES_MEET.of(first.dtype)
    turns = [xp.any(screw[:3] != 0) for screw in (first, second)]
    both = turns[0] & turns[1]
    pair = zip(turns, (first, second))
    one, other = (xp.where(turn, screw[:3], screw[3:]) for turn, screw in pair)
    # Of two turns, the angle between axes is a number like any other.
    across = xp.where(both, 1.0, abs(one @ other))
    apart = xp.where(both, distance_between(first, second, xp), 1.0)
    return [(sine_between(one, other, xp), parallel), (across, parallel), (apart, meet)]
