"""The one result type of the subproblems, and the edge between arrays and lanes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.lanes import Condition, Lane, Lanes
from niryo_jax.lanes.batching import Edge, on_lanes


class SubproblemKind(IntEnum):
    """What the set of solutions is."""

    NONE = 0
    FINITE = 1
    TANGENT = 2
    INFINITE = 3

    @property
    def message(self) -> str:
        """The meaning, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    SubproblemKind.NONE: "There is no solution; the angles are those of the closest approach.",
    SubproblemKind.FINITE: "Every solution is listed.",
    SubproblemKind.TANGENT: "Two solutions coincide; derivatives do not exist here.",
    SubproblemKind.INFINITE: "There are infinitely many solutions; one of them is listed.",
}


class SubproblemSolutions(NamedTuple):
    """All solutions of a subproblem.

    Attributes:
        angles: (..., slots, joints) radians in (-pi, pi]; metres where the joint is a translation.
        valid: (..., slots) whether the slot holds a solution.
        residual: (..., slots) metres by which the angles miss the condition.
        kind: (...,) a `SubproblemKind`.
    """

    angles: jax.Array
    valid: jax.Array
    residual: jax.Array
    kind: jax.Array


class Solved(NamedTuple):
    """`SubproblemSolutions` on lanes, with 1 and 0 for true and false."""

    angles: Lanes
    valid: Lanes
    residual: Lanes
    kind: Lane


def solve(solver: Callable[..., Solved], *edges: Edge) -> SubproblemSolutions:
    """The answer of a solver on lanes to arrays with any batch axes."""
    angles, valid, residual, kind = on_lanes(lambda *args: tuple(solver(*args)), *edges)
    return SubproblemSolutions(angles, valid > 0.5, residual, kind.astype(jnp.int32))


def flag(condition: Condition) -> Lane:
    """1 where the condition holds, 0 elsewhere."""
    return lanes.select(condition, 1.0, 0.0)


def kind_of(solved: Condition, tangent: Condition, infinite: Condition) -> Lane:
    """The `SubproblemKind` as a number."""
    several = lanes.select(tangent, float(SubproblemKind.TANGENT), float(SubproblemKind.FINITE))
    several = lanes.select(infinite, float(SubproblemKind.INFINITE), several)
    return lanes.select(solved, several, float(SubproblemKind.NONE))


def answer(
    angles: Sequence[Sequence[Lane]],
    valid: Sequence[Condition],
    residual: Sequence[Lane],
    *,
    tangent: Condition,
    infinite: Condition,
) -> Solved:
    """The answer that lists these slots; a problem is solved where one of them is valid."""
    solved = valid[0]
    for other in valid[1:]:
        solved = solved | other
    return Solved(
        np.array([list(slot) for slot in angles], dtype=object),
        np.array([flag(ok) for ok in valid], dtype=object),
        np.array(list(residual), dtype=object),
        kind_of(solved, tangent, infinite),
    )
