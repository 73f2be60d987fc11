"""Where a camera sits on the tool: hand-eye calibration as least squares, by optimistix.

You learn: to make residuals of `forward_kinematics` and `se3.log`, give them to
Levenberg-Marquardt, and say how sure the answer is. The camera on the tool sees one marker that
stands somewhere: FK(q) X C = Y with unknown X (camera on the tool) and Y (marker in the room).
Needs optimistix (`pip install "niryo_jax[research]"`).

Expected output:

    25 pictures; first guess off by 67.1 mm and 0.54 rad
    after 26 steps: camera off by 0.12 mm and 0.2 mrad
    expected from the noise: 0.21 mm and 0.3 mrad
    what is left: 0.98 standard deviations
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from niryo_jax.extras import need

TURN_NOISE, SHIFT_NOISE = 1e-3, 5e-4
"""Of what the camera says of the marker, radians and metres."""


class Result(NamedTuple):
    before: float
    off: np.ndarray
    deviations: np.ndarray
    left: float


def main(pictures: int = 25) -> Result:
    optx = need("optimistix", "research")
    jax.config.update("jax_enable_x64", True)
    robot, rng = nj.robots.niryo_one(), np.random.default_rng(7)

    # 1. What is true, and what the camera sees of it.
    camera = nj.se3.exp(np.array([0.3, -0.4, 0.2, 0.04, 0.02, 0.05]))
    marker = nj.se3.exp(np.array([0.1, 0.2, 1.5, 0.35, 0.05, 0.02]))
    q = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper, (pictures, 6))
    tool = nj.forward_kinematics(robot, q)
    sizes = np.repeat([TURN_NOISE, SHIFT_NOISE], 3)
    noise = nj.se3.exp(sizes * rng.standard_normal((pictures, 6)))
    seen = nj.se3.inverse(tool @ camera) @ marker @ noise

    # 2. Both poses from a guess, each as a twist from it.
    guess = jnp.eye(4), tool[0] @ seen[0]

    def poses(twists: jax.Array) -> tuple[jax.Array, jax.Array]:
        return guess[0] @ nj.se3.exp(twists[0]), guess[1] @ nj.se3.exp(twists[1])

    def residuals(twists: jax.Array, _: None = None) -> jax.Array:
        camera, marker = poses(twists)
        return nj.se3.log(nj.se3.inverse(tool @ camera @ seen) @ marker) / sizes

    start = jnp.zeros((2, 6))
    before = _off(poses(start)[0], camera)
    print(
        f"{pictures} pictures; first guess off by {1e3 * np.linalg.norm(before[3:]):.1f} mm and "
        f"{np.linalg.norm(before[:3]):.2f} rad"
    )
    solver = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
    found = optx.least_squares(residuals, solver, start, max_steps=100)
    steps = int(found.stats["num_steps"])
    off = _off(poses(found.value)[0], camera)
    print(f"after {steps} steps: camera off by {_shown(off)}")

    # 3. How sure that is: the inverse of J^T J, of residuals in standard deviations.
    jacobian = jax.jacobian(residuals)(found.value).reshape(-1, 12)
    deviations = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))[:6]
    print(f"expected from the noise: {_shown(deviations)}")
    freedom = 6 * pictures - 12
    left = float(jnp.sqrt(jnp.sum(residuals(found.value) ** 2) / freedom))
    print(f"what is left: {left:.2f} standard deviations")
    return Result(float(np.linalg.norm(before[3:])), off, deviations, left)


def _off(found: jax.Array, true: jax.Array) -> np.ndarray:
    """(6,) the twist from one pose to the other."""
    return np.asarray(nj.se3.log(nj.se3.inverse(found) @ true))


def _shown(twist: np.ndarray) -> str:
    turn, shift = (np.linalg.norm(part) for part in (twist[:3], twist[3:]))
    return f"{1e3 * shift:.2f} mm and {1e3 * turn:.1f} mrad"


if __name__ == "__main__":
    main()
