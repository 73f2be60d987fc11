"""Of the infinitely many joint vectors that do a task, those that are nearest to a reference.

The least |q - q_ref| under the equations of the task and the joint limits. A step is the least that
follows the task, J^+ e, and a share of the way to the reference less what of it the task would see,
(1 - J^+ J) (q_ref - q): gradient projection (Rosen, 1960), which is the null-space term of arms
with joints to spare (Liegeois, 1977). Joints that would leave their limits go to them, and the
others do without.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.execution.padding import is_small, padded_rows
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.results.limits import Limits
from niryo_jax.ik.task import Task
from niryo_jax.lanes import Lanes
from niryo_jax.robot import Robot
from niryo_jax.specialise import Geometry, specialised_for_any_tool
from niryo_jax.tolerances import NEWTON_POSITION

_MOST, _ROWS = 100, 4096
_STEP = 0.3
"""No joint moves by more in one step, radians (or metres)."""
_DAMPING = 0.1
_SHARE, _LEAST_SHARE, _SHRINK, _GROW = 0.5, 0.02, 0.5, 1.2
"""Of the way along the task that a step takes: less of it where the last went too far."""


def drawn_to(
    robot: Robot,
    pose: jax.Array,
    q: jax.Array,
    reference: jax.Array,
    limits: Limits,
    task: Task,
    dependent: float,
) -> jax.Array:
    """Joint vectors that do a task, from starts that do it or nearly do, near to references.

    Nothing is verified: what does not do its task within the limits ends somewhere within them.

    Args:
        robot: the arm.
        pose: (rows, 4, 4) rigid motions.
        q: (rows, n) starts.
        reference: (rows, n) what to come near to.
        limits: of the joints.
        task: one that is not "pose".
        dependent: a Jacobian row that is independent of the others by less than this share does
            not count: what moves it is taken as free.

    Returns:
        (rows, n), each a local minimum of the distance to its reference.
    """
    arrays = jax.lax.stop_gradient((pose, q, reference, *limits))
    quick = is_small(len(q))
    return _drawn(robot, *arrays, task=task, dependent=dependent, quick=quick)


@specialised_for_any_tool
def _drawn(
    geometry: Geometry,
    pose: jax.Array,
    q: jax.Array,
    reference: jax.Array,
    lower: jax.Array,
    upper: jax.Array,
    task: Task,
    dependent: float,
) -> jax.Array:
    rows = q.shape[0]
    chunk = min(_ROWS, max(rows, 1))
    chunks = -(-rows // chunk)

    def parts(x: jax.Array) -> jax.Array:
        return padded_rows(x, 1, chunks * chunk, mode="edge").reshape(chunks, chunk, *x.shape[1:])

    def solve(given: tuple[jax.Array, ...]) -> jax.Array:
        pose, q, reference = given
        goal = lanes.unpack(pose, 2)
        return drawn(geometry, goal, q.T, reference.T, (lower, upper), task, dependent).T

    if rows == 0:
        return q
    answer = jax.lax.map(solve, (parts(pose), parts(q), parts(reference)))
    return answer.reshape(chunks * chunk, -1)[:rows]


def drawn(
    geometry: Geometry,
    goal: Lanes,
    q: jax.Array,
    reference: jax.Array,
    limits: Limits,
    task: Task,
    dependent: float,
) -> jax.Array:
    """`drawn_to` of (4, 4) lanes of goals and joint vectors (n, r), as a part of a program."""
    lower, upper = (jnp.asarray(limit, q.dtype)[:, None] for limit in limits)
    enough = NEWTON_POSITION.of(q.dtype)

    def step(state: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        i, q, share, before, _ = state
        twist, jacobian = rolled.bound_twist(geometry, goal, q, task)
        damping = _DAMPING * jnp.sqrt(rolled.added(twist * twist, 0))
        pull = reference - q

        def moves(moving: jax.Array, given: jax.Array) -> tuple[jax.Array, jax.Array]:
            """The step of the joints that are `moving`, the others' given, and what is along."""
            free = jacobian * moving[None]
            inverse = rolled.pseudo_inverse(free, dependent, damping)
            back = rolled.added(inverse * (twist - _applied(jacobian, given))[None], 1)
            # Without damping, so that no part of it is seen.
            seen = rolled.pseudo_inverse(free, dependent)
            along = moving * pull - _applied(seen, _applied(free, pull))
            return _limited(moving * (back + share * along)) + given, moving * along

        d, _ = moves(jnp.ones_like(q), jnp.zeros_like(q))
        beyond = (q + d < lower) | (q + d > upper)
        to_limit = jnp.where(beyond, jnp.clip(q + d, lower, upper) - q, 0.0)
        d, along = moves(jnp.where(beyond, 0.0, 1.0).astype(q.dtype), to_limit)
        back_and_forth = jnp.sum(along * before, axis=0) < 0
        share = jnp.where(back_and_forth, _SHRINK * share, _GROW * share)
        d = jnp.clip(q + d, lower, upper) - q
        return i + 1, q + d, jnp.clip(share, _LEAST_SHARE, 1.0), along, jnp.max(jnp.abs(d), axis=0)

    def goes_on(state: tuple[jax.Array, ...]) -> jax.Array:
        return (state[0] < _MOST) & jnp.any(state[-1] > enough)

    start = jnp.clip(q, lower, upper)
    share = jnp.full(q.shape[1:], _SHARE, q.dtype)
    state = jnp.int32(0), start, share, jnp.zeros_like(q), jnp.full_like(share, np.inf)
    return jax.lax.while_loop(goes_on, step, state)[1]


def _applied(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    return rolled.added(matrix * vector[None], 1)


def _limited(move: jax.Array) -> jax.Array:
    """A move (n, r), shorter in its direction where a joint would move too far."""
    largest = jnp.max(jnp.abs(move), axis=0)
    return move * jnp.minimum(1.0, _STEP / jnp.maximum(largest, 1e-30))
