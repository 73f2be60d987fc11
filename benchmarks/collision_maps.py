"""What it costs a capability map to look at collisions, on one core.

    python -m benchmarks.collision_maps [--voxel 0.05] [--orientations 200] [--rounds 7] [--save]

The same tiles from all over the map of the Niryo One, with and without. The exit code is 1 where
poses that count and poses that only collide are not those of the plain map together, or where a
number is not that of inverse kinematics and clearance pose by pose.
"""

from __future__ import annotations

import argparse

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks.measure import Claim, Report, Timed, about, alternate, header, table
from benchmarks.workspace import slow_path
from niryo_jax import collision as co
from niryo_jax import workspace as ws
from niryo_jax.workspace.tiles import Arrays, Tile, TileProgram

TIMES = 1.25
"""What is aimed at: no more than so many times the time of a plain map."""

VOXELS = 8
"""So many voxels of a tile, or a few more, are looked at the slow way."""

TILES = 8

SHAPE = co.niryo_one("gripper_1")
TABLE = co.World.table(0.0)
BOX = co.World.boxes([[0.3, 0.0, 0.1]], [[0.05, 0.05, 0.1]])
CHECKS = {
    "plain": None,
    "itself": co.CollisionCheck(SHAPE),
    "itself and a table": co.CollisionCheck(SHAPE, TABLE),
    "itself, a table and a box": co.CollisionCheck(SHAPE, TABLE + BOX),
}


def _joined(parts: list[Arrays], name: str) -> np.ndarray:
    return np.concatenate([part[name] for part in parts])


def measure(voxel: float, orientations: int, rounds: int, report: Report) -> float:
    """Fill a report; returns the time with a table over that of a plain map."""
    robot = nj.robots.niryo_one()
    subjects: list[Timed] = []
    tiles, specs = list[Tile](), list[ws.MapSpec]()
    for name, check in CHECKS.items():
        spec = ws.MapSpec.of(robot, voxel, None, orientations, collisions=check)
        program = TileProgram(spec)
        every = [tile for chunk in spec.chunks() for tile in program.tiles(chunk)]
        apart = max(1, len(every) // TILES)
        tiles = every[apart // 2 :: apart]
        size = sum(int(tile.live.sum()) for tile in tiles) * orientations
        specs.append(spec)
        subjects.append(
            Timed(name, size, lambda p=program, tiles=tiles: [p(tile) for tile in tiles])
        )
    alternate(subjects, rounds)
    plain = subjects[0]
    rows: list[list[str]] = []
    for subject, (name, check), spec in zip(subjects, CHECKS.items(), specs):
        # The fastest round is least disturbed by other programs.
        times = min(subject.rounds) / min(plain.rounds)
        index = _joined(subject.result, "reachability_index")
        colliding = np.zeros(1)
        if check is not None:
            colliding = _joined(subject.result, "colliding_fraction")
            whole = _joined(plain.result, "reachability_index")
            if not np.allclose(index + colliding, whole, rtol=0, atol=1e-6):
                report.wrong.append(f"{name}: what collides is not what a plain map has more")
            for number, tile in enumerate(tiles):
                some = np.flatnonzero(tile.live)[:: max(1, int(tile.live.sum()) // VOXELS)]
                pose = np.zeros((len(some), orientations, 4, 4))
                pose[..., :3, :3], pose[..., 3, 3] = spec.rotations, 1.0
                pose[..., :3, 3] = tile.centres[some][:, None]
                truths = slow_path(robot, pose, spec.dexterous, check)
                for key, truth in truths.items():
                    if key in spec.variables and not np.allclose(
                        subject.result[number][key][some],
                        truth,
                        rtol=3e-7,
                        atol=1e-9,
                        equal_nan=True,
                    ):
                        report.wrong.append(f"{name}: {key} is not that of the slow path")
        rows.append(
            [
                name,
                f"{subject.size / min(subject.rounds):,.0f}",
                f"{subject.spread:.0%}",
                f"{times:.2f}",
                f"{np.mean(index):.3f}",
                f"{np.mean(colliding):.3f}",
                f"{subject.first:.1f}",
            ]
        )
    report.data["subjects"] = [subject.facts() for subject in subjects]
    head = ["looked at", "poses/s", "spread", "time / plain", "reached", "only colliding"]
    report.sections.append(table([*head, "first call (s)"], rows))
    return min(subjects[2].rounds) / min(plain.rounds)


def main() -> int:
    """Run, print, and return the exit code."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--voxel", type=float, default=0.05)
    parser.add_argument("--orientations", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    facts = about(voxel=options.voxel, orientations=options.orientations)
    report = Report("Capability maps free of collisions", facts, [header(facts)])
    times = measure(options.voxel, options.orientations, options.rounds, report)
    text = f"with a table {times:.2f} times the time of a plain map, of {TIMES}"
    report.claims = [Claim(text, times <= TIMES)]
    return report.finish("collision-maps" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
