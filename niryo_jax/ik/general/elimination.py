"""Gauss's elimination of many small matrices side by side.

A matrix is a list of its rows, arrays (columns, ...) with the batch as the last axes: what becomes
of a row in a step is one loop, over numbers that lie next to each other. What many read is kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from niryo_jax.lanes.batch_last import kept


def eliminated(rows: Sequence[jax.Array], least: float = 0.0) -> tuple[list[jax.Array], jax.Array]:
    """What is left of n rows of at least as many columns, and the determinant of the first n.

    The largest number of a column is its pivot; of equal ones the first. Row k of the result is
    that of the pivot, divided by it: the numbers behind column k.

    Args:
        rows: n arrays (columns, ...).
        least: what stands for a pivot that is smaller.
    """
    units = list[jax.Array]()
    product: jax.Array | None = None
    while rows:
        first, others = rows[0], rows[1:]
        place = _largest([row[0] for row in rows])
        pivot = kept(_chosen(place, [row[0] for row in rows]))
        signed = jnp.where(place == 0.0, pivot, -pivot)
        product = signed if product is None else kept(product * signed)
        divisor = jnp.where(jnp.abs(pivot) > least, pivot, least)
        unit = _chosen(place, [row[1:] for row in rows]) / divisor
        units.append(unit)
        rows = []
        for i, row in enumerate(others, start=1):
            here = place == float(i)
            share = jnp.where(here, first[0], row[0])
            rows.append(kept(jnp.where(here, first[1:], row[1:]) - share * unit))
    assert product is not None
    return units, product


def _largest(column: Sequence[jax.Array]) -> jax.Array:
    """Which number of a column is the largest: 0.0, 1.0, ..."""
    largest = jnp.abs(column[0])
    place = jnp.zeros_like(largest)
    for i, number in enumerate(column[1:], start=1):
        larger = jnp.abs(number) > largest
        largest = jnp.where(larger, jnp.abs(number), largest)
        place = jnp.where(larger, float(i), place)
    return kept(place)


def _chosen(place: jax.Array, rows: Sequence[jax.Array]) -> jax.Array:
    chosen = rows[0]
    for i, row in enumerate(rows[1:], start=1):
        chosen = jnp.where(place == float(i), row, chosen)
    return chosen


def solved(units: Sequence[jax.Array]) -> jax.Array:
    """(n, columns - n, ...) what the first n columns must be multiplied by to give the others, from
    `eliminated`."""
    n = len(units)
    out = list[jax.Array]()
    for k in reversed(range(n)):
        # Of unit k the first numbers belong to the unknowns k + 1 to n - 1.
        rest = units[k][n - 1 - k :]
        for j, solution in zip(range(n - 2 - k, -1, -1), out):
            rest = rest - units[k][j] * solution
        out.append(kept(rest))
    return jnp.stack(out[::-1])
