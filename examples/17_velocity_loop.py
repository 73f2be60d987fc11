"""A loop at 100 Hz that follows a moving target past a singular wrist, within all limits.

You learn: how to turn the pose of a moving target into a twist (its own velocity, and what is
missing), ask for joint rates that keep the limits of positions, rates and accelerations, and read
what kept the tool from moving as asked.

Expected output (times, and in the last bits what the singular wrist makes of rounding, depend on
the machine):

    801 steps of 10 ms: 0.25 m there and back, past a wrist whose smallest singular value is 0.0001
    undamped, unlimited: the fastest joint would need 365 rad/s
    in the loop: 2.00 rad/s, changed by at most 10.0 rad/s^2, no limit exceeded: True
    reached 632 steps, limited 168, damped 1
    the tool strays by at most 18.0 mm and 0.2 deg, and ends 0.09 mm and 0.00 deg from the target
    a step takes 0.2 ms
"""

from __future__ import annotations

import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj

DT = 0.01
FASTEST = np.full(6, 2.0)
SUDDEN = np.full(6, 10.0)
GAIN = 4.0


class Result(NamedTuple):
    singular: float
    unlimited: float
    fastest: float
    sudden: float
    kept: bool
    statuses: dict[str, int]
    strays: tuple[float, float]
    ends: tuple[float, float]
    step: float


def main() -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()

    # 1. The target: its orientation stays, its position goes there and back. Twice axes 4 and 6 are
    # almost one line, and to follow exactly both would have to turn by half a turn at once.
    q = np.array([0.0, -0.25, -0.35, 0.0, 0.6, 0.0])
    start = np.asarray(nj.forward_kinematics(robot, q))
    times = np.arange(0.0, 8.0 + DT / 2, DT)
    way = np.array([-0.06, 0.012, 0.24])

    def target(t: float) -> tuple[np.ndarray, np.ndarray]:
        """The pose at a time, and the velocity of its origin."""
        pose = start.copy()
        share = 0.5 - 0.5 * np.cos(2 * np.pi * t / 8.0)
        pose[:3, 3] += share * way
        return pose, 0.5 * np.sin(2 * np.pi * t / 8.0) * 2 * np.pi / 8.0 * way

    # 2. The loop, all in the axes of the tool: the velocity of the target, and what is missing.
    @jax.jit
    def command(q: jax.Array, rate: jax.Array, pose: jax.Array, velocity: jax.Array) -> tuple:
        tool = nj.forward_kinematics(robot, q)
        missing = nj.se3.log(nj.se3.inverse(tool) @ pose)
        ahead = jnp.concatenate([jnp.zeros(3), tool[:3, :3].T @ velocity])
        twist = ahead + GAIN * missing
        found = nj.motion.velocity_ik(
            robot,
            q,
            twist,
            frame="body",
            rate_limits=FASTEST,
            dt=DT,
            acceleration_limits=SUDDEN,
            previous_rate=rate,
        )
        off = jnp.linalg.norm(tool[:3, 3] - pose[:3, 3]), jnp.linalg.norm(missing[:3])
        return found, off, jnp.max(jnp.abs(nj.joint_rates(robot, q, ahead, frame="body")))

    rate, log, spent = np.zeros(6), [], []
    for t in times:
        pose, velocity = target(t)
        began = time.perf_counter()
        found, off, unlimited = jax.block_until_ready(command(q, rate, pose, velocity))
        spent.append(time.perf_counter() - began)
        after = np.asarray(found.rate)
        log.append(
            (
                float(found.smallest_singular_value),
                float(unlimited),
                float(np.max(np.abs(after))),
                float(np.max(np.abs(after - rate))) / DT,
                nj.motion.VelocityStatus(int(found.status)).name,
                *map(float, off),
            )
        )
        rate, q = after, q + DT * after
        if np.any(q < robot.lower - 1e-12) or np.any(q > robot.upper + 1e-12):
            raise RuntimeError(f"a joint is outside: {q}")
    smallest, unlimited, fastest, sudden, statuses, metres, turns = zip(*log)

    # 3. What became of it.
    counts = {name: statuses.count(name) for name in ("REACHED", "LIMITED", "SINGULAR")}
    result = Result(
        min(smallest),
        max(unlimited),
        max(fastest),
        max(sudden),
        max(fastest) <= FASTEST[0] and max(sudden) <= SUDDEN[0] + 1e-9,
        counts,
        (1e3 * max(metres), np.rad2deg(max(turns))),
        (1e3 * metres[-1], np.rad2deg(turns[-1])),
        float(np.median(spent[1:])),
    )
    print(
        f"{len(times)} steps of {1e3 * DT:.0f} ms: {np.linalg.norm(way):.2f} m there and back, "
        f"past a wrist whose smallest singular value is {result.singular:.4f}"
    )
    print(f"undamped, unlimited: the fastest joint would need {result.unlimited:.0f} rad/s")
    print(
        f"in the loop: {result.fastest:.2f} rad/s, changed by at most {result.sudden:.1f} rad/s^2, "
        f"no limit exceeded: {result.kept}"
    )
    print(
        f"reached {counts['REACHED']} steps, limited {counts['LIMITED']}, "
        f"damped {counts['SINGULAR']}"
    )
    print(
        f"the tool strays by at most {result.strays[0]:.1f} mm and {result.strays[1]:.1f} deg, "
        f"and ends {result.ends[0]:.2f} mm and {result.ends[1]:.2f} deg from the target"
    )
    print(f"a step takes {1e3 * result.step:.1f} ms")
    return result


if __name__ == "__main__":
    main()
