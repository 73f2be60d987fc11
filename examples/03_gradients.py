"""Gradients through kinematics: of a measure, of a solution, and of the arm's own geometry.

You learn: that `jax.grad` and `jax.jacobian` work on every function, that the derivative of a
Newton-Raphson solution costs one linear solve whatever the number of steps, and that a robot's
screws are arrays like any other.

Expected output:

    manipulability 0.00598 -> 0.01468 m^3 after 50 steps uphill
    1 mm of target along x turns the joints by [-1.29 -3.3   5.17 -1.42 -1.97  0.44] mrad
    1 mm of height of axis 2 turns the joints by [ 0.01 -1.67  2.06 -0.23 -0.35  0.3 ] mrad
    changing all by 0.1 mm: predicted to 7e-07 rad
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj


class Result(NamedTuple):
    before: float
    after: float
    slopes: np.ndarray
    miss: float


def main() -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()
    q0 = jnp.array([0.3, -0.4, -0.6, 0.5, -0.7, 0.2])

    # 1. A posture that can move well in every direction: climb Yoshikawa's measure.
    climb = jax.jit(jax.value_and_grad(lambda q: nj.manipulability(robot, q)))
    q, before = q0, float(climb(q0)[0])
    for _ in range(50):
        _, slope = climb(q)
        q = jnp.clip(q + 0.02 * slope / jnp.linalg.norm(slope), robot.lower, robot.upper)
    after = float(climb(q)[0])
    print(f"manipulability {before:.5f} -> {after:.5f} m^3 after 50 steps uphill")

    # 2. A solution as a function of the target and of the arm. Axis 2 points along -y through
    #    (0, 0, h), so its screw is (0, -1, 0, h, 0, 0), of which number 3 changes with the height.
    pose = nj.forward_kinematics(robot, q0)

    def solve(change: jax.Array) -> tuple[jax.Array, jax.Array]:
        shift, height = change[:3], change[3]
        built = dataclasses.replace(robot, screws=jnp.asarray(robot.screws).at[1, 3].add(height))
        q = nj.newton_raphson(built, pose.at[:3, 3].add(shift), q0 + 0.05).q
        return q, q

    # The derivative is that of the implicit function theorem, whatever the number of steps. With
    # `has_aux` the second q comes back as it is, and the first one's derivative with it.
    slopes_and_q = jax.jit(jax.jacfwd(solve, has_aux=True))
    slopes, q = slopes_and_q(jnp.zeros(4))
    print(f"1 mm of target along x turns the joints by {_show(slopes[:, 0])} mrad")
    print(f"1 mm of height of axis 2 turns the joints by {_show(slopes[:, 3])} mrad")

    # 3. The slopes predict what solving again gives.
    change = jnp.array([1e-4, 0.0, -1e-4, 1e-4])
    predicted = q + slopes @ change
    miss = float(jnp.max(jnp.abs(slopes_and_q(change)[1] - predicted)))
    print(f"changing all by 0.1 mm: predicted to {miss:.0e} rad")
    return Result(before, after, np.asarray(slopes), miss)


def _show(rates: jax.Array) -> str:
    """rad/m are mrad/mm."""
    return np.array2string(np.asarray(rates), precision=2, suppress_small=True)


if __name__ == "__main__":
    main()
