"""The commands `niryo-jax workspace`: one small map, and all that is done with it."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("rich")
pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytest.importorskip("matplotlib")
pytest.importorskip("filelock")

from niryo_jax import workspace as ws
from niryo_jax.cli.app import run

VOXEL, COUNT = 0.1, 16
# More than the arm reaches, so that there are two chunks.
CORNERS = ("-0.5", "-0.5", "-0.2", "1.5", "0.5", "0.8")
MAP = ("map", "niryo_one", "--voxel", VOXEL, "--orientations", COUNT, "--bounds", *CORNERS)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A store that the command has written; its exit code, stdout and stderr."""
    store = tmp_path_factory.mktemp("map") / "one.zarr"
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(["workspace", *map(str, MAP), "--store", str(store), "--json"])
    return store, (code, out.getvalue(), err.getvalue())


@pytest.fixture
def store(made):
    return made[0]


@pytest.fixture
def copy(store, tmp_path):
    """A copy of the store, to be damaged."""
    return Path(shutil.copytree(store, tmp_path / "copy.zarr"))


@pytest.fixture
def unfinished(copy):
    """A store in which one of two chunks is not done."""
    (copy / "chunk_checksum" / "c" / "1").unlink()
    return copy


@pytest.fixture
def cli(cli):
    """Run a command of `niryo-jax workspace`."""
    return lambda *arguments: cli("workspace", *arguments)


@pytest.fixture
def asked(monkeypatch):
    """What the command asks of the library, which is interrupted at once."""
    calls = []

    def interrupted(*positional, **named):
        calls.append((positional, named))
        raise KeyboardInterrupt

    monkeypatch.setattr(ws, "capability_map", interrupted)
    monkeypatch.setattr(ws, "resume", interrupted)
    return calls


# --- map, resume, info


def test_map_prints_one_document_of_what_it_stored(made):
    store, (code, out, err) = made
    document = json.loads(out)
    found = ws.open_map(store)
    assert code == 0
    assert "niryo_one: 2,000 voxels of 0.1 m x 16 orientations = 32,000 poses" in err
    assert document["store"] == str(store)
    assert document["voxels"] * document["orientations"] == document["poses"] == 32_000
    assert document["poses_reached"] == int(found.orientation_reached.sum()) > 400
    assert (document["exact"], document["poses_undecided"]) == (True, 0)
    assert document["chunks_missing"] == 0
    count = int((found.reachability_index > 0).sum())
    assert document["volume"] == pytest.approx(count * VOXEL**3)
    assert document["volume_lower"] < document["volume"] < document["volume_upper"]
    assert 0 < document["dexterous_volume"] <= document["volume"]
    assert document["most_solutions"] == int(found.solutions_most.max())
    assert document["best_manipulability"] == pytest.approx(float(found.manipulability_best.max()))


def test_the_same_map_again_and_resume_and_info_say_the_same(made, as_json):
    store, (_, out, _) = made
    for arguments in ((*MAP, "--store", store), ("resume", store), ("info", store)):
        assert as_json(*arguments) == (0, json.loads(out))


def test_info_is_a_table(cli, store):
    code, out, err = cli("info", store)
    assert (code, err) == (0, "")
    assert "Capability map of niryo_one" in out
    assert " 32,000" in out
    assert "0.1 m" in out


def test_another_map_is_not_written_over_a_store(cli, store):
    code, out, err = cli(*MAP, "--voxel", 0.2, "--store", store)
    assert (code, out) == (6, "")
    assert "it was made with voxel = 0.1, not 0.2" in err


def test_volumes_of_a_map_that_is_not_finished_are_not_known(cli, as_json, unfinished):
    code, document = as_json("info", unfinished)
    assert (code, document["chunks_missing"]) == (0, 1)
    for name in ("volume", "volume_lower", "volume_upper", "dexterous_volume"):
        assert document[name] is None
    assert "1 of 2 chunks are not computed yet" in cli("info", unfinished)[2]


def test_a_map_that_is_not_finished_is_good_for_nothing_else(cli, store, unfinished, tmp_path):
    tasks = tmp_path / "tasks.txt"
    tasks.write_text("0.2 0 0.2 1 0 0 0\n")
    picture = tmp_path / "x.png"
    for arguments in (
        ("plot", unfinished, "-o", picture),
        ("export", unfinished, tmp_path / "x.npz"),
        ("place-base", unfinished, tasks),
        ("compare", store, unfinished),
    ):
        code, out, err = cli(*arguments)
        assert (code, out) == (6, "")
        assert f"1 of 2 chunks are not computed yet; `niryo-jax workspace resume {unfinished}`" in (
            err
        )
    assert {file.name for file in tmp_path.iterdir()} == {"copy.zarr", "tasks.txt"}


def test_a_damaged_map_and_what_is_no_map_end_with_6(cli, as_json, copy, tmp_path):
    (chunk,) = (copy / "reachability_index" / "c" / "0" / "0").iterdir()
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 1
    chunk.write_bytes(content)
    code, document = as_json("info", copy)
    assert (code, document["exit_code"]) == (6, 6)
    assert "damaged" in document["error"]
    for path, sentence in ((tmp_path / "absent", "no such store"), (tmp_path, "no capability map")):
        for command in ("info", "resume", "plot"):
            code, out, err = cli(command, path)
            assert (code, out) == (6, "")
            assert sentence in err


def test_a_store_whose_name_is_markup_is_shown_as_it_is(cli, store, tmp_path):
    odd = shutil.copytree(store, tmp_path / "[bold]a:x:[")
    code, out, _ = cli("info", odd)
    assert code == 0
    assert "[bold]a:x:[" in "".join(out.split())


def test_options_reach_the_library(cli, asked, tmp_path):
    store = tmp_path / "x.zarr"
    options = "--kind directions --rolls 4 --seed 3 --dexterous 0.1 --length 0.5 --full --share 1/3"
    cli(*MAP, "--store", store, *options.split())
    cli("resume", store, "--share", "0/2")
    (robot, voxel, corners, chosen), named = asked[0]
    assert (robot.name, voxel) == ("niryo_one", VOXEL)
    np.testing.assert_array_equal(np.concatenate(corners), np.array(CORNERS, float))
    assert (chosen.kind, len(chosen), chosen.rolls, chosen.seed) == ("directions", COUNT, 4, 3)
    del named["progress"]
    assert named == {
        "store": store,
        "full": True,
        "dexterous": 0.1,
        "length": 0.5,
        "collisions": None,
        "share": (1, 3),
    }
    (resumed,), named = asked[1]
    assert (resumed, named["share"]) == (store, (0, 2))


@pytest.mark.parametrize("arguments", [("map", "niryo_one"), ("resume", "any.zarr")])
def test_an_interrupted_map_says_that_it_can_be_resumed(cli, as_json, asked, arguments):
    code, out, err = cli(*arguments)
    assert (code, out) == (130, "")
    assert "error: interrupted; the map can be resumed" in err
    code, document = as_json(*arguments)
    assert code == document["exit_code"] == 130
    assert len(asked) == 2


@pytest.mark.skipif(
    importlib.util.find_spec("yourdfpy") is None, reason="yourdfpy is not installed"
)
def test_the_store_of_a_urdf_stays_in_the_directory(cli, asked, tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(
        """<robot name="../[/b]arm"><link name="a"/><link name="b"/>
        <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
        <origin xyz="0.3 0 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
        <joint name="f" type="fixed"><parent link="b"/><child link="c"/><origin xyz="0.3 0 0"/>
        </joint><link name="c"/></robot>"""
    )
    code, _, err = cli("map", file, "--orientations", COUNT)
    assert (code, len(asked)) == (130, 1)
    assert "../[/b]arm: " in err
    assert asked[0][1]["store"] == Path("_b_arm.zarr")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--voxel 0", "voxel: expected a positive length in metres, got 0.0"),
        ("--voxel nan", "voxel: expected a positive length"),
        ("--voxel 9", "larger than"),
        ("--voxel x", "'--voxel'"),
        ("--bounds 0 0 0 1 1", "--bounds"),
        ("--bounds 0 0 0 0 1 1", "bounds: the box is empty"),
        ("--bounds nan 0 0 1 1 1", "bounds: expected finite corners"),
        ("--orientations 0", "'--orientations'"),
        ("--orientations 100000000000000", "number: expected at most"),
        (
            "--kind bad",
            "kind: expected one of 'super-fibonacci', ",
        ),
        ("--rolls 2", 'only the kind "directions" has rolls'),
        ("--kind directions --rolls 7", "divides"),
        ("--seed -1", "'--seed'"),
        ("--dexterous nan", "dexterous: expected a number of at least 0"),
        ("--length 0", "length: expected a positive number"),
        ("--share 2/2", "--share: expected I/N"),
        ("--share x", "--share: expected I/N"),
        ("--share 0/2 --distributed", "expected one of the two"),
        ("--distributed", "--distributed: "),
        ("--tip x", "--base and --tip choose the chain of a URDF or MJCF file"),
    ],
)
def test_wrong_options_end_with_2_and_leave_no_store(
    cli, as_json, tmp_path, monkeypatch, options, sentence
):
    monkeypatch.chdir(tmp_path)
    code, out, err = cli(*MAP, *options.split())
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert sentence in err
    code, document = as_json(*MAP, *options.split())
    assert code == document["exit_code"] == 2
    assert sentence in document["error"]
    assert not list(tmp_path.iterdir())


def test_a_store_that_cannot_be_made_ends_with_6(cli, tmp_path):
    (tmp_path / "file").touch()
    code, out, err = cli(*MAP, "--store", tmp_path / "file" / "x.zarr")
    assert (code, out) == (6, "")
    assert "cannot make the store" in err


def test_without_the_extra_one_line_says_what_to_install(as_json, store, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    for arguments in (("info", store), ("resume", store), MAP):
        code, document = as_json(*arguments)
        assert code == 5
        assert 'pip install "niryo_jax[workspace]"' in document["error"]


# --- plot, export, compare


def test_plots_are_written_where_they_are_wanted(cli, store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for kind, suffix in (("solution-counts", "svg"), ("dexterity", "pdf")):
        output = tmp_path / f"any.{suffix}"
        assert cli("plot", store, "--kind", kind, "-o", output) == (0, f"wrote {output}\n", "")
        assert output.read_bytes().startswith(starts[suffix])
    assert cli("plot", store, "--kind", "manipulability") == (
        0,
        "wrote one-manipulability.png\n",
        "",
    )
    of = ("--kind", "sections", "--of", "limit_margin_best")
    assert cli("plot", store, *of) == (0, "wrote one-limit_margin_best.png\n", "")
    for file in tmp_path.glob("*.png"):
        assert file.read_bytes().startswith(starts["png"])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("plot MAP --kind bad", "--kind: expected one of overview, sections"),
        ("plot MAP --of x", "--of goes with --kind sections"),
        ("plot MAP --kind sections --of x", "expected a variable 'x'"),
        ("plot MAP -o x.bmp", ".png, .svg, .pdf"),
        ("plot MAP -o absent/x.png", "cannot write absent/x.png: No such file or directory"),
        ("export MAP x.txt", "ends in .npz or .ply"),
        ("export MAP x.npz --of reachability_index", "--of goes with a .ply file"),
        ("export MAP x.ply --of x", "expected a variable 'x'"),
        ("export MAP absent/x.npz", "cannot write absent/x.npz: No such file or directory"),
        ("compare MAP MAP -o absent/x.png", "cannot write absent/x.png"),
    ],
)
def test_wrong_outputs_end_with_2_and_leave_no_file(
    cli, store, tmp_path, monkeypatch, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    code, out, err = cli(*(store if word == "MAP" else word for word in arguments.split()))
    assert (code, out) == (2, "")
    assert sentence in err
    assert not list(tmp_path.iterdir())


def test_exports_hold_the_map(cli, store, tmp_path):
    archive, cloud = tmp_path / "x.npz", tmp_path / "x.ply"
    assert cli("export", store, archive) == (0, f"wrote {archive}\n", "")
    found = ws.open_map(store)
    with np.load(archive) as arrays:
        np.testing.assert_array_equal(arrays["reachability_index"], found.reachability_index)
    assert cli("export", store, cloud, "--of", "dexterous_fraction")[0] == 0
    points = int((found.dexterous_fraction > 0).sum())
    assert f"\nelement vertex {points}\n".encode() in cloud.read_bytes()


def test_a_map_compared_with_itself(cli, as_json, store, tmp_path):
    picture = tmp_path / "x.svg"
    code, document = as_json("compare", store, store, "-o", picture)
    assert code == 0
    assert document["volume_gained"] == document["volume_lost"] == 0
    assert document["volume_common"] == document["volume_a"] == as_json("info", store)[1]["volume"]
    assert picture.exists()
    code, out, _ = cli("compare", store, store)
    assert code == 0
    # A threshold of singular values is no volume.
    (line,) = (line for line in out.splitlines() if line.split()[:1] == ["dexterous"])
    assert line.split() == ["dexterous", "0.05"]


# --- place-base


@pytest.fixture
def placed(monkeypatch):
    """What the command asks of `base_placement`, which gives two placements of two task poses."""
    calls = []

    def base_placement(found, tasks, **named):
        calls.append((found, tasks, named))
        reached = np.array([[True, calls[-1][1][0, 0, 3] < 1], [True, False]])
        base = np.tile(np.eye(4), (2, 1, 1))
        position, margin = base[:, :3, 3], np.array([0.5, np.inf])
        heading = np.array([0.0, np.pi / 2])
        share, volume = reached.mean(axis=1), np.array([0.01, np.nan])
        return ws.BasePlacements(base, position, heading, reached, share, margin, volume, 9, 5)

    monkeypatch.setattr(ws, "base_placement", base_placement)
    return calls


def test_placements_are_shown_and_options_reach_the_library(cli, as_json, store, placed, tmp_path):
    tasks = tmp_path / "tasks.txt"
    tasks.write_text(
        "# x y z, w x y z\n0.2 0 0.1 1 0 0 0\n\n0.3 0.1 0.2 2 0 2 0  # of any length\n"
    )
    options = "--headings 7 --height 0.4 --region -1 -2 1 2 --step 0.3 --most 2"
    code, document = as_json("place-base", store, tasks, *options.split())
    assert code == 0
    assert (document["candidates"], document["evaluated"]) == (9, 5)
    first, second = document["placements"]
    assert (first["reached"], first["margin"], first["manipulability"]) == ([True, True], 0.5, 0.01)
    assert (second["reached"], second["margin"], second["manipulability"]) == (
        [True, False],
        None,
        None,
    )
    found, poses, named = placed[0]
    assert found.attrs["robot_name"] == "niryo_one"
    expected = np.tile(np.eye(4), (2, 1, 1))
    expected[:, :3, 3] = [[0.2, 0, 0.1], [0.3, 0.1, 0.2]]
    expected[1, :3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    np.testing.assert_allclose(poses, expected, atol=1e-15)
    del named["progress"]
    assert named == {
        "region": ((-1, -2), (1, 2)),
        "step": 0.3,
        "headings": 7,
        "height": 0.4,
        "most": 2,
    }
    np.save(tmp_path / "tasks.npy", poses)
    code, out, _ = cli("place-base", store, tmp_path / "tasks.npy")
    assert code == 0
    np.testing.assert_array_equal(placed[1][1], poses)
    assert "9 candidates, 5 evaluated exactly" in out
    assert "2 of 2" in out
    assert "90.0" in out


def test_tasks_that_are_not_all_reached_end_with_3(cli, as_json, store, placed, tmp_path):
    tasks = tmp_path / "tasks.txt"
    tasks.write_text("5 0 0.1 1 0 0 0\n0.3 0.1 0.2 1 0 0 0\n")
    code, out, err = cli("place-base", store, tasks)
    assert (code, "1 of 2" in out) == (3, True)
    assert "error: no placement was found from which all task poses are reached" in err
    code, document = as_json("place-base", store, tasks)
    assert code == document["exit_code"] == 3
    assert document["placements"][0]["reached"] == [True, False]


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("x.txt", b"", "got none"),
        ("x.txt", b"# nothing\n", "got none"),
        ("x.txt", b"0 0 0 1 0 0\n", "got one of 6"),
        ("x.txt", b"0 0 0 0 0 0 0\n", "quaternions other than zero"),
        ("x.txt", b"nan 0 0 1 0 0 0\n", "finite numbers"),
        ("x.txt", b"a b c d e f g\n", "cannot read"),
        ("x.txt", b"\xff\xfe\x00", "cannot read"),
        ("x.npy", b"", "cannot read"),
        ("x.npy", b"\x80\x04garbage", "cannot read"),
    ],
)
def test_tasks_that_cannot_be_read_end_with_2(
    cli, as_json, store, tmp_path, name, content, sentence
):
    tasks = tmp_path / name
    tasks.write_bytes(content)
    code, out, err = cli("place-base", store, tasks)
    assert (code, out) == (2, "")
    assert err.startswith("error: TASKS: ")
    assert sentence in err
    assert as_json("place-base", store, tasks)[0] == 2


@pytest.mark.parametrize(
    "options",
    ["--headings 0", "--most 0", "--step 0", "--height nan", "--region 1 1 0 0", "--step 1e-7"],
)
def test_wrong_numbers_of_placements_end_with_2(as_json, store, tmp_path, options):
    tasks = tmp_path / "x.txt"
    tasks.write_text("0.2 0 0.1 1 0 0 0\n")
    code, document = as_json("place-base", store, tasks, *options.split())
    assert code == document["exit_code"] == 2
