"""Capability maps: their numbers, and what becomes of them when a run is killed or shared."""

from __future__ import annotations

import jax
import numpy as np
import pytest

import niryo_jax as nj
from benchmarks.workspace import poses_at, slow_path
from niryo_jax import workspace as ws
from niryo_jax.lanes.singular import singular_values

for needed in ("xarray", "zarr"):
    pytest.importorskip(needed)

VOXEL, COUNT = 0.15, 40


@pytest.fixture(scope="module")
def niryo_map():
    """A coarse map of the Niryo One with the numbers of every pose."""
    return ws.capability_map(nj.robots.niryo_one(), VOXEL, orientations=COUNT, full=True)


@pytest.fixture(scope="module")
def scara():
    return nj.robots.load("abb_irb910sc")


def test_every_number_is_that_of_the_slow_path(niryo_map, niryo):
    """Each variable again, by public functions on whole solution sets and plain numpy."""
    centres = np.stack(np.meshgrid(*(niryo_map[axis] for axis in "xyz"), indexing="ij"), axis=-1)
    truths = slow_path(niryo, poses_at(niryo_map, centres), niryo_map.attrs["dexterous"])
    of_chunks = {"orientation_reached", "solution_histogram", "orientation_quaternion"}
    assert set(truths) == set(niryo_map) - of_chunks
    for name, truth in truths.items():
        np.testing.assert_allclose(niryo_map[name], truth, rtol=3e-7, atol=1e-9, err_msg=name)
    count = truths["pose_solutions"]
    np.testing.assert_array_equal(
        niryo_map.orientation_reached.sum("chunk"), (count > 0).sum((0, 1, 2))
    )
    np.testing.assert_array_equal(
        niryo_map.solution_histogram.sum("chunk"), np.bincount(count.ravel(), minlength=17)
    )


def test_no_reachable_pose_is_called_unreachable(niryo, niryo_map, rng):
    q = rng.uniform(niryo.lower, niryo.upper, (4_096, 6))
    pose = nj.forward_kinematics(niryo, q)
    measures = ws.pose_measures(niryo, pose)
    assert np.all(measures.solutions > 0)
    assert np.all(measures.complete)
    centres = [niryo_map[axis].values for axis in "xyz"]
    lower, upper = ([c[end] for c in centres] for end in (0, -1))
    position = np.asarray(pose)[:, :3, 3]
    assert np.all(position >= np.array(lower) - VOXEL / 2)
    assert np.all(position <= np.array(upper) + VOXEL / 2)


@pytest.mark.parametrize("shape", [(), (1,), (3, 2), (0,)])
def test_measures_of_poses_in_any_batch(scara, shape):
    q = np.broadcast_to((scara.lower + scara.upper) / 2, (*shape, 4))
    measures = ws.pose_measures(scara, nj.forward_kinematics(scara, q))
    for value in measures:
        assert value.shape == shape
    assert np.all(measures.solutions >= 1)


def test_a_pose_that_is_none_has_no_solutions(scara):
    measures = ws.pose_measures(scara, np.full((2, 4, 4), np.nan))
    assert np.all(measures.solutions == 0)
    assert np.all(np.isnan(measures.manipulability))


@pytest.mark.parametrize("length", [1.0, 0.25])
def test_length_scales_singular_values_alone(scara, length, rng):
    q = rng.uniform(scara.lower, scara.upper, (50, 4))
    pose = nj.forward_kinematics(scara, q)
    measures = ws.pose_measures(scara, pose, length=length)
    solutions = nj.inverse_kinematics(scara, pose)
    scaled = nj.singular_values(scara, solutions.q, length=length)[..., -1]
    plain = nj.singular_values(scara, solutions.q)
    for found, values in (
        (measures.singular_value, scaled),
        (measures.manipulability, np.prod(plain, axis=-1)),
    ):
        best = np.where(solutions.within_limits, values, -np.inf).max(-1)
        np.testing.assert_allclose(found, best, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("rows", "columns"), [(6, 6), (6, 7), (6, 4), (3, 6), (1, 2), (5, 5)])
def test_singular_values_are_those_of_lapack(rows, columns, rng):
    matrix = rng.standard_normal((rows, columns, 200))
    matrix[0] *= 1e-9
    matrix[:, :, 0] = 0.0
    truth = np.linalg.svd(np.moveaxis(matrix, -1, 0), compute_uv=False).T
    for dtype in (np.float64, np.float32):
        found = np.asarray(singular_values(jax.numpy.asarray(matrix, dtype)))
        assert found.shape == truth.shape
        found = -np.sort(-found, axis=0)
        np.testing.assert_allclose(
            found, truth, rtol=0, atol=20 * np.finfo(dtype).eps * truth.max()
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"voxel": 0.0}, "voxel"),
        ({"voxel": np.nan}, "voxel"),
        ({"voxel": 5.0}, "voxel"),
        ({"bounds": ((0, 0, 0), (1, 0, 1))}, "bounds"),
        ({"bounds": ((0, 0, np.nan), (1, 1, 1))}, "bounds"),
        ({"orientations": 0}, "orientations: expected 1 or more"),
        ({"length": 0.0}, "length"),
        ({"dexterous": -1.0}, "dexterous"),
        ({"share": (2, 2)}, "share"),
    ],
)
def test_bad_arguments_are_named(niryo, options, message):
    with pytest.raises(ValueError, match=message):
        ws.capability_map(niryo, **{"voxel": 0.2, "orientations": 2, **options})


def test_limits_that_are_no_numbers_are_refused(niryo):
    leaves, tree = jax.tree.flatten(niryo)
    lower = np.array([np.nan, *niryo.lower[1:]])
    broken = jax.tree.unflatten(tree, [*leaves[:2], lower, leaves[3]])
    with pytest.raises(ValueError, match="limits"):
        ws.capability_map(broken, 0.2)
