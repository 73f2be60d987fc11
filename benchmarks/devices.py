"""What more cores and more devices are worth.

    python -m benchmarks.devices [--poses 65536] [--rounds 7] [--cores 1 2 ...] [--save]
The functions run in processes that may use one core and all of them, in turn, and then spread over
as many devices of one process as there are cores; the ratios are of the medians.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import reference
from benchmarks.measure import Claim, Report, Timed, about, cores, header, in_a_process, table

LEAST = 0.1

SHARE = 1.7
"""What two cores are to be worth."""

RIGHT = {"float64": 1e-12, "float32": 1e-5}
"""Metres and entries of rotations by which the answers may miss."""


def functions(robot: nj.Robot, q: jax.Array, pose: jax.Array) -> dict[str, Callable[[], Any]]:
    """What is timed."""
    return {
        "forward kinematics": lambda: nj.forward_kinematics(robot, q),
        "space Jacobian": lambda: nj.space_jacobian(robot, q),
        "Newton-Raphson": lambda: nj.newton_raphson(robot, pose, q + 0.02).q,
        "complete inverse kinematics": lambda: nj.inverse_kinematics(robot, pose),
    }


def inputs(
    poses: int, dtype: str, robot: nj.Robot | None = None
) -> tuple[nj.Robot, np.ndarray, np.ndarray]:
    """A robot (the Niryo One), joint vectors, and their poses."""
    robot = robot or nj.robots.niryo_one()
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (poses, 6))
    pose = np.concatenate(
        [
            reference.forward_kinematics(robot, part)
            for part in np.array_split(q, 1 + poses // 65536)
        ]
    )
    return robot, q.astype(dtype), pose.astype(dtype)


def right(robot: nj.Robot, name: str, answer: Any, q: np.ndarray, pose: np.ndarray) -> bool:
    """Whether an answer is, on the first poses."""
    few = slice(0, 4096)
    tolerance = RIGHT[str(q.dtype)]
    if name == "forward kinematics":
        return float(np.max(np.abs(np.asarray(answer[few]) - pose[few]))) < tolerance
    if name == "space Jacobian":
        truth = reference.space_jacobian(robot, q[few].astype(float))
        return float(np.max(np.abs(np.asarray(answer[few]) - truth))) < tolerance
    if name == "Newton-Raphson":
        reached = reference.forward_kinematics(robot, np.asarray(answer[few], float))
        near = np.abs(reached - pose[few]).max(axis=(1, 2)) < max(tolerance, 1e-9)
        return bool(np.mean(near) > 0.999)
    solved = np.asarray(answer.found[few])
    reached = reference.forward_kinematics(robot, np.asarray(answer.q[few], float)[solved])
    wanted = np.broadcast_to(pose[few, None], (*solved.shape, 4, 4))[solved]
    return bool(np.max(np.abs(reached - wanted)) < tolerance and solved.any(axis=1).mean() > 0.999)


def probe(poses: int, rounds: int, devices: int) -> dict[str, Any]:
    """Seconds of each function in this process, on one device or spread over several."""
    robot, q, pose = inputs(poses, "float64")
    if devices > 1:
        mesh = jax.sharding.Mesh(np.array(jax.devices()), ("rows",))
        rows = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("rows"))
        given = jax.device_put(q, rows), jax.device_put(pose, rows)
    else:
        given = jax.device_put(q), jax.device_put(pose)
    out = {}
    for name, function in functions(robot, *given).items():
        timed = Timed(name, poses, function)
        for _ in range(rounds):
            timed.round(LEAST)
        out[name] = {"rounds": timed.rounds, "right": right(robot, name, timed.result, q, pose)}
    return out


def scaling(poses: int, rounds: int) -> Report:
    """One core, all cores, and as many devices, in processes that take turns."""
    all_cores = sorted(os.sched_getaffinity(0))
    facts = about(rounds=rounds, poses=poses)
    report = Report("Cores and devices", {"about": facts}, [header(facts)])
    ways = {
        "one core": ([all_cores[-1]], 1),
        "all cores": (all_cores, 1),
        "a device a core": (all_cores, len(all_cores)),
    }
    times: dict[str, dict[str, list[float]]] = {way: {} for way in ways}
    for turn in range(2):
        for way, (use, devices) in ways.items():
            print(f"  {way}, turn {turn + 1}", flush=True)
            os.sched_setaffinity(0, use)
            found = in_a_process(
                "benchmarks.devices",
                *("--probe", str(devices), "--poses", str(poses), "--rounds", str(rounds)),
            )
            os.sched_setaffinity(0, all_cores)
            if "error" in found:
                raise RuntimeError(f"{way}: {found['error']}")
            for name in (name for name in found if name != "process"):
                times[way].setdefault(name, []).extend(found[name]["rounds"])
                if not found[name]["right"]:
                    report.wrong.append(f"{name}, {way}")
    lines = []
    for name, alone in times["one core"].items():
        one = statistics.median(alone)
        cells = [name, f"{poses / one:,.0f}"]
        for way in ("all cores", "a device a core"):
            ratio = one / statistics.median(times[way][name])
            cells.append(f"{ratio:.2f}")
            if way == "all cores" and len(all_cores) == 2:
                text = f"{name}: two cores at least {SHARE} times one: {ratio:.2f}"
                report.claims.append(Claim(text, ratio >= SHARE))
        lines.append(cells)
    head = ["what", "poses/s on one core", f"{len(all_cores)} cores", f"{len(all_cores)} devices"]
    report.sections.append(table(head, lines))
    report.data["seconds"] = times
    return report


def main() -> int:
    """Measure, print, and fail where an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=65_536)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--probe", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", "cpu")
    if options.probe:
        if options.probe > 1:
            jax.config.update("jax_num_cpu_devices", options.probe)
        print(json.dumps(probe(options.poses, options.rounds, options.probe)))
        return 0
    if cores() < 2:
        print("only one core: nothing to compare")
        return 0
    return scaling(options.poses, options.rounds).finish("devices" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
