"""Small least squares with bounds, many at once: which joint rates come nearest to a twist.

    minimise |A x - b|^2 + s |x - z|^2   with   lower <= x <= upper

and of several such x (an arm with joints to spare, s = 0) one that z is near to; without bounds the
nearest.

An active set method (Nocedal & Wright, *Numerical Optimization*, algorithm 16.3): bounds that hold
are kept until the objective is least under them; then the one that is pressed against hardest from
the wrong side is let go. It goes down in every step and never leaves the bounds. So that each
solve has one answer, a small multiple of |x - c|^2 is added, c = z first and then the x that was
found, which takes the multiple out again (the proximal point method of Rockafellar, 1976).

The batch is the last axis of every array.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batch_last import kept, lanes_in, squared, stacked, times, transposed_times
from niryo_jax.lanes.symmetric import Factor, factor, solved
from niryo_jax.tolerances import PROXIMAL, PROXIMAL_REDUNDANT, ROUNDING_OF_SLOPE

_ADVANCES, _ADVANCES_FLOAT32 = 3, 5
"""How many times c moves."""

_SOLVES = 2
"""With c = z where several x are the least: the first gives all of x but what z decides, in which
it leaves rounding over the small multiple; the second takes that out."""

_MOST = 12
"""Steps for each unknown, at the most; a handful in all is what is seen."""


class Problem(NamedTuple):
    """Least squares of m rows and n unknowns, for each of r elements.

    Attributes:
        matrix: (m, n, r); rhs: (m, r).
        square: (r,) s.
        centre: (n, r) z.
        lower, upper: (n, r), may be infinite.
    """

    matrix: jax.Array
    rhs: jax.Array
    square: jax.Array
    centre: jax.Array
    lower: jax.Array
    upper: jax.Array

    def residual(self, x: jax.Array) -> jax.Array:
        """(m, r) b - A x."""
        return kept(self.rhs - times(self.matrix, x))

    def slope(self, x: jax.Array) -> jax.Array:
        """(n, r) half the derivative of the objective."""
        return kept(
            self.square * (x - self.centre) - transposed_times(self.matrix, self.residual(x))
        )


@jax.custom_jvp
def free_least_squares(problem: Problem) -> jax.Array:
    """(n, r) the answer where nothing is bound; lower and upper are not looked at."""
    hessian, extra = _hessian(problem)
    factored = factor(_added(hessian, extra))

    def step(i: jax.Array, x: jax.Array) -> jax.Array:
        drawn = jnp.where(i < first, extra * (x - problem.centre), 0.0)
        return x - _solved(factored, problem.slope(x) + drawn)

    first, advances = _solves(problem)
    return jax.lax.fori_loop(0, first + advances, step, problem.centre)


@free_least_squares.defjvp
def _free_jvp(primals: tuple[Problem], tangents: tuple[Problem]) -> tuple[jax.Array, jax.Array]:
    x = free_least_squares(*primals)
    return x, _rate(*primals, *tangents, x, jnp.zeros_like(x))


@jax.custom_jvp
def bounded_least_squares(problem: Problem) -> tuple[jax.Array, jax.Array]:
    """The answer within the bounds, of which lower <= upper.

    Returns:
        (n, r) x, and (n, r) the bounds that hold it: -1 lower, 1 upper, 0 none.

    Its derivative is that of a small change which leaves these bounds as they are.
    """
    hessian, extra = _hessian(problem)
    n, rows = problem.centre.shape
    largest = _largest(problem.matrix, problem.square)
    lower, upper = problem.lower, problem.upper
    number = jnp.arange(n)[:, None]
    first, advances = _solves(problem)

    def goes_on(state: _State) -> jax.Array:
        return (state.step < _MOST * n) & ~jnp.all(state.done)

    def step(state: _State) -> _State:
        x, held, centre = state.x, state.held, state.centre
        slope = problem.slope(x)
        whole = slope + extra * (x - centre)
        # A bound pushes back; where it would have to pull, it is let go.
        wrong = jnp.where(state.least & (lower < upper), held * whole, 0.0)
        worst = jnp.max(wrong, axis=0)
        size = jnp.max(jnp.abs(x), axis=0) + jnp.max(jnp.abs(slope), axis=0) / largest
        let_go = worst > ROUNDING_OF_SLOPE.of(x.dtype) * largest * size
        held = jnp.where(let_go & (number == jnp.argmax(wrong, axis=0)), 0.0, held)
        settled = state.least & ~let_go
        done = state.done | (settled & (state.solved == first + advances))
        centre = jnp.where(settled & (state.solved >= first), x, centre)
        whole = slope + extra * (x - centre)
        free = held == 0
        factored = factor(_masked(_added(hessian, extra), free))
        move = jnp.where(free, -_solved(factored, jnp.where(free, whole, 0.0)), 0.0)
        room = jnp.where(move > 0, upper - x, lower - x)
        share = jnp.where(move != 0, room / jnp.where(move != 0, move, 1.0), jnp.inf)
        taken = jnp.minimum(1.0, jnp.min(share, axis=0))
        hit = free & (share <= taken) & (taken < 1)
        moved = jnp.clip(x + taken * move, lower, upper)
        moved = jnp.where(hit, jnp.where(move > 0, upper, lower), moved)
        held = jnp.where(hit, jnp.sign(move), held)
        return _State(
            state.step + 1,
            jnp.where(done, x, moved),
            jnp.where(done, state.held, held),
            centre,
            jnp.where(settled, state.solved + 1, state.solved),
            taken >= 1,
            done,
        )

    # Those that the unbounded answer would break hold at first, and most of them to the end.
    start = problem.centre - _solved(factor(_added(hessian, extra)), problem.slope(problem.centre))
    held = jnp.where(start > upper, 1.0, jnp.where(start < lower, -1.0, 0.0)).astype(start.dtype)
    begin = _State(
        jnp.int32(0),
        jnp.clip(start, lower, upper),
        held,
        problem.centre,
        jnp.ones(rows, jnp.int32),
        jnp.zeros(rows, bool),
        jnp.zeros(rows, bool),
    )
    end = jax.lax.while_loop(goes_on, step, begin)
    return end.x, end.held


class _State(NamedTuple):
    """Of the loop.

    Attributes:
        solved: (r,) how many solves have ended at an optimum, the next one included.
        least: (r,) whether the objective is least under the bounds that hold.
    """

    step: jax.Array
    x: jax.Array
    held: jax.Array
    centre: jax.Array
    solved: jax.Array
    least: jax.Array
    done: jax.Array


@bounded_least_squares.defjvp
def _bounded_jvp(
    primals: tuple[Problem], tangents: tuple[Problem]
) -> tuple[tuple[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]:
    x, held = bounded_least_squares(*primals)
    return (x, held), (_rate(*primals, *tangents, x, held), jnp.zeros_like(held))


def _rate(problem: Problem, rate: Problem, x: jax.Array, held: jax.Array) -> jax.Array:
    """The rate of the answer.

    It is that of the problem with the small multiple and c = z, whose answer y has H y = ... for
    the unknowns that are free: there the part of the residual that turns with A stays large enough
    to be told from rounding where A has more columns than rows.
    """
    hessian, extra = _hessian(problem)
    free = held == 0
    factored = factor(_masked(_added(hessian, extra), free))

    def solve(slope: jax.Array) -> jax.Array:
        return jnp.where(free, -_solved(factored, jnp.where(free, slope, 0.0)), 0.0)

    matrix, square = problem.matrix, problem.square + extra
    y = x + solve(problem.slope(x) + extra * (x - problem.centre))
    given = jnp.where(held > 0, rate.upper, rate.lower)
    given = jnp.where(free, 0.0, given)
    residual = problem.residual(y)
    moved = kept(rate.rhs - times(rate.matrix, y) - times(matrix, given), by=residual)
    slope = -transposed_times(rate.matrix, residual) - transposed_times(matrix, moved)
    slope = slope + rate.square * (y - problem.centre) - square * rate.centre
    return given + solve(slope)


def optimality(problem: Problem, x: jax.Array) -> jax.Array:
    """(r,) by how much x misses the conditions of Karush, Kuhn and Tucker: the largest entry of
    x - clip(x - slope / L), which is 0 at an optimum alone; L is the largest diagonal of A^T A."""
    stepped = x - problem.slope(x) / _largest(problem.matrix, problem.square)
    return jnp.max(jnp.abs(x - jnp.clip(stepped, problem.lower, problem.upper)), axis=0)


def _solves(problem: Problem) -> tuple[int, int]:
    """How many there are with c = z, and how many after."""
    m, n, _ = problem.matrix.shape
    double = problem.matrix.dtype == jnp.float64
    return 1 if m >= n else _SOLVES, _ADVANCES if double else _ADVANCES_FLOAT32


def _hessian(problem: Problem) -> tuple[Lanes, jax.Array]:
    """A^T A + s, and the small multiple (r,)."""
    m, n, _ = problem.matrix.shape
    hessian = squared(problem.matrix)
    share = (PROXIMAL if m >= n else PROXIMAL_REDUNDANT).of(problem.matrix.dtype)
    return _added(lanes_in(hessian), problem.square), share * _largest(problem.matrix, 0.0)


def _largest(matrix: jax.Array, square: jax.Array | float) -> jax.Array:
    """(r,) the largest entry of the diagonal of A^T A + s; 1 where it is 0."""
    largest = jnp.max(jnp.sum(matrix * matrix, axis=0), axis=0) + square
    return jnp.where(largest > 0, largest, 1.0)


def _added(matrix: Lanes, square: jax.Array) -> Lanes:
    return matrix + lanes.identity(len(matrix)) * Lane(square)


def _masked(matrix: Lanes, free: jax.Array) -> Lanes:
    """The rows and columns that are free, and those of the identity for the others."""
    out = matrix.copy()
    for i in range(len(matrix)):
        out[i, i] = lanes.select(free[i], matrix[i, i], 1.0)
        for j in range(i):
            out[i, j] = lanes.select(free[i] & free[j], matrix[i, j], 0.0)
    return out


def _solved(factored: Factor, rhs: jax.Array) -> jax.Array:
    return stacked(solved(factored, lanes_in(rhs)), rhs[0])
