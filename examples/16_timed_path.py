"""A straight line of the tool, done by the best branch, as fast as joints and tool may move.

You learn: how to find joint vectors for a path of poses, give limits, and get times, velocities and
accelerations at the rate of a controller; how a point-to-point move and an arc are made. Given a
path, `main` draws the figure of docs/motion.md.

Expected output:

    the line: 301 poses over 300 mm, on the cheapest of all branches
    fastest: 2.07 s, at most 63 % of a velocity and 100 % of an acceleration limit
    with the tool at 0.1 m/s at most: 3.30 s
    quintic: 2.54 s, its jerk bounded too
    at 1 kHz: 2068 samples, the tool off the line by less than a nanometre
    back to the start, from point to point: 2.17 s (S-curve)
    an arc of 471 mm: 4.31 s
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import niryo_jax as nj
from niryo_jax import motion
from niryo_jax.figures import save
from niryo_jax.motion.figures import motion_figure


class Result(NamedTuple):
    durations: dict[str, float]
    shares: tuple[float, float]
    off: float
    samples: int


def main(picture: Path | None = None) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot, limits = nj.robots.niryo_one(), motion.niryo_limits("niryo_one")

    # 1. Poses a millimetre apart, and the cheapest way through all their solutions.
    start = np.asarray(nj.forward_kinematics(robot, np.zeros(6))).copy()
    end = start.copy()
    start[:3, 3], end[:3, 3] = [0.25, -0.15, 0.2], [0.25, 0.15, 0.2]
    poses = motion.cartesian_trajectory(start, end, 1.0, 301, lambda u: u).pose
    best = motion.best_path(robot, poses)
    assert best.ok, best.message
    print(f"the line: {len(poses)} poses over 300 mm, on the cheapest of all branches")

    # 2. In the shortest time: without and with a limit of the tool, and smoothly.
    fastest = motion.retime(best, limits, robot=robot)
    slow = motion.CartesianLimits(linear=0.1)
    careful = motion.retime(best, limits, robot=robot, cartesian=slow)
    smooth = motion.retime(best, limits, robot=robot, method="quintic")
    found = fastest.every(1e-3)
    shares = tuple(
        float(np.max(np.abs(rate) / most))
        for rate, most in (
            (found.velocity, limits.velocity),
            (found.acceleration, limits.acceleration),
        )
    )
    print(
        f"fastest: {float(fastest.duration):.2f} s, at most {shares[0]:.0%} of a velocity and "
        f"{shares[1]:.0%} of an acceleration limit".replace("%", " %")
    )
    print(f"with the tool at 0.1 m/s at most: {float(careful.duration):.2f} s")
    print(f"quintic: {float(smooth.duration):.2f} s, its jerk bounded too")
    reached = np.asarray(nj.forward_kinematics(robot, found.q))[:, :3, 3]
    off = float(np.max(np.linalg.norm(reached[:, [0, 2]] - start[[0, 2], 3], axis=1)))
    less = "less than a nanometre" if off < 1e-9 else f"{1e9 * off:.1f} nm"
    print(f"at 1 kHz: {len(found.time)} samples, the tool off the line by {less}")

    # 3. Back, all joints together; the tool goes where it likes.
    back = motion.point_to_point(best.q[-1], best.q[0], limits, "scurve")
    print(f"back to the start, from point to point: {float(back.duration):.2f} s (S-curve)")

    # 4. The same ends by an arc.
    arc = motion.best_path(robot, motion.arc(start, [0.25, 0.0, 0.35], end, 301))
    assert arc.ok, arc.message
    round_way = motion.retime(arc, limits, robot=robot)
    print(f"an arc of {1e3 * 0.15 * np.pi:.0f} mm: {float(round_way.duration):.2f} s")

    if picture is not None:
        drawn = {"fastest": fastest, "tool at 0.1 m/s": careful, "quintic": smooth}
        save(motion_figure(drawn, limits), picture)
    times = {"fastest": fastest, "careful": careful, "smooth": smooth, "arc": round_way}
    durations = {name: float(path.duration) for name, path in times.items()}
    durations["back"] = float(back.duration)
    return Result(durations, (shares[0], shares[1]), off, len(found.time))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
