"""The parameters that fit measurements best: Levenberg-Marquardt on the product of exponentials.

Steps solve (J^T W J + m D) s = J^T W r, with D the diagonal of J^T W J (Marquardt, 1963), so that
metres and radians need no scale; W are the weights of a robust loss. What no measurement tells is
never moved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from niryo_jax.calibration.loss import Loss, cost, spread, weights
from niryo_jax.calibration.measurements import ROWS, Measurements, linearised
from niryo_jax.calibration.parameters import Parameters
from niryo_jax.robot import Robot

_STEPS, _SCALES = 100, 8
_FIRST, _LEAST, _MOST = 1e-3, 1e-9, 1e12
_SILENT = 1e-16
"""A parameter whose square this share of others' is the rounding of, measurements do not tell."""

_SETTLED = 1e-3


class Fit(NamedTuple):
    """What was found.

    Attributes:
        x: (m,) values of the free parameters.
        residuals: (N, rows) in standard deviations as they were given.
        jacobian: (N, rows, m) of what is predicted, in the same units.
        weights: (N,) how much each measurement counts.
        scale: the standard deviations that are seen, over those that were given.
        steps: how many were taken.
        settled: whether the last of them changed nothing.
    """

    x: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    weights: np.ndarray
    scale: float
    steps: int
    settled: bool


def least_squares(robot: Robot, parameters: Parameters, found: Measurements, loss: Loss) -> Fit:
    """The fit of the free parameters, which begin at 0.

    Tukey's loss begins where Huber's ends, since it has minima of its own. The scale of a robust
    loss is that of the smaller half of the residuals, found again until it stays.
    """
    rows, steps, settled = ROWS[found.kind], 0, False
    x = np.zeros(len(parameters.free))
    scale = 1.0
    for stage in ("huber", "tukey") if loss == "tukey" else (loss,):
        for _ in range(1 if loss == "linear" else _SCALES):
            if stage != "linear":
                norms = np.linalg.norm(linearised(robot, parameters, found, x)[0], axis=1)
                new = max(spread(norms, rows), 1e-12)
                stays, scale = abs(new - scale) < _SETTLED * scale, new
                if stays and steps:
                    break
            x, taken, settled = _descended(robot, parameters, found, x, stage, scale)
            steps += taken
    r, jacobian = linearised(robot, parameters, found, x)
    count = weights(loss, np.linalg.norm(r, axis=1) / scale, rows)
    freedom = np.sum(count > 0) * rows - len(x)
    if loss == "linear" and freedom > 0:
        scale = float(np.sqrt(np.sum(r**2) / freedom))
    return Fit(x, r, jacobian, count, scale, steps, settled)


def _descended(
    robot: Robot,
    parameters: Parameters,
    found: Measurements,
    x: np.ndarray,
    loss: Loss,
    scale: float,
) -> tuple[np.ndarray, int, bool]:
    """The parameters after steps down, how many, and whether the last of them changed nothing."""
    rows, damping = ROWS[found.kind], _FIRST

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        r, jacobian = linearised(robot, parameters, found, x)
        return r / scale, jacobian / scale, cost(loss, np.linalg.norm(r, axis=1) / scale, rows)

    r, jacobian, value = at(x)
    for step in range(_STEPS):
        count = np.sqrt(weights(loss, np.linalg.norm(r, axis=1), rows))
        flat = (jacobian * count[:, None, None]).reshape(-1, len(x))
        normal, slope = flat.T @ flat, flat.T @ (r * count[:, None]).ravel()
        diagonal = np.diag(normal)
        normal = normal + _SILENT * diagonal.max() * np.eye(len(x))
        while damping < _MOST:
            move = np.linalg.solve(normal + np.diag(damping * diagonal), slope)
            new = at(x + move)
            if new[2] <= value:
                break
            damping *= 10.0
        else:
            return x, step, True
        # By how much the cost would fall, in squares of standard deviations.
        gain = float(move @ slope)
        x, damping = x + move, max(damping / 10.0, _LEAST)
        r, jacobian, value = new
        if gain < 1e-16 * max(1.0, value):
            return x, step + 1, True
    return x, _STEPS, False
