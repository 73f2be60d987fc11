"""An arm without a spherical wrist, the UR16e: three parallel axes, up to eight solutions.

You learn: how many solutions poses have, and that joints which turn by up to 360 degrees to either
side reach most of them in several ways, of which `nearest` takes the shortest.

Expected output:

    500 poses: 2 solutions 14, 4 solutions 94, 6 solutions 42, 8 solutions 350
    solved from where the arm stands, a turn away from the angles listed: 500 of 500
    first pose: the arm goes on from 350.0 deg to 349.5 deg at joint 6
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

import niryo_jax as nj


class Result(NamedTuple):
    counts: dict[int, int]
    solved: int
    largest_error: float
    largest_step: float


def main(poses: int = 500) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.load("ur16e")

    # Where the arm stands: anywhere within +-360 degrees.
    start = jax.random.uniform(
        jax.random.key(8), (poses, 6), minval=robot.lower + 0.1, maxval=robot.upper - 0.1
    )
    start = start.at[0, 5].set(jnp.deg2rad(350.0))
    # Where its tool shall be: a motion of 0.1 rad at most in each joint away.
    step = jax.random.uniform(jax.random.key(9), (poses, 6), minval=-0.1, maxval=0.1)
    targets = nj.forward_kinematics(robot, start + step)

    solutions = nj.inverse_kinematics(robot, targets)
    sizes = [int(count) for count in solutions.count]
    counts = {size: sizes.count(size) for size in sorted(set(sizes))}
    print(f"{poses} poses: " + ", ".join(f"{n} solutions {k}" for n, k in counts.items()))
    largest_error = float(jnp.max(jnp.where(solutions.found, solutions.position_error, 0.0)))

    # Angles are listed in (-180, 180] degrees; the nearest solution may be a turn away from them.
    q, ok = solutions.nearest(start)
    solved = int(jnp.sum(ok))
    print(
        f"solved from where the arm stands, a turn away from the angles listed: {solved} of {poses}"
    )
    before, after = jnp.rad2deg(start[0, 5]), jnp.rad2deg(q[0, 5])
    print(f"first pose: the arm goes on from {before:.1f} deg to {after:.1f} deg at joint 6")
    return Result(counts, solved, largest_error, float(jnp.max(jnp.abs(q - start))))


if __name__ == "__main__":
    main()
