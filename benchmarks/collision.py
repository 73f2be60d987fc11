"""Self-collision of the Niryo One beside coal on the same capsules, on one core.

    python -m benchmarks.collision [--configurations 100000] [--rounds 5]

coal measures one pair in one place at a time: once in a loop of Python over pairs, with the places
of the capsules given, and once by pinocchio's loop in C++, one call for each configuration. The
exit code is 1 where a distance of ours is wrong.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks import reference
from benchmarks.kinematics_peers import urdf
from benchmarks.measure import (
    Claim,
    Report,
    Timed,
    about,
    alternate,
    header,
    table,
    version_of,
)
from niryo_jax import collision as co

RIGHT = {"float64": 1e-12, "float32": 5e-6}
"""How far a distance may be from the reference, metres."""

LEAST = 0.1
"""Seconds a round lasts at the least."""

TIMES = 20.0
"""What is aimed at: so many times the configurations a second of coal."""

FEW = 1_000
"""Configurations that coal handles in a run."""


def segments(a: np.ndarray, u: np.ndarray, b: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The distance of segments a + s u and b + t v: the least at ends, and between the lines."""
    r = a - b
    uu, vv, uv = (np.sum(x * y, -1) for x, y in ((u, u), (v, v), (u, v)))
    ur, vr = np.sum(u * r, -1), np.sum(v * r, -1)
    first, second = np.where(uu > 0, uu, 1), np.where(vv > 0, vv, 1)
    square = np.maximum(uu * vv - uv**2, 0)
    inner = np.clip((uv * vr - vv * ur) / np.where(square > 0, square, 1), 0, 1)
    zero, one = np.zeros_like(uu), np.ones_like(uu)
    ways = [(s, np.clip((vr + s * uv) / second, 0, 1)) for s in (zero, one, inner)]
    ways += [(np.clip((t * uv - ur) / first, 0, 1), t) for t in (zero, one)]
    gaps = [r + s[..., None] * u - t[..., None] * v for s, t in ways]
    return np.min([np.linalg.norm(gap, axis=-1) for gap in gaps], axis=0)


def capsules(
    robot: nj.Robot, model: co.CollisionModel, q: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Start and vector (N, 3) of each capsule, by the reference."""
    motions = reference.chain(robot, q)
    out: list[tuple[np.ndarray, np.ndarray]] = []
    for start, end, link in zip(model.start, model.end, model.links):
        turn, place = motions[link][:, :3, :3], motions[link][:, :3, 3]
        out.append((turn @ start + place, turn @ (end - start)))
    return out


def truth(robot: nj.Robot, model: co.CollisionModel, q: np.ndarray) -> np.ndarray:
    """(N, p) the distances of all pairs."""
    placed = capsules(robot, model, q)
    return np.stack(
        [
            segments(*placed[i], *placed[j]) - model.radius[i] - model.radius[j]
            for i, j in model.pairs
        ],
        axis=-1,
    )


def _upright(vector: np.ndarray) -> np.ndarray:
    """A rotation that brings z along a vector."""
    length = np.linalg.norm(vector)
    z = vector / length if length else np.eye(3)[2]
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def by_coal(
    robot: nj.Robot, model: co.CollisionModel, q: np.ndarray
) -> tuple[str, Callable[[], np.ndarray]]:
    """A loop of Python over configurations and pairs."""
    coal = importlib.import_module("coal")
    shapes = [
        coal.Capsule(float(radius), float(np.linalg.norm(end - start)))
        for start, end, radius in zip(model.start, model.end, model.radius)
    ]
    placed = [
        [coal.Transform3s(_upright(v), a + v / 2) for a, v in zip(*capsule)]
        for capsule in capsules(robot, model, q)
    ]
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def run() -> np.ndarray:
        out = np.empty((len(q), len(model.pairs)))
        for k in range(len(q)):
            for p, (i, j) in enumerate(model.pairs):
                result.clear()
                out[k, p] = coal.distance(
                    shapes[i], placed[i][k], shapes[j], placed[j][k], request, result
                )
        return out

    return "coal, loop over pairs, places given", run


def by_pinocchio(
    robot: nj.Robot, model: co.CollisionModel, q: np.ndarray
) -> tuple[str, Callable[[], np.ndarray]]:
    """pinocchio's loop over the pairs of a configuration, which moves the capsules as well."""
    pin, coal = importlib.import_module("pinocchio"), importlib.import_module("coal")
    arm = pin.buildModelFromXML(urdf(robot))
    data = arm.createData()
    # Where the frames of its joints are while the capsules are at home.
    pin.forwardKinematics(arm, data, np.zeros(robot.joints))
    geometry = pin.GeometryModel()
    for name, start, end, radius, link in zip(
        model.names, model.start, model.end, model.radius, model.links
    ):
        home = pin.SE3(_upright(end - start), (start + end) / 2)
        shape = coal.Capsule(float(radius), float(np.linalg.norm(end - start)))
        place = data.oMi[link].inverse() * home
        geometry.addGeometryObject(pin.GeometryObject(name, link, place, shape))
    for i, j in model.pairs:
        geometry.addCollisionPair(pin.CollisionPair(i, j))
    found = geometry.createData()

    def run() -> np.ndarray:
        out = np.empty((len(q), len(model.pairs)))
        for k, x in enumerate(q):
            pin.computeDistances(arm, data, geometry, found, x)
            out[k] = [result.min_distance for result in found.distanceResults]
        return out

    return "coal, by pinocchio's computeDistances", run


PEERS: dict[str, Callable[..., tuple[str, Callable[[], np.ndarray]]]] = {
    "coal": by_coal,
    "pin": by_pinocchio,
}
"""By the package that pip takes."""


def measure(size: int, few: int, rounds: int, report: Report, skip: tuple[str, ...] = ()) -> float:
    """Fill a report; returns how many times as fast as the fastest way by coal ours is."""
    robot = nj.robots.niryo_one()
    model = co.niryo_one("gripper_1")
    floor = co.World.table()
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (size, 6))
    right = truth(robot, model, q)
    above = np.min(
        [
            np.minimum(start[:, 2], (start + vector)[:, 2]) - radius
            for (start, vector), radius, link in zip(
                capsules(robot, model, q), model.radius, model.links
            )
            if link not in floor.ignored[0]
        ],
        axis=0,
    )
    slope = jax.jit(jax.grad(lambda q: co.clearance(robot, model, q).sum()))
    subjects: list[tuple[str, Timed]] = []
    for dtype in RIGHT:
        given = jax.device_put(q.astype(dtype))
        runs: dict[str, Callable[[], Any]] = {
            "clearance": lambda g=given: co.clearance(robot, model, g),
            "all distances": lambda g=given: co.distances(robot, model, g).distance,
            "clearance, and to the table": lambda g=given: co.clearance(robot, model, g, floor),
            "clearance and its derivative": lambda g=given: slope(g),
        }
        subjects += [(dtype, Timed(f"niryo_jax, {name}", size, run)) for name, run in runs.items()]
    peers: list[Timed] = []
    for package, build in PEERS.items():
        if package in skip or version_of(package) is None:
            report.sections.append(f"{package}: not installed (pip install {package})")
            continue
        name, run = build(robot, model, q[:few])
        peers.append(Timed(name, min(few, size), run))
    subjects += [("float64", peer) for peer in peers]
    alternate([subject for _, subject in subjects], rounds, LEAST)
    rows: list[list[str]] = []
    ours = subjects[0][1].rate
    for dtype, subject in subjects:
        found, miss = np.asarray(subject.result, np.float64), "-"
        expected = {
            "niryo_jax, clearance": np.min(right, axis=-1),
            "niryo_jax, clearance, and to the table": np.minimum(np.min(right, -1), above),
            "niryo_jax, all distances": right,
            **{peer.name: right[: len(found)] for peer in peers},
        }.get(subject.name)
        if expected is not None:
            error = float(np.max(np.abs(found - expected)))
            miss = f"{error:.0e}"
            if subject not in peers and not error < RIGHT[dtype]:
                report.wrong.append(f"{subject.name}, {dtype}: misses by {error:.1e} m")
        cells = [dtype, subject.name, f"{subject.rate:,.0f}", f"{subject.spread:.0%}"]
        rows.append([*cells, f"{ours / subject.rate:.1f}", miss, f"{subject.first:.2f}"])
    report.data["subjects"] = [subject.facts() for _, subject in subjects]
    head = [
        *("type", "by", "configurations/s", "spread"),
        *("clearance / it", "misses by (m)", "first call (s)"),
    ]
    pairs = len(model.pairs)
    report.sections += [
        f"{len(model.names)} capsules, {pairs} pairs, "
        f"{np.mean(np.min(right, -1) < 0):.0%} of {size:,} random configurations collide:",
        table(head, rows),
    ]
    return ours / max((peer.rate for peer in peers), default=np.nan)


def main() -> int:
    """Run, print, and return the exit code."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--configurations", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    facts = about("coal", "pin", configurations=options.configurations)
    report = Report("Self-collision", facts, [header(facts)])
    over = measure(options.configurations, FEW, options.rounds, report)
    holds = None if np.isnan(over) else over >= TIMES
    report.claims = [Claim(f"{over:.0f} times as fast as coal on one core, of {TIMES:.0f}", holds)]
    return report.finish("collision" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
