"""What it costs a capability map to look at collisions, on one core.

    python -m benchmarks.collision_maps [--voxel 0.05] [--orientations 200] [--rounds 7] [--save]

The same tiles from all over the map of the Niryo One, with and without. The exit code is 1 where
poses that count and poses that only collide are not those of the plain map together, or where a
number is not that of inverse kinematics and clearance pose by pose.
"""

from __future__ import annotations

import argparse
import statistics
import time

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks.measure import Claim, Report, about, header, table
from benchmarks.workspace import slow_path
from niryo_jax import collision as co
from niryo_jax import workspace as ws
from niryo_jax.workspace.tiles import Arrays, TileProgram

TIMES = 1.25
"""What is aimed at: no more than so many times the time of a plain map."""

VOXELS = 8
"""So many voxels of a tile are looked at the slow way."""

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


class Map:
    """Tiles of a map, timed.

    Attributes:
        spec: what it is of.
        tiles: from all over it.
        poses: in them.
        first: seconds of the first run, compilation included.
        seconds: of the processor, for each round: other programs count for little.
        result: of each tile.
    """

    def __init__(self, spec: ws.MapSpec) -> None:
        self.spec, self._program = spec, TileProgram(spec)
        every = [tile for chunk in spec.chunks() for tile in self._program.tiles(chunk)]
        apart = max(1, len(every) // TILES)
        self.tiles = every[apart // 2 :: apart]
        self.poses = sum(int(tile.live.sum()) for tile in self.tiles) * len(spec.quaternions)
        self.seconds = list[float]()
        self.result = list[Arrays]()
        self.first = self._once()

    def _once(self) -> float:
        started = time.process_time()
        self.result = [self._program(tile) for tile in self.tiles]
        return time.process_time() - started

    def round(self) -> None:
        """Run once more."""
        self.seconds.append(self._once())

    @property
    def median(self) -> float:
        """Seconds of a run."""
        return statistics.median(self.seconds)

    def joined(self, name: str) -> np.ndarray:
        """A variable, over the voxels of all tiles."""
        return np.concatenate([part[name] for part in self.result])


def differing(found: Map, robot: nj.Robot) -> set[str]:
    """The variables of which a voxel is not what public functions and numpy make of it."""
    wrong, spec = set[str](), found.spec
    for tile, result in zip(found.tiles, found.result):
        some = np.flatnonzero(tile.live)[:: max(1, int(tile.live.sum()) // VOXELS)][:VOXELS]
        pose = np.zeros((VOXELS, len(spec.quaternions), 4, 4))
        pose[..., :3, :3], pose[..., 3, 3] = spec.rotations, 1.0
        # Of one size, so that the functions are compiled once.
        pose[..., :3, 3] = tile.centres[np.resize(some, VOXELS)][:, None]
        for name, truth in slow_path(robot, pose, spec.dexterous, spec.collisions).items():
            if name in spec.variables:
                have, want = result[name][some], truth[: len(some)]
                if not np.allclose(have, want, rtol=3e-7, atol=1e-9, equal_nan=True):
                    wrong.add(name)
    return wrong


def measure(voxel: float, orientations: int, rounds: int, report: Report) -> float:
    """Fill a report; returns the time with a table over that of a plain map."""
    robot = nj.robots.niryo_one()
    maps = {
        name: Map(ws.MapSpec.of(robot, voxel, None, orientations, collisions=check))
        for name, check in CHECKS.items()
    }
    for _ in range(rounds):
        for found in maps.values():
            found.round()
    plain, rows = maps["plain"], list[list[str]]()
    times = {name: found.median / plain.median for name, found in maps.items()}
    for name, found in maps.items():
        index, colliding = found.joined("reachability_index"), np.zeros(1)
        if found.spec.collisions is not None:
            colliding = found.joined("colliding_fraction")
            whole = plain.joined("reachability_index")
            if not np.allclose(index + colliding, whole, rtol=0, atol=1e-6):
                report.wrong.append(f"{name}: what collides is not what a plain map has more")
        for variable in sorted(differing(found, robot)):
            report.wrong.append(f"{name}: {variable} is not that of the slow path")
        spread = (max(found.seconds) - min(found.seconds)) / found.median
        numbers = f"{found.poses / found.median:,.0f}", f"{spread:.0%}", f"{times[name]:.2f}"
        shares = (f"{np.mean(share):.3f}" for share in (index, colliding))
        rows.append([name, *numbers, *shares, f"{found.first:.1f}"])
    report.data["seconds"] = {name: found.seconds for name, found in maps.items()}
    head = ["looked at", "poses/s", "spread", "time / plain", "reached", "only colliding"]
    report.sections.append(table([*head, "first call (s)"], rows))
    return times["itself and a table"]


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
