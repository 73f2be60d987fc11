"""Along a self-motion: of the infinitely many solutions of a pose, the one that is liked best.

Where the Jacobian is singular the arm may be able to move while the tool rests. Walkers start at a
solution and go both ways along its null space, kept on the pose by Newton's method; each goes
straight on, for more than a whole turn, and remembers the best place. The score of a place changes
by no more than the largest joint does, so a walker takes long steps where the score is far below
zero, and short ones where it is not: it misses no place of a positive score that is wider than its
shortest step. A self-motion of more than one dimension is searched along one line that no symmetry
of an arm has, which winds about it.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.ik.closed_form.srs import ELBOW, has_angle
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.newton.held import Held, held_row
from niryo_jax.ik.newton.pose_error import within_tolerance
from niryo_jax.lanes import Lanes
from niryo_jax.specialise import Geometry
from niryo_jax.tolerances import SAME_SOLUTION, SELF_MOTION

_MOST, _TRIAL, _POLISHING = 400, 8, 8
_FAR_ENOUGH = 8.0
_LEAST, _SHORTEST, _LONGEST = 1e-3, 0.01, 0.25
_ON_THE_WAY, _ASTRAY = 1e-2, 2e-2
_STRAIGHT = 0.8

Vectors = Callable[[jax.Array], jax.Array]
"""A function of joint vectors (m, n), one for each walker."""

WALKERS = 2
"""How many set out from each solution."""


def best_of_self_motion(
    geometry: Geometry,
    goal: Lanes,
    q: jax.Array,
    live: jax.Array,
    score: Vectors,
    enough: float,
    size: jax.Array,
    held: Held,
    pull: Vectors | None,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The best place that walkers find on the self-motions of solutions.

    Args:
        geometry: the arm.
        goal: (4, 4) lanes of r * WALKERS rows: each goal is repeated for its walkers.
        q: (r, n) solutions, or joint vectors near them.
        live: (r,) whether to search.
        score: (m,) of joint vectors, larger is better.
        enough: a score that needs no better one.
        size: (r * WALKERS,) the extent of the goals.
        held: what does not move, if anything. An arm angle that has no value holds nothing.
        pull: (m, n) how joint vectors would move, were there no goal, at the best place.

    Returns:
        (r, n) joint vectors that reach the goal to `within_tolerance`, and (r,) metres and radians
        by which they miss; where there are none, q and infinity.
    """
    rows, n = q.shape
    count = rows * WALKERS
    dependent = SELF_MOTION.of(q.dtype)
    by_angle = held == "arm angle"
    # The elbow sets the distance from shoulder to wrist, which is that of the pose.
    still = ELBOW if by_angle else held
    moves = jnp.asarray(np.arange(n) != still, q.dtype)[:, None]
    line = np.cos(0.7 + 1.3 * np.arange(n))
    ahead = jnp.asarray([line, -line], q.dtype)
    heading = jnp.broadcast_to(ahead, (rows, WALKERS, n)).reshape(count, n).T * moves
    start = jnp.broadcast_to(q[:, None], (rows, WALKERS, n)).reshape(count, n).T
    none = jnp.full(count, jnp.inf, q.dtype)

    holds = has_angle(geometry, start.T) if by_angle else none

    def held_too(jacobian: jax.Array, q: jax.Array) -> jax.Array:
        """The Jacobian, below a row for the arm angle where it has a value."""
        row = jnp.where(holds, held_row(geometry, q.T, held), 0.0)
        return jnp.concatenate([row[None], jacobian])

    def step(state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        i, q, heading, anchor, stride, gone, least, *best = state
        # At the end every walker returns to its best place, and stays on the pose there.
        returning, polishing = i == _MOST, i >= _MOST
        q = jnp.where(returning, best[0], q)
        top = jnp.where(returning, -none, best[1])
        twist, jacobian, (metres, radians) = rolled.near_twist(geometry, goal, q)
        jacobian = jacobian * moves[None]
        inverse = rolled.pseudo_inverse(jacobian, dependent, longest_first=True)
        resting, least_moves = jacobian, inverse
        if by_angle:
            resting = held_too(jacobian, q)
            least_moves = rolled.pseudo_inverse(resting, dependent, longest_first=True)

        def along(direction: jax.Array) -> jax.Array:
            """What of a direction leaves the tool at rest, and what is held."""
            seen = rolled.added(resting * direction[None], 1)
            return direction - rolled.added(least_moves * seen[None], 1)

        here, miss = score(q.T), (metres + radians) / size
        near = miss < _ON_THE_WAY * dependent
        there = jnp.where(polishing, within_tolerance(metres, radians, size=size), near)
        # The last place of those while polishing is the best: it misses by the least.
        better = there & (here >= jnp.where(polishing, -none, top))
        best = [jnp.where(better, x, y) for x, y in zip((q, here, metres, radians), best)]
        best[1] = jnp.where(better, here, top)

        ahead = along(heading)
        ahead = ahead / jnp.maximum(jnp.max(jnp.abs(ahead), axis=0), 1e-30)
        back = _clipped(rolled.added(inverse * twist[None], 1))
        # A step that leaves the curve, or after which it heads elsewhere, is made again, shorter.
        lengths = jnp.sum(ahead * ahead, axis=0) * jnp.sum(heading * heading, axis=0)
        turns = jnp.sum(ahead * heading, axis=0) < _STRAIGHT * jnp.sqrt(lengths)
        lost = ((miss > _ASTRAY) | (near & turns)) & (i > 0) & ~polishing
        goes = near & ~lost & ~polishing & (best[1] < enough)
        stride = jnp.where(lost, stride / 3, jnp.where(goes, 1.5 * stride, stride))
        stride = jnp.clip(stride, _LEAST, _LONGEST)
        far = jnp.where(goes, jnp.minimum(stride, jnp.maximum(jnp.abs(here), _SHORTEST)), 0.0)
        anchor, heading = (jnp.where(goes, x, y) for x, y in ((q, anchor), (ahead, heading)))
        move = back + far * heading
        if pull is not None:
            move = move + jnp.where(polishing, _clipped(along(pull(q.T).T)), 0.0)
        q = jnp.where(lost, anchor, q + move)

        # Where nothing moves that counts, nothing will.
        least = jnp.where(near, jnp.minimum(least, here), least)
        gone = gone + far
        hopeless = (i >= _TRIAL) & (best[1] - least < SAME_SOLUTION.of(q.dtype))
        ended = hopeless | (gone > _FAR_ENOUGH)
        over = (best[1] >= enough).reshape(rows, WALKERS).any(axis=1)
        over = ~live | over | ended.reshape(rows, WALKERS).all(axis=1)
        i = jnp.where(~polishing & jnp.all(over), _MOST, i + 1)
        return i, q, heading, anchor, stride, gone, least, *best

    stride = jnp.full(count, _LONGEST, q.dtype)
    state = (
        jnp.int32(0),
        start,
        heading,
        start,
        stride,
        jnp.zeros_like(stride),
        none,
        start,
        -none,
        none,
        none,
    )
    state = jax.lax.while_loop(lambda x: x[0] < _MOST + _POLISHING, step, state)
    placed, top, *errors = state[7:]
    top, *errors = (x.reshape(rows, WALKERS) for x in (top, *errors))
    top = jnp.where(jnp.isfinite(errors[0]), top, -jnp.inf)
    best = jnp.argmax(top, axis=1)[:, None]
    found = jnp.take_along_axis(top, best, axis=1)[:, 0] > -jnp.inf
    metres, radians = (
        jnp.where(found, jnp.take_along_axis(x, best, axis=1)[:, 0], jnp.inf) for x in errors
    )
    placed = jnp.take_along_axis(placed.T.reshape(rows, WALKERS, n), best[..., None], axis=1)
    return jnp.where(found[:, None], placed[:, 0], q), metres, radians


def _clipped(move: jax.Array) -> jax.Array:
    """A move (n, m) of which no joint moves farther than the longest step, in its direction."""
    return move * jnp.minimum(1.0, _LONGEST / jnp.maximum(jnp.max(jnp.abs(move), axis=0), 1e-30))
