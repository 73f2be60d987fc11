"""An arm from what was measured of it: thirty parameters from 60 poses, three of them wrong.

You learn: how to choose where to measure, fit an arm although some measurements are wrong, see how
sure the fit is and what no measurement can tell, and solve the fitted arm completely. Given a path,
`main` draws the figure of docs/calibration.md.

Expected output:

    30 parameters of niryo_one from 60 measurements: 8.35 mm, 6.96 mrad before, 0.16 mm, 0.164 mrad
    after (root mean square).
    Measurements that were held out: 0.172 mm, 0.2 mrad.
    4 measurements are not believed: number 7, 21, 23, 41.
    Rank 30, condition 6.61.
    spread of the errors in standard deviations: 0.7; doubted: 7, 21, 23, 41
    sharper by 1.1 where the measurements are chosen
    cannot be told: joint_6 offset - tool turn x
    200 of 200 poses of the true arm solved on the fitted one, off by at most 0.12 mm; proved out of
    its reach, at the edge: 0
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import niryo_jax as nj
from niryo_jax import calibration
from niryo_jax.calibration.figures import calibration_figure
from niryo_jax.figures import save

WRONG = (7, 23, 41)
SIGMA = 1e-4, 1e-4


class Result(NamedTuple):
    fit: calibration.Calibration
    spread: float
    sharper: float
    combinations: str
    solved: int
    off: float


def main(picture: Path | None = None) -> Result:
    jax.config.update("jax_enable_x64", True)
    nominal, rng = nj.robots.niryo_one(), np.random.default_rng(5)
    lower, upper = np.asarray(nominal.lower), np.asarray(nominal.upper)

    # 1. The arm as it really is: every axis and the tool off by some mrad and mm.
    true = worn(nominal, rng)
    candidates = rng.uniform(lower, upper, (400, 6))
    q = candidates[calibration.informative(nominal, candidates, 60)]
    measured = seen(true, q, rng)
    measured[list(WRONG), :3, 3] += rng.normal(size=(3, 3)) * 0.05

    # 2. The fit, which does not believe what is wrong.
    fit = calibration.fit(nominal, q, measured, loss="tukey", sigma=SIGMA)
    print(fit.message)
    exact = calibration.fit(nominal, q, np.asarray(nj.forward_kinematics(true, q)))
    spread = float(np.sqrt(np.mean(((fit.values - exact.values) / fit.deviations) ** 2)))
    doubted = ", ".join(map(str, fit.doubted))
    print(f"spread of the errors in standard deviations: {spread:.1f}; doubted: {doubted}")

    # 3. Where to measure: the same number of poses, not chosen.
    any_q = candidates[:60]
    other = calibration.fit(nominal, any_q, np.asarray(nj.forward_kinematics(true, any_q)))
    ratio = (other.deviations / other.scale) / (exact.deviations / exact.scale)
    sharper = float(np.exp(np.mean(np.log(ratio))))
    print(f"sharper by {sharper:.1f} where the measurements are chosen")

    # 4. What nobody can tell.
    both = calibration.fit(nominal, q, measured, ("offsets", "home"), redundant="hold")
    print(f"cannot be told: {both.combinations[0]}")

    # 5. The fitted arm, solved completely, reaches what the true one reaches.
    poses = np.asarray(nj.forward_kinematics(true, rng.uniform(lower, upper, (200, 6))))
    solutions = nj.inverse_kinematics(fit.robot, poses)
    reached = np.asarray(nj.forward_kinematics(true, solutions.q))[..., :3, 3]
    miss = np.linalg.norm(reached - poses[:, None, :3, 3], axis=-1)
    off = float(miss[np.asarray(solutions.found)].max())
    solved = int(np.sum(np.any(solutions.found, axis=-1)))
    edge = np.asarray(solutions.status)[~np.any(solutions.found, axis=-1)]
    print(
        f"{solved} of 200 poses of the true arm solved on the fitted one, off by at most "
        f"{1e3 * off:.2f} mm; proved out of its reach, at the edge: "
        f"{np.sum(edge == nj.IKStatus.UNREACHABLE)}"
    )
    if picture is not None:
        save(calibration_figure(fit, exact.values, title="A worn Niryo One, 60 poses"), picture)
    return Result(fit, spread, sharper, both.combinations[0], solved, off)


def worn(robot: nj.Robot, rng: np.random.Generator) -> nj.Robot:
    """The arm with every axis turned and shifted a little, and its tool."""
    twists = rng.normal(size=(7, 6)) * 2e-3
    moves = np.asarray(nj.se3.exp(twists))
    screws = np.einsum("nij,nj->ni", np.asarray(nj.se3.adjoint(moves[:6])), robot.screws)
    return dataclasses.replace(robot, screws=screws, home=moves[6] @ robot.home)


def seen(robot: nj.Robot, q: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 4, 4) poses as an instrument sees them."""
    noise = rng.normal(size=(len(q), 6)) * np.repeat(SIGMA[::-1], 3)
    return np.asarray(nj.forward_kinematics(robot, q)) @ np.asarray(nj.se3.exp(noise))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
