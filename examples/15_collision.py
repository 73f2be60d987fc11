"""Which solutions of a pose are free of collisions, and the way out of a box.

You learn: how to give an arm a shape and a world, ask for its clearance, find out that every
solution of a pose collides, and push a configuration away from what it touches by the derivative.

Expected output:

    Niryo One with gripper 1: 8 capsules, 8 pairs
    at the object: 8 solutions, 4 clear of the arm, 4 of the table too
    behind the wall: 8 solutions, all of them collide: True
    over the box: nearest are tool and box_1, -32.9 mm
    after 21 steps along the derivative: 22.1 mm, joints moved by at most 15.0 deg
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from niryo_jax import collision as co
from niryo_jax.hardware.pick_and_place import TABLE_2_1


class Result(NamedTuple):
    clear: tuple[int, int]
    all_collide: bool
    before: float
    after: float
    moved: float


def main() -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()
    model = co.niryo_one("gripper_1")
    print(f"Niryo One with gripper 1: {len(model.names)} capsules, {len(model.pairs)} pairs")

    # 1. Every solution of a pose, and those that touch neither the arm nor the table. The table is
    # a millimetre below the base, for the jaws reach it where they grip.
    solutions = nj.inverse_kinematics(robot, np.array(TABLE_2_1[2].pose))
    table = co.World.table(-0.001)
    itself, both = (co.free(robot, model, solutions, world) for world in (None, table))
    clear = int(itself.clear.sum()), int(both.clear.sum())
    print(
        f"at the object: {int(solutions.count)} solutions, {clear[0]} clear of the arm, "
        f"{clear[1]} of the table too"
    )

    # 2. With a wall through the place no solution is left, and that is known.
    wall = table + co.World.boxes([[0.148, -0.148, 0.15]], [[0.2, 0.01, 0.15]])
    blocked = co.free(robot, model, solutions, wall)
    all_collide = bool(blocked.all_collide)
    count = int(solutions.count)
    print(f"behind the wall: {count} solutions, all of them collide: {all_collide}")

    # 3. Out of a box by the derivative of the clearance.
    q = jnp.deg2rad(jnp.array([0.0, -35.0, -25.0, 0.0, -30.0, 0.0]))
    box = co.World.boxes([[0.3, 0.0, 0.06]], [[0.06, 0.06, 0.06]])
    found = co.distances(robot, model, q, box)
    before = float(jnp.min(found.distance))
    print(f"over the box: nearest are {' and '.join(found.nearest_pair())}, {1e3 * before:.1f} mm")
    start, steps = q, 0
    step = jax.jit(jax.value_and_grad(lambda q: co.clearance(robot, model, q, box)))
    value, slope = step(q)
    while value < 0.02 and steps < 100:
        # As far as would bring it 3 mm away if the derivative stayed as it is.
        q = q + 0.003 * slope / (slope @ slope)
        value, slope = step(q)
        steps += 1
    moved = float(jnp.rad2deg(jnp.max(jnp.abs(q - start))))
    print(
        f"after {steps} steps along the derivative: {1e3 * float(value):.1f} mm, "
        f"joints moved by at most {moved:.1f} deg"
    )
    return Result(clear, all_collide, before, float(value), moved)


if __name__ == "__main__":
    main()
