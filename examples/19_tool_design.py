"""A tool made for its task: shape by gradients, until every pose is reached, and reached well.

You learn: that the tool is part of the arm's geometry and can be designed through complete inverse
kinematics. Poses that no solution reaches pull by how far the wrist is beyond its reach, those
solved outside the limits by how far outside, all others by the manipulability of their best
solution. Needs optax (`pip install "niryo_jax[research]"`).

Expected output:

    12 poses around an object, 6 reached with a tool of 20 mm
    after 60 steps: 12 reached, the worst with manipulability 6.3 litres, after 3.3 when all were
    first reached
    tool: 113 mm long, turned by 8 deg
    verified on the arm with that tool: 12 of 12 solved completely, off by at most 5e-16 m
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
    first_whole: float
    worst: float
    off: float


def main(steps: int = 60) -> Result:
    optax = need("optax", "research")
    jax.config.update("jax_enable_x64", True)
    robot, task = nj.robots.niryo_one(), task_poses()

    def flanges(tool: jax.Array) -> jax.Array:
        """Where the bare arm's tool frame has to be for each pose of the task."""
        return task @ nj.se3.inverse(nj.se3.exp(tool))

    @jax.jit
    def merits(pose: jax.Array, answer: nj.IKSolutions) -> jax.Array:
        """For each pose that of its best solution: above 0 where it is within the limits."""
        limits = np.asarray(robot.lower), np.asarray(robot.upper)
        outside = jnp.maximum(jnp.maximum(limits[0] - answer.q, answer.q - limits[1]), 0.0)
        # Of the bare arm: what a tool adds to its speed is no merit of a posture.
        merit = nj.manipulability(robot, answer.q) - 0.02 * jnp.sum(outside, axis=-1)
        best = jnp.max(jnp.where(answer.found, merit, -jnp.inf), axis=-1)
        # How far the wrist is beyond the reach of shoulder and elbow.
        wrist = pose[:, :3, 3] - WRIST_TO_TOOL * pose[:, :3, 0]
        beyond = jnp.linalg.norm(wrist - SHOULDER, axis=-1) - REACH
        solved = jnp.any(answer.found, axis=-1)
        return jnp.where(solved, jnp.where(solved, best, 0.0), -0.02 - 0.1 * beyond)

    def loss(tool: jax.Array) -> tuple[jax.Array, jax.Array]:
        pose = flanges(tool)
        merit = merits(pose, nj.inverse_kinematics(robot, pose))
        worst = jax.nn.logsumexp(-SHARP * merit) / SHARP
        return worst + 0.5 * jnp.maximum(jnp.linalg.norm(tool[3:]) - LONGEST, 0.0), merit

    # A tool along the flange, since a length of 0 has no direction.
    tool = best = jnp.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])
    merit = loss(tool)[1]
    reached = int(np.sum(merit > 0))
    print(f"{len(task)} poses around an object, {reached} reached with a tool of 20 mm")

    optimiser = optax.adam(optax.cosine_decay_schedule(0.03, steps))
    state = optimiser.init(tool)
    first_whole, worst = 0.0, -np.inf
    for _ in range(steps):
        slope, merit = jax.grad(loss, has_aux=True)(tool)
        least = float(jnp.min(merit))
        first_whole = first_whole or max(least, 0.0)
        best, worst = (tool, least) if least > worst else (best, worst)
        change, state = optimiser.update(slope, state)
        tool = optax.apply_updates(tool, change)
    both = reached, int(np.sum(loss(best)[1] > 0))
    print(
        f"after {steps} steps: {both[1]} reached, the worst with manipulability {1e3 * worst:.1f} "
        f"litres, after {1e3 * first_whole:.1f} when all were first reached"
    )
    shape = np.asarray(nj.se3.exp(best))
    turn = np.rad2deg(np.linalg.norm(nj.so3.log(shape[:3, :3])))
    print(f"tool: {1e3 * np.linalg.norm(shape[:3, 3]):.0f} mm long, turned by {turn:.0f} deg")

    # The same on an arm that has the tool.
    fitted = robot.with_tool(shape)
    answer = nj.inverse_kinematics(fitted, task)
    solved = int(np.sum(np.any(answer.within_limits, axis=-1) & np.asarray(answer.complete)))
    off = float(np.max(np.asarray(answer.position_error)[np.asarray(answer.found)]))
    print(
        f"verified on the arm with that tool: {solved} of {len(task)} solved completely, "
        f"off by at most {off:.0e} m"
    )
    return Result(both, first_whole, worst, off)


# Of the Niryo One, metres: axis 2, the two lengths from there to the wrist, and on to its tool.
SHOULDER = np.array([0.0, 0.0, 0.183])
REACH = 0.21 + np.hypot(0.2215, 0.03)
WRIST_TO_TOOL = 0.0237
LONGEST = 0.15
SHARP = 1e3
"""Of the smooth minimum over the poses, in 1 / m^3."""


def task_poses() -> np.ndarray:
    """(12, 4, 4) the tool at a ring around an object, pointing at its axis and down."""
    around, down = np.meshgrid(np.linspace(-0.7, 0.7, 4), np.deg2rad([20.0, 45.0, 70.0]))
    around, down = around.ravel(), down.ravel()
    forward = np.stack(
        [np.cos(down) * np.cos(around), np.cos(down) * np.sin(around), -np.sin(down)], axis=-1
    )
    side = np.stack([-np.sin(around), np.cos(around), 0 * around], axis=-1)
    poses = np.zeros((12, 4, 4))
    poses[:, :3, 0], poses[:, :3, 1] = forward, side
    poses[:, :3, 2] = np.cross(forward, side)
    poses[:, :3, 3] = [0.45, 0.0, 0.3] - 0.05 * forward
    poses[:, 3, 3] = 1.0
    return poses


if __name__ == "__main__":
    main()
