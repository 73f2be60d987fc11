"""Base placement against trying every candidate, and against forward kinematics."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support import product_of_exponentials, random_poses

import niryo_jax as nj
from niryo_jax.workspace import placement
from niryo_jax.workspace.description import robot_text
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.measures import PoseMeasures, pose_measures
from niryo_jax.workspace.placement import base_placement

xarray = pytest.importorskip("xarray")

BATCH = 2048
"""Poses of every call: one program for each arm."""

VOXEL = 0.05


@pytest.fixture(scope="module", autouse=True)
def _one_program():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(placement, "_POSES_AT_ONCE", BATCH)
        yield


def measured(robot, pose):
    """`pose_measures` of poses (n, 4, 4), so many at a time."""
    parts = []
    for start in range(0, len(pose), BATCH):
        some = pose[start : start + BATCH]
        rows = np.concatenate([some, np.tile(np.eye(4), (BATCH - len(some), 1, 1))])
        parts.append([np.asarray(x)[: len(some)] for x in pose_measures(robot, rows)])
    return PoseMeasures(*(np.concatenate(x) for x in zip(*parts)))


def capability(robot, grid, rotations):
    """As much of a capability map as base placement reads."""
    centres = np.stack(np.meshgrid(*grid.centres, indexing="ij"), axis=-1)
    pose = np.zeros((*centres.shape[:3], len(rotations), 4, 4))
    pose[..., :3, :3] = rotations
    pose[..., :3, 3] = centres[..., None, :]
    pose[..., 3, 3] = 1
    reached = measured(robot, pose.reshape(-1, 4, 4)).solutions > 0
    share = reached.reshape(*grid.shape, -1).mean(axis=-1)
    axes = ("x", "y", "z")
    return xarray.Dataset(
        {
            "reachability_index": (axes, share.astype(np.float32)),
            "undecided_fraction": (axes, np.zeros(grid.shape, np.float32)),
        },
        dict(zip(axes, grid.centres)),
        {"voxel": grid.voxel, "robot": robot_text(robot)},
    )


def upright(x, y, z, heading):
    """The pose of a base."""
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


@pytest.fixture(scope="module")
def scara():
    """Four joints, z up, limits that tell headings apart."""
    home = np.diag([1.0, -1.0, -1.0, 1.0])
    home[:3, 3] = 0.65, 0, 0.25
    return nj.Robot.from_axes(
        [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, -1]],
        [[0, 0, 0], [0.4, 0, 0], [0.65, 0, 0], [0.65, 0, 0]],
        home,
        prismatic=[False, False, True, False],
        lower=[-2.4, -2.6, -0.18, -2.9],
        upper=[2.4, 2.6, 0, 2.9],
        name="scara",
    )


@pytest.fixture(scope="module")
def scara_map(scara):
    """With turns about the vertical, which are the orientations that it can take."""
    home = np.asarray(scara.home)
    turns = [upright(0, 0, 0, k * np.pi / 4)[:3, :3] @ home[:3, :3] for k in range(8)]
    height = home[2, 3]
    grid = Grid.covering((-0.7, -0.7, height - 0.2), (0.7, 0.7, height + 0.02), VOXEL)
    return capability(scara, grid, np.stack(turns))


def tasks_of(robot, base, rng, count):
    """Joint vectors well within the limits, and the poses in the world."""
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    q = low + (high - low) * rng.uniform(0.1, 0.9, (count, robot.joints))
    pose = base @ product_of_exponentials(robot.screws, robot.home, q)
    return q, pose.astype(np.float64)


def every_candidate(robot, tasks, region, step, headings):
    """Reached (n, t) and margin (n, t) of a grid in the middle of a region, without a map."""
    (x0, y0), (x1, y1) = region
    nx, ny = int((x1 - x0) / step + 1e-6) + 1, int((y1 - y0) / step + 1e-6) + 1
    bases = np.stack(
        [
            upright(
                (x0 + x1 - (nx - 1) * step) / 2 + i * step,
                (y0 + y1 - (ny - 1) * step) / 2 + j * step,
                0,
                2 * np.pi * k / headings,
            )
            for k in range(headings)
            for i in range(nx)
            for j in range(ny)
        ]
    )
    pose = np.linalg.solve(bases[:, None], tasks[None]).reshape(-1, 4, 4)
    measures = measured(robot, pose)
    shape = (len(bases), len(tasks))
    return measures.solutions.reshape(shape) > 0, measures.limit_margin.reshape(shape)


@pytest.mark.parametrize("away", [(0.0,), (0.0, 0.5), (0.0, 9.0), (0.0, 1.0, 1.0)])
def test_no_candidate_is_better(scara, scara_map, rng, away):
    tasks = np.concatenate([tasks_of(scara, upright(x, 0.1, 0, 0.3), rng, 2)[1] for x in away])
    region = ((-0.6, -0.4), (0.7, 0.6))
    reached, margin = every_candidate(scara, tasks, region, 0.1, 8)
    counts = reached.sum(axis=1)
    best = counts == counts.max()
    least = np.min(np.where(reached, margin, np.inf), axis=1)

    steps = []
    found = base_placement(
        scara_map,
        tasks,
        robot=scara,
        region=region,
        step=0.1,
        headings=8,
        most=10_000,
        progress=lambda *counts: steps.append(counts),
    )
    assert found.candidates == len(reached)
    assert found.evaluated < found.candidates
    assert found.share[0] * len(tasks) == counts.max() > 0
    assert np.sum(found.share == found.share[0]) == best.sum()
    np.testing.assert_allclose(
        found.margin[: best.sum()], -np.sort(-least[best]), rtol=0, atol=1e-9
    )
    order = np.lexsort((-found.margin, -found.share))
    assert np.array_equal(order, np.arange(len(order)))
    assert steps[-1] == (found.evaluated, found.evaluated)


def test_a_known_base_is_found(scara, scara_map, rng):
    heading = 5 * np.pi / 12
    base = upright(1.3, -0.4, 0.2, heading)
    q, tasks = tasks_of(scara, base, rng, 4)
    known = np.minimum(q - scara.lower, scara.upper - q).min()
    found = base_placement(
        scara_map,
        tasks,
        robot=scara,
        region=((1.1, -0.6), (1.5, -0.2)),
        height=0.2,
        most=10_000,
    )
    (here,) = np.nonzero(np.abs(found.base - base).max(axis=(1, 2)) < 1e-9)
    assert len(here) == 1
    assert found.share[here] == 1
    assert found.margin[0] >= found.margin[here[0]] > known - 1e-9
    np.testing.assert_allclose(found.heading[here], heading)
    np.testing.assert_allclose(found.position[here[0]], base[:3, 3])


def test_placements_reach_what_they_say(scara, scara_map, rng):
    _, tasks = tasks_of(scara, upright(0, 0, 0, 0), rng, 6)
    tasks[3:, :3, 3] += (0.6, 0, 0)
    found = base_placement(scara_map, tasks, robot=scara, headings=6, most=16)
    assert found.reached.shape == (16, 6)
    np.testing.assert_allclose(found.share, found.reached.mean(axis=1))
    pose = np.linalg.solve(found.base[:, None], tasks[None])
    answer = nj.inverse_kinematics(scara, pose)
    q, inside = np.asarray(answer.q), np.asarray(answer.within_limits)
    np.testing.assert_array_equal(np.any(inside, axis=-1), found.reached)
    forward = product_of_exponentials(scara.screws, scara.home, q)
    miss = np.abs(found.base[:, None, None] @ forward - tasks[:, None]).max(axis=(-2, -1))
    assert miss[inside].max() < 1e-10
    margin = np.minimum(q - scara.lower, scara.upper - q).min(axis=-1)
    best = np.where(inside, margin, -np.inf).max(axis=-1)
    least = np.where(found.reached, best, np.inf).min(axis=1)
    np.testing.assert_allclose(found.margin, least, rtol=0, atol=1e-9)


def test_the_answer_moves_with_the_world(scara, scara_map, rng):
    _, tasks = tasks_of(scara, upright(0, 0, 0, 0), rng, 3)
    world = upright(2.0, -3.0, 0.7, np.pi / 2)
    options = {"robot": scara, "step": 0.11, "headings": 8, "most": 10_000}
    here = base_placement(scara_map, tasks, **options)
    there = base_placement(scara_map, world @ tasks, height=0.7, **options)
    assert here.candidates == there.candidates
    whole = here.share == 1
    assert whole.any()
    np.testing.assert_allclose(here.margin[whole], there.margin[there.share == 1], atol=1e-9)
    moved = world @ here.base[whole]
    apart = np.abs(moved[:, None] - there.base[None]).max(axis=(2, 3))
    assert apart.min(axis=1).max() < 1e-9


def test_six_joints(rng):
    robot = nj.robots.abb_irb120(up="z")
    rotations = np.stack([pose[:3, :3] for pose in random_poses(rng, (6,)).astype(float)])
    robot_map = capability(robot, Grid.covering((-0.8,) * 3, (0.8, 0.8, 1.1), 0.2), rotations)
    base = upright(0.5, 0.5, 0, np.pi)
    _, tasks = tasks_of(robot, base, rng, 5)
    region = ((0.3, 0.3), (0.7, 0.7))
    found = base_placement(robot_map, tasks, robot=robot, region=region, most=10_000)
    (here,) = np.nonzero(np.abs(found.base - base).max(axis=(1, 2)) < 1e-9)
    assert found.share[here] == [1]


def test_what_the_map_could_not_decide_is_tried(scara, scara_map, rng):
    _, tasks = tasks_of(scara, upright(0, 0, 0, 0), rng, 2)
    nothing = scara_map["reachability_index"]
    undecided = scara_map.assign(reachability_index=0 * nothing, undecided_fraction=nothing)
    sure, unsure = (
        base_placement(m, tasks, robot=scara, headings=4) for m in (scara_map, undecided)
    )
    np.testing.assert_array_equal(sure.base, unsure.base)


def test_out_of_reach(scara, scara_map):
    high = np.array(scara.home)[None] + np.eye(4)[3] * [[0], [0], [9], [0]]
    found = base_placement(scara_map, high, robot=scara, headings=10)
    assert found.base.shape == (0, 4, 4)
    assert found.reached.shape == (0, 1)
    assert found.evaluated == 0
    again = base_placement(scara_map, high, headings=10)
    assert again.candidates == found.candidates, "the robot is that of the map"
    places, rest = divmod(found.candidates, 10)
    assert rest == 0
    free = dataclasses.replace(
        scara,
        lower=np.array([-np.inf, *scara.lower[1:]]),
        upper=np.array([np.inf, *scara.upper[1:]]),
    )
    # Its first joint does what a turn of the base would do.
    assert base_placement(scara_map, high, robot=free, headings=10).candidates == places


def sheared():
    """Not a rigid motion."""
    pose = np.eye(4)
    pose[0, 1] = 0.1
    return pose[None]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"task_poses": np.eye(4)}, r"task_poses: expected shape \(t, 4, 4\), got \(4, 4\)"),
        ({"task_poses": np.eye(3)[None]}, r"task_poses: expected shape"),
        ({"task_poses": np.zeros((0, 4, 4))}, "task_poses: expected at least one pose"),
        ({"task_poses": sheared()}, "task_poses: expected a rigid motion"),
        ({"task_poses": np.full((1, 4, 4), np.nan)}, "task_poses: expected a rigid motion"),
        ({"region": ((0, 0), (1, -1))}, "region: .* empty"),
        ({"region": ((0, 0), (1, np.nan))}, "region: expected .* finite"),
        ({"region": (0, 1)}, "region: expected"),
        ({"step": 0.0}, "step: expected a positive length in metres, got 0.0"),
        ({"step": 1e-9}, "step: .* gives"),
        ({"step": np.nan}, "step: expected"),
        ({"headings": 0}, "headings: expected 1 or more, got 0"),
        ({"most": 0}, "most: expected 1 or more, got 0"),
        ({"height": np.inf}, "height: expected finite metres, got inf"),
    ],
)
def test_bad_input(scara, scara_map, change, message):
    given = {"task_poses": np.asarray(scara.home)[None], "robot": scara, **change}
    with pytest.raises(ValueError, match=message):
        base_placement(scara_map, **given)


def test_a_map_of_nothing(scara, scara_map):
    nothing = scara_map.assign(reachability_index=0 * scara_map["reachability_index"])
    with pytest.raises(ValueError, match="map: nothing in it is reached"):
        base_placement(nothing, np.asarray(scara.home)[None], robot=scara)
