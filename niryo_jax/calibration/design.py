"""Where to measure: the configurations, out of many, that tell most of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np
from jax.typing import ArrayLike

from niryo_jax.arguments import check_choice, check_count, check_finite
from niryo_jax.calibration.measurements import ROWS, Kind, Measurements, linearised
from niryo_jax.calibration.parameters import MINIMAL, parameters_of
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.robot import Robot, check_is_robot

_ROUNDS = 20
_LITTLE = 1e-6
_BETTER = 1.0 + 1e-9


def informative(
    robot: Robot,
    candidates: ArrayLike,
    count: int,
    parameters: Sequence[str] = MINIMAL,
    *,
    measured: Kind = "pose",
    sigma: tuple[float, float] = (1e-3, 1e-3),
    hold: Sequence[str] = (),
) -> np.ndarray:
    """The configurations that make the determinant of J^T J largest (a D-optimal design).

    One after the other is taken that adds most, and then exchanged as long as another would add
    more (Fedorov, 1972). The parameters are those of the nominal arm; what no candidate tells has
    no say.

    Args:
        robot: the nominal arm, concrete.
        candidates: (m, n) joint vectors to choose from, radians.
        count: how many.
        parameters, sigma, hold: as of `fit`.
        measured: what will be measured there: "pose", "position" or "distance" (from the origin).

    Returns:
        (count,) the numbers of the candidates that were chosen, in rising order; none twice.

    Raises:
        ValueError: wrong shapes or numbers, more wanted than there are.
    """
    check_is_robot(robot)
    check_choice("measured", measured, get_args(Kind))
    chosen = parameters_of(robot, parameters, hold)
    q = np.asarray(as_floating("candidates", candidates), float)
    check_shape("candidates", q, (robot.joints,))
    check_finite("candidates", q)
    if q.ndim != 2:
        raise ValueError(f"candidates: expected (m, {robot.joints}), got shape {q.shape}")
    count = check_count("count", count, 1, len(q))
    shape = {"pose": (4, 4), "position": (3,), "distance": ()}[measured]
    nothing = np.broadcast_to(
        np.eye(4) if measured == "pose" else np.zeros(shape), (len(q), *shape)
    )
    found = Measurements(measured, q, nothing, np.zeros(3), np.array(sigma, float))
    jacobian = linearised(robot, chosen, found, np.zeros(len(chosen.free)))[1]
    jacobian = jacobian / np.maximum(np.linalg.norm(jacobian, axis=(0, 1)), 1e-300)
    return _most_telling(jacobian, count, ROWS[measured])


def _most_telling(jacobian: np.ndarray, count: int, rows: int) -> np.ndarray:
    """Of (m, rows, k), by the lemma det(A + B^T B) = det(A) det(1 + B A^-1 B^T)."""
    size = jacobian.shape[2]
    taken, free = list[int](), np.ones(len(jacobian), bool)
    information = _LITTLE * np.eye(size)

    def gains(information: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(information)
        return np.linalg.det(np.eye(rows) + jacobian @ inverse @ np.swapaxes(jacobian, 1, 2))

    def part(i: int) -> np.ndarray:
        return jacobian[i].T @ jacobian[i]

    for _ in range(count):
        best = int(np.where(free, gains(information), -np.inf).argmax())
        taken.append(best)
        free[best] = False
        information = information + part(best)
    for _ in range(_ROUNDS):
        changed = False
        for place, old in enumerate(taken):
            without = information - part(old)
            gain = gains(without)
            best = int(np.where(free, gain, -np.inf).argmax())
            if free.any() and gain[best] > _BETTER * gain[old]:
                taken[place], changed = best, True
                free[old], free[best] = True, False
                information = without + part(best)
        if not changed:
            break
    return np.sort(np.array(taken))
