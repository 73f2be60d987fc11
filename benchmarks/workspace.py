"""Capability maps: exact, fast, the same bits on any number of devices and after any kill.

    python -m benchmarks.workspace [--only map arms scale kills machines faults peers]
                                   [--voxel 0.025] [--orientations 200] [--kills 20]
                                   [--most 100000000] [--save]

On all cores of the machine. The exit code is 1 where a number of the map is not that of inverse
kinematics pose by pose, a pose that the arm can take is called unreachable, two ways of computing
the map differ by a bit, or a fault loses what was done.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import reference, workspace_peers
from benchmarks.measure import Claim, Report, about, header, in_a_process, table
from niryo_jax import collision as co
from niryo_jax import workspace as ws
from niryo_jax.workspace.orientations import rotations_of

PARTS = ("map", "arms", "scale", "kills", "machines", "faults", "peers")
CELLS = 10_000
AT_ONCE = 40
ARMS = (("niryo_one", 0.025), ("abb_irb120", 0.025), ("ur16e", 0.025), ("kuka_iiwa14", 0.1))
"""Arms of each kind of solver, and the voxels of their maps, metres."""

SAMPLES = 100_000
COARSE = ("--voxel", "0.04", "--orientations", "64", "--full")
"""A map of several chunks that takes a few seconds."""


def contents(store: Path) -> dict[str, bytes]:
    """Every file of a store but locks and what a killed process was writing."""
    return {
        str(path.relative_to(store)): path.read_bytes()
        for path in store.rglob("*")
        if path.is_file() and not path.name.startswith(".") and ".partial" not in path.name
    }


def run(store: Path, *arguments: str, **env: str) -> dict[str, Any]:
    """A map in a process of its own, and what it cost."""
    cost = in_a_process("benchmarks.workspace_run", str(store), *arguments, **env)
    if "error" in cost:
        raise RuntimeError(cost["error"])
    return cost


def start(store: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """A process that makes a map."""
    return subprocess.Popen(
        [sys.executable, "-m", "benchmarks.workspace_run", str(store), *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=Path(__file__).parents[1],
    )


def slow_path(
    robot: nj.Robot,
    pose: np.ndarray,
    dexterous: float,
    collisions: co.CollisionCheck | None = None,
) -> dict[str, np.ndarray]:
    """The variables of a map for poses (..., M, 4, 4), M to a voxel: public functions and numpy."""
    solutions = nj.inverse_kinematics(robot, pose)
    q, within = np.asarray(solutions.q), np.asarray(solutions.within_limits)
    some = np.any(within, axis=-1)
    if collisions is not None:
        within = within & np.asarray(collisions.free(robot, solutions).clear)
    count, unlimited = within.sum(-1), np.asarray(solutions.count)
    reached = count > 0
    body = np.asarray(nj.body_jacobian(robot, q))[within]
    values = np.linalg.svd(body, compute_uv=False)
    posture = q[within]
    measures = {
        "manipulability": values.prod(-1),
        "limit_margin": np.minimum(posture - robot.lower, robot.upper - posture).min(-1),
        "singular_value": values[:, -1],
        "position_noise": np.sqrt((body[:, 3:] ** 2).sum((-1, -2))),
    }
    out: dict[str, np.ndarray] = {
        "reachability_index": reached.mean(-1),
        "reachability_index_unlimited": (unlimited > 0).mean(-1),
        "undecided_fraction": (~np.asarray(solutions.complete)).mean(-1),
        "solutions_mean": count.mean(-1),
        "solutions_mean_unlimited": unlimited.mean(-1),
        "solutions_most": count.max(-1),
        "pose_solutions": count,
        "pose_solutions_unlimited": unlimited,
    }
    for name, value in measures.items():
        best_of = np.fmin if name == "position_noise" else np.fmax
        table_of_slots = np.full(within.shape, np.nan)
        table_of_slots[within] = value
        best = best_of.reduce(table_of_slots, axis=-1)
        out[f"pose_{name}"] = best
        out[f"{name}_best"] = best_of.reduce(best, axis=-1)
        number = reached.sum(-1)
        mean = np.nansum(best, axis=-1) / np.maximum(number, 1)
        out[f"{name}_mean"] = np.where(number > 0, mean, np.nan)
    if collisions is not None:
        out["colliding_fraction"] = (some & ~reached).mean(-1)
    clear = np.nan_to_num(out["pose_singular_value"], nan=-1.0) >= dexterous
    out["dexterous_fraction"] = clear.mean(-1)
    return out


def poses_at(found: Any, centres: np.ndarray) -> np.ndarray:
    """(..., M, 4, 4) the orientations of a map at centres (..., 3)."""
    rotations = rotations_of(found.orientation_quaternion.values)
    pose = np.zeros((*centres.shape[:-1], len(rotations), 4, 4))
    pose[..., :3, :3], pose[..., 3, 3] = rotations, 1.0
    pose[..., :3, 3] = centres[..., None, :]
    return pose


def check_map(report: Report, robot: nj.Robot, store: Path) -> None:
    """Random voxels against the slow path; forward-sampled poses, looked up exactly."""
    found = ws.open_map(store)
    rng = np.random.default_rng(7)
    shape = found.reachability_index.shape
    cells = rng.choice(int(np.prod(shape)), min(CELLS, int(np.prod(shape))), replace=False)
    axes = [found[axis].values for axis in "xyz"]
    worst, numbers, differing = 0.0, 0, 0
    # Whole batches of one size, so that the functions are compiled once.
    for some in np.resize(cells, (-(-len(cells) // AT_ONCE), AT_ONCE)):
        place = np.unravel_index(some, shape)
        centres = np.stack([axis[index] for axis, index in zip(axes, place)], axis=-1)
        for name, truth in slow_path(
            robot, poses_at(found, centres), found.attrs["dexterous"]
        ).items():
            if name in found:
                have = found[name].values[place]
                same = np.isclose(have, truth, rtol=3e-7, atol=1e-9, equal_nan=True)
                numbers, differing = numbers + same.size, differing + int(np.sum(~same))
                worst = max(worst, float(np.nanmax(np.abs(have - truth), initial=0.0)))
    if differing:
        report.wrong.append(f"{differing} numbers of {len(cells)} voxels are not the slow path's")
    q = rng.uniform(robot.lower, robot.upper, (SAMPLES, 6))
    sampled = reference.forward_kinematics(robot, q)
    lost = int(np.sum(np.asarray(ws.pose_measures(robot, sampled).solutions) == 0))
    if lost:
        report.wrong.append(f"{lost} of {SAMPLES} poses that the arm takes are called unreachable")
    low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))
    half, position = found.attrs["voxel"] / 2, sampled[:, :3, 3]
    outside = int(np.sum(np.any((position < low - half) | (position > high + half), axis=1)))
    if outside:
        report.wrong.append(f"{outside} of {SAMPLES} positions lie outside of the map's box")
    report.sections.append(
        f"- {len(cells):,} random voxels by the slow path: {differing} of {numbers:,} numbers "
        f"differ (largest difference {worst:.0e}, of float32 storage)\n"
        f"- {SAMPLES:,} poses from random joint vectors, looked up exactly: {lost} called "
        f"unreachable, {outside} outside of the box"
    )


def time_map(report: Report, store: Path, options: argparse.Namespace) -> None:
    """The main map, in a fresh process."""
    size = ("--voxel", str(options.voxel), "--orientations", str(options.orientations))
    cost = run(store, *size)
    rate = cost["computed"] / cost["computing"]
    report.data["map"] = cost
    report.claims.append(
        Claim(
            f"the Niryo One at {options.voxel:g} m with {options.orientations} orientations, "
            f"{cost['poses']:,} poses with compilation and storage: {cost['seconds']:.0f} s "
            f"(aim 120), {rate:,.0f} poses/s once compiled, peak {cost['peak_mib']:,.0f} MiB",
            cost["seconds"] < 120,
        )
    )


def time_arms(report: Report, work: Path, orientations: int) -> None:
    """Maps of arms of each kind."""
    rows = list[list[str]]()
    for name, voxel in ARMS:
        store = work / "arm.zarr"
        size = ("--voxel", str(voxel), "--orientations", str(orientations))
        cost = run(store, "--robot", name, *size)
        found = ws.open_map(store)
        share = float(found.reachability_index.mean())
        undecided = float(found.undecided_fraction.mean())
        shutil.rmtree(store)
        row = [name, f"{voxel:g}", f"{cost['poses']:,}", f"{cost['seconds']:.0f}"]
        rate = cost["computed"] / cost["computing"]
        rows.append([*row, f"{rate:,.0f}", f"{share:.1%}", f"{undecided:.2%}"])
        report.data.setdefault("arms", {})[name] = cost
        print(rows[-1], flush=True)
    head = ["arm", "voxel (m)", "poses", "whole process (s)", "poses/s", "reached", "undecided"]
    report.sections.append("## Arms of each kind\n\n" + table(head, rows))


def time_sizes(report: Report, work: Path, most: float) -> None:
    """Cost per pose and peak memory over sizes."""
    rows, rates = list[list[str]](), list[float]()
    for voxel, count in ((0.1, 14), (0.1, 140), (0.05, 170), (0.025, 217), (0.0125, 271)):
        store = work / "size.zarr"
        cost = run(store, "--voxel", str(voxel), "--orientations", str(count))
        shutil.rmtree(store)
        each = cost["computing"] / max(1, cost["computed"])
        if cost["computed"] > 0:
            rates.append(each)
        rows.append(
            [
                f"{cost['poses']:,}",
                f"{voxel:g}",
                str(count),
                f"{each * 1e6:.2f}" if cost["computed"] else "one tile",
                f"{cost['seconds']:.1f}",
                f"{cost['peak_mib']:,.0f}",
            ]
        )
        print(rows[-1], flush=True)
        if cost["poses"] * 8 > most:
            break
    head = ["poses", "voxel (m)", "orientations", "us/pose", "whole process (s)", "peak (MiB)"]
    report.sections.append("## Over sizes\n\n" + table(head, rows))
    large = rates[-3:]
    spread = max(large) / min(large) - 1
    report.claims.append(
        Claim(
            f"cost per pose from {rows[-len(large)][0]} to {rows[-1][0]} poses: spread "
            f"{spread:.0%} (aim 10 % beyond noise)",
            spread < 0.1,
        )
    )


def kill_often(report: Report, work: Path, times: int) -> None:
    """Kill -9 at random times; the map that comes out has the bytes of one that ran through."""
    whole, store = work / "whole.zarr", work / "killed.zarr"
    if not whole.exists():
        run(whole, *COARSE)
    # What a run takes when its program is in the cache.
    seconds = run(store, *COARSE)["process"]
    shutil.rmtree(store)
    draw, killed, finished = random.Random(1), 0, 0
    done: list[int] = []
    while killed < times:
        process = start(store, *COARSE)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=draw.uniform(0.0, seconds))
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            process.wait()
            killed += 1
            chunks = store / "chunk_checksum" / "c"
            done.append(len(list(chunks.iterdir())) if chunks.is_dir() else 0)
        elif process.returncode == 0:
            finished += 1
            _same(report, whole, store, f"the run after {killed} kills")
            shutil.rmtree(store)
    run(store, *COARSE)
    _same(report, whole, store, "the last run")
    report.sections.append(
        f"- {times} kills -9 at random times of runs of {seconds:.0f} s; chunks done after each: "
        f"{', '.join(map(str, done))}; the bytes of all {finished + 1} finished maps equal those "
        "of one that ran through"
    )


def on_machines(report: Report, work: Path) -> None:
    """8 forced devices, and 2 processes under jax.distributed, of which one is lost."""
    whole = work / "whole.zarr"
    if not whole.exists():
        run(whole, *COARSE)
    run(work / "devices.zarr", *COARSE, "--devices", "8")
    _same(report, whole, work / "devices.zarr", "8 devices")

    def pair(store: Path) -> list[subprocess.Popen[bytes]]:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            address = f"127.0.0.1:{listener.getsockname()[1]}"
        return [start(store, *COARSE, "--address", address, "--index", str(i)) for i in (0, 1)]

    for process in pair(work / "two.zarr"):
        process.wait(timeout=300)
    _same(report, whole, work / "two.zarr", "2 processes")
    store = work / "lost.zarr"
    first, second = pair(store)
    chunks = store / "chunk_checksum" / "c"
    while second.poll() is None and not (chunks.is_dir() and len(list(chunks.iterdir())) > 1):
        time.sleep(0.01)
    second.send_signal(signal.SIGKILL)
    first.wait(timeout=300)
    left = len(list(chunks.iterdir()))
    for process in pair(store):
        process.wait(timeout=300)
    _same(report, whole, store, "2 processes of which one was killed and both started again")
    report.sections.append(
        "- 8 forced devices; 2 processes with jax.distributed on loopback; one of the 2 killed "
        f"({left} chunks were done) and both started again: the bytes of one process and one device"
    )


@contextlib.contextmanager
def small_disk(where: Path, size: str) -> Iterator[bool]:
    """A file system of so many bytes, where this process may mount one."""
    where.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(where)]
    mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(where)], check=True)


def with_faults(report: Report, work: Path) -> None:
    """A full disk, a read-only one, a damaged chunk, a second process: what is said and kept."""
    whole = work / "whole.zarr"
    if not whole.exists():
        run(whole, *COARSE)
    said = dict[str, str]()

    def refused(what: str, store: Path, *more: str) -> None:
        done = in_a_process("benchmarks.workspace_run", str(store), *COARSE, *more)
        said[what] = done.get("error", "")
        if "StoreError" not in said[what]:
            report.wrong.append(f"{what}: expected a StoreError, got {said[what] or 'none'}")

    disk = work / "disk"
    with small_disk(disk, "3m") as mounted:
        if mounted:
            refused("a full disk", disk / "map.zarr")
            kept = contents(disk / "map.zarr")
            subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
            subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
            refused("a read-only disk", disk / "map.zarr")
            if contents(disk / "map.zarr") != kept:
                report.wrong.append("a read-only disk: its files changed")
            subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
            run(disk / "map.zarr", *COARSE)
            _same(report, whole, disk / "map.zarr", "resumed with room on the disk")
        else:
            report.sections.append("- no small disk: this process may not mount one")
    damaged = Path(shutil.copytree(whole, work / "damaged.zarr"))
    (damaged / "pose_solutions" / "c" / "0" / "0" / "0" / "0").write_bytes(b"damaged")
    try:
        ws.open_map(damaged)
        report.wrong.append("a damaged chunk was not found")
    except ws.StoreError as error:
        said["a damaged chunk"] = str(error)
    run(damaged, *COARSE)
    _same(report, whole, damaged, "resumed with a damaged chunk")
    busy = work / "busy.zarr"
    process = start(busy, *COARSE)
    while process.poll() is None and not (busy / "chunk_checksum" / ".lock-0").exists():
        time.sleep(0.01)
    refused("a second process", busy)
    process.wait(timeout=300)
    _same(report, whole, busy, "a map while a second process tried")
    refused("other parameters", whole, "--orientations", "65")
    lines = [f"- {what}: {text.replace(str(work), '')}" for what, text in said.items()]
    report.sections.append("## What is said of faults\n\n" + "\n".join(lines))


def _same(report: Report, whole: Path, store: Path, what: str) -> None:
    ours, theirs = contents(store), contents(whole)
    if ours != theirs:
        differing = {name for name in ours | theirs if ours.get(name) != theirs.get(name)}
        report.wrong.append(f"{what}: {len(differing)} files differ, {sorted(differing)[:3]}")


def main() -> int:
    """Measure, check and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=PARTS, default=PARTS)
    parser.add_argument("--voxel", type=float, default=0.025)
    parser.add_argument("--orientations", type=int, default=200)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--most", type=float, default=1e8, help="poses of the largest size")
    parser.add_argument("--poses", type=int, default=4000, help="that the peers are given")
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()
    facts = about("xarray", "zarr", cores_used=os.cpu_count())
    report = Report("Workspace maps", {**facts}, [header(facts)])
    with tempfile.TemporaryDirectory() as directory:
        work = Path(directory)
        # The first process of all is timed with an empty cache of compiled programs.
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(work / "cache"))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")
        if "map" in options.only:
            time_map(report, work / "main.zarr", options)
            check_map(report, robot, work / "main.zarr")
        if "arms" in options.only:
            time_arms(report, work, options.orientations)
        if "scale" in options.only:
            time_sizes(report, work, options.most)
        if "kills" in options.only:
            kill_often(report, work, options.kills)
        if "machines" in options.only:
            on_machines(report, work)
        if "faults" in options.only:
            with_faults(report, work)
        if "peers" in options.only:
            rows, absent = workspace_peers.compare(options.poses)
            report.sections.append("## Beside other ways\n\n" + workspace_peers.page(rows))
            report.sections += [f"- {name}: {why}" for name, why in absent.items()]
    return report.finish("workspace" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
