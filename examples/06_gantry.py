"""A gantry, the ABB IRB6620LX: a slide of 31 m carries a five-axis arm.

You learn: that prismatic joints are joints like any other, in metres where the others are in
radians, and what distinguishes the solutions of such an arm.

Expected output, with one line for each of the four solutions:

    100 poses: 4 solutions each, no others: True
    the slide is where it was, to 7e-15 m
    first pose: slide 17.90 m, then    15.5    -6.6    39.5    13.4    30.9 deg
    ...
    nearest to where the arm was made to stand: found for 100 of 100
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj


class Result(NamedTuple):
    counts: set[int]
    complete: bool
    slide_error: float
    nearest_error: float


def main(poses: int = 100) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.load("abb_irb6620lx")

    q = jax.random.uniform(jax.random.key(6), (poses, 6), minval=robot.lower, maxval=robot.upper)
    solutions = nj.inverse_kinematics(robot, nj.forward_kinematics(robot, q))
    counts, complete = {int(count) for count in solutions.count}, bool(solutions.complete.all())
    print(f"{poses} poses: {sorted(counts)} solutions each, no others: {complete}")

    # The axes of joints 2 and 3 are parallel to the slide, so they cannot do its work: it stands at
    # one place in all solutions, which differ in the elbow and in the wrist.
    away = jnp.where(solutions.found, jnp.abs(solutions.q[..., 0] - q[:, None, 0]), 0.0)
    slide_error = float(away.max())
    print(f"the slide is where it was, to {slide_error:.0e} m")
    for solution in solutions.q[0][solutions.found[0]]:
        angles = " ".join(f"{angle:7.1f}" for angle in np.rad2deg(solution[1:]))
        print(f"first pose: slide {solution[0]:.2f} m, then {angles} deg")

    # Joints 4 and 6 turn by up to 300 degrees to either side: turns of 360 degrees are considered.
    nearest, ok = solutions.nearest(q)
    nearest_error = float(jnp.max(jnp.abs(nearest - q)))
    print(f"nearest to where the arm was made to stand: found for {int(ok.sum())} of {poses}")
    return Result(counts, complete, slide_error, nearest_error)


if __name__ == "__main__":
    main()
