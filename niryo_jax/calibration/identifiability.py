"""What measurements can tell of the parameters, and what they cannot: by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_DEPENDENT = 1e-8
"""A combination that changes residuals by less than this share of what others do is not told."""

_SHOWN = 0.05


class Identifiability(NamedTuple):
    """What a Jacobian of residuals says of the parameters.

    Attributes:
        rank: how many combinations of them can be told.
        condition: the largest singular value over the least of these, columns of unit length.
        identifiable: (m,) whether each is told whatever the others are.
        combinations: in words, what can be changed without any residual changing.
    """

    rank: int
    condition: float
    identifiable: np.ndarray
    combinations: tuple[str, ...]


def identifiability(jacobian: np.ndarray, names: tuple[str, ...]) -> Identifiability:
    """Of a Jacobian (rows, m) in standard deviations."""
    size = np.linalg.norm(jacobian, axis=0)
    seen = np.nonzero(size > _DEPENDENT * size.max(initial=0.0))[0]
    silent = np.setdiff1d(np.arange(len(names)), seen)
    values, right = np.linalg.svd(jacobian[:, seen] / size[seen])[1:]
    values = np.pad(values, (0, len(seen) - len(values)))
    told = values > _DEPENDENT * values.max(initial=0.0)
    rank = int(np.sum(told))
    null = right[~told]
    condition = float(values[0] / values[rank - 1]) if rank else np.inf
    fixed = np.zeros(len(names), bool)
    fixed[seen] = np.all(np.abs(null) < 1e-6, axis=0)
    words = [names[i] for i in silent]
    words += [_in_words(row, [names[i] for i in seen]) for row in _sparse(null / size[seen])]
    return Identifiability(rank, condition, fixed, tuple(words))


def _sparse(rows: np.ndarray) -> np.ndarray:
    """The same space by rows with many zeros: reduced by Gauss and Jordan, the largest first."""
    rows, used = rows.copy(), list[int]()
    for i in range(len(rows)):
        left = np.abs(rows[i:]).copy()
        left[:, used] = 0.0
        pivot, column = np.unravel_index(left.argmax(), left.shape)
        order = np.arange(len(rows))
        order[i], order[i + pivot] = i + pivot, i
        rows = rows[order]
        rows[i] /= rows[i, column]
        others = np.arange(len(rows)) != i
        rows[others] -= rows[others, column][:, None] * rows[i]
        used.append(int(column))
    return rows


def _in_words(row: np.ndarray, names: list[str]) -> str:
    """A combination, the largest parts first, as a sum."""
    row = row / np.abs(row).max()
    parts = [i for i in np.argsort(-np.abs(row), kind="stable") if abs(row[i]) > _SHOWN]
    if row[parts[0]] < 0:
        row = -row
    words = list[str]()
    for i in parts:
        sign = "-" if row[i] < 0 else "+"
        factor = "" if abs(abs(row[i]) - 1) < 5e-3 else f"{abs(row[i]):.2g} "
        words.append(f"{sign} {factor}{names[i]}")
    return " ".join(words).removeprefix("+ ")
