"""Capability maps: their numbers, and what becomes of them when a run is killed or shared."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax import workspace as ws
from niryo_jax.lanes.singular import singular_values
from niryo_jax.workspace.orientations import rotations_of

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


def poses_of(map):
    """(x, y, z, M, 4, 4) the poses that a map is of, put together by hand."""
    centres = np.stack(np.meshgrid(map.x, map.y, map.z, indexing="ij"), axis=-1)
    rotations = rotations_of(map.orientation_quaternion.values)
    pose = np.zeros((*centres.shape[:-1], len(rotations), 4, 4))
    pose[..., :3, :3], pose[..., 3, 3] = rotations, 1.0
    pose[..., :3, 3] = centres[..., None, :]
    return pose


def test_every_number_is_that_of_the_slow_path(niryo_map, niryo):
    """Each variable again, by public functions on whole solution sets and plain numpy."""
    solutions = nj.inverse_kinematics(niryo, poses_of(niryo_map))
    within = np.asarray(solutions.within_limits)
    count = within.sum(-1)
    reached = count > 0
    equal = np.testing.assert_array_equal
    equal(niryo_map.pose_solutions, count)
    equal(niryo_map.pose_solutions_unlimited, solutions.count)
    equal(niryo_map.reachability_index, reached.mean(-1).astype(np.float32))
    equal(
        niryo_map.reachability_index_unlimited,
        (np.asarray(solutions.count) > 0).mean(-1).astype(np.float32),
    )
    equal(niryo_map.solutions_most, count.max(-1))
    np.testing.assert_allclose(niryo_map.solutions_mean, count.mean(-1), rtol=1e-6)
    equal(niryo_map.undecided_fraction, 0.0)
    equal(niryo_map.orientation_reached.sum("chunk"), reached.sum((0, 1, 2)))
    equal(niryo_map.solution_histogram.sum("chunk"), np.bincount(count.ravel(), minlength=17))
    body = np.asarray(nj.body_jacobian(niryo, solutions.q))
    smallest = np.linalg.svd(body, compute_uv=False)[..., -1]
    margin = np.minimum(solutions.q - niryo.lower, niryo.upper - solutions.q).min(-1)
    truths = {
        "manipulability": np.asarray(nj.manipulability(niryo, solutions.q)),
        "singular_value": smallest,
        "limit_margin": margin,
        "position_noise": -np.sqrt((body[..., 3:, :] ** 2).sum((-1, -2))),
    }
    some = reached.any(-1)
    for name, values in truths.items():
        best = np.where(within, values, -np.inf).max(-1)
        sign = -1 if name == "position_noise" else 1
        pose = np.where(reached, sign * best, np.nan)
        np.testing.assert_allclose(niryo_map[f"pose_{name}"], pose, rtol=1e-6, atol=1e-9)
        top = sign * np.where(reached, best, -np.inf).max(-1)
        np.testing.assert_allclose(
            niryo_map[f"{name}_best"], np.where(some, top, np.nan), rtol=1e-6, atol=1e-9
        )
        mean = np.where(reached, sign * best, 0).sum(-1) / np.maximum(reached.sum(-1), 1)
        np.testing.assert_allclose(
            niryo_map[f"{name}_mean"], np.where(some, mean, np.nan), rtol=1e-6, atol=1e-9
        )
    clear = np.where(within, smallest, 0).max(-1) >= niryo_map.attrs["dexterous"]
    equal(niryo_map.dexterous_fraction, clear.mean(-1).astype(np.float32))


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
        ({"orientations": 0}, "number"),
        ({"length": 0.0}, "length"),
        ({"dexterous": -1.0}, "dexterous"),
        ({"share": (2, 2)}, "share"),
    ],
)
def test_bad_arguments_are_named(niryo, options, message):
    with pytest.raises(ValueError, match=message):
        ws.capability_map(niryo, **{"voxel": 0.2, "orientations": 2, **options})


def test_limits_that_are_no_numbers_are_refused(niryo):
    broken = dataclasses.replace(niryo, lower=np.array([np.nan, *niryo.lower[1:]]))
    with pytest.raises(ValueError, match="limits"):
        ws.capability_map(broken, 0.2)
