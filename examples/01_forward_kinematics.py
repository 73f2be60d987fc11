"""Forward kinematics of the Niryo One: from joint angles to the pose of the tool frame.

You learn: how to get a robot, that every function takes any leading batch axes, and how a space
Jacobian turns joint speeds into the speed of the tool.

Expected output:

    start pose of the paper at (91.0, 0.0, 190.5) mm
    100000 random poses: farthest from the base axis 458 mm
    joint 1 at 1 rad/s turns the tool about z at 1.0 rad/s
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj


class Result(NamedTuple):
    start: np.ndarray
    farthest: float
    twist: np.ndarray


def main() -> Result:
    # JAX computes in float32 unless told otherwise; the package never changes that by itself.
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()

    # One joint vector in radians, one 4 x 4 pose in metres.
    start = nj.forward_kinematics(robot, jnp.array([0.0, 0.3, -1.3, 0.0, 0.0, 0.0]))
    x, y, z = 1e3 * start[:3, 3]
    print(f"start pose of the paper at ({x:.1f}, {y:.1f}, {z:.1f}) mm")

    # A batch of joint vectors (100000, 6) gives a batch of poses (100000, 4, 4), in one call.
    q = jax.random.uniform(jax.random.key(0), (100_000, 6), minval=robot.lower, maxval=robot.upper)
    poses = nj.forward_kinematics(robot, q)
    farthest = float(jnp.max(jnp.linalg.norm(poses[:, :2, 3], axis=-1)))
    print(f"{len(q)} random poses: farthest from the base axis {1e3 * farthest:.0f} mm")

    # Twists are (omega, v). In the space frame v is the speed of the point at the origin.
    rates = jnp.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    twist = nj.space_jacobian(robot, q[0]) @ rates
    print(f"joint 1 at 1 rad/s turns the tool about z at {twist[2]:.1f} rad/s")
    return Result(np.asarray(start), farthest, np.asarray(twist))


if __name__ == "__main__":
    main()
