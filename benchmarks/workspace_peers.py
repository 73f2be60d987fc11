"""The work of a capability map by others' ways, on a random slice of its poses.

    python -m benchmarks.workspace_peers [--poses 4000] [--skip NAME ...]

The poses are those of a map of the Niryo One: the centres of voxels of 2.5 cm, each with 200 evenly
spread orientations. Two ways are in use. One asks a numerical solver about each pose, and takes
what it does not solve for unreachable; its time for the whole map is extrapolated from the slice.
The other samples joint vectors and marks the voxels that they fall into, so that what was not hit
is not known to be unreachable. What each says is compared with complete inverse kinematics. All on
one core.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import numpy as np

import niryo_jax as nj
from benchmarks.kinematics_peers import elementary_transforms, urdf
from benchmarks.measure import about, header, installed, table
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.orientations import orientations

VOXEL = 0.025
ORIENTATIONS = 200
BOX = (-0.475, -0.475, -0.15), (0.475, 0.475, 0.65)
MAP_POSES = Grid.covering(*BOX, VOXEL).size * ORIENTATIONS

BATCH = 500
"""Poses of one call: one shape, one program."""

SAMPLES = 1_000_000
"""Joint vectors of the map by sampling: about what it handles in ten seconds."""

PATIENCE = 50.0
"""Seconds after which a peer is asked about no further poses."""


@dataclasses.dataclass(frozen=True)
class Peer:
    """A library's way to tell which poses an arm reaches within its joint limits.

    Attributes:
        name: as printed.
        reachable: poses (n, 4, 4) -> the flags (n,).
        prepare: makes a map of the whole workspace, from which `reachable` reads; None for what
            solves each pose when it is asked. Returns a remark for the table.
        batch: how many poses it is asked about in one call; None for all.
    """

    name: str
    reachable: Callable[[np.ndarray], np.ndarray]
    prepare: Callable[[], str] | None = None
    batch: int | None = BATCH


class Row(NamedTuple):
    """What a peer said of the first poses of a slice.

    Attributes:
        name: of the peer.
        poses: how many it was asked about.
        reachable: how many of these are reachable.
        seconds: for each pose; None where it makes a map at once.
        whole: seconds for the whole map.
        missed: reachable poses that it takes for unreachable.
        wrong: unreachable poses that it takes for reachable.
        remark: in words.
    """

    name: str
    poses: int
    reachable: int
    seconds: float | None
    whole: float
    missed: int
    wrong: int
    remark: str


def slice_of_map(count: int, seed: int = 0) -> np.ndarray:
    """(count, 4, 4) random poses out of those of the map."""
    rng = np.random.default_rng(seed)
    pose = np.tile(np.eye(4), (count, 1, 1))
    rotations = np.asarray(orientations(ORIENTATIONS).rotations)
    pose[:, :3, :3] = rng.choice(rotations, count)
    for axis, centres in enumerate(Grid.covering(*BOX, VOXEL).centres):
        pose[:, axis, 3] = rng.choice(centres, count)
    return pose


def truth(robot: nj.Robot, pose: np.ndarray) -> np.ndarray:
    """Which poses (n, 4, 4) are reached within the limits, by complete inverse kinematics.

    Raises:
        RuntimeError: it is not proved for one of them.
    """
    answer = nj.inverse_kinematics(robot, pose)
    if not np.all(np.asarray(answer.complete)):
        raise RuntimeError("a set of solutions is not proved to be complete")
    return np.any(np.asarray(answer.within_limits), axis=-1)


def _roboticstoolbox(robot: nj.Robot) -> Iterator[Peer]:
    """Levenberg-Marquardt in C++, up to 100 random starts, limits on: all as it is by default."""
    arm = elementary_transforms(robot)
    for joint, low, high in zip(arm.joints(), np.asarray(robot.lower), np.asarray(robot.upper)):
        joint.qlim = (float(low), float(high))

    def reachable(pose: np.ndarray) -> np.ndarray:
        return np.array([bool(arm.ik_LM(x).success) for x in pose])

    yield Peer("roboticstoolbox, ik_LM", reachable)


def _scikit_robot(robot: nj.Robot) -> Iterator[Peer]:
    """Its map by sampling; its batched solver from one start (its default) and from 20."""
    from skrobot.coordinates.math import matrix2quaternion
    from skrobot.kinematics.reachability_map import ReachabilityMap
    from skrobot.models.urdf import RobotModelFromURDF

    model: Any = RobotModelFromURDF(urdf=urdf(robot))
    links = [joint.child_link for joint in model.joint_list]
    sampled: Any = ReachabilityMap(model, links, model.tool, voxel_size=VOXEL)

    def sample() -> str:
        sampled.compute(SAMPLES, orientation_bins=ORIENTATIONS, verbose=False)
        index = sampled.reachability_index.sum() / Grid.covering(*BOX, VOXEL).size
        return (
            f"{SAMPLES:,} samples; says of a voxel, not of a pose: of all approach directions, "
            f"{index:.0%} were seen"
        )

    def in_a_voxel_that_was_hit(pose: np.ndarray) -> np.ndarray:
        return np.asarray(sampled.get_reachability_at_positions(pose[:, :3, 3])) > 0

    def solver(attempts: int) -> Callable[[np.ndarray], np.ndarray]:
        def reachable(pose: np.ndarray) -> np.ndarray:
            turn = [matrix2quaternion(rotation) for rotation in pose[:, :3, :3]]
            answer = model.batch_inverse_kinematics(
                np.concatenate([pose[:, :3, 3], turn], axis=1),
                move_target=model.tool,
                link_list=links,
                attempts_per_pose=attempts,
                # What its documentation advises for finding any solution at all.
                retry_seed="random",
                random_initial_range=0.7,
                select_closest_to_initial=False,
            )
            return np.array(answer.success_flags, bool)

        return reachable

    yield Peer("scikit-robot, ReachabilityMap", in_a_voxel_that_was_hit, sample)
    yield Peer("scikit-robot, batched, 1 start", solver(1))
    yield Peer("scikit-robot, batched, 20 starts", solver(20))


PACKAGES: dict[str, tuple[str, Callable[[nj.Robot], Iterator[Peer]]]] = {
    "roboticstoolbox": ("roboticstoolbox-python", _roboticstoolbox),
    "scikit-robot": ("scikit-robot", _scikit_robot),
}
"""Library -> the package that pip takes, and its adapters."""


def peers(robot: nj.Robot, skip: Sequence[str] = ()) -> tuple[list[Peer], dict[str, str]]:
    """The peers that are installed, and for the others why they take no part."""
    return installed(PACKAGES, robot, skip)


def ours(robot: nj.Robot) -> Peer:
    """Complete inverse kinematics, whose answers are the truth that the others are held against."""
    return Peer("niryo_jax, inverse_kinematics", lambda pose: truth(robot, pose), batch=None)


def measure(peer: Peer, pose: np.ndarray, right: np.ndarray) -> Row:
    """Ask a peer about poses (n, 4, 4) of which the truth (n,) is known, as long as there is time.

    Compilation is not counted: it is paid once for a map.
    """
    started = time.perf_counter()
    remark = peer.prepare() if peer.prepare is not None else ""
    made = time.perf_counter() - started

    batch = peer.batch or len(pose)
    peer.reachable(pose[:batch])
    said, spent = [], 0.0
    for start in range(0, len(pose), batch):
        if spent > PATIENCE:
            break
        started = time.perf_counter()
        said.append(peer.reachable(pose[start : start + batch]))
        spent += time.perf_counter() - started
    answers = np.concatenate(said)
    count = len(answers)
    exists = right[:count]
    each = None if peer.prepare is not None else spent / count
    return Row(
        name=peer.name,
        poses=count,
        reachable=int(exists.sum()),
        seconds=each,
        whole=made if each is None else each * MAP_POSES,
        missed=int(np.sum(exists & ~answers)),
        wrong=int(np.sum(~exists & answers)),
        remark=remark,
    )


def compare(count: int, skip: Sequence[str] = ()) -> tuple[list[Row], dict[str, str]]:
    """Us and all peers that are installed on so many poses; why the others take no part.

    `count` is a whole number of batches.
    """
    robot = nj.robots.niryo_one()
    pose = slice_of_map(count)
    right = truth(robot, pose)
    found, absent = peers(robot, skip)
    return [measure(peer, pose, right) for peer in [ours(robot), *found]], absent


def page(rows: Sequence[Row]) -> str:
    """Rows as a table in Markdown."""
    head = ["way", "poses", "us/pose", f"all {MAP_POSES:,}", "reachable, said not to be"]
    return table(
        [*head, "not reachable, said to be", "remark"],
        [
            [
                row.name,
                f"{row.poses:,}",
                "" if row.seconds is None else f"{row.seconds * 1e6:,.1f}",
                f"{row.whole / 3600:.1f} h" if row.whole > 3600 else f"{row.whole:.0f} s",
                f"{row.missed} of {row.reachable}",
                f"{row.wrong} of {row.poses - row.reachable}",
                row.remark,
            ]
            for row in rows
        ],
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=4000, help=f"a multiple of {BATCH}")
    parser.add_argument("--skip", nargs="*", default=[], choices=list(PACKAGES))
    options = parser.parse_args()
    if options.poses < BATCH or options.poses % BATCH:
        parser.error(f"--poses: expected a multiple of {BATCH}, got {options.poses}")
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    rows, absent = compare(options.poses, options.skip)
    print(header(about(*(package for package, _ in PACKAGES.values()))) + "\n")
    print(page(rows))
    for name, why in absent.items():
        print(f"\n{name}: {why}")


if __name__ == "__main__":
    main()
