"""Histograms of the tool's positions, and volumes and sections of maps."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from arms import arm, forward
from support import unit_vectors

pytest.importorskip("xarray")

import xarray as xr

import niryo_jax as nj
from niryo_jax.workspace import forward as forward_module
from niryo_jax.workspace.extent import joint_ranges
from niryo_jax.workspace.forward import forward_map, joint_samples
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.variables import VOXELS
from niryo_jax.workspace.volume import reachable_volume, section


def gantry(sides=(0.5, 0.4, 0.3), low=(0.0, 0.0, 0.0)):
    """Three slides along x, y and z: its workspace is a box."""
    home = np.eye(4)
    return nj.Robot.from_axes(
        np.eye(3),
        np.zeros((3, 3)),
        home,
        prismatic=[True] * 3,
        lower=np.array(low),
        upper=np.array(low) + sides,
        name="gantry",
    )


def shell_arm(a=0.3, b=0.2):
    """Links a and b on a shoulder, a spherical wrist, the tool at its centre, no limits."""
    home = np.eye(4)
    home[0, 3] = a + b
    axes = [[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]]
    points = [[0, 0, 0], [0, 0, 0], [a, 0, 0], *[[a + b, 0, 0]] * 3]
    return nj.Robot.from_axes(axes, points, home, name="shell")


def shell_volume(a=0.3, b=0.2):
    return 4 / 3 * np.pi * ((a + b) ** 3 - abs(a - b) ** 3)


def map_of(grid, inside, name="reachability_index"):
    """A map of what a function of the voxels' centres (..., 3) says."""
    centres = np.stack(np.meshgrid(*grid.centres, indexing="ij"), axis=-1)
    values = np.asarray(inside(centres), np.float32)
    return xr.Dataset({name: (VOXELS, values)}, grid.coordinates, {"voxel": grid.voxel})


# Samples of the joints


def test_any_part_of_the_samples_can_be_had_by_itself(niryo):
    whole = np.asarray(joint_samples(niryo, 1000, first=123, seed=4))
    parts = [joint_samples(niryo, 250, first=123 + start, seed=4) for start in range(0, 1000, 250)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert np.abs(np.asarray(joint_samples(niryo, 1000, first=123)) - whole).max() > 0.1


def test_the_sequence_does_not_repeat_after_2_32_samples(niryo):
    start = 2**32 - 3
    across = np.asarray(joint_samples(niryo, 6, first=start))
    after = np.asarray(joint_samples(niryo, 3, first=2**32))
    np.testing.assert_array_equal(across[3:], after)
    assert np.abs(after - np.asarray(joint_samples(niryo, 3))).max() > 0.1
    far = np.asarray(joint_samples(niryo, 3, first=10**15))
    assert np.all((far >= niryo.lower) & (far <= niryo.upper))


@pytest.mark.parametrize("seed", [0, 1])
def test_samples_are_more_even_than_chance(niryo, seed):
    count = 2**16
    low, high = joint_ranges(niryo)
    q = (np.asarray(joint_samples(niryo, count, seed=seed)) - low) / (high - low)
    assert np.all((q > 0) & (q < 1))
    # By chance the cumulative share of a joint would be off by 1 / sqrt(count).
    off = np.abs(np.sort(q, axis=0) - (np.arange(count)[:, None] + 0.5) / count)
    assert off.max() < 0.25 / np.sqrt(count)
    # So would be the mean of a function of all of them, in units of its deviation.
    function = np.prod(1 + 0.5 * np.sin(2 * np.pi * q + 1), axis=1)
    assert abs(function.mean() - 1) < 0.25 * function.std() / np.sqrt(count)


# Forward maps


def histogram(grid, points):
    edges = [np.append(c - grid.voxel / 2, c[-1] + grid.voxel / 2) for c in grid.centres]
    return np.histogramdd(points, edges)[0]


def test_counts_are_those_of_the_positions_in_numpy(niryo):
    samples = 50_000
    counted = forward_map(niryo, samples, voxel=0.05, seed=2)
    points = forward(niryo, np.asarray(joint_samples(niryo, samples, seed=2)))[0][:, :3, 3]
    grid = Grid.covering(points.min(axis=0), points.max(axis=0), 0.05)
    truth = map_of(grid, lambda centres: histogram(grid, points))["reachability_index"]
    counts, truth = xr.align(counted["samples"], truth, join="outer", fill_value=0)
    # A position on a face may be rounded to either side.
    assert np.abs(counts - truth).sum() <= 4
    assert counted["samples"].dtype == np.int64
    assert counted.attrs["outside"] == 0
    assert counted.attrs["samples"] == samples
    assert (counted.attrs["robot_name"], counted.attrs["seed"]) == ("niryo_one", 2)
    assert counted["x"].attrs["units"] == "m"


def test_cores_and_parts_make_no_difference(niryo, monkeypatch):
    samples = 300_001
    plain = forward_map(niryo, samples, voxel=0.05)
    told = []
    monkeypatch.setattr(forward_module, "_PART", 2**15)
    for cores in (1, 3):
        monkeypatch.setattr(forward_module, "cores", lambda cores=cores: cores)
        again = forward_map(
            niryo, samples, voxel=0.05, progress=lambda done, total: told.append((done, total))
        )
        xr.testing.assert_identical(plain, again)
    assert [done for done, _ in told[-4:]] == [98304, 196608, 294912, samples]
    assert {total for _, total in told} == {samples}


def test_bounds_cut_and_what_is_outside_is_counted(niryo):
    whole = forward_map(niryo, 200_000, voxel=0.05)
    part = forward_map(niryo, 200_000, voxel=0.05, bounds=((0, -0.2, 0.1), (0.4, 0.2, 0.3)))
    np.testing.assert_array_equal(part["x"], whole["x"].sel(x=part["x"]))
    cut = whole["samples"].sel({axis: part[axis] for axis in VOXELS})
    np.testing.assert_array_equal(part["samples"], cut)
    assert part.attrs["outside"] == 200_000 - int(cut.sum()) > 0


def test_float32_differs_only_by_rounding(niryo):
    with jax.enable_x64(False):
        single = forward_map(niryo, 200_000, voxel=0.05)
    assert single.attrs["dtype"] == "float32"
    assert single.attrs["outside"] == 0
    double = forward_map(niryo, 200_000, voxel=0.05)
    assert np.abs(single["samples"] - double["samples"]).sum() < 20


def test_slides_fill_their_box_evenly():
    samples = 1_000_000
    counted = forward_map(gantry(), samples, voxel=0.05)
    assert counted["samples"].shape == (10, 8, 6)
    assert counted.attrs["outside"] == 0
    share = counted["samples"] * (480 / samples)
    assert abs(share - 1).max() < 0.02  # by chance it would be 0.02 RMS


def test_an_arm_in_a_plane_stays_in_its_layer():
    home = np.eye(4)
    home[:3, 3] = 0.5, 0.0, 0.1  # the plane is a face between two voxels
    robot = nj.Robot.from_axes([[0, 0, 1]] * 2, [[0, 0, 0], [0.3, 0, 0]], home)
    counted = forward_map(robot, 10_000, voxel=0.1)
    assert counted["samples"].shape == (10, 10, 1)
    assert counted.attrs["outside"] == 0


def test_bad_arguments_are_refused(niryo, rng):
    for samples in (0, -1):
        with pytest.raises(ValueError, match="samples"):
            forward_map(niryo, samples, voxel=0.1)
    with pytest.raises(ValueError, match="samples"):
        joint_samples(niryo, 2**24 + 1)
    with pytest.raises(ValueError, match="seed"):
        forward_map(niryo, 10, voxel=0.1, seed=-1)
    with pytest.raises(ValueError, match="first"):
        joint_samples(niryo, 10, first=-1)
    with pytest.raises(ValueError, match="voxel"):
        forward_map(niryo, 10, voxel=0.0)
    with pytest.raises(ValueError, match="voxels"):
        forward_map(niryo, 10, voxel=1e-4)
    with pytest.raises(ValueError, match="limits"):
        forward_map(arm("gantry", rng), 10, voxel=0.1)


# Volumes


def encloses(volume, truth):
    return volume.lower - 1e-12 <= truth <= volume.upper + 1e-12


@pytest.mark.parametrize("voxel", [0.05, 0.02, 0.011])
def test_the_bounds_hold_for_balls_and_shells(rng, voxel):
    for _ in range(5):
        centre, (inner, outer) = rng.uniform(-0.1, 0.1, 3), (0.11, 0.43)
        grid = Grid.covering(centre - outer, centre + outer, voxel)

        def inside(points, centre=centre, inner=inner, outer=outer):
            distance = np.linalg.norm(points - centre, axis=-1)
            return (distance > inner) & (distance < outer)

        found = reachable_volume(map_of(grid, inside))
        truth = 4 / 3 * np.pi * (outer**3 - inner**3)
        assert encloses(found, truth)
        assert abs(found.value - truth) < 0.15 * (found.upper - found.lower)
        surface = 4 * np.pi * (outer**2 + inner**2)
        assert found.upper - found.lower < 2 * surface * voxel


def test_the_bounds_hold_for_planes(rng):
    voxel, count = 0.1, 12
    grid = Grid(voxel, (0, 0, 0), (count,) * 3)
    side = count * voxel
    fine = (np.arange(8 * count) + 0.5) * voxel / 8
    x, y = np.meshgrid(fine, fine, indexing="ij")
    for _ in range(30):
        normal = unit_vectors(rng).astype(float)
        offset = normal @ np.full(3, side / 2) + rng.uniform(-0.1, 0.1)

        def inside(points, normal=normal, offset=offset):
            return points @ normal < offset

        # The plane cuts each line along z once; what lies below is known exactly.
        at = (offset - normal[0] * x - normal[1] * y) / normal[2]
        below = np.clip(at, 0, side) if normal[2] > 0 else side - np.clip(at, 0, side)
        assert encloses(reachable_volume(map_of(grid, inside)), below.sum() * (voxel / 8) ** 2)


def test_the_bounds_are_reached_by_a_cube_whose_faces_run_along_centres():
    grid, side = Grid(0.1, (-4, -4, -4), (8, 8, 8)), 0.5
    for nudge, voxels in ((1e-12, 6), (-1e-12, 4)):
        half = side / 2 + nudge
        cube = reachable_volume(
            map_of(grid, lambda points, half=half: np.abs(points).max(axis=-1) < half)
        )
        assert cube.value == pytest.approx(voxels**3 * 1e-3)
        assert encloses(cube, side**3)
        if nudge > 0:
            assert cube.lower == pytest.approx(side**3)


def test_the_bounds_hold_for_boxes_and_for_holes(rng):
    voxel = 0.1
    grid = Grid(voxel, (-12, -12, -12), (24, 24, 24))
    for _ in range(40):
        low, high = rng.uniform(-0.9, -0.1, 3), rng.uniform(0.1, 0.9, 3)

        def inside(points, low=low, high=high):
            return np.all((points > low) & (points < high), axis=-1)

        truth = np.prod(high - low)
        assert encloses(reachable_volume(map_of(grid, inside)), truth)
        around = reachable_volume(map_of(grid, lambda p, inside=inside: ~inside(p)))
        assert encloses(around, 2.4**3 - truth)


def test_the_volume_of_a_spherical_wrist_arm_from_complete_inverse_kinematics():
    robot, voxel = shell_arm(), 0.04
    grid = Grid.covering((-0.5,) * 3, (0.5,) * 3, voxel)

    def reached(points):
        poses = np.zeros((*points.shape[:-1], 4, 4))
        poses[..., :3, :3] = [[0, -1, 0], [0.6, 0, -0.8], [0.8, 0, 0.6]]
        poses[..., :3, 3], poses[..., 3, 3] = points, 1
        found = nj.inverse_kinematics(robot, poses.reshape(-1, 4, 4)).found
        return np.asarray(found).any(axis=-1).reshape(points.shape[:-1])

    found = reachable_volume(map_of(grid, reached))
    assert encloses(found, shell_volume())
    assert found.value == pytest.approx(shell_volume(), rel=0.02)


def test_the_volume_of_a_forward_map():
    box = reachable_volume(
        forward_map(gantry(low=(0.013, 0.0, 0.02)), 300_000, voxel=0.05), of="samples"
    )
    assert encloses(box, 0.5 * 0.4 * 0.3)
    shell = reachable_volume(forward_map(shell_arm(), 4_000_000, voxel=0.04), of="samples")
    assert encloses(shell, shell_volume())
    assert shell.value > shell_volume()


def test_a_share_says_which_voxels_count():
    grid = Grid(0.1, (0, 0, 0), (10, 10, 10))
    shares = map_of(grid, lambda p: np.clip(p[..., 0], 0, 0.95) + 0.05)
    for at_least, layers in ((0.0, 10), (0.7, 4), (1.0, 1), (1.1, 0)):
        found = reachable_volume(shares, at_least=at_least)
        assert found.value == pytest.approx(layers * 0.1)
    nothing = reachable_volume(map_of(grid, lambda p: np.full(p.shape[:-1], np.nan)))
    assert nothing == (0.0, 0.0, 0.0, 0)
    # Dimensions in another order are the same map.
    turned = shares.transpose("z", "x", "y")
    assert reachable_volume(turned, at_least=0.5) == reachable_volume(shares, at_least=0.5)


def test_what_is_not_a_map_is_refused():
    grid = Grid(0.1, (0, 0, 0), (3, 3, 3))
    map = map_of(grid, lambda p: p[..., 0])
    map["flat"] = ("x", np.zeros(3))
    for name in ("flat", "nothing"):
        with pytest.raises(ValueError, match=r"reachability_index$"):
            reachable_volume(map, of=name)
    with pytest.raises(ValueError, match="map"):
        reachable_volume(map.drop_attrs())
    with pytest.raises(ValueError, match="map"):
        section(map.drop_vars("x"), "y", 0.0)


# Sections


@pytest.mark.parametrize("axis", VOXELS)
def test_a_section_is_the_plane_of_voxels_that_holds_the_coordinate(axis):
    grid = Grid(0.1, (-3, -7, 2), (6, 5, 4))
    map = map_of(grid, lambda p: p @ [1.0, 10.0, 100.0])
    first = grid.first[VOXELS.index(axis)]
    for k, centre in enumerate(grid.centres[VOXELS.index(axis)]):
        expected = map.isel({axis: k})
        for at in (centre, centre - 0.049, centre + 0.049, (first + k) * 0.1):
            xr.testing.assert_identical(section(map, axis, at), expected)
    low, high = (float(corner[VOXELS.index(axis)]) for corner in (grid.lower, grid.upper))
    xr.testing.assert_identical(section(map, axis, high), map.isel({axis: -1}))
    xr.testing.assert_identical(section(map, axis, round(low, 6)), map.isel({axis: 0}))
    for at in (low - 0.01, high + 0.01):
        with pytest.raises(ValueError, match=f"spans {axis} from {low:.6g} to {high:.6g} m"):
            section(map, axis, at)
    with pytest.raises(ValueError, match="at: expected a number"):
        section(map, axis, np.nan)
    with pytest.raises(ValueError, match="axis"):
        section(map, "w", 0.0)
