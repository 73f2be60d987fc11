"""What a GPU, or whatever device JAX finds, makes of the kinematics.

    python -m benchmarks.accelerator [--poses 1000000] [--rounds 5] [--patience 300] [--save]

Programs for a GPU take long to compile: all are compiled first, side by side in processes that
share a folder of programs, and what is not done after `--patience` seconds is left out and said.
Then each runs alone, beside a copy of arrays of the same size, which is the floor of what is bound
by memory. Forward kinematics in float32 runs on ten times as many poses.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks.devices import functions, inputs, right
from benchmarks.measure import Claim, Report, Timed, about, header, table

LEAST = 0.05

MADE = 262_144
"""So many different poses are made on the host; larger batches repeat them."""

LAST = "forward kinematics, batch last"

NUMBERS = {"forward kinematics": 22, LAST: 22, "space Jacobian": 42}
"""Read and written for a pose, where little else costs."""

COMPLETE = "complete inverse kinematics"

AIMS = {"float32": 10e6, "float64": 2e6}
"""Complete sets of the Niryo One a second."""


@dataclasses.dataclass(frozen=True)
class Job:
    """One function of one robot at one size."""

    function: str
    robot: str
    dtype: str
    size: int

    @property
    def text(self) -> str:
        """As printed, and as key in the JSON."""
        return f"{self.function}, {self.robot}, {self.dtype}, {self.size:,}"

    def prepared(self) -> tuple[Callable[[], Any], Callable[[Any], bool]]:
        """What runs it, and what judges its answer."""
        made = min(self.size, MADE)
        robot, q, pose = inputs(made, self.dtype, getattr(nj.robots, self.robot)())
        repeats = -(-self.size // made)
        some_q, some_pose = jax.device_put(q), jax.device_put(pose)
        all_q = jnp.tile(some_q, (repeats, 1))[: self.size]
        all_pose = jnp.tile(some_pose, (repeats, 1, 1))[: self.size]
        if self.function == LAST:
            columns = jax.block_until_ready(all_q.T)

            def judge(answer: Any) -> bool:
                first = np.moveaxis(np.asarray(answer[..., :made]), -1, 0)
                return right(robot, "forward kinematics", first, q, pose)

            return lambda: nj.forward_kinematics(robot, columns, batch_last=True), judge
        run = functions(robot, all_q, all_pose)[self.function]
        return run, lambda answer: right(robot, self.function, answer, q, pose)


def jobs(poses: int) -> list[Job]:
    """In the order in which they run: the quick ones first."""
    simple = [
        Job("forward kinematics", "niryo_one", "float32", 10 * poses),
        Job("forward kinematics", "niryo_one", "float64", poses),
        Job(LAST, "niryo_one", "float32", 10 * poses),
        Job(LAST, "niryo_one", "float64", poses),
        Job("space Jacobian", "niryo_one", "float32", poses),
        Job("space Jacobian", "niryo_one", "float64", poses),
        Job("Newton-Raphson", "niryo_one", "float32", poses),
        Job("Newton-Raphson", "niryo_one", "float64", poses),
    ]
    few = min(poses, 10_240)
    sets = [
        Job(COMPLETE, robot, dtype, size)
        for robot, size in (
            ("abb_irb120", poses),
            ("ur16e", poses),
            ("niryo_one", poses),
            ("ur16e", few),
            ("niryo_one", few),
        )
        for dtype in ("float32", "float64")
    ]
    return simple + sets


def compile_all(work: list[Job], cache: str, patience: float) -> dict[Job, float | str]:
    """Seconds that each took to compile and run once, beside the others; or what went wrong."""
    command = [sys.executable, "-m", "benchmarks.accelerator", "--cache", cache, "--prepare"]
    started = time.perf_counter()
    running = {
        job: subprocess.Popen(
            [*command, json.dumps(dataclasses.astuple(job))],
            cwd=Path(__file__).parents[1],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for job in work
    }
    found: dict[Job, float | str] = {}
    for job, process in running.items():
        left = max(0.1, patience - (time.perf_counter() - started))
        try:
            out, error = process.communicate(timeout=left)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            found[job] = f"not compiled after {patience:.0f} s"
        else:
            lines = error.strip().splitlines() or [f"exit code {process.returncode}"]
            found[job] = float(out.split()[-1]) if process.returncode == 0 else lines[-1][:200]
        print(f"  {job.text}: {found[job]}", flush=True)
    return found


def copy_bandwidth(numbers: int, dtype: str) -> float:
    """Bytes a second, read and written, of a copy of arrays of that size in all."""
    x = jnp.ones(numbers // 2, dtype)
    copy = jax.jit(lambda x: x + 1)
    timed = Timed("copy", numbers, lambda: copy(x))
    for _ in range(7):
        timed.round(LEAST)
    return 2 * x.nbytes / timed.seconds


def measure(poses: int, rounds: int, patience: float) -> Report:
    """On JAX's default device."""
    with tempfile.TemporaryDirectory() as cache:
        work = jobs(poses)
        compiled = compile_all(work, cache, patience)
        keep_programs(cache)
        facts = about(rounds=rounds)
        title = f"On {facts['device']}"
        report = Report(title, {"about": facts, "jobs": {}}, [header(facts)])
        lines = [_row(job, compiled[job], rounds, report) for job in work]
    head = ["what", "robot", "type", "batch", "poses/s", "spread", "share of copy bandwidth"]
    report.sections.append(table([*head, "compiled beside the others (s)"], lines))
    return report


def _row(job: Job, compiled: float | str, rounds: int, report: Report) -> list[str]:
    cells = [job.function, job.robot, job.dtype, f"{job.size:,}"]
    facts: dict[str, Any] = {"compiled": compiled}
    report.data["jobs"][job.text] = facts
    if isinstance(compiled, str):
        return [*cells, compiled, "", "", ""]
    run, judge = job.prepared()
    timed = Timed(job.text, job.size, run)
    for _ in range(rounds):
        timed.round(LEAST)
    facts.update(timed.facts())
    if not judge(timed.result):
        report.wrong.append(job.text)
    share = ""
    if job.function in NUMBERS:
        numbers = NUMBERS[job.function] * job.size
        floor = numbers * np.dtype(job.dtype).itemsize / copy_bandwidth(numbers, job.dtype)
        share = f"{floor / timed.seconds:.2f}"
        if job.function.startswith("forward") and job.dtype == "float32":
            text = f"{job.function}, float32, at more than half of copy bandwidth: {share}"
            report.claims.append(Claim(text, float(share) > 0.5))
    elif job.function == COMPLETE and job.robot == "niryo_one" and job.size > 100_000:
        text = f"{COMPLETE}, {job.dtype}, at least {AIMS[job.dtype]:,.0f} poses/s"
        report.claims.append(Claim(f"{text}: {timed.rate:,.0f}", timed.rate >= AIMS[job.dtype]))
    print(f"  {job.text}: {timed.rate:,.0f}/s, {timed.spread:.0%} {share}", flush=True)
    return [*cells, f"{timed.rate:,.0f}", f"{timed.spread:.0%}", share, f"{compiled:.0f}"]


def keep_programs(folder: str) -> None:
    """Compiled programs are kept in a folder, and taken from it."""
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def main() -> int:
    """Measure, print, and fail where an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=1_048_576)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--patience", type=float, default=300)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    parser.add_argument("--prepare", help=argparse.SUPPRESS)
    parser.add_argument("--cache", help=argparse.SUPPRESS)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if options.prepare:
        keep_programs(options.cache)
        run, _ = Job(*json.loads(options.prepare)).prepared()
        started = time.perf_counter()
        jax.block_until_ready(run())
        print(time.perf_counter() - started)
        return 0
    report = measure(options.poses, options.rounds, options.patience)
    kind = jax.devices()[0].device_kind.lower().replace(" ", "-")
    return report.finish(f"device-{kind}" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
