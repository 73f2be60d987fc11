"""What errors of the joints make of the position of the tool: a study repeated, and corrected.

You learn: how errors of the joints become one of the tool, which joint matters, what averaging
hides, and which of all solutions of a pose is the least sensitive.

A lab report drew 200 errors of 0.01 rad for each joint, averaged them, and then asked how far the
tool goes: that is the error of the average of 200 motions. A single motion is sqrt(200) = 14 times
as far off. Given a path, `main` draws the figure of docs/uncertainty.md.

Expected output (what is drawn depends on the seed):

    pose 2: ZYZ 0.0, 90.0, 0.0 deg
      test   dx      dy      dz      e_t (mm), from the average of 200 draws
      1    -0.18   -0.02   -0.27    0.33
      2     0.01    0.22   -0.15    0.27
      3    -0.01   -0.00    0.05    0.05
      one motion: rms 3.85 mm, not 0.27; half axes 2.867, 2.098, 1.474 mm
      200,000 draws: half axes 2.864, 2.104, 1.474 mm; mean of e_t 3.50 mm, 95 % below 6.41 mm
      joints alone, mm: 2.09, 2.12, 2.42, 0.14, 0.24, 0.00; most by joint 3
      mean shift -0.018, 0.018, 0.014 mm
    pose 3: ZYZ 0.0, 90.0, 0.0 deg
      ...
      one motion: rms 3.97 mm, not 0.28; half axes 3.021, 2.095, 1.490 mm
      ...
    pose 2 has 8 solutions; within the limits the least sensitive has 3.85 mm rms
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import niryo_jax as nj
from niryo_jax import uncertainty as un
from niryo_jax.figures import save
from niryo_jax.hardware.pick_and_place import TABLE_2_1
from niryo_jax.lie.zyz import zyz_from_rotation

SIGMA = 0.01
DRAWS = 200


class Result(NamedTuple):
    zyz: np.ndarray
    tests: np.ndarray
    rms: np.ndarray
    averaged: np.ndarray
    half_axes: np.ndarray
    drawn_half_axes: np.ndarray
    alone: np.ndarray
    agrees: np.ndarray
    least: float


def main(picture: Path | None = None) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()
    poses = np.stack([TABLE_2_1[step].pose for step in (1, 2)])
    solutions = nj.inverse_kinematics(robot, poses)
    q, _ = solutions.farthest_from_limits()
    noise = un.Gaussian.independent(np.full(6, SIGMA))
    covariance = noise.covariance(q)
    key = jax.random.key(2)

    # 1. The tables of the report: three tests of each pose, from the average of 200 draws.
    zyz = np.rad2deg(zyz_from_rotation(poses[:, :3, :3]))
    errors = noise.sample(key, q, 3 * DRAWS).reshape(2, 3, DRAWS, 6)
    moved = nj.forward_kinematics(robot, q[:, None] + errors.mean(axis=2))
    tests = 1e3 * np.asarray(moved[..., :3, 3] - poses[:, None, :3, 3])

    # 2. What a single motion does: by the formula, and by trying it.
    one = un.propagate(robot, q, covariance)
    average = un.propagate(robot, q, covariance / DRAWS)
    tried = un.monte_carlo(robot, q, noise, key, 200_000)
    alone = un.sensitivity(robot, q, SIGMA)
    half_axes, drawn = (1e3 * np.asarray(x.ellipsoid().half_axes) for x in (one, tried))
    rms, averaged = (1e3 * np.asarray(x.rms) for x in (one, average))
    for pose in range(2):
        print(f"pose {pose + 2}: ZYZ {_row(zyz[pose], 1)} deg")
        print(f"  test   dx      dy      dz      e_t (mm), from the average of {DRAWS} draws")
        for number, test in enumerate(tests[pose], start=1):
            x, y, z = test
            print(f"  {number} {x:8.2f}{y:8.2f}{z:8.2f}{np.linalg.norm(test):8.2f}")
        print(
            f"  one motion: rms {rms[pose]:.2f} mm, not {averaged[pose]:.2f}; "
            f"half axes {_row(half_axes[pose], 3)} mm"
        )
        print(
            f"  {tried.samples:,} draws: half axes {_row(drawn[pose], 3)} mm; "
            f"mean of e_t {1e3 * tried.mean_norm[pose]:.2f} mm, "
            f"95 % below {1e3 * tried.percentiles[pose, 1]:.2f} mm"
        )
        print(
            f"  joints alone, mm: {_row(alone.millimetres[pose], 2)}; "
            f"most by joint {int(alone.ranking[pose, 0]) + 1}"
        )
        print(f"  mean shift {_row(1e3 * one.mean_shift[pose], 3)} mm")

    # 3. Of all solutions of a pose, the one at which the errors matter least.
    best, _ = un.least_sensitive(robot, solutions, covariance[0])
    least = float(un.propagate(robot, best[0], covariance[0]).rms)
    print(
        f"pose 2 has {int(solutions.count[0])} solutions; within the limits the least sensitive "
        f"has {1e3 * least:.2f} mm rms"
    )
    if picture is not None:
        from niryo_jax.uncertainty.figures import error_figure

        title = "Niryo One, pose 3 of Table 2.1, joints off by 0.01 rad"
        save(error_figure(robot, q[1], noise, key, title=title), picture)
    agrees = np.asarray(un.compare(one, tried).agrees())
    return Result(
        zyz, tests, rms, averaged, half_axes, drawn, np.asarray(alone.millimetres), agrees, least
    )


def _row(values: np.ndarray, decimals: int) -> str:
    rounded = np.round(np.asarray(values), decimals) + 0.0
    return ", ".join(f"{value:.{decimals}f}" for value in rounded)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
