"""A redundant arm, the KUKA iiwa 14: seven joints, one of which is free to choose.

You learn: how to lock a joint, so that the others have a finite number of solutions, and how to
look through all values of the free joint in one batch.

Expected output:

    joint 3 locked at 65.1 deg: 8 solutions; joint 1 locked: 8; together 16
    largest position error 4e-16 m
    360 values of joint 3: 8 to 8 solutions, 2546 within the limits
    best: joint 3 at -93.3 deg, 45.5 deg from the nearest limit
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj


class Result(NamedTuple):
    solutions: np.ndarray
    largest_error: float
    family: int
    margin: float


def main(values: int = 360) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.load("kuka_iiwa14")
    pose = nj.forward_kinematics(robot, jnp.array([0.9, 0.6, 0.2, -1.3, 0.4, 0.8, -0.6]))

    # A joint is locked by its index, counted from 0, and its value. A batch of values gives a batch
    # of answers for the one pose. The book locks joint 3, then joint 1, at the angle that turns
    # the home plane of the arm to the target; after that value of joint 3 come all the others.
    angle = jnp.arctan2(pose[1, 3], pose[0, 3])
    angles = jnp.append(angle, jnp.linspace(robot.lower[2], robot.upper[2], values))
    family = nj.inverse_kinematics(robot, pose, locked=(2, angles))
    third = family.map(lambda x: x[0])
    first = nj.inverse_kinematics(robot, pose, locked=(0, angle))
    together = jnp.concatenate([part.q[part.found] for part in (third, first)])
    print(
        f"joint 3 locked at {jnp.rad2deg(angle):.1f} deg: {int(third.count)} solutions; "
        f"joint 1 locked: {int(first.count)}; together {len(together)}"
    )
    reached = nj.forward_kinematics(robot, together)
    largest_error = float(jnp.max(jnp.linalg.norm(reached[:, :3, 3] - pose[:3, 3], axis=-1)))
    print(f"largest position error {largest_error:.0e} m")

    inside = int(jnp.sum(family.within_limits[1:]))
    print(
        f"{values} values of joint 3: {family.count.min()} to {family.count.max()} solutions, "
        f"{inside} within the limits"
    )

    # The best of each answer comes first; of these, the one farthest from the limits.
    q, ok = family.farthest_from_limits()
    margins = jnp.where(ok, jnp.min(jnp.minimum(q - robot.lower, robot.upper - q), axis=-1), -1.0)
    best = int(jnp.argmax(margins))
    print(
        f"best: joint 3 at {jnp.rad2deg(angles[best]):.1f} deg, "
        f"{jnp.rad2deg(margins[best]):.1f} deg from the nearest limit"
    )
    return Result(np.asarray(together), largest_error, inside, float(margins[best]))


if __name__ == "__main__":
    main()
