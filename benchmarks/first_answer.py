"""How long a first answer takes: fresh processes, no cache, CPU seconds on one core.

    python -m benchmarks.first_answer [--rounds 3] [--poses 65536] [--save]

Each number is the least of some processes. The command's cache is an empty folder of its own. What
a batch of many poses makes of the larger program is timed beside it.
"""

from __future__ import annotations

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

import jax
import numpy as np

import niryo_jax as nj
from benchmarks.measure import Claim, Report, Timed, about, alternate, header, in_a_process, table

Q = (0.1, 0.2, -0.3, 0.4, 0.5, 0.6)
POSE = ("0.148", "-0.148", "0.15", "--rpy", "0", "90", "0", "--degrees")
RIGHT = 1e-9

# What is asked of a process, and the most CPU seconds that all of it may take.
QUESTIONS: dict[str, tuple[str, str, float | None]] = {
    "one pose, all solutions, Niryo One": ("niryo_one", "solutions", 5.0),
    "one pose, all solutions, IRB1600": ("abb_irb1600", "solutions", 5.0),
    "one pose and its Jacobian, Niryo One": ("niryo_one", "jacobian", 8.0),
    "one pose and its Jacobian, IRB1600": ("abb_irb1600", "jacobian", 8.0),
    "forward kinematics, Niryo One": ("niryo_one", "forward", None),
}


def answer(name: str, what: str) -> dict[str, Any]:
    """One question in this process: its CPU seconds so far, and how far off the answer is."""
    robot = nj.robots.load(name)
    pose = _product_of_exponentials(robot, np.array(Q))
    if what == "forward":
        error = float(np.abs(np.asarray(nj.forward_kinematics(robot, np.array(Q))) - pose).max())
        return {"seconds": time.process_time(), "error": error, "steady": 0.0}
    solutions = jax.block_until_ready(nj.inverse_kinematics(robot, pose))
    if what == "jacobian":
        solve = jax.jacobian(lambda pose: nj.inverse_kinematics(robot, pose).q)
        jax.block_until_ready(solve(jax.numpy.asarray(pose)))
    seconds = time.process_time()
    started = time.perf_counter()
    for _ in range(100):
        jax.block_until_ready(nj.inverse_kinematics(robot, pose))
    steady = (time.perf_counter() - started) / 100
    q = np.asarray(solutions.q)[np.asarray(solutions.found)]
    apart = np.abs((q - np.array(Q) + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
    return {"seconds": seconds, "error": float(apart.min()), "steady": steady}


def _product_of_exponentials(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """The tool's pose in numpy, so that nothing else is compiled."""
    pose = np.eye(4)
    for screw, angle in zip(np.asarray(robot.screws), q):
        hat = np.cross(np.eye(3), screw[:3])
        step = np.eye(4)
        step[:3, :3] += np.sin(angle) * hat + (1 - np.cos(angle)) * hat @ hat
        turned = np.sin(angle) * screw[3:] + (1 - np.cos(angle)) * np.cross(screw[:3], screw[3:])
        step[:3, 3] = turned
        pose = pose @ step
    return pose @ np.asarray(robot.home)


def command(folder: str) -> dict[str, float]:
    """Wall and CPU seconds of `niryo-jax ik` with a folder of programs."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "niryo_jax.cli", "ik", *POSE],
        env={**os.environ, "NIRYO_JAX_CACHE_DIR": folder},
        check=True,
        capture_output=True,
    )
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "wall": wall,
        "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
    }


def large(poses: int, rounds: int) -> Timed:
    """A large batch of the Niryo One, which has a program of its own."""
    robot = nj.robots.niryo_one()
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (poses, 6))
    pose = jax.device_put(nj.forward_kinematics(robot, q))
    timed = Timed("large", poses, lambda: nj.inverse_kinematics(robot, pose))
    alternate([timed], rounds)
    return timed


def measure(poses: int, rounds: int) -> Report:
    """Everything."""
    facts = about(rounds=rounds, poses=poses)
    report = Report("A first answer", {"about": facts}, [header(facts)])
    lines = []
    for text, (name, what, limit) in QUESTIONS.items():
        runs = [
            in_a_process("benchmarks.first_answer", "--answer", name, what, JAX_ENABLE_X64="1")
            for _ in range(rounds)
        ]
        failed = [run["error"] for run in runs if "seconds" not in run]
        if failed or not all(run["error"] < RIGHT for run in runs):
            report.wrong.append(f"{text}: {failed or [run['error'] for run in runs]}")
            continue
        seconds = min(run["seconds"] for run in runs)
        steady = min(run["steady"] for run in runs)
        lines.append([text, f"{seconds:.2f}", f"{steady * 1e3:.2f}" if steady else ""])
        report.data[text] = runs
        print(f"  {text}: {seconds:.2f} s", flush=True)
        if limit is not None:
            claim = f"{text}: {seconds:.2f} s of CPU in all, at most {limit:.0f}"
            report.claims.append(Claim(claim, seconds <= limit))
    report.sections.append(table(["a fresh process", "CPU (s)", "again (ms)"], lines))
    commands = list[list[dict[str, float]]]()
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            commands.append([command(folder), command(folder)])
    for which, limit in (("first", 6.0), ("second", 2.0)):
        index = ["first", "second"].index(which)
        wall = min(pair[index]["wall"] for pair in commands)
        cpu = min(pair[index]["cpu"] for pair in commands)
        claim = f"niryo-jax ik, {which}: {wall:.2f} s of wall time ({cpu:.2f} of CPU)"
        report.claims.append(Claim(f"{claim}, at most {limit:.0f}", wall <= limit))
    report.data["command"] = commands
    timed = large(poses, 2 * rounds)
    report.data["large"] = timed.facts()
    report.sections.append(
        f"{poses:,} poses of the Niryo One: {timed.rate:,.0f} poses/s after {timed.first:.1f} s."
    )
    return report


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--poses", type=int, default=65536)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    parser.add_argument("--answer", nargs=2, metavar=("ROBOT", "WHAT"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.answer:
        print(json.dumps(answer(*options.answer)))
        return 0
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", None)
    os.environ.pop("JAX_COMPILATION_CACHE_DIR", None)
    return measure(options.poses, options.rounds).finish("first-answer" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
