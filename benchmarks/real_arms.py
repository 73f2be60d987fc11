"""What is found of real arms: recall, proofs and speed of each, near singularities too, and beside
other libraries.

    python -m benchmarks.real_arms [--only irb120_ik ...] [--skip ssik ...] [--quick] [--save]

The arms are those of `benchmarks/data/real_arms.json`. Poses are made by forward kinematics in
numpy from joint vectors within the limits, at random and where the smallest singular value of the
Jacobian is 1e-3, 1e-6 and 1e-9, so each has a solution that is known; what Newton's method finds
from 400 guesses in numpy is compared with the answers, and other libraries solve the same poses in
the same run where they are installed. A pose that is called unreachable, an answer called
complete that lacks a solution that is known, and a joint vector that misses its pose make it fail.

The whole takes some 25 minutes on one core, `--quick` two. `--save` writes docs/arms.md.
"""

from __future__ import annotations

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import argparse
import contextlib
import dataclasses
import json
import time
from typing import Any

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import arms_page, arms_peers, reference, singular
from benchmarks.arms_peers import Peer
from benchmarks.honesty import REAL_ARMS, from_file
from benchmarks.measure import Report, Timed, about, alternate, header, in_a_process
from benchmarks.poses import distinct, misses, polished
from benchmarks.search import search
from niryo_jax.ik.dispatch import method_for

SIZES = 1e-3, 1e-6, 1e-9
"""Smallest singular values of the postures near singular ones."""

MISS = 1e-9
"""Metres and entries of a rotation by which a solution may miss, times 1 and the arm's reach."""

CLOSES = 1e-6
"""Metres and radians by which a solution of another library may."""

SAME = 1e-4
"""Radians within which joint vectors are one solution."""

PATIENCE = 10
"""Seconds after which another library is asked no further pose of a kind."""

ENDLESS = nj.Singularity.SHOULDER, nj.Singularity.WRIST, nj.Singularity.SELF_MOTION
"""Names of infinitely many solutions, of which one is returned."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        poses: at random, and near singular postures of each size, of arms of up to six joints.
        redundant: the same of arms of seven and eight.
        peers: the same for other libraries, the first of those.
        searched: poses of which the search looks for all solutions.
        starts: its guesses.
        speed: poses of the batch that is timed, of one arm of each kind; 0 times nothing.
        rounds: of timing.
    """

    poses: tuple[int, int] = (400, 100)
    redundant: tuple[int, int] = (64, 32)
    peers: tuple[int, int] = (64, 32)
    searched: int = 32
    starts: int = 400
    speed: int = 8_192
    rounds: int = 3


QUICK = Effort((32, 8), (8, 4), (8, 4), 4, 60, 0, 0)


def kind(robot: nj.Robot) -> tuple[str, str]:
    """The family of an arm, and what solves it, in few words."""
    if method_for(robot) == "sampled":
        by_angle = any(plan.by_arm_angle for plan in robot.plans)
        what = "arm angles" if by_angle else f"values of joint {robot.plans[0].locked + 1}"
        family = "spherical shoulder and wrist" if by_angle else "one joint locked: closed form"
        return family, f"closed form at 16 {what}"
    if robot.plans:
        family = robot.plans[0].family
        name = {
            "SphericalWrist": "spherical shoulder" if family.reverse else "spherical wrist",
            "ThreeParallel": "three parallel axes",
            "PlanarArm": "parallel axes on a base",
        }[type(family).__name__]
        return name, "closed form"
    if robot.offset_wrist is not None:
        return "offset wrist", "scan with proof"
    if robot.is_general:
        return "none (general)", "polynomial, isolation of roots"
    return "none", "Newton from 64 guesses"


def joint_vectors(robot: nj.Robot, counts: tuple[int, int], seed: int) -> dict[str, np.ndarray]:
    """Joint vectors within the limits: at random, and near singular ones of each size."""
    low, high = singular.limits(robot)
    regular = np.random.default_rng(seed).uniform(low, high, (counts[0], robot.joints))
    near = {f"{size:.0e}": singular.near(robot, size, counts[1], seed) for size in SIZES}
    return {"random": regular, **near}


def apart(robot: nj.Robot, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(..., n) -> (...,): the largest difference of a joint, whole turns aside where it turns."""
    turns = np.any(np.asarray(robot.screws)[:, :3], axis=1)
    off = np.abs(a - b)
    return np.where(turns, np.minimum(off % (2 * np.pi), -off % (2 * np.pi)), off).max(axis=-1)


def judged(robot: nj.Robot, effort: Effort, seed: int) -> dict[str, Any]:
    """What is found of an arm, and what is said of it; the poses are under "poses"."""
    counts = effort.poses if robot.joints <= 6 else effort.redundant
    parts = joint_vectors(robot, counts, seed)
    q = np.concatenate(list(parts.values()))
    pose = reference.forward_kinematics(robot, q)
    started = time.perf_counter()
    answer = jax.block_until_ready(nj.inverse_kinematics(robot, pose))
    first = time.perf_counter() - started
    found, complete = np.asarray(answer.found), np.asarray(answer.complete)
    made = np.any(found & (apart(robot, np.asarray(answer.q), q[:, None]) < SAME), axis=1)
    endless = np.any(found & np.isin(np.asarray(answer.singularity), ENDLESS), axis=1)
    inside = np.any(found & np.asarray(answer.within_limits), axis=1)
    reached = reference.forward_kinematics(robot, np.asarray(answer.q)[found])
    wanted = np.broadcast_to(pose[:, None], (*found.shape, 4, 4))[found]
    allowed = MISS * (1 + np.abs(wanted[:, :3, 3]).max(axis=1, initial=0))
    if robot.joints < 6:
        # Next to what such an arm can do the nearest pose is an answer, which says how near it is.
        allowed += np.asarray(answer.position_error + answer.rotation_error)[found]
    spurious = np.abs(reached - wanted).max(axis=(1, 2), initial=0) > allowed
    false = complete & ~made & ~endless & (robot.joints <= 6)
    result = {
        "joints": robot.joints,
        "solutions": float(found[: counts[0]].sum(axis=1).mean()),
        "most": int(found[: counts[0]].sum(axis=1).max()),
        "first call": first,
        "unreachable": int(np.sum(answer.status == nj.IKStatus.UNREACHABLE)),
        "spurious": int(spurious.sum()),
        "falsely complete": int(false.sum()),
        "sets": {},
        "beside": {},  # the same of the poses that other libraries are given
    }
    start = 0
    for name, part in parts.items():
        here = slice(start, start + len(part))
        start += len(part)
        result["sets"][name] = {
            "poses": len(part),
            "made-by": int(made[here].sum()),
            "endless": int(np.sum(endless[here] & ~made[here])),
            "complete": int(complete[here].sum()),
            "found": int(found[here].any(axis=1).sum()),
            "in limits": int(inside[here].sum()),
        }
        few = min(len(part), effort.peers[name != "random"])
        beside = slice(here.start, here.start + few)
        result["beside"][name] = {
            "poses": few,
            "made-by": int(made[beside].sum()),
            "found": int((inside if robot.joints > 6 else found.any(axis=1))[beside].sum()),
        }
    if robot.joints <= 6:
        few = min(effort.searched, counts[0])
        known = search(robot, pose[:few], effort.starts, seed)
        mine = [np.asarray(answer.q)[i][found[i]] for i in range(few)]
        shared = [_hits(robot, a, b) for a, b in zip(known, mine)]
        lacking = [len(a) > hits for a, hits in zip(known, shared)]
        result["searched"] = {
            "poses": few,
            "known": sum(map(len, known)),
            "found": sum(shared),
            "ours": sum(map(len, mine)),
        }
        result["guesses know more"] = int(np.sum(complete[:few] & lacking))
        result["sets of solutions"] = {"niryo_jax": mine, "search": known}
    return {**result, "parts": parts}


FALSE = "unreachable", "spurious", "falsely complete", "guesses know more"


def _hits(robot: nj.Robot, wanted: np.ndarray, have: np.ndarray) -> int:
    """How many of the joint vectors (k, n) are among others (m, n)."""
    near = apart(robot, wanted[:, None], have[None]) if len(have) else np.zeros((len(wanted), 0))
    return int(np.any(near < SAME, axis=1).sum())


def of_a_peer(robot: nj.Robot, solver: Peer, parts: dict[str, np.ndarray]) -> dict[str, Any]:
    """What another library finds of the same poses; its solutions of those at random."""
    counts: dict[str, Any] = {"spurious": 0, "claimed": 0, "raised": 0, "sets": {}}
    solutions = list[np.ndarray]()
    for name, q in parts.items():
        pose = reference.forward_kinematics(robot, q)
        made = answered = asked = 0
        started = time.perf_counter()
        for target, wanted in zip(pose, q):
            if time.perf_counter() - started > PATIENCE:
                break
            asked += 1
            claimed = doubted = np.zeros((0, robot.joints))
            try:
                answer = solver.one(solver.given(target))
                claimed = solver.answers(answer)
                doubted = doubted if solver.doubted is None else solver.doubted(answer)
            except Exception:  # of a library that answers a pose with an error
                counts["raised"] += 1
            both = np.concatenate([claimed, doubted])
            targets = np.broadcast_to(target, (len(both), 4, 4))
            position, rotation = misses(robot, both, targets)
            good = (position < CLOSES) & (rotation < CLOSES)
            counts["claimed"] += len(claimed)
            counts["spurious"] += int(np.sum(~good[: len(claimed)]))
            right = both[good]
            made += _hits(robot, wanted[None], right)
            answered += len(right) > 0
            if name == "random" and robot.joints <= 6:
                solutions.append(polished(robot, right, targets[good]))
        counts["sets"][name] = {"poses": asked, "made-by": made, "found": answered}
    counts["solutions"] = solutions
    return counts


def compared(
    robot: nj.Robot, effort: Effort, mine: dict[str, Any], skip: tuple[str, ...]
) -> tuple[dict[str, Any], list[Peer]]:
    """The libraries that solve the arm: name -> what they find; why the others do not."""
    solvers, absent = arms_peers.solvers(robot, skip)
    parts = {name: q[: effort.peers[name != "random"]] for name, q in mine["parts"].items()}
    peers = {solver.name: of_a_peer(robot, solver, parts) for solver in solvers}
    sets = {
        **mine.get("sets of solutions", {}),
        **{name: peer.pop("solutions") for name, peer in peers.items()},
    }
    if robot.joints <= 6:
        few = min(map(len, sets.values()))
        union = [distinct(np.concatenate([s[i] for s in sets.values()])) for i in range(few)]
        recall = {
            name: sum(_hits(robot, u, have) for u, have in zip(union, s)) / sum(map(len, union))
            for name, s in sets.items()
        }
        mine["recall of all"] = recall["niryo_jax"]
        for name, peer in peers.items():
            peer["recall"] = recall[name]
    for solver in solvers:
        peers[solver.name]["preparation"] = solver.preparation
    return {"peers": peers, "absent": absent}, solvers


def timed(
    robot: nj.Robot, effort: Effort, parts: dict[str, np.ndarray], peers: list[Peer], ours: bool
) -> dict[str, Any]:
    """Seconds a pose of the other libraries, and ours of a large batch."""
    pose = reference.forward_kinematics(robot, parts["random"][: effort.peers[0]])
    subjects = dict[str, Timed]()
    for solver in peers:
        each = Timed("", 1, _all_of_it(solver, pose[:1])).first
        few = pose[: max(1, int(PATIENCE / effort.rounds / each))]
        subjects[solver.name] = Timed("", len(few), _all_of_it(solver, few))
    if ours:
        if method_for(robot) == "complete":
            low, high = singular.limits(robot)
            q = np.random.default_rng(0).uniform(low, high, (effort.speed, robot.joints))
        else:
            q = np.concatenate(list(parts.values()))
        batch = jax.device_put(reference.forward_kinematics(robot, q))
        subjects["batch"] = Timed("", len(q), lambda: nj.inverse_kinematics(robot, batch))
    alternate(list(subjects.values()), effort.rounds)
    return {name: one.seconds / one.size for name, one in subjects.items()}


def _all_of_it(solver: Peer, pose: np.ndarray) -> Any:
    given = [solver.given(x) for x in pose]
    if solver.many is not None:
        many = solver.many
        return lambda: len(many(given))

    def run() -> None:
        for x in given:
            with contextlib.suppress(Exception):
                solver.one(x)

    return run


def first_answer(name: str) -> dict[str, Any]:
    """One pose in this process: its CPU seconds so far, the miss, and seconds of a later call."""
    robot = arms()[name]
    q = np.mean(singular.limits(robot), axis=0, keepdims=True) + 0.1
    pose = reference.forward_kinematics(robot, q)
    answer = jax.block_until_ready(nj.inverse_kinematics(robot, pose[0]))
    seconds = time.process_time()
    position, rotation = misses(robot, np.asarray(answer.q)[:1], pose)
    again = Timed("", 1, lambda: nj.inverse_kinematics(robot, pose[0]))
    alternate([again], 20)
    miss = float(position[0] + rotation[0])
    return {"seconds": seconds, "miss": miss, "alone": again.seconds}


def arms() -> dict[str, nj.Robot]:
    """Those of the file, by name: alike ones beside each other, those of six joints first."""
    robots = [case.robot for case in from_file(REAL_ARMS)]
    order = sorted(robots, key=lambda robot: ((robot.joints - 6) % 6, kind(robot)))
    return {str(robot.name): robot for robot in order}


def measure(todo: dict[str, nj.Robot], effort: Effort, skip: tuple[str, ...]) -> Report:
    """All arms, beside all libraries; first answers of one arm of each kind."""
    packages = [package for package, _ in arms_peers.PEERS.values()]
    facts = about(*packages, arms=len(todo))
    data: dict[str, Any] = {"about": facts, "effort": vars(effort), "arms": {}}
    report = Report("Real arms", data, [header(facts)])
    described = json.loads(REAL_ARMS.read_text())
    data["sources"] = described["sources"]
    seen = set[tuple[int, tuple[str, str]]]()
    for name, robot in todo.items():
        started = time.perf_counter()
        first_of_kind = (robot.joints, kind(robot)) not in seen
        if first_of_kind:
            seen.add((robot.joints, kind(robot)))
            jax.clear_caches()  # alike arms share programs, others only memory
        mine = judged(robot, effort, sum(map(ord, name)))
        report.wrong += [f"{name}: {mine[what]} {what}" for what in FALSE if mine.get(what)]
        # What takes half a minute for each arm is done for one arm of each kind, as timing is.
        slow = () if first_of_kind else ("roboticstoolbox",)
        others, solvers = compared(robot, effort, mine, (*skip, *slow))
        parts = mine.pop("parts")
        mine.pop("sets of solutions", None)
        row = {
            "source": described["arms"][name]["source"],
            "kind": kind(robot),
            **mine,
            **others,
        }
        if effort.speed:
            row["seconds a pose"] = timed(robot, effort, parts, solvers, first_of_kind)
        if effort.speed and first_of_kind:
            run = in_a_process("benchmarks.real_arms", "--answer", name, JAX_ENABLE_X64="1")
            if run.get("miss", np.inf) < CLOSES:
                row["first answer"] = run["seconds"]
                row["seconds a pose"]["alone"] = run["alone"]
            else:
                report.wrong.append(f"{name}: first answer: {run}")
        row["seconds"] = time.perf_counter() - started
        data["arms"][name] = row
        print(f"  {name}: {arms_page.in_short(row)}", flush=True)
    report.sections += arms_page.sections(data)
    return report


def main() -> int:
    """Judge, time, print, and fail where something false is said."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", help="these arms alone")
    parser.add_argument("--skip", nargs="*", default=[], help="these libraries, or all: peers")
    parser.add_argument("--quick", action="store_true", help="few arms, few poses, nothing timed")
    parser.add_argument("--save", action="store_true", help="write the results and docs/arms.md")
    parser.add_argument("--answer", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.answer:
        print(json.dumps(first_answer(options.answer)))
        return 0
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", None)
    return table_of(options.only, tuple(options.skip), options.quick, options.save)


def table_of(only: list[str] | None, skip: tuple[str, ...], quick: bool, save: bool) -> int:
    """The table, printed and saved; the exit code."""
    todo = arms()
    names = only or (QUICK_ARMS if quick else list(todo))
    skip = tuple(arms_peers.PEERS) if "peers" in skip else skip
    report = measure({name: todo[name] for name in names}, QUICK if quick else Effort(), skip)
    code = report.finish(arms_page.STEM if save else None)
    if save:
        arms_page.collect()
    return code


QUICK_ARMS = ["irb120_ik", "ur5e_ik", "so100"]


if __name__ == "__main__":
    raise SystemExit(main())
