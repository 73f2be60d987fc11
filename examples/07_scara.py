"""A SCARA, the ABB IRB910SC: four joints, so that most poses are out of reach.

You learn: that an arm of fewer than six joints is solved like any other, what the status says of a
pose that such an arm cannot reach, and how to ask before the arm is moved.

Expected output:

    200 poses above the table: 2 solutions each
    elbow to the left and to the right: [ 60. -60.] deg
    a tilted tool: UNREACHABLE
    too far away: UNREACHABLE
    below the stroke: OUTSIDE_LIMITS
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj


class Result(NamedTuple):
    counts: set[int]
    elbows: np.ndarray
    statuses: tuple[nj.IKStatus, ...]


def main(poses: int = 200) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.load("abb_irb910sc")

    # Joints 1, 2 and 4 turn about y, which is up; joint 3 slides along it. The arm is never quite
    # stretched or folded here, where its two solutions would be one.
    low, high = jnp.array(robot.lower).at[1].set(0.1), jnp.array(robot.upper)
    q = jax.random.uniform(jax.random.key(7), (poses, 4), minval=low, maxval=high)
    q = q.at[0].set(jnp.array([0.2, jnp.pi / 3, -0.1, 0.5]))
    targets = nj.forward_kinematics(robot, q)

    # Three more: the first with its tool tilted, moved a metre away, and 0.2 m lower.
    first = targets[0]
    tilted = first @ nj.se3.exp(jnp.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
    far = first.at[0, 3].add(1.0)
    low_down = first.at[1, 3].add(-0.2)
    targets = jnp.concatenate([targets, jnp.stack([tilted, far, low_down])])

    solutions = nj.inverse_kinematics(robot, targets)
    counts = {int(count) for count in solutions.count[:poses]}
    print(f"{poses} poses above the table: {sorted(counts)} solutions each")
    elbows = np.rad2deg(solutions.q[0, :, 1][solutions.found[0]])
    print(f"elbow to the left and to the right: {np.round(elbows, 6)} deg")
    statuses = tuple(nj.IKStatus(int(status)) for status in solutions.status[poses:])
    for what, status in zip(("a tilted tool", "too far away", "below the stroke"), statuses):
        print(f"{what}: {status.name}")
    return Result(counts, elbows, statuses)


if __name__ == "__main__":
    main()
