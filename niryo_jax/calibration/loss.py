"""How much a measurement counts, by how far it is from what is predicted.

Huber (1964) and Tukey's biweight (Beaton & Tukey, 1974), of the norm of all numbers of a
measurement: a pose that is wrong in one of them is not believed in the others. In one dimension
their constants are the usual ones, 1.345 and 4.685, of 95 % efficiency.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

Loss = Literal["linear", "huber", "tukey"]

_HUBER, _TUKEY = 0.345, 3.685


def weights(loss: Loss, norms: np.ndarray, rows: int) -> np.ndarray:
    """How much measurements count, by the norms of their `rows` numbers in standard deviations."""
    if loss == "linear":
        return np.ones_like(norms)
    if loss == "huber":
        return np.minimum(1.0, (rows**0.5 + _HUBER) / np.maximum(norms, 1e-30))
    share = np.minimum(norms / (rows**0.5 + _TUKEY), 1.0)
    return (1.0 - share**2) ** 2


def cost(loss: Loss, norms: np.ndarray, rows: int) -> float:
    """What is made least: half the sum of squares where the loss is linear."""
    if loss == "linear":
        return float(0.5 * np.sum(norms**2))
    if loss == "huber":
        most = rows**0.5 + _HUBER
        return float(np.sum(np.where(norms < most, 0.5 * norms**2, most * (norms - 0.5 * most))))
    most = rows**0.5 + _TUKEY
    share = np.minimum(norms / most, 1.0)
    return float(np.sum(most**2 / 6.0 * (1.0 - (1.0 - share**2) ** 3)))


def spread(norms: np.ndarray, rows: int) -> float:
    """The standard deviation that half of the norms being smaller says, whatever the others are:
    the median of a chi-square of k degrees is k (1 - 2 / 9k)^3 (Wilson & Hilferty, 1931)."""
    median = rows * (1.0 - 2.0 / (9.0 * rows)) ** 3
    return float(np.sqrt(np.median(norms**2) / median))
