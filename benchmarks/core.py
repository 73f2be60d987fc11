"""Forward kinematics, Jacobian and inverse kinematics of the Niryo One beside plain numpy.

    python -m benchmarks.core [--poses 65536] [--runs 7] [--save]

Both sides get the same joint vectors in the same run, in float64. Numbers are medians of the runs
with their spread; compare ratios, not rates. The benchmark fails with exit code 1 when an answer
is wrong. `--save` writes a dated JSON and a Markdown table to `benchmarks/results/`.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

import niryo_jax as nj

RESULTS = Path(__file__).parent / "results"


def hat(w: np.ndarray) -> np.ndarray:
    """The matrix of w x."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def numpy_chain(robot: nj.Robot, q: np.ndarray) -> list[np.ndarray]:
    """exp([S1] q1) ... exp([Si] qi) for i = 0..n, vectorised over the batch, in plain numpy."""
    motions = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for screw, angle in zip(robot.screws, q.T):
        w = hat(screw[:3])
        sin, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
        motion = np.zeros((len(q), 4, 4))
        motion[:, :3, :3] = np.eye(3) + sin * w + versine * (w @ w)
        motion[:, :3, 3] = sin[:, 0] * screw[3:] + versine[:, 0] * (w @ screw[3:])
        motion[:, 3, 3] = 1
        motions.append(motions[-1] @ motion)
    return motions


def numpy_forward_kinematics(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N, 4, 4)."""
    return numpy_chain(robot, q)[-1] @ robot.home


def numpy_space_jacobian(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N, 6, n)."""
    columns = []
    for screw, motion in zip(robot.screws, numpy_chain(robot, q)):
        w = motion[:, :3, :3] @ screw[:3]
        v = motion[:, :3, :3] @ screw[3:] + np.cross(motion[:, :3, 3], w)
        columns.append(np.concatenate([w, v], axis=1))
    return np.stack(columns, axis=-1)


def seconds(function: Callable[[], Any], runs: int) -> dict[str, float]:
    """First call (compilation included), then median, least and greatest of the runs."""
    started = time.perf_counter()
    jax.block_until_ready(function())
    first = time.perf_counter() - started
    times = []
    for _ in range(runs):
        started = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - started)
    return {
        "first": first,
        "median": statistics.median(times),
        "least": min(times),
        "greatest": max(times),
    }


def measure(poses: int, runs: int) -> tuple[dict[str, dict[str, float]], dict[str, bool]]:
    """Times by name, and whether each answer is right."""
    robot = nj.robots.niryo_one()
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (poses, 6))
    step = rng.standard_normal(q.shape)
    guess = q + 0.1 * step / np.linalg.norm(step, axis=1, keepdims=True)
    pose = numpy_forward_kinematics(robot, q)
    few = pose[: max(1, poses // 16)]
    subjects: dict[str, Callable[[], Any]] = {
        "forward kinematics, numpy": lambda: numpy_forward_kinematics(robot, q),
        "forward kinematics": lambda: nj.forward_kinematics(robot, q),
        "space Jacobian, numpy": lambda: numpy_space_jacobian(robot, q),
        "space Jacobian": lambda: nj.space_jacobian(robot, q),
        "Newton-Raphson from 0.1 rad": lambda: nj.newton_raphson(robot, pose, guess).q,
        "inverse kinematics, seeded": lambda: nj.inverse_kinematics(robot, few).q,
    }
    times = {name: seconds(function, runs) for name, function in subjects.items()}
    for name, time_of in times.items():
        time_of["poses"] = len(few) if "seeded" in name else poses
    result, answers = nj.newton_raphson(robot, pose, guess), nj.inverse_kinematics(robot, few)
    reached = numpy_forward_kinematics(robot, np.asarray(result.q))[result.converged]
    solved = numpy_forward_kinematics(robot, np.asarray(answers.q[answers.found]))
    wanted = np.broadcast_to(few[:, None], (*answers.found.shape, 4, 4))[answers.found]
    jacobian = numpy_space_jacobian(robot, q)
    right = {
        "forward kinematics": _near(nj.forward_kinematics(robot, q), pose, 1e-13),
        "space Jacobian": _near(nj.space_jacobian(robot, q), jacobian, 1e-13),
        "Newton-Raphson": _near(reached, pose[result.converged], 1e-9)
        and float(result.converged.mean()) > 0.999,
        "inverse kinematics": _near(solved, wanted, 1e-9)
        and float(np.mean(answers.count > 0)) > 0.99,
    }
    return times, right


def _near(a: Any, b: Any, tolerance: float) -> bool:
    return bool(np.max(np.abs(np.asarray(a) - np.asarray(b))) < tolerance)


def table(times: dict[str, dict[str, float]]) -> str:
    """A Markdown table: poses a second, spread, first call, ratio to numpy."""
    lines = [
        "| what | poses/s | spread | first call (s) | ratio to numpy |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, t in times.items():
        spread = (t["greatest"] - t["least"]) / t["median"]
        reference = times.get(f"{name}, numpy")
        ratio = f"{reference['median'] / t['median']:.1f}" if reference else ""
        rate = t["poses"] / t["median"]
        lines.append(f"| {name} | {rate:,.0f} | {spread:.0%} | {t['first']:.2f} | {ratio} |")
    return "\n".join(lines)


def main() -> int:
    """Measure, print, and fail where an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=65_536)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    times, right = measure(options.poses, options.runs)
    about = {
        "date": datetime.date.today().isoformat(),
        "machine": platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None,
        "device": str(jax.devices()[0]),
        "jax": jax.__version__,
        "numpy": np.__version__,
        "poses": options.poses,
    }
    text = f"{', '.join(f'{k} {v}' for k, v in about.items())}\n\n{table(times)}\n"
    print(text)
    for name, fine in right.items():
        print(f"{name}: {'right' if fine else 'WRONG'}")
    if options.save:
        RESULTS.mkdir(exist_ok=True)
        stem = RESULTS / f"{about['date']}-core"
        stem.with_suffix(".json").write_text(
            json.dumps({"about": about, "seconds": times, "right": right}, indent=1) + "\n"
        )
        stem.with_suffix(".md").write_text(f"# Core, float64\n\n{text}")
    return 0 if all(right.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
