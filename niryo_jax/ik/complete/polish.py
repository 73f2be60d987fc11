"""Newton's method for the candidates that miss by more than rounding, a chunk at a time."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from niryo_jax import lanes
from niryo_jax.execution.compaction import at_once, for_each_chunk
from niryo_jax.ik.newton import rolled
from niryo_jax.ik.results.limits import without_whole_turns
from niryo_jax.specialise import Geometry
from niryo_jax.tolerances import DEPENDENT_ROW, IK_POLISH

MOST = 16
POLISHED = 128
_POLISHING = 20
_APPROACHING = 12
_DAMPING_FACTOR = 5.0
_LARGEST_STEP = 0.2
_WORTH_IT = 0.25


class Solved(NamedTuple):
    """Joint vectors (r, n), the metres and radians by which they miss, and their branches."""

    q: jax.Array
    position: jax.Array
    rotation: jax.Array
    label: jax.Array

    @property
    def errors(self) -> tuple[jax.Array, jax.Array]:
        """Metres and radians by which they miss."""
        return self.position, self.rotation

    def replace(self, where: jax.Array, new: Solved) -> Solved:
        """With the rows `where` replaced; rows out of range are left out."""
        return Solved(*(x.at[where].set(y, mode="drop") for x, y in zip(self, new)))


def chunk_of(rows: int, on_a_core: int, on_accelerator: int) -> int:
    """How many roots to work on at once: about as many as the poses have, for few poses."""
    return min(at_once(on_a_core, on_accelerator), MOST * rows)


def is_rough(position: jax.Array, rotation: jax.Array) -> jax.Array:
    """Whether metres and radians missed are more than rounding."""
    tolerance = IK_POLISH.of(position.dtype)
    return (position > tolerance) | (rotation > tolerance)


def polished(
    geometry: Geometry,
    target: jax.Array,
    solved: Solved,
    pose: jax.Array,
    periodic: tuple[bool, ...],
) -> Solved:
    """Newton's method on the full pose for the joint vectors that miss by more than rounding.

    Of arms with fewer than six joints a pose may only be approached: then it is the method of
    Levenberg and Marquardt, which goes back where a step leads away.
    """
    dtype, rows = solved.q.dtype, target.shape[0]
    rough = is_rough(*solved.errors) & (pose < rows)
    few = geometry.joints < 6

    def polish(state: Solved, at: jax.Array, live: jax.Array) -> Solved:
        row = jnp.minimum(pose[at], rows - 1)
        goal, its = lanes.unpack(target[row], 2), geometry.at(row)

        def goes_on(carry: tuple[jax.Array, ...]) -> jax.Array:
            count, _, _, *best = carry
            return (count < steps) & jnp.any(live & is_rough(*best[1:]))

        def step(carry: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
            count, q, damping, *best = carry
            twist, jacobian, _ = rolled.near_twist(its, goal, q)
            damped = damping if few else None
            inverse = rolled.pseudo_inverse(jacobian, DEPENDENT_ROW.of(dtype), damped)
            move = rolled.added(inverse * twist[None], 1)
            q = q + jnp.clip(move, -_LARGEST_STEP, _LARGEST_STEP)
            position, rotation = rolled.pose_errors(its, goal, q)
            miss, least = position**2 + rotation**2, best[1] ** 2 + best[2] ** 2
            # Next to a self-motion rounding alone moves joints far, and misses by no less.
            better = miss <= least if few else miss < _WORTH_IT * least
            # A root that is done stays as it is, however long its neighbours take.
            better = better & live & is_rough(*best[1:])
            best = [jnp.where(better, x, y) for x, y in zip((q, position, rotation), best)]
            damping = damping * jnp.where(better, 1.0 / _DAMPING_FACTOR, _DAMPING_FACTOR)
            return count + 1, best[0] if few else q, damping, *best

        q, *errors = state.q[at].T, state.position[at], state.rotation[at]
        # A miss that stays near a fold of what can be reached moves joints by its square root.
        damping = jnp.sqrt(errors[0] + errors[1]) / _DAMPING_FACTOR
        steps = _APPROACHING if few else _POLISHING
        start = jnp.int32(0), q, damping, q, *errors
        *_, q, position, rotation = jax.lax.while_loop(goes_on, step, start)
        q = without_whole_turns(q.T, periodic)
        where = jnp.where(live, at, pose.shape[0])
        return state.replace(where, Solved(q, position, rotation, state.label[at]))

    chunk = min(chunk_of(rows, POLISHED, max(rows // 8, 4096)), pose.shape[0])
    return for_each_chunk(rough, chunk, polish, solved)
