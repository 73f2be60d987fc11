"""Figures, exports and comparisons of maps, on made-up maps whose answers are known."""

from __future__ import annotations

import errno
import json
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("xarray")

import matplotlib.text as mpl_text
import xarray as xr

from niryo_jax.workspace import export, plots
from niryo_jax.workspace.compare import compare
from niryo_jax.workspace.grid import Grid
from niryo_jax.workspace.orientations import orientations
from niryo_jax.workspace.variables import VARIABLES, VOXELS

CHUNKS, SLOTS = 3, 8


def ball_map(
    radius=0.4, centre=(0.0, 0.0, 0.2), voxel=0.05, number=20, name="ball", kind="super-fibonacci"
):
    """A capability map of an arm that reaches a ball, best in its middle."""
    middle = np.array(centre)
    grid = Grid.covering(middle - radius, middle + radius, voxel)
    chosen = orientations(number, kind)
    x, y, z = np.meshgrid(*grid.centres, indexing="ij")
    distance = np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
    inside = distance < radius
    depth = np.where(inside, 1 - distance / max(radius, 1e-9), 0.0)
    reached = np.ceil(depth * number)
    rng = np.random.default_rng(0)
    arrays = {}
    for variable, one in VARIABLES.items():
        if one.dims != VOXELS:
            continue
        share = reached / number
        if variable.startswith("solutions"):
            values = np.round(8 * share)
        elif (
            one.fill != one.fill
            and variable.endswith(("_best", "_mean"))
            and (not variable.startswith("solutions"))
        ):
            values = np.where(inside, 0.1 + depth * rng.uniform(0.9, 1.0, depth.shape), np.nan)
        else:
            factor = {"dexterous_fraction": 0.6, "undecided_fraction": 0.0}.get(variable, 1.0)
            values = share * factor
        arrays[variable] = (VOXELS, values.astype(one.dtype))
    shares = rng.multinomial(int(inside.sum()), np.ones(CHUNKS) / CHUNKS)
    weights = 0.3 + 0.7 * chosen.rotations[:, 0, 0] ** 2
    arrays["orientation_reached"] = (
        ("chunk", "orientation"),
        (shares[:, None] * weights).astype(np.int32),
    )
    histogram = np.zeros((CHUNKS, SLOTS + 1), np.int64)
    histogram[0, 0] = grid.size * number - int(reached.sum())
    histogram[1, 4] = int(reached.sum()) // 2
    histogram[2, 2] = int(reached.sum()) - int(reached.sum()) // 2
    arrays["solution_histogram"] = (("chunk", "solutions"), histogram)
    arrays["orientation_quaternion"] = (("orientation", "quaternion"), chosen.quaternions)
    described = {
        variable: {"long_name": VARIABLES[variable].meaning, "units": VARIABLES[variable].units}
        for variable in arrays
        if variable in VARIABLES
    }
    return xr.Dataset(
        {
            variable: (dims, values, described.get(variable, {}))
            for variable, (dims, values) in arrays.items()
        },
        {axis: (axis, at, {"units": "m"}) for axis, at in zip(VOXELS, grid.centres)},
        {
            "robot": "{}",
            "robot_name": name,
            "voxel": voxel,
            "first_voxel": list(grid.first),
            "shape": list(grid.shape),
            "orientations": number,
            "orientation_kind": chosen.kind,
            "orientation_seed": chosen.seed,
            "orientation_rolls": chosen.rolls,
            "orientation_axis": None if chosen.axis is None else list(chosen.axis),
            "dexterous": 0.05,
            "length": 1.0,
            "method": "complete",
            "exact": 1,
        },
    )


def nothing_reached():
    """The map of an arm that reaches none of its box."""
    empty = ball_map(number=5)
    for name in set(empty.data_vars) - {"orientation_quaternion"}:
        missing = np.nan if empty[name].isnull().any() else 0
        empty[name] = xr.full_like(empty[name], missing)
    return empty


@pytest.fixture(scope="module")
def ball():
    return ball_map()


def images(figure):
    """The pictures of a figure's sections: values, where blank, and the box they cover."""
    return [axes.images[0] for axes in figure.axes if axes.images]


def words(figure):
    """All text of a figure."""
    return " ".join(text.get_text() for text in figure.findobj(mpl_text.Text))


def test_sections_show_the_planes_of_the_map_where_they_are(ball):
    front, side, top = images(plots.sections(ball))
    highest = int(np.argmax(ball.reachability_index.sum(("x", "y")).values))
    half = ball.attrs["voxel"] / 2
    planes = [
        (front, ball.reachability_index.sel(y=half), ("x", "z")),
        (side, ball.reachability_index.sel(x=half), ("y", "z")),
        (top, ball.reachability_index.isel(z=highest), ("x", "y")),
    ]
    for image, plane, (across, up) in planes:
        drawn, truth = image.get_array(), plane.transpose(up, across).values
        np.testing.assert_array_equal(drawn.filled(0), truth)
        np.testing.assert_array_equal(np.ma.getmaskarray(drawn), truth == 0)
        faces = [ball[axis].values[[0, -1]] + [-half, half] for axis in (across, up)]
        np.testing.assert_allclose(image.get_extent(), np.ravel(faces), atol=1e-12)
        assert image.axes.get_aspect() == 1
        assert image.axes.get_xlabel() == f"{across} (m)"


def test_the_colours_of_shares_start_at_zero_and_end_at_the_best_of_the_map(ball):
    for image in images(plots.sections(ball)):
        assert image.norm.vmin == 0
        assert image.norm.vmax == float(ball.reachability_index.max())


def test_the_outline_separates_what_is_reached_from_what_is_not(ball):
    image = images(plots.sections(ball))[0]
    (outline,) = (one for one in image.axes.collections if hasattr(one, "get_segments"))
    middles = {tuple(np.round(segment.mean(0), 6)) for segment in outline.get_segments()}
    reached = ~np.ma.getmaskarray(image.get_array())
    x, z, half = ball.x.values, ball.z.values, ball.attrs["voxel"] / 2

    def at(i, k):
        return 0 <= i < x.size and 0 <= k < z.size and reached[k, i]

    expected = {
        tuple(np.round([x[i] + step * half * (not up), z[k] + step * half * up], 6))
        for k, i in zip(*np.nonzero(reached))
        for up in (0, 1)
        for step in (-1, 1)
        if not at(i + step * (not up), k + step * up)
    }
    assert middles == expected


def test_a_box_that_does_not_hold_the_base_is_cut_through_its_middle():
    away = ball_map(radius=0.2, centre=(2.0, -3.0, 0.0))
    text = words(plots.sections(away))
    assert "section at y = -2975 mm" in text
    assert "section at x = 2025 mm" in text


def test_a_forward_map_is_drawn_and_exported(ball, tmp_path):
    counts = (ball.reachability_index * 1000).astype(np.int64)
    forward = xr.Dataset({"samples": counts}, attrs={"robot_name": "ball", "voxel": 0.05})
    front = images(plots.sections(forward, "samples"))[0]
    truth = counts.sel(y=0.025).transpose("z", "x").values
    np.testing.assert_array_equal(front.get_array().filled(0), truth)
    number = export.to_ply(forward, tmp_path / "map.ply", "samples", at_least=500)
    assert number == int((counts >= 500).sum())


def test_solution_counts_are_shares_of_all_poses(ball):
    (axes,) = plots.solution_counts(ball).axes
    poses = ball.solution_histogram.sum("chunk").values
    heights = np.array([bar.get_height() for bar in axes.patches])
    np.testing.assert_allclose(heights, 100 * poses[: heights.size] / poses.sum())
    assert heights.size == 5
    assert "poses" in words(axes.figure)


def test_solution_counts_of_very_different_shares_are_drawn_on_a_logarithmic_scale(ball):
    (axes,) = plots.solution_counts(ball).axes
    assert axes.get_yscale() == "linear"
    rare = ball.copy()
    rare["solution_histogram"] = ball.solution_histogram * 1000
    rare.solution_histogram[0, 7] = 1
    (axes,) = plots.solution_counts(rare).axes
    assert axes.get_yscale() == "log"
    assert axes.get_ylim()[0] < 100 / int(rare.solution_histogram.sum())


@pytest.mark.parametrize("kind", ["super-fibonacci", "directions"])
def test_volume_by_orientation_points_where_the_tool_points(kind):
    map = ball_map(kind=kind)
    figure = plots.volume_by_orientation(map)
    curve, sphere = figure.axes[0], figure.axes[1]
    heights = curve.patches[0].get_data().values
    volumes = map.orientation_reached.sum("chunk").values * map.attrs["voxel"] ** 3
    np.testing.assert_allclose(heights, np.sort(volumes)[::-1])

    x_axes = orientations(20, kind).rotations[:, :, 0]
    mesh = sphere.collections[0]
    colours_ = mesh.get_array().reshape(180, 360)
    for direction, volume in zip(x_axes, volumes):
        up = np.degrees(np.arcsin(direction[2]))
        right = -np.degrees(np.arctan2(direction[1], direction[0]))
        row = min(int(up + 90), 179)
        assert colours_[row, min(int(right + 180), 359)] == pytest.approx(volume)


def test_manipulability_is_blank_where_it_is_not_a_number(ball):
    front = images(plots.manipulability(ball))[0]
    truth = ball.manipulability_best.sel(y=0.025).transpose("z", "x").values
    np.testing.assert_array_equal(np.ma.getmaskarray(front.get_array()), np.isnan(truth))
    assert "m³" in words(front.axes.figure)


@pytest.mark.parametrize("name", plots.PLOTS)
def test_a_map_in_which_nothing_is_reached_is_still_drawn(name, tmp_path):
    figure = plots.PLOTS[name](nothing_reached())
    plots.save(figure, tmp_path / "blank.png")
    if name in ("overview", "sections", "dexterity", "manipulability"):
        assert "nothing is reached" in words(figure)


def test_every_figure_says_what_it_is_of(ball):
    for plot in plots.PLOTS.values():
        text = words(plot(ball))
        assert all(part in text for part in ("ball", "50 mm", "20 orientations")), text


def test_a_map_without_the_variable_names_those_it_has(ball):
    slim = ball[["reachability_index", "solution_histogram"]]
    with pytest.raises(ValueError, match=r"'limit_margin_best'.*it has reachability_index"):
        plots.sections(slim, "limit_margin_best")
    with pytest.raises(ValueError, match="dexterous_fraction"):
        plots.dexterity(slim)
    with pytest.raises(ValueError, match="manipulability_best"):
        plots.manipulability(slim)
    with pytest.raises(ValueError, match=r"'orientation_reached'.*has none"):
        plots.volume_by_orientation(slim)
    with pytest.raises(ValueError, match=r"'solution_histogram'"):
        plots.overview(slim[["reachability_index"]])


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf", "SVG"])
def test_a_saved_figure_is_the_same_on_every_run(ball, tmp_path, suffix):
    paths = [tmp_path / f"{run}.{suffix}" for run in "ab"]
    for path in paths:
        plots.save(plots.overview(ball), path)
    first, second = (path.read_bytes() for path in paths)
    assert first == second
    start = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix.lower()]
    assert first.startswith(start)
    assert sorted(path.name for path in tmp_path.iterdir()) == [path.name for path in paths]


def test_the_text_of_an_svg_stays_text(ball, tmp_path):
    plots.save(plots.overview(ball), tmp_path / "map.svg")
    assert ">x (m)</text>" in (tmp_path / "map.svg").read_text()


def test_an_unknown_suffix_names_those_that_are_known(ball, tmp_path):
    with pytest.raises(ValueError, match=r"\.png, \.svg, \.pdf, got .*map\.bmp"):
        plots.save(plots.solution_counts(ball), tmp_path / "map.bmp")
    assert not list(tmp_path.iterdir())


def test_npz_brings_a_map_back_bit_for_bit(ball, tmp_path):
    path = tmp_path / "map.npz"
    export.to_npz(ball, path)
    back = export.from_npz(path)
    assert back.attrs == ball.attrs
    assert list(back.data_vars) == list(ball.data_vars)
    assert set(back.coords) == set(ball.coords)
    for name, array in ball.variables.items():
        assert back.variables[name].dims == array.dims
        assert back.variables[name].dtype == array.dtype
        assert back.variables[name].attrs == array.attrs
        assert back.variables[name].values.tobytes() == array.values.tobytes()
    again = tmp_path / "again.npz"
    export.to_npz(back, again)
    assert again.read_bytes() == path.read_bytes()


def test_npz_is_read_by_numpy_alone(ball, tmp_path):
    export.to_npz(ball, tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as archive:
        metadata = json.loads(str(archive["metadata"]))
        np.testing.assert_array_equal(archive["solutions_mean"], ball.solutions_mean)
        np.testing.assert_array_equal(archive["x"], ball.x)
    assert metadata["attributes"]["robot_name"] == "ball"
    assert metadata["arrays"]["position_noise_best"]["attributes"]["units"] == "m/rad"
    assert metadata["arrays"]["solution_histogram"]["dims"] == ["chunk", "solutions"]


def test_a_map_from_a_store_is_exported_like_one_in_memory(ball, tmp_path):
    ball.to_zarr(tmp_path / "map.zarr", consolidated=False)
    stored = xr.open_zarr(tmp_path / "map.zarr", chunks=None, consolidated=False)
    export.to_npz(stored, tmp_path / "map.npz")
    assert export.from_npz(tmp_path / "map.npz").identical(ball)
    paths = [tmp_path / "stored.ply", tmp_path / "memory.ply"]
    for map, path in zip((stored, ball), paths):
        export.to_ply(map, path, "solutions_mean")
    of_store, of_memory = (read_ply(path) for path in paths)
    for name in of_memory.dtype.names:  # a store lists its variables in another order
        np.testing.assert_array_equal(of_store[name], of_memory[name])


def test_npz_attributes_of_numpy_become_those_of_python(ball, tmp_path):
    numbered = ball.assign_attrs(
        voxel=np.float64(0.05), axis=np.array([1.0, 0.0]), exact=np.int8(1)
    )
    export.to_npz(numbered, tmp_path / "map.npz")
    back = export.from_npz(tmp_path / "map.npz").attrs
    assert (back["voxel"], back["axis"], back["exact"]) == (0.05, [1.0, 0.0], 1)
    with pytest.raises(TypeError, match=r"attributes: .*got set"):
        export.to_npz(ball.assign_attrs(bad={1}), tmp_path / "bad.npz")


def test_a_file_that_is_not_a_whole_map_is_refused(ball, tmp_path):
    whole = tmp_path / "map.npz"
    export.to_npz(ball, whole)
    content = bytearray(whole.read_bytes())
    cut, damaged, other, text = (tmp_path / name for name in ("cut", "damaged", "other", "text"))
    cut.write_bytes(content[: len(content) // 2])
    content[len(content) // 2] ^= 0xFF
    damaged.write_bytes(content)
    with other.open("wb") as file:
        np.savez(file, a=np.arange(3))
    text.write_text("not an archive")
    for path in (cut, damaged, other, text):
        with pytest.raises(ValueError, match=f"to_npz, got .*{path.name}"):
            export.from_npz(path)
    with pytest.raises(FileNotFoundError):
        export.from_npz(tmp_path / "missing.npz")


def test_a_failed_write_leaves_what_was_there(ball, tmp_path, monkeypatch):
    path = tmp_path / "map.npz"
    path.write_text("before")
    monkeypatch.setattr(np.lib.format, "write_array", disk_is_full)
    with pytest.raises(OSError, match="No space left"):
        export.to_npz(ball, path)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_is_replaced_at_once(ball, tmp_path):
    path = tmp_path / "map.ply"
    path.write_text("before")
    with path.open() as reader:  # whoever reads the old file goes on reading it, whole
        export.to_ply(ball, path)
        assert reader.read() == "before"
    assert len(read_ply(path))


def disk_is_full(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


PLY_TYPES = {"float": "<f4", "uchar": "u1"}


def read_ply(path):
    """The points of a binary PLY, by its header."""
    content = path.read_bytes()
    head, _, body = content.partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    ((_, _, number),) = (line for line in lines if line[0] == "element")
    fields = [(line[2], PLY_TYPES[line[1]]) for line in lines if line[0] == "property"]
    points = np.frombuffer(body, fields)
    assert len(points) == int(number)
    return points


def test_ply_holds_the_reached_voxels_with_all_their_numbers(ball, tmp_path):
    path = tmp_path / "map.ply"
    number = export.to_ply(ball, path)
    points = read_ply(path)
    assert number == len(points) == int((ball.reachability_index > 0).sum())
    per_voxel = [name for name in ball.data_vars if ball[name].dims == VOXELS]
    assert list(points.dtype.names) == [*VOXELS, "red", "green", "blue", *per_voxel]
    for point in points[:: len(points) // 7]:
        truth = ball.sel({axis: point[axis] for axis in VOXELS}, method="nearest")
        for name in (*VOXELS, *per_voxel):
            assert point[name] == np.float32(truth[name].values)
    best = points[np.argmax(points["reachability_index"])]
    assert best[["red", "green", "blue"]].item() == (253, 231, 36)  # the top end of viridis


def test_ply_takes_only_what_is_asked_for(ball, tmp_path):
    path = tmp_path / "map.ply"
    assert export.to_ply(ball, path, at_least=0.5) == int((ball.reachability_index >= 0.5).sum())
    assert read_ply(path)["reachability_index"].min() >= 0.5
    margin = ball.limit_margin_best
    assert export.to_ply(ball, path, "limit_margin_best") == int(margin.notnull().sum())
    assert export.to_ply(nothing_reached(), path) == len(read_ply(path)) == 0
    with pytest.raises(ValueError, match="'solution_histogram' over"):
        export.to_ply(ball, path, "solution_histogram")


def test_comparison_counts_what_is_gained_and_lost():
    a, b = ball_map(0.3, name="first"), ball_map(0.35, (0.1, 0.0, 0.4), name="second")
    found = compare(a, b)
    reached = [
        {tuple(np.round(p, 9)) for p in points(map, map.reachability_index > 0)} for map in (a, b)
    ]
    cube = 0.05**3
    truth = {
        "volume_a": reached[0],
        "volume_b": reached[1],
        "volume_common": reached[0] & reached[1],
        "volume_lost": reached[0] - reached[1],
        "volume_gained": reached[1] - reached[0],
    }
    for name, voxels in truth.items():
        assert voxels
        assert found.attrs[name] == pytest.approx(len(voxels) * cube)
    for change, name in ((-1, "volume_lost"), (1, "volume_gained")):
        assert {tuple(np.round(p, 9)) for p in points(found, found.change == change)} == truth[name]
    both = points(found, found.reached == 3)
    assert {tuple(np.round(p, 9)) for p in both} == truth["volume_common"]
    assert (found.attrs["robot_a"], found.attrs["robot_b"]) == ("first", "second")
    mean = float(a.reachability_index.where(a.reachability_index > 0).mean())
    assert found.attrs["reachability_index_mean_a"] == pytest.approx(mean, rel=1e-6)


def points(map, where):
    """(n, 3) centres of the voxels where something holds."""
    chosen = np.nonzero(where.transpose(*VOXELS).values)
    return np.stack([map[axis].values[index] for axis, index in zip(VOXELS, chosen)], -1)


def test_comparison_takes_what_lies_outside_of_a_box_as_unreached():
    a, b = ball_map(0.2), ball_map(0.2, (0.9, 0.0, 0.2))
    found = compare(a, b)
    assert found.x.size == round(1.3 / 0.05)
    np.testing.assert_allclose(np.diff(found.x), 0.05)
    gap = found.sel(x=0.45, method="nearest")
    assert float(np.abs(gap.reachability_index_difference).max()) == 0
    assert bool(gap.manipulability_best_difference.isnull().all())
    of_b = found.reachability_index_difference.sel(b.coords)
    np.testing.assert_array_equal(of_b, b.reachability_index)
    of_a = found.reachability_index_difference.sel(a.coords)
    np.testing.assert_array_equal(of_a, -a.reachability_index)
    assert found.attrs["volume_common"] == 0


def test_a_comparison_with_itself_and_backwards(ball):
    other = ball_map(0.35)
    there, back, none = compare(ball, other), compare(other, ball), compare(ball, ball)
    for name in there.data_vars:
        if name != "reached":
            np.testing.assert_array_equal(there[name], -back[name])
        if name.endswith("_difference"):
            assert not np.any(none[name].fillna(0))
    assert none.attrs["volume_gained"] == none.attrs["volume_lost"] == 0
    assert none.attrs["volume_common"] == there.attrs["volume_a"]
    assert not [name for name in there.data_vars if "orientation" in name or "histogram" in name]
    assert there.position_noise_best_difference.attrs["units"] == "m/rad"


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (ball_map(voxel=0.04), "voxel: .*0.05 in a and 0.04 in b"),
        (ball_map(number=10), "orientations: .*20 in a and 10 in b"),
        (ball_map(kind="random"), "orientation_kind: .*super-fibonacci in a and random in b"),
        (ball_map().assign_attrs(orientation_seed=3), "orientation_seed: .*0 in a and 3 in b"),
        (ball_map().assign_attrs(length=0.5), "length: .*1.0 in a and 0.5 in b"),
        (ball_map().assign_attrs(dexterous=0.1), "dexterous: .*0.05 in a and 0.1 in b"),
        (ball_map().isel(orientation=slice(None, None, -1)), "orientation_quaternion"),
        (ball_map().assign_coords(x=ball_map().x + 0.01), "b: .*along x"),
        (ball_map()[["solution_histogram"]], "'reachability_index'"),
    ],
)
def test_maps_that_cannot_be_compared_say_why(ball, other, named):
    with pytest.raises(ValueError, match=named):
        compare(ball, other)


def test_differences_are_drawn_about_zero_and_blank_where_neither_reaches(tmp_path):
    found = compare(ball_map(0.3), ball_map(0.35, (0.1, 0.0, 0.4), name="second"))
    figure = plots.differences(found)
    values, kinds = images(figure)
    plane = found.sel(y=0.025)
    neither = plane.reached.transpose("z", "x").values == 0
    for image, name in ((values, "reachability_index_difference"), (kinds, "change")):
        np.testing.assert_array_equal(np.ma.getmaskarray(image.get_array()), neither)
        truth = np.where(neither, 0, plane[name].transpose("z", "x").values)
        np.testing.assert_array_equal(image.get_array().filled(0), truth)
    assert values.norm.vmin == -values.norm.vmax
    assert "ball → second" in words(figure)
    plots.save(figure, tmp_path / "differences.pdf")
    assert export.to_ply(found, tmp_path / "differences.ply", "change") == int(
        (found.reached > 0).sum()
    )
    with pytest.raises(ValueError, match=r"'nothing_difference'.*reachability_index_difference"):
        plots.differences(found, "nothing")


def test_importing_needs_no_extra_and_using_names_it(ball, tmp_path, monkeypatch):
    modules = "plots, niryo_jax.workspace.export, niryo_jax.workspace.compare"
    script = f"import sys, niryo_jax.workspace.{modules}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {"xarray", "matplotlib", "zarr"} & set(run.stdout.split())
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for use in (plots.overview, lambda map: export.to_ply(map, tmp_path / "map.ply")):
        with pytest.raises(ImportError, match=r"niryo_jax\[workspace\]"):
            use(ball)
