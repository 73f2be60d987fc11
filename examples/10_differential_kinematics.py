"""From joint rates to the velocity of the tool, and back; near a singularity with damping.

You learn: that "the velocity of the tool" has three meanings, that joint rates come back from the
one that is named, and what damping costs and saves.

Expected output:

    IRB120  tool_point  turning [ 0.   -0.92  0.  ] rad/s, moving [ 0.14  0.   -0.23] m/s
    IRB120  space       turning [ 0.   -0.92  0.  ] rad/s, moving [0.51 0.   0.  ] m/s
    IRB120  body        turning [0.   0.   0.92] rad/s, moving [-0.23 -0.14  0.  ] m/s
    IRB120  the joint rates come back to 9e-16 rad/s
    SCARA   undamped: fastest joint     1.3,     1.3,  1756.2,     3.1 rad/s
    SCARA   damped:   fastest joint     1.2,     1.1,     0.6,     2.4 rad/s
    SCARA   moving error of damping 0.015, 0.040, 0.230, 0.072 m/s
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax.differential import joint_rates, tool_velocity
from niryo_jax.robots import book


class Result(NamedTuple):
    velocity: np.ndarray
    round_trip: float
    fastest: np.ndarray
    damped: np.ndarray
    error: np.ndarray


def main() -> Result:
    jax.config.update("jax_enable_x64", True)

    # 1. The book's example (2018): what the tool does at one point of a trajectory.
    robot = book.abb_irb120(up="y", edition=2018)
    q = jnp.array([-2.1294, -0.9092, 0.0977, 0.0, 0.8116, -2.1294])
    rates = jnp.array([-0.0073, 0.8807, -1.606, -0.0001, 0.7253, 0.9128])
    for frame in ("tool_point", "space", "body"):
        # Rows are (omega, v). In "space" v belongs to the point at the origin of the space frame.
        rounded = np.round(tool_velocity(robot, q, rates, frame=frame), 2) + 0.0
        omega, v = np.split(rounded, 2)
        print(f"IRB120  {frame:10}  turning {omega} rad/s, moving {v} m/s")
    velocity = tool_velocity(robot, q, rates)
    round_trip = float(jnp.max(jnp.abs(joint_rates(robot, q, velocity) - rates)))
    print(f"IRB120  the joint rates come back to {round_trip:.0e} rad/s")

    # 2. The same velocity for a SCARA at four points. At the third it is all but folded.
    scara = book.abb_irb910sc(edition=2018)
    points = jnp.deg2rad(jnp.array([[-90, -90], [-90, -154.7], [-90, -179.97], [90, -154.7]]))
    q = jnp.pad(points, ((0, 0), (0, 2)))
    wanted = jnp.array([0.0, -0.92, 0.0, 0.14, 0.0, -0.23])
    exact = joint_rates(scara, q, wanted)
    damped = joint_rates(scara, q, wanted, damping=0.05)
    fastest, slowed = (jnp.max(jnp.abs(x), axis=-1) for x in (exact, damped))
    error = jnp.linalg.norm((tool_velocity(scara, q, damped) - wanted)[:, 3:], axis=-1)
    print(f"SCARA   undamped: fastest joint {_row(fastest, '7.1f')} rad/s")
    print(f"SCARA   damped:   fastest joint {_row(slowed, '7.1f')} rad/s")
    print(f"SCARA   moving error of damping {_row(error, '.3f')} m/s")
    return Result(*map(np.asarray, (velocity, round_trip, fastest, slowed, error)))


def _row(values: jax.Array, form: str) -> str:
    return ", ".join(f"{value:{form}}" for value in np.asarray(values))


if __name__ == "__main__":
    main()
