"""Errors of joints: propagation and Monte Carlo beside numpy, on one core.

    python -m benchmarks.uncertainty [--configurations 65536] [--samples 10000000] [--rounds 5]

In Monte Carlo numpy does what we do: draws, forward kinematics, moments and percentiles. The exit
code is 1 where an answer of ours is wrong.
"""

from __future__ import annotations

import argparse
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import reference
from benchmarks.measure import Claim, Report, Timed, about, alternate, header, table
from niryo_jax import uncertainty as un
from niryo_jax.uncertainty.trials import PERCENTILES

SIGMA = 0.01

RIGHT = {"float64": 1e-13, "float32": 3e-6}
"""How far a covariance may be from the reference, as a share of its largest entry."""

LEAST = 0.1
"""Seconds a round of propagation lasts at the least."""

CHUNK = 65_536
"""Draws that numpy handles at a time."""

PROPAGATIONS, SECONDS = 1e6, 5.0
"""What is aimed at: configurations a second, and seconds for ten million draws."""


def point_jacobian(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, 6, 6) velocity of the tool's origin in the axes of the space frame, by the reference."""
    jacobian = reference.space_jacobian(robot, q)
    position = reference.forward_kinematics(robot, q)[:, :3, 3]
    jacobian[:, 3:] += np.cross(jacobian[:, :3], position[..., None], axis=1)
    return jacobian


def propagation(
    robot: nj.Robot, size: int, rounds: int, report: Report
) -> tuple[list[list[str]], float]:
    """Rows of the table, and configurations a second in float64."""
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (size, 6))
    root = rng.standard_normal((6, 6))
    covariance = SIGMA**2 * (root @ root.T) / 6
    jacobian = point_jacobian(robot, q)
    truth = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)
    rows, rate = [], 0.0
    for dtype, right in RIGHT.items():
        given, spread = jax.device_put(q.astype(dtype)), jax.device_put(covariance.astype(dtype))
        theirs = jacobian.astype(dtype), covariance.astype(dtype)
        ours = Timed("niryo_jax", size, lambda g=given, s=spread: un.propagate(robot, g, s))
        whole = Timed(
            "numpy, with the Jacobian", min(size, 8192), lambda: _by_numpy(robot, q, covariance)
        )
        bare = Timed(
            "numpy, Jacobian given", size, lambda t=theirs: t[0] @ t[1] @ np.swapaxes(t[0], -1, -2)
        )
        subjects = [ours, bare, *[whole] * (dtype == "float64")]
        alternate(subjects, rounds, LEAST)
        found = np.asarray(ours.result.covariance, np.float64)
        error = float(np.max(np.abs(found - truth)) / np.max(np.abs(truth)))
        if not error < right:
            report.wrong.append(f"propagate, {dtype}: misses by {error:.1e}")
        rate = ours.rate if dtype == "float64" else rate
        for subject in subjects:
            over = ours.rate / subject.rate
            cells = [dtype, subject.name, f"{subject.rate:,.0f}", f"{subject.spread:.0%}"]
            rows.append([*cells, f"{over:.1f}", f"{subject.first:.2f}"])
        report.data[f"propagate, {dtype}"] = [subject.facts() for subject in subjects]
    return rows, rate


def _by_numpy(robot: nj.Robot, q: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    jacobian = point_jacobian(robot, q[:8192])
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)


def trials_by_numpy(robot: nj.Robot, q: np.ndarray, samples: int) -> tuple[np.ndarray, Any]:
    """Covariance of the position, and percentiles of the norm of its error."""
    rng = np.random.default_rng(1)
    start = reference.forward_kinematics(robot, q[None])[0, :3, 3]
    errors = [
        reference.forward_kinematics(
            robot, q + SIGMA * rng.standard_normal((min(CHUNK, samples - done), 6))
        )[:, :3, 3]
        - start
        for done in range(0, samples, CHUNK)
    ]
    moved = np.concatenate(errors)
    return np.cov(moved.T), np.percentile(np.linalg.norm(moved, axis=-1), PERCENTILES)


def trials(
    robot: nj.Robot, samples: int, rounds: int, report: Report
) -> tuple[list[list[str]], float]:
    """Rows of the table, and seconds for the draws in float64."""
    q = np.deg2rad([-45, -46.8656, -34.8624, 0, -8.2720, -45])
    noise = un.Gaussian.independent(np.full(6, SIGMA))
    key, fewer = jax.random.key(0), max(2, samples // 20)
    ours = Timed("niryo_jax", samples, lambda: un.monte_carlo(robot, q, noise, key, samples))
    theirs = Timed("numpy", fewer, lambda: trials_by_numpy(robot, q, fewer))
    alternate([ours, theirs], rounds)
    expected = un.propagate(robot, q, SIGMA**2 * np.eye(6))
    axes = np.asarray(ours.result.ellipsoid().half_axes / expected.ellipsoid().half_axes)
    # At so many draws the second order, of some 1e-4, is what is left.
    if not np.all(np.abs(axes - 1) < 2e-3 + 4 / np.sqrt(2 * samples)):
        report.wrong.append(f"monte_carlo: half axes are {axes} of those propagated")
    report.data["monte_carlo"] = [subject.facts() for subject in (ours, theirs)]
    rows = [
        [x.name, f"{x.size:,}", f"{x.seconds:.2f}", f"{x.rate / 1e6:.2f}", f"{x.spread:.0%}"]
        for x in (ours, theirs)
    ]
    return rows, ours.seconds * 1e7 / samples


def main() -> int:
    """Run, print, and return the exit code."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--configurations", type=int, default=65_536)
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    facts = about(configurations=options.configurations, samples=options.samples)
    report = Report("Errors of joints", facts, [header(facts)])
    robot = nj.robots.niryo_one()
    rows, rate = propagation(robot, options.configurations, options.rounds, report)
    head = ["type", "by", "configurations/s", "spread", "ours / its", "first call (s)"]
    report.sections += ["Covariance of the tool, six joints:", table(head, rows)]
    rows, seconds = trials(robot, options.samples, options.rounds, report)
    head = ["by", "draws", "seconds", "million draws/s", "spread"]
    report.sections += ["Monte Carlo of one configuration, float64:", table(head, rows)]
    report.claims += [
        Claim(f"{rate:,.0f} configurations/s on one core, of 1,000,000", rate >= PROPAGATIONS),
        Claim(f"ten million draws in {seconds:.1f} s on one core, of 5", seconds <= SECONDS),
    ]
    return report.finish("uncertainty" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
