"""What an arm can reach: a capability map of the Niryo One, and where to put the arm.

You learn: how to map a workspace by complete inverse kinematics, what its volume is and how well
that is known, and how to find the place from which given poses are reached best.

Needs the extra "workspace". Most of the time goes into compiling two programs.

Expected output, and the path of a picture where matplotlib is installed:

    900 voxels x 60 orientations: 11514 of 54000 poses reached, 0 undecided
    volume 0.361 m^3, between 0.201 and 0.554
    in the best voxel 72 % of the orientations
    5760 placements looked up, 1623 solved: the best at (0.70, 0.50) m, heading 30 deg
    from there 3 of 3 poses are reached, every joint 46 deg or more from its limits
"""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

import niryo_jax as nj
from niryo_jax import workspace as ws
from niryo_jax.lie.rpy import pose_from_rpy


class Result(NamedTuple):
    volume: ws.Volume
    undecided: int
    placements: ws.BasePlacements
    tasks: np.ndarray
    picture: Path | None


def main(voxel: float = 0.1, orientations: int = 60) -> Result:
    jax.config.update("jax_enable_x64", True)
    robot = nj.robots.niryo_one()

    # 1. Every orientation at the centre of every voxel. Given a `store`, the map is kept on disk,
    # and a run that is ended can go on.
    found = ws.capability_map(robot, voxel, orientations=orientations)
    tried = found.reachability_index.size * orientations
    reached = int(found.orientation_reached.sum())
    undecided = round(float(found.undecided_fraction.sum()) * orientations)
    print(
        f"{found.reachability_index.size} voxels x {orientations} orientations: "
        f"{reached} of {tried} poses reached, {undecided} undecided"
    )
    volume = ws.reachable_volume(found)
    print(f"volume {volume.value:.3f} m^3, between {volume.lower:.3f} and {volume.upper:.3f}")
    print(
        f"in the best voxel {100 * float(found.reachability_index.max()):.0f} % of the orientations"
    )

    # 2. Where to stand to take something from above at three places. The map rules out most
    # placements; the others are solved at the very poses.
    places = [(1.0, 0.4, 0.1), (1.0, 0.6, 0.1), (0.8, 0.7, 0.15)]
    tasks = np.stack([pose_from_rpy([*place, 0.0, np.pi / 2, 0.0]) for place in places])
    best = ws.base_placement(found, tasks)
    x, y, _ = best.position[0]
    print(
        f"{best.candidates} placements looked up, {best.evaluated} solved: the best at "
        f"({x:.2f}, {y:.2f}) m, heading {np.rad2deg(best.heading[0]):.0f} deg"
    )
    print(
        f"from there {best.reached[0].sum()} of {len(tasks)} poses are reached, every joint "
        f"{np.rad2deg(best.margin[0]):.0f} deg or more from its limits"
    )

    picture = None
    if importlib.util.find_spec("matplotlib") is not None:
        picture = Path(tempfile.mkdtemp()) / "capability-map.png"
        ws.plots.save(ws.plots.overview(found), picture)
        print(f"picture {picture}")
    return Result(volume, undecided, best, tasks, picture)


if __name__ == "__main__":
    main()
