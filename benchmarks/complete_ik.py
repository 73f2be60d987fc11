"""All solutions of inverse kinematics beside the other libraries that return them.

    python -m benchmarks.complete_ik [--seed 0] [--rounds 5] [--skip ssik ...] [--save]

On the Niryo One and on the same arm with a spherical wrist, every library that is installed solves
the same random poses (joint vectors uniform within the limits) in the same run, on one core. The
rounds of the libraries alternate, so that a slow moment of the machine hits all of them; compare
ratios, not rates. Recall is the share of the union of all verified solutions that a library finds;
a solution is verified where a product of exponentials in plain numpy takes it to the pose.

The exit code is 1 when an answer of niryo_jax in float64 is wrong: a solution it claims misses by
more than 1e-12, or the joint vector that made a pose is not among its answers. Speed never fails
the run. `--save` writes a dated JSON and a Markdown table to `benchmarks/results/`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import poses as judge
from benchmarks.measure import Claim, Report, about, header, in_a_process
from benchmarks.peers import LIBRARIES, Row, Subject, UnsuitedError, theirs
from benchmarks.poses import ARMS, Answers, Arm

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "niryo_jax" / "benchmarks"

GATE = 1e-12
"""Metres and radians by which an answer of ours in float64 may miss: rounding of a chain of six
motions with lengths below a metre is 1e-15, and the rest allows for poses near singularities."""


def ours(arm: Arm, pose: np.ndarray, dtype: str) -> Subject:
    """niryo_jax with its defaults on one batch of poses (N, 4, 4)."""
    given = pose.astype(dtype)

    def run() -> nj.IKSolutions:
        return jax.block_until_ready(nj.inverse_kinematics(arm.robot, given))

    def one(i: int) -> nj.IKSolutions:
        return jax.block_until_ready(nj.inverse_kinematics(arm.robot, given[i]))

    def answers(solutions: nj.IKSolutions) -> Answers:
        found = np.asarray(solutions.found)
        q = np.asarray(solutions.q)[found].astype(np.float64)
        return Answers(q, np.nonzero(found)[0], len(found))

    name = f"niryo_jax, {dtype}, batch {len(pose):,}"
    return Subject(name, run, one, answers, len(pose), single=dtype == "float32")


def measure(
    arm: Arm, options: argparse.Namespace
) -> tuple[list[Row], dict[str, str], np.ndarray, np.ndarray]:
    """The rows of one arm, the libraries that could not take part, and the poses with the joint
    vectors that made them."""
    made_by = judge.random_joints(arm.robot, max(options.batches), options.seed)
    pose = judge.poses_of(arm.robot, made_by)
    subjects: list[Subject] = []
    for dtype in ("float64", "float32"):
        for batch in options.batches:
            print(f"  {arm.name}: niryo_jax, {dtype}, batch {batch:,}: first call", flush=True)
            subjects.append(ours(arm, pose[:batch], dtype))
    absent: dict[str, str] = {}
    for name, library in LIBRARIES.items():
        if name in options.skip:
            absent[name] = "skipped"
            continue
        print(f"  {arm.name}: {name}", flush=True)
        try:
            solvers = library.solvers(arm, options.cache)
        except UnsuitedError as error:
            absent[name] = str(error)
            continue
        peer_poses = pose[: min(options.batches)]
        subjects += [theirs(solver, peer_poses, options.peer_poses) for solver in solvers]
    for _ in range(options.rounds):
        for subject in subjects:
            subject.round()
    return [subject.row() for subject in subjects], absent, pose, made_by


def judged(
    arm: Arm, rows: list[Row], pose: np.ndarray, made_by: np.ndarray, poses: int
) -> tuple[dict[str, dict[str, float]], list[int]]:
    """Name -> how right its answers are; and how many solutions each compared pose has."""
    how_right, sets = {}, {"made by": Answers(made_by[:poses], np.arange(poses), poses)}
    for row in rows:
        how_right[row.name] = judge.accuracy(arm, row.answers, pose, made_by, row.single)
        sets[row.name] = judge.verified(arm, row.answers.first(poses), pose, row.single)
    union, tally = judge.union_and_recall(sets, poses)
    for name, accuracy in how_right.items():
        accuracy.update(tally[name])
    return how_right, [len(q) for q in union]


def gate(arm: Arm, rows: list[Row], accuracy: dict[str, dict[str, float]]) -> list[str]:
    """What is wrong with our answers in float64."""
    wrong = []
    for row in rows:
        if not row.name.startswith("niryo_jax, float64"):
            continue
        a = accuracy[row.name]
        for kind, unit in (("position", "m"), ("rotation", "rad")):
            if not a[f"{kind}_max"] <= GATE:  # not a number is wrong, too
                wrong.append(f"{arm.name}: {row.name}: misses by {a[f'{kind}_max']:.1e} {unit}")
        if a["made_by_lost"]:
            wrong.append(
                f"{arm.name}: {row.name}: the joint vector that made the pose is not among the "
                f"answers of {a['made_by_lost']:,} of {row.poses:,} poses"
            )
    return wrong


def ratio(rows: list[Row], others: tuple[str, ...]) -> tuple[float, str] | None:
    """Our best rate in float64 on a batch of at least 10,000 over the best one of a library, with
    the range of the rounds, in words."""
    mine = [r for r in rows if r.name.startswith("niryo_jax, float64") and r.poses >= 10_000]
    peers = [r for r in rows if r.name.startswith(others)]
    if not mine or not peers:
        return None
    a, b = max(mine, key=lambda r: r.rate), max(peers, key=lambda r: r.rate)
    each = [(y / b.poses) / (x / a.poses) for x, y in zip(a.rounds, b.rounds)]
    text = (
        f"{a.rate / b.rate:,.2f} x (rounds {min(each):,.2f} to {max(each):,.2f}; {a.name}: "
        f"{a.rate:,.0f} poses/s, {b.name}: {b.rate:,.0f})"
    )
    return a.rate / b.rate, text


def speed_claims(rows: dict[str, list[Row]]) -> list[Claim]:
    """Ours beside ssik on the Niryo One and beside eaik's batched call on the spherical variant."""
    claims = []
    python = ("ssik, Manipulator", "ssik, artefact, Python")
    for label, arm, others, what, times in (
        ("a", "niryo_one", python, "ssik as it documents (Python)", 1000),
        ("a", "niryo_one", ("ssik, artefact, native",), "ssik with its native code", 1000),
        ("b", "spherical", ("eaik, batched",), "eaik's batched call", 5),
    ):
        text = f"({label}) {arm}: ours >= {times:,} x {what}, all solutions, float64, one core"
        found = ratio(rows.get(arm, []), others)
        if found is None:
            claims.append(Claim(text, None))
        else:
            claims.append(Claim(f"{text}: {found[1]}", found[0] >= times))
    return claims


def probe_first_call(arm: Arm, batch: int, seed: int) -> dict[str, Any]:
    """Seconds of the first and of the second call in this process."""
    pose = judge.poses_of(arm.robot, judge.random_joints(arm.robot, batch, seed))
    times = []
    for _ in range(2):
        started = time.perf_counter()
        jax.block_until_ready(nj.inverse_kinematics(arm.robot, pose))
        times.append(time.perf_counter() - started)
    return {"first": times[0], "second": times[1]}


def probe_memory(arm: Arm, count: int, seed: int) -> dict[str, Any]:
    """Peak memory of this process after one call, and whether smaller calls answer the same."""
    pose = judge.poses_of(arm.robot, judge.random_joints(arm.robot, count, seed))
    before = _peak_memory()
    started = time.perf_counter()
    whole = jax.block_until_ready(nj.inverse_kinematics(arm.robot, pose))
    seconds = time.perf_counter() - started
    peak, piece = _peak_memory(), max(1, count // 16)
    different, sets, farthest = 0, 0, 0.0
    for i in range(0, count, piece):
        part = nj.inverse_kinematics(arm.robot, pose[i : i + piece])
        here = slice(i, i + piece)
        same = {
            name: (np.asarray(getattr(whole, name))[here] == np.asarray(getattr(part, name)))
            .reshape(len(part.count), -1)
            .all(axis=1)
            for name in ("q", "found", "count", "status", "position_error", "rotation_error")
        }
        alike = same["found"] & same["count"] & same["status"]
        different += int((~np.all(list(same.values()), axis=0)).sum())
        sets += int((~alike).sum())
        farther = judge.apart(np.asarray(whole.q)[here][alike], np.asarray(part.q)[alike])
        farthest = max(farthest, float(farther.max(initial=0)))
    return {
        "before": before,
        "peak": peak,
        "seconds": seconds,
        "piece": piece,
        "different": different,
        "different sets": sets,
        "farthest": farthest,
    }


def _peak_memory() -> int:
    """Bytes of this process's largest resident set so far."""
    import resource  # there is none on Windows

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def in_a_subprocess(probe: str, arm: str, count: int, seed: int, **env: str) -> dict[str, Any]:
    """What a probe prints in a process of its own, on the same core."""
    arguments = ["--probe", probe, "--arms", arm, "--batches", str(count), "--seed", str(seed)]
    return in_a_process("benchmarks.complete_ik", *arguments, **env)


def first_calls(arm: str, batch: int, seed: int) -> tuple[dict[str, Any], list[Claim]]:
    """The first call in a fresh process, and in a second one with JAX's persistent cache.

    Once with JAX's default settings, which keep only what took a second to compile, and once
    with everything kept.
    """
    found: dict[str, Any] = {}
    for setting, env in (
        ("defaults", {}),
        ("everything kept", {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}),
    ):
        with tempfile.TemporaryDirectory() as folder:
            env = {**env, "JAX_COMPILATION_CACHE_DIR": folder}
            found[setting] = [
                in_a_subprocess("first-call", arm, batch, seed, **env) for _ in range(2)
            ]
    claims = []
    for text, which, limit in (
        (f"(c) {arm}: first call under 20 s at batch {batch:,}", 0, 20),
        (f"(c) {arm}: first call of a second process with the persistent cache under 3 s", 1, 3),
    ):
        run = found["defaults"][which]
        if "error" in run:
            claims.append(Claim(f"{text}: {run['error']}", False))
            continue
        other = found["everything kept"][which].get("first", float("nan"))
        detail = f"{run['first']:.2f} s ({other:.2f} s with everything kept in the cache)"
        claims.append(Claim(f"{text}: {detail}", run["first"] < limit))
    return found, claims


def memory(count: int, seed: int) -> tuple[dict[str, Any], list[Claim]]:
    """One call with `count` poses in a process of its own."""
    found = in_a_subprocess("memory", "niryo_one", count, seed)
    text = f"(d) niryo_one: {count:,} poses in one call"
    if "error" in found:
        return found, [Claim(f"{text}: {found['error']}", False)]
    peak, before = found["peak"] / 2**30, found["before"] / 2**30
    within = (
        f"{text} within 4 GiB: peak {peak:.2f} GiB ({before:.2f} GiB before the call), "
        f"{found['seconds']:.1f} s with compilation"
    )
    same = (
        f"{text}: every bit as in calls of {found['piece']:,}: {found['different']:,} poses "
        f"differ, {found['different sets']:,} of them in found, count or status; the others by at "
        f"most {found['farthest']:.1e} rad in a slot"
    )
    return found, [Claim(within, peak < 4), Claim(same, found["different"] == 0)]


def speed_table(rows: list[Row], absent: dict[str, str]) -> str:
    """A Markdown table of rates and times."""
    best = max(
        (r.rate for r in rows if r.name.startswith("niryo_jax, float64")), default=float("nan")
    )
    lines = [
        "| solver | poses/s | spread | ours / its | one pose (µs) | preparation (s) | load (s) "
        "| first call (s) | poses |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in rows:
        over = "" if r.name.startswith("niryo_jax") else f"{best / r.rate:,.2f}"
        load = "in preparation" if r.load is None else f"{r.load:.2f}"
        lines.append(
            f"| {r.name} | {r.rate:,.0f} | {r.spread:.0%} | {over} | {1e6 * r.latency:,.0f} "
            f"| {r.preparation:.1f} | {load} | {r.first:.3g} | {r.poses:,} |"
        )
    lines += [f"| {name} | {reason} |  |  |  |  |  |  |  |" for name, reason in absent.items()]
    return "\n".join(lines)


def accuracy_table(accuracy: dict[str, dict[str, float]]) -> str:
    """A Markdown table of recall and residuals."""
    lines = [
        "| solver | recall | complete poses | made by lost | spurious of claimed | repeated "
        "| position max, median (m) | rotation max, median (rad) |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, a in accuracy.items():
        cells = [
            name,
            f"{a['recall']:.3%}",
            f"{a['complete']:.2%}",
            f"{a['made_by_lost']:,} of {a['poses']:,}",
            f"{a['spurious']:,} of {a['claimed']:,}",
            f"{a['repeated']:,.0f}",
            f"{a['position_max']:.1e}, {a['position_median']:.1e}",
            f"{a['rotation_max']:.1e}, {a['rotation_median']:.1e}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def notes(rows: dict[str, list[Row]]) -> str:
    """What the others do better, measured and otherwise."""
    lines = []
    for arm, of_arm in rows.items():
        mine = min(r.latency for r in of_arm if r.name.startswith("niryo_jax"))
        quicker = [r.name for r in of_arm if r.latency < mine]
        if quicker:
            lines.append(f"- {arm}: answer a single pose sooner than ours: {'; '.join(quicker)}.")
    for name, library in LIBRARIES.items():
        lines.append(
            f"- {name} {library.version or '(not installed)'} ({library.licence}): {library.about}."
        )
    lines += [
        "- ssik's native code solves a general arm that its user builds only where a table lies "
        "beside the artefact; `ssik build` 8.2.0 writes none, so that its artefact runs in Python. "
        "The row with native code makes the table with ssik's own function.",
        "- Only niryo_jax compiles at its first call for each batch size; `first call` is one pose "
        "for the others. `preparation` is paid once for an arm and kept on disk, `load` in each "
        "process, with the import of the library at the first arm that it solves.",
        "- `made by` is the joint vector, within the limits, from which the pose was made.",
        "- `complete poses`, `recall` and `repeated` are of the poses compared, on which the union "
        "is formed; the rest is of all the poses of the row. Claims that the library itself marks "
        "as least-squares compromises are no claims here.",
        f"- Spurious: misses by more than {judge.CLOSES:.0e} m or rad, in float32 by more than "
        f"{judge.CLOSES_FLOAT32:.0e}. Answers are polished before they are matched with others.",
    ]
    return "\n".join(lines)


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS))
    parser.add_argument("--batches", nargs="+", type=int, default=[10_000, 65_536], metavar="N")
    parser.add_argument("--peer-poses", type=int, default=400, help="poses compared for recall")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    skips = [*LIBRARIES, "first-call", "memory"]
    parser.add_argument(
        "--skip", nargs="+", choices=skips, default=[], metavar="WHAT", help=", ".join(skips)
    )
    parser.add_argument(
        "--memory", type=int, default=1_000_000, metavar="N", help="poses in a call"
    )
    parser.add_argument("--cache", type=Path, default=CACHE, help="what takes long to prepare")
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    parser.add_argument("--probe", choices=["first-call", "memory"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.probe is None and options.peer_poses > min(options.batches):
        parser.error("--peer-poses: more than the smallest of --batches")
    return options


def main() -> int:
    """Measure, print, and fail where an answer of ours is wrong."""
    options = arguments()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    if options.probe:
        probe = {"first-call": probe_first_call, "memory": probe_memory}[options.probe]
        print(json.dumps(probe(ARMS[options.arms[0]](), options.batches[0], options.seed)))
        return 0
    packages = [library.package for library in LIBRARIES.values()]
    facts = about(
        *packages,
        seed=options.seed,
        rounds=options.rounds,
        **{"poses compared": options.peer_poses},
    )
    print(header(facts), flush=True)
    report = Report("All solutions of inverse kinematics", {"about": facts}, [header(facts)])
    data = report.data
    claims: list[Claim] = []
    if "first-call" not in options.skip:
        data["first call"] = {}
        for name in options.arms:
            print(f"  {name}: first call in a process of its own", flush=True)
            found, more = first_calls(name, min(options.batches), options.seed)
            data["first call"][name] = found
            claims += more
    if "memory" not in options.skip:
        print(f"  memory of {options.memory:,} poses", flush=True)
        data["memory"], more = memory(options.memory, options.seed)
        claims += more
    rows: dict[str, list[Row]] = {}
    for name in options.arms:
        arm = ARMS[name]()
        rows[name], absent, pose, made_by = measure(arm, options)
        print(f"  {name}: comparing the answers", flush=True)
        accuracy, counts = judged(arm, rows[name], pose, made_by, options.peer_poses)
        report.wrong += gate(arm, rows[name], accuracy)
        report.sections += [f"## {name}", speed_table(rows[name], absent), accuracy_table(accuracy)]
        shares = ", ".join(f"{n}: {counts.count(n)}" for n in sorted(set(counts)))
        report.sections.append(f"Solutions in the union, and on how many poses: {shares}.")
        data[name] = {
            "rows": [
                {**r._asdict(), "answers": len(r.answers.q), "rate": r.rate} for r in rows[name]
            ],
            "absent": absent,
            "accuracy": accuracy,
            "union counts": counts,
        }
    report.claims += speed_claims(rows) + claims
    report.sections += ["## Notes", notes(rows)]
    return report.finish("complete-ik" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
