"""A Puma-type arm, the ABB IRB120: all eight solutions of a pose that a numeric solver missed.

You learn: how to get a robot of Pardos-Gotor's book, that a pose printed with four decimals is
projected to a rigid motion first, and how to judge an answer by forward kinematics.

Expected output, with one line for each of the eight solutions:

    the printed pose is 9e-05 from a rigid motion
    8 solutions, no others: True; largest position error 3e-16 m
     -143.6   -85.4    45.7   -73.6   -42.6   -16.0 deg  within the limits
    ...
    the book's solution is within 0.0004 rad of one of them
    the book's numeric answer misses by 0.434 m and 0.95 rad
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from niryo_jax.robots import book

# Printed in the book of 2018 (exercise 47): a pose, one of its solutions, and what a numeric solver
# answered after 106 ms.
POSE = [
    [-0.8401, 0.5318, 0.1069, -0.4226],
    [0.5391, 0.7968, 0.2731, 0.2161],
    [0.0600, 0.2870, -0.9560, 0.1709],
    [0.0, 0.0, 0.0, 1.0],
]
PRINTED = [-2.5067, -1.4903, 0.7965, -1.2848, -0.7433, -0.2789]
NUMERIC = [-1.9134, -0.1847, -0.3630, -0.1163, -1.0924, 1.4402]


class Result(NamedTuple):
    count: int
    complete: bool
    distance: float
    numeric_miss: float
    numeric_turn: float


def main() -> Result:
    jax.config.update("jax_enable_x64", True)
    # The edition of 2018 draws the arm with y up; `nj.robots.load("abb_irb120")` has z up.
    robot = book.abb_irb120(up="y", edition=2018)

    solutions = nj.inverse_kinematics(robot, jnp.array(POSE))
    count, complete = int(solutions.count), bool(solutions.complete)
    found = solutions.found
    error = float(jnp.max(solutions.position_error[found]))
    print(f"the printed pose is {float(solutions.pose_distance):.0e} from a rigid motion")
    print(f"{count} solutions, no others: {complete}; largest position error {error:.0e} m")
    for q, inside in zip(solutions.q[found], solutions.within_limits[found]):
        angles = " ".join(f"{angle:7.1f}" for angle in np.rad2deg(q))
        print(f"{angles} deg  {'within' if inside else 'beyond'} the limits")

    apart = jnp.max(jnp.abs(solutions.q[found] - jnp.array(PRINTED)), axis=-1)
    distance = float(jnp.min(apart))
    print(f"the book's solution is within {distance:.4f} rad of one of them")

    # The twist from the numeric answer to the pose, in the tool frame: (omega, v).
    answer = nj.forward_kinematics(robot, jnp.array(NUMERIC))
    pose, _ = nj.se3.project(jnp.array(POSE))
    turn = float(jnp.linalg.norm(nj.se3.log(nj.se3.inverse(answer) @ pose)[:3]))
    miss = float(jnp.linalg.norm(answer[:3, 3] - pose[:3, 3]))
    print(f"the book's numeric answer misses by {miss:.3f} m and {turn:.2f} rad")
    return Result(count, complete, distance, miss, turn)


if __name__ == "__main__":
    main()
