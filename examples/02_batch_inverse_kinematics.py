"""Inverse kinematics of a whole batch: every solution, their limits, and why there are none.

You learn: that `inverse_kinematics` never raises for a pose it cannot solve, how to read what it
returns, and how to pick one solution for each pose.

Expected output:

    1000 poses: SOLVED 1000
    solutions per pose: 2 to 14, within the limits: 1 to 6
    largest position error 1e-15 m
    a far pose: The pose cannot be reached, whatever the joint angles. Wherever the wrist ...
    nearest to home found for 1000 of 1000
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

import niryo_jax as nj


class Result(NamedTuple):
    solved: int
    largest_error: float
    far: nj.IKStatus
    picked: int


def main(count: int = 1000) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()

    # Poses that are reachable for certain: forward kinematics of random joints inside the limits.
    q = jax.random.uniform(jax.random.key(1), (count, 6), minval=robot.lower, maxval=robot.upper)
    poses = nj.forward_kinematics(robot, q)
    # One more that is not: two metres away.
    poses = jnp.concatenate([poses, jnp.eye(4).at[0, 3].set(2.0)[None]])

    solutions = nj.inverse_kinematics(robot, poses)

    # Each pose has 16 slots; `found` says which of them hold a solution, the best first.
    names = [nj.IKStatus(int(status)).name for status in solutions.status[:count]]
    summary = ", ".join(f"{name} {names.count(name)}" for name in sorted(set(names)))
    within = jnp.sum(solutions.within_limits[:count], axis=-1)
    print(f"{count} poses: {summary}")
    print(
        f"solutions per pose: {solutions.count[:count].min()} to {solutions.count.max()}, "
        f"within the limits: {within.min()} to {within.max()}"
    )
    # Forward kinematics judges the answers; errors of empty slots are infinite.
    error = float(jnp.max(jnp.where(solutions.found, solutions.position_error, 0.0)))
    print(f"largest position error {error:.0e} m")
    print(f"a far pose: {solutions.message(count)}")

    # One solution per pose: within the limits, and nearest to where the arm is now.
    _, ok = solutions.nearest(jnp.zeros(6))
    picked = int(jnp.sum(ok[:count]))
    print(f"nearest to home found for {picked} of {count}")
    return Result(names.count("SOLVED"), error, nj.IKStatus(int(solutions.status[count])), picked)


if __name__ == "__main__":
    main()
