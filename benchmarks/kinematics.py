"""Forward kinematics, Jacobians and numerical inverse kinematics beside other libraries.

    python -m benchmarks.kinematics [--poses 65536] [--rounds 7] [--skip frax ...] [--save]

Every library that is installed gets the same joint vectors of the Niryo One in the same run, on one
core; joint vectors come as (N, 6) and poses leave as (N, 4, 4), as each library gives them. The
exit code is 1 when an answer of niryo_jax is wrong; a peer's wrong answer is named in the table.
Speed never fails the run. Gains over a peer are stated against its best row.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import floors, reference
from benchmarks.kinematics_peers import Peer, elementary_transforms, peers
from benchmarks.measure import Claim, Report, Timed, about, alternate, header, table, version_of

RIGHT = {"float64": 1e-13, "float32": 2e-6}
"""How far an entry of ours may be from the reference: rounding of a chain of six motions."""

PEER_RIGHT = {"float64": 1e-6, "float32": 1e-4}
"""The same for others; a URDF read in single precision is no error of theirs."""

LOOP = 2_000
"""Poses for libraries that solve them one at a time; their rate does not depend on it."""

LEAST = 0.05
"""Seconds a round lasts at the least."""

PATIENCE = 0.3
"""Seconds of one run after which a peer gets no larger batch."""

NAMES = ("pin", "roboticstoolbox-python", "frax", "almond-pyroki", "pytorch-kinematics", "torch")


class Inputs:
    """Joint vectors of the Niryo One and what a reference in numpy makes of them."""

    def __init__(self, poses: int) -> None:
        self.robot = nj.robots.niryo_one()
        rng = np.random.default_rng(0)
        self.q = rng.uniform(self.robot.lower, self.robot.upper, (poses, 6))
        self.pose = reference.forward_kinematics(self.robot, self.q)
        self.jacobian = reference.space_jacobian(self.robot, self.q)


def ours(inputs: Inputs, size: int, dtype: str) -> dict[str, Timed]:
    """niryo_jax's functions on the first joint vectors."""
    robot = inputs.robot
    q = jax.device_put(inputs.q[:size].astype(dtype))
    both = jax.jit(lambda q: (nj.forward_kinematics(robot, q), nj.space_jacobian(robot, q)))
    functions: dict[str, Callable[[], Any]] = {
        "forward kinematics": lambda: nj.forward_kinematics(robot, q),
        "space Jacobian": lambda: nj.space_jacobian(robot, q),
        "both": lambda: both(q),
    }
    return {what: Timed("niryo_jax", size, function) for what, function in functions.items()}


def theirs(inputs: Inputs, peer: Peer, size: int) -> dict[str, Timed]:
    """A peer's functions on the first joint vectors, fewer where it loops."""
    size = size if peer.batched else min(size, LOOP)
    q = peer.given(inputs.q[:size].astype(peer.dtype))
    forward, jacobian = peer.forward, peer.jacobian
    out = {}
    if forward is not None:
        out["forward kinematics"] = Timed(peer.name, size, lambda: forward(q))
    if jacobian is not None:
        out["space Jacobian"] = Timed(peer.name, size, lambda: jacobian(q))
    return out


def misses(inputs: Inputs, what: str, answer: np.ndarray) -> float:
    """The largest difference from the reference."""
    truth = inputs.pose if what == "forward kinematics" else inputs.jacobian
    return float(np.max(np.abs(np.asarray(answer) - truth[: len(answer)])))


def peer_misses(inputs: Inputs, peer: Peer, what: str, answer: Any) -> float | None:
    """The same for a peer; None where it hands nothing over."""
    if answer is None:
        return None
    if what == "forward kinematics":
        return misses(inputs, what, peer.poses(answer))
    size = len(answer)
    return misses(inputs, what, peer.space_jacobians(answer, inputs.pose[:size]))


def compare(
    inputs: Inputs,
    found: list[Peer],
    dtype: str,
    size: int,
    rounds: int,
    report: Report,
    too_slow: list[Peer],
) -> dict[str, list[Timed]]:
    """What -> rows of one precision and batch size, ours first.

    Peers that are `too_slow` are left out; those that take long here are added.
    """
    mine = ours(inputs, size, dtype)
    others = [(p, theirs(inputs, p, size)) for p in found if p.dtype == dtype and p not in too_slow]
    rows = {what: [subject] for what, subject in mine.items()}
    for _, subjects in others:
        for what, subject in subjects.items():
            rows[what].append(subject)
    alternate([subject for of_what in rows.values() for subject in of_what], rounds, LEAST)
    error: dict[int, float | None] = {}
    for what, subject in mine.items():
        answers = subject.result if what == "both" else (subject.result,)
        whats = ("forward kinematics", "space Jacobian") if what == "both" else (what,)
        far = max(misses(inputs, w, a) for w, a in zip(whats, answers))
        error[id(subject)] = far
        if not far < RIGHT[dtype]:
            report.wrong.append(f"{what}, {dtype}, batch {size:,}: misses by {far:.1e}")
    for peer, subjects in others:
        for what, subject in subjects.items():
            error[id(subject)] = peer_misses(inputs, peer, what, subject.result)
            if subject.seconds > PATIENCE and peer.batched:
                too_slow.append(peer)
    lines, facts = [], []
    for what, of_what in rows.items():
        for subject in of_what:
            far = error[id(subject)]
            over = of_what[0].rate / subject.rate
            said = "not handed over" if far is None else f"{far:.0e}"
            if far is not None and not far < PEER_RIGHT[dtype]:
                said += " WRONG"
            cells = [what, subject.name, f"{subject.rate:,.0f}", f"{subject.spread:.0%}"]
            lines.append([*cells, f"{over:,.1f}", f"{subject.first:.2f}", said])
            facts.append({"what": what, "error": far, **subject.facts()})
    head = ["what", "library", "poses/s", "spread", "ours / its", "first call (s)", "largest error"]
    report.sections += [f"## {dtype}, batch {size:,}", table(head, lines)]
    report.data[f"{dtype}, {size}"] = facts
    return rows


def best(rows: list[Timed], *names: str) -> Timed | None:
    """The fastest peer, among those named if any are."""
    peers = [r for r in rows[1:] if not names or r.name.startswith(names)]
    return max(peers, key=lambda r: r.rate) if peers else None


def at_least(text: str, rows: list[Timed], times: float, *names: str) -> Claim:
    """Ours at least so many times the best of the peers."""
    peer = best(rows, *names)
    if peer is None:
        return Claim(text, None)
    ratio = rows[0].rate / peer.rate
    detail = f"{ratio:,.1f} x ({rows[0].rate:,.0f} and {peer.rate:,.0f} poses/s, {peer.name})"
    return Claim(f"{text}: {detail}", ratio >= times)


def claims(rows: dict[str, dict[str, list[Timed]]], size: int) -> list[Claim]:
    """About forward kinematics and Jacobians at the batch size that the aims are stated for."""
    out = []
    for dtype, times in (("float64", 6), ("float32", 20)):
        text = f"forward kinematics, {dtype}, at least {times} x the best peer"
        out.append(at_least(text, rows[dtype]["forward kinematics"], times))
        forward = rows[dtype]["forward kinematics"][0]
        floor = floors.forward_kinematics(dtype, size)
        share = 1e9 * forward.seconds / size / floor.nanoseconds
        text = f"forward kinematics, {dtype}, within 4 x the floor ({floor})"
        out.append(Claim(f"{text}: {share:.1f} x", share < 4))
    for dtype, times, name in (("float64", 6, "pinocchio"), ("float32", 25, "frax")):
        text = f"space Jacobian, {dtype}, at least {times} x {name}"
        out.append(at_least(text, rows[dtype]["space Jacobian"], times, name))
        jacobian, both = rows[dtype]["space Jacobian"][0], rows[dtype]["both"][0]
        share = both.seconds / jacobian.seconds
        text = f"pose and Jacobian together, {dtype}, less than 1.3 x the Jacobian: {share:.2f} x"
        out.append(Claim(text, share < 1.3))
    return out


def numerical(inputs: Inputs, size: int, rounds: int, report: Report) -> None:
    """Newton-Raphson from a guess, one solution from none, and single poses."""
    robot, pose = inputs.robot, inputs.pose[:size]
    rng = np.random.default_rng(1)
    step = rng.standard_normal((size, 6))
    guess = inputs.q[:size] + 0.1 * step / np.linalg.norm(step, axis=1, keepdims=True)
    newton = Timed(
        "Newton-Raphson from 0.1 rad, to 1e-9",
        size,
        lambda: nj.newton_raphson(
            robot, pose, guess, position_tolerance=1e-9, rotation_tolerance=1e-9
        ),
    )
    chosen = Timed(
        "inverse kinematics, best solution within the limits",
        size,
        lambda: nj.inverse_kinematics(robot, pose).farthest_from_limits(),
    )
    one, one_q = inputs.pose[0], jax.device_put(inputs.q[0])
    forward_one = Timed("forward kinematics", 1, lambda: nj.forward_kinematics(robot, one_q))
    solve_one = Timed("inverse kinematics", 1, lambda: nj.inverse_kinematics(robot, one))
    subjects = [newton, chosen, forward_one, solve_one]
    peer = None
    if version_of("roboticstoolbox-python") is not None:
        arm = elementary_transforms(robot)
        few = list(pose[: LOOP // 4])

        def one_each() -> list[Any]:
            return [arm.ik_LM(x, method="chan") for x in few]

        peer = Timed("roboticstoolbox, ik_LM, chan", len(few), one_each)
        subjects.append(peer)
    alternate(subjects, rounds, LEAST)
    for name, q, ok in (
        (newton.name, newton.result.q, newton.result.converged),
        (chosen.name, *chosen.result),
    ):
        reached = reference.forward_kinematics(robot, np.asarray(q)[ok])
        far = float(np.max(np.abs(reached - pose[ok])))
        share = float(np.mean(ok))
        least = 1.0 if name == chosen.name else 0.999
        if not (far < 1e-8 and share >= least):
            report.wrong.append(f"{name}: misses by {far:.1e}, {share:.3%} solved")
    lines = [
        [s.name, f"{s.size:,}", f"{s.rate:,.0f}", f"{s.spread:.0%}", f"{s.first:.2f}"]
        for s in subjects
    ]
    head = ["what", "batch", "poses/s", "spread", "first call (s)"]
    report.sections += ["## Numerical inverse kinematics and single poses, float64"]
    report.sections.append(table(head, lines))
    report.data["numerical"] = [s.facts() for s in subjects]
    text = f"Newton-Raphson from 0.1 rad to 1e-9, at least 500,000 poses/s: {newton.rate:,.0f}"
    report.claims.append(Claim(text, newton.rate >= 500_000))
    text = "one solution from no guess, at least 30 x roboticstoolbox (ik_LM, chan)"
    if peer is None:
        report.claims.append(Claim(text, None))
    else:
        success = float(np.mean([solution.success for solution in peer.result]))
        ratio = chosen.rate / peer.rate
        detail = f"{ratio:,.1f} x ({chosen.rate:,.0f} and {peer.rate:,.0f} poses/s; it succeeds on"
        report.claims.append(Claim(f"{text}: {detail} {success:.1%})", ratio >= 30))
    for subject, limit in ((forward_one, 30), (solve_one, 500)):
        text = f"{subject.name} of one pose under {limit} us a call: {1e6 * subject.seconds:,.0f}"
        report.claims.append(Claim(text, 1e6 * subject.seconds < limit))


def measure(sizes: list[int], main_size: int, rounds: int, skip: list[str]) -> Report:
    """Everything, in one process."""
    inputs = Inputs(max([*sizes, main_size]))
    found, absent = peers(inputs.robot, skip)
    facts = about(*NAMES, rounds=rounds)
    report = Report("Forward kinematics and Jacobians", {"about": facts, "absent": absent})
    report.sections.append(header(facts))
    rows: dict[str, dict[str, list[Timed]]] = {}
    too_slow: list[Peer] = []
    for dtype in ("float64", "float32"):
        for size in sorted({*sizes, main_size}):
            print(f"  {dtype}, batch {size:,}", flush=True)
            measured = compare(inputs, found, dtype, size, rounds, report, too_slow)
            if size == main_size:
                rows[dtype] = measured
    report.claims += claims(rows, main_size)
    print("  numerical inverse kinematics", flush=True)
    numerical(inputs, main_size, rounds, report)
    if absent:
        report.sections.append("\n".join(f"- {name}: {why}." for name, why in absent.items()))
    return report


def main() -> int:
    """Measure, print, and fail where an answer is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", type=int, nargs="*", default=[1, 1_000, 100_000, 1_000_000])
    parser.add_argument("--poses", type=int, default=65_536, help="batch size of the claims")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--skip", nargs="*", default=[], help="libraries to leave out")
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    report = measure(options.batches, options.poses, options.rounds, options.skip)
    return report.finish("kinematics" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
