"""A small network that learns inverse kinematics near a posture, with kinematics in its loss.

You learn: to train through `forward_kinematics`: the loss is by how much the tool misses, in metres
and radians, so that no joint vector is ever shown to the network. It learns one branch, the one
that it starts on; all of them are what `inverse_kinematics` is for. Needs optax
(`pip install "niryo_jax[research]"`).

Expected output:

    untrained: 89 mm, 0.46 rad
    after 1500 steps: 2.8 mm, 0.03 rad on poses that it has not seen
    and two steps of newton_raphson from there: 2e-04 mm
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from niryo_jax.extras import need

CENTRE = np.array([0.3, -0.4, -0.3, 0.4, -0.6, 0.2])
SPREAD = 0.35
WIDTH = 64


class Result(NamedTuple):
    before: float
    after: float
    polished: float


def main(steps: int = 1500) -> Result:
    optax = need("optax", "research")
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()

    def poses(key: jax.Array, count: int) -> jax.Array:
        """Poses of random joints near the centre, in float32."""
        q = CENTRE + SPREAD * jax.random.uniform(key, (count, 6), minval=-1.0, maxval=1.0)
        return nj.forward_kinematics(robot, q.astype(jnp.float32))

    def network(weights: Any, pose: jax.Array) -> jax.Array:
        """Joint vectors (..., 6) from position and the first two columns of the rotation."""
        x = jnp.concatenate([10.0 * pose[..., :3, 3], pose[..., :3, 0], pose[..., :3, 1]], axis=-1)
        for matrix, bias in weights[:-1]:
            x = jnp.tanh(x @ matrix + bias)
        matrix, bias = weights[-1]
        return (x @ matrix + bias + CENTRE).astype(pose.dtype)

    def misses(weights: Any, pose: jax.Array) -> jax.Array:
        """(..., 6) the twist from the tool to the pose, rad and m."""
        reached = nj.forward_kinematics(robot, network(weights, pose))
        return nj.se3.log(nj.se3.inverse(reached) @ pose)

    optimiser = optax.adam(optax.cosine_decay_schedule(3e-3, steps))

    @jax.jit
    def step(carry: tuple[Any, Any], key: jax.Array) -> tuple[tuple[Any, Any], None]:
        weights, state = carry
        pose = poses(key, 128)

        def loss(weights: Any) -> jax.Array:
            # A metre counts as ten radians.
            return jnp.mean(jnp.sum((misses(weights, pose) * SCALE) ** 2, axis=-1))

        change, state = optimiser.update(jax.grad(loss)(weights), state)
        return (optax.apply_updates(weights, change), state), None

    first, *keys = jax.random.split(jax.random.key(0), 3)
    weights = initial(first)
    unseen = poses(keys[0], 500)
    before = missed(misses(weights, unseen))
    print(f"untrained: {1e3 * before[0]:.0f} mm, {before[1]:.2f} rad")
    carry = weights, optimiser.init(weights)
    weights, _ = jax.lax.scan(step, carry, jax.random.split(keys[1], steps))[0]
    after = missed(misses(weights, unseen))
    print(
        f"after {steps} steps: {1e3 * after[0]:.1f} mm, {after[1]:.2f} rad on poses that it has "
        "not seen"
    )

    # What it says is a good guess.
    q = np.asarray(network(weights, unseen), np.float64)
    exact = np.asarray(unseen, np.float64)
    result = nj.newton_raphson(robot, exact, q, max_iterations=2)
    polished = float(np.mean(result.position_error))
    print(f"and two steps of newton_raphson from there: {1e3 * polished:.0e} mm")
    return Result(before[0], after[0], polished)


SCALE = np.array([1.0, 1.0, 1.0, 10.0, 10.0, 10.0], np.float32)


def initial(key: jax.Array) -> list[tuple[jax.Array, jax.Array]]:
    """Weights of two hidden layers, in float32."""
    sizes = (9, WIDTH, WIDTH, 6)
    drawn = [
        jax.random.normal(one, (a, b), jnp.float32) / np.float32(np.sqrt(a))
        for one, a, b in zip(jax.random.split(key, 3), sizes, sizes[1:])
    ]
    # The last layer begins with nothing, so that the network begins at the centre.
    drawn[-1] = 0.0 * drawn[-1]
    return [(matrix, jnp.zeros(matrix.shape[1], jnp.float32)) for matrix in drawn]


def missed(twists: jax.Array) -> tuple[float, float]:
    """Mean distances, metres and radians."""
    norms = [np.linalg.norm(twists[:, part], axis=-1) for part in (slice(3, 6), slice(0, 3))]
    return float(np.mean(norms[0])), float(np.mean(norms[1]))


if __name__ == "__main__":
    main()
