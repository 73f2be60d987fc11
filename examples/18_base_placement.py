"""Where to put an arm: its base moved uphill through complete inverse kinematics.

You learn: that a solution has a derivative by its pose, so that whatever is made of the best
solution of each pose can be improved by gradients. Needs optax
(`pip install "niryo_jax[research]"`).

Expected output:

    9 poses of a task, 9 reached; the tightest has 33.1 deg to the nearest limit
    after 40 steps: 9 reached; the tightest has 48.8 deg
    base moved by 88 mm and turned by 0.0 deg
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from niryo_jax.extras import need


class Result(NamedTuple):
    reached: tuple[int, int]
    before: float
    after: float
    trace: np.ndarray


def main(steps: int = 40) -> Result:
    optax = need("optax", "research")
    jax.config.update("jax_enable_x64", True)
    robot, task = nj.robots.niryo_one(), task_poses()

    def margins(base: jax.Array) -> tuple[jax.Array, jax.Array]:
        """For each pose of the task the distance to the limits of the solution farthest within."""
        x, y, turn = base
        placed = nj.se3.exp(jnp.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) * turn)
        placed = placed.at[:2, 3].set(jnp.array([x, y]))
        answer = nj.inverse_kinematics(robot, nj.se3.inverse(placed) @ task)
        q, ok = answer.farthest_from_limits()
        return jnp.minimum(q - robot.lower, robot.upper - q), ok

    def loss(base: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The smallest margin, made smooth so that all tight joints pull."""
        margin, ok = margins(base)
        tight = jnp.where(ok[:, None], margin, jnp.pi)
        return jax.nn.logsumexp(-30.0 * tight) / 30.0, ok

    base = start = jnp.array([0.0, 0.0, 0.0])
    first, ok = margins(base)
    before, reached = float(jnp.min(first)), int(ok.sum())
    print(
        f"{len(task)} poses of a task, {reached} reached; the tightest has "
        f"{np.rad2deg(before):.1f} deg to the nearest limit"
    )

    # Outside of jax.jit the derivative runs the solver that is compiled already.
    optimiser = optax.adam(optax.cosine_decay_schedule(0.01, steps))
    state, trace = optimiser.init(base), [before]
    for _ in range(steps):
        slope = jax.grad(loss, has_aux=True)(base)[0]
        change, state = optimiser.update(slope, state)
        base = optax.apply_updates(base, change)
        trace.append(float(jnp.min(margins(base)[0])))

    last, ok = margins(base)
    after, both = float(jnp.min(last)), (reached, int(ok.sum()))
    print(f"after {steps} steps: {both[1]} reached; the tightest has {np.rad2deg(after):.1f} deg")
    moved = base - start
    print(
        f"base moved by {1e3 * float(jnp.hypot(*moved[:2])):.0f} mm and turned by "
        f"{abs(np.rad2deg(float(moved[2]))):.1f} deg"
    )
    return Result(both, before, after, np.array(trace))


def task_poses() -> np.ndarray:
    """(9, 4, 4) the tool pointing down over a grid on a table."""
    poses = np.zeros((9, 4, 4))
    poses[:, :3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    x, y = np.meshgrid([0.17, 0.22, 0.27], [-0.05, 0.05, 0.15])
    poses[:, :3, 3] = np.stack([x.ravel(), y.ravel(), np.full(9, 0.12)], axis=-1)
    poses[:, 3, 3] = 1.0
    return poses


if __name__ == "__main__":
    main()
