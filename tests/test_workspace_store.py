"""Maps on disk: runs that are killed, shared and resumed; stores that are damaged or in use."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import jax
import numpy as np
import pytest

import niryo_jax as nj
from niryo_jax import workspace as ws
from niryo_jax.workspace.store import MapStore

for needed in ("xarray", "zarr", "filelock"):
    pytest.importorskip(needed)


def scara():
    return nj.robots.load("abb_irb910sc")


def turns():
    """Orientations that a SCARA can take: turns about the vertical."""
    about = nj.so3.exp(np.linspace(-3, 3, 16)[:, None] * np.array([0.0, 1.0, 0.0]))
    return ws.given(np.asarray(about) @ np.asarray(scara().home)[:3, :3])


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def contents(directory):
    """Every file of a store but its locks, as bytes."""
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file() and not path.name.startswith(".lock")
    }


MAKE = """
    import os, sys
    import jax
    jax.config.update("jax_enable_x64", True)
    store, devices, address, index = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    jax.config.update("jax_num_cpu_devices", devices)
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    import contextlib
    import numpy as np
    import niryo_jax as nj
    from niryo_jax import workspace as ws
    from niryo_jax.workspace import processes
    processes._PATIENCE = float(sys.argv[5])
    company = contextlib.nullcontext()
    if address != "alone":
        company = ws.one_of_many(address, 2, index, heartbeat_timeout_seconds=10)
    with company:
        robot = nj.robots.load("abb_irb910sc")
        turns = nj.so3.exp(np.linspace(-3, 3, 16)[:, None] * np.array([0.0, 1.0, 0.0]))
        rotations = np.asarray(turns) @ np.asarray(robot.home)[:3, :3]
        ws.capability_map(robot, 0.03, orientations=ws.given(rotations), store=store, full=True)
    print("done")
"""


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Compiled programs that all processes of this module share."""
    return os.environ.get("JAX_COMPILATION_CACHE_DIR") or str(tmp_path_factory.mktemp("cache"))


def run_script(script, *arguments, **options):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
        **options,
    )


@pytest.fixture(scope="module")
def start(cache):
    """Start a process that makes the map of a SCARA: (store, devices, address, index)."""

    def start(store, devices=1, address="alone", index=0, patience=300):
        return subprocess.Popen(
            [
                sys.executable,
                "-c",
                textwrap.dedent(MAKE),
                *map(str, (store, devices, address, index, patience)),
            ],
            env={
                **os.environ,
                "JAX_PLATFORMS": "cpu",
                "JAX_COMPILATION_CACHE_DIR": cache,
                # One program and much work for it: it is compiled to run fast.
                "XLA_FLAGS": "",
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return start


def finish(process):
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert out.startswith("done")


@pytest.fixture(scope="module")
def stored(start, tmp_path_factory):
    """The map of a run that nothing disturbs."""
    store = tmp_path_factory.mktemp("whole") / "map.zarr"
    finish(start(store))
    return store


@pytest.fixture(scope="module")
def uninterrupted(stored):
    assert float(ws.open_map(stored).reachability_index.max()) > 0.5
    return contents(stored)


def kill_when_some_is_done(process, store, chunks, later):
    """Kill -9 some time after so many chunks are done."""
    deadline = time.monotonic() + 120
    done = store / "chunk_checksum" / "c"
    while time.monotonic() < deadline and process.poll() is None:
        if done.is_dir() and len(list(done.iterdir())) >= chunks:
            time.sleep(later)
            break
        time.sleep(0.001)
    process.kill()
    process.communicate()


def test_a_killed_run_goes_on_to_the_same_bytes(start, uninterrupted, tmp_path, rng):
    store = tmp_path / "map.zarr"
    for chunks in (0, 1, 4):
        kill_when_some_is_done(start(store), store, chunks, rng.uniform(0, 0.05))
    left = contents(store) if store.exists() else {}
    assert not {name for name in left if not name.startswith(".") and name not in uninterrupted} - {
        name for name in left if ".partial" in name
    }
    finish(start(store))
    found = contents(store)
    assert {name: found[name] for name in uninterrupted} == uninterrupted
    assert np.all(MapStore.open(store).done())


def test_eight_devices_make_the_same_bytes(start, uninterrupted, tmp_path):
    finish(start(tmp_path / "map.zarr", devices=8))
    assert contents(tmp_path / "map.zarr") == uninterrupted


def test_two_processes_make_the_same_bytes_also_when_one_is_lost(start, uninterrupted, tmp_path):
    store = tmp_path / "map.zarr"

    def both(patience):
        address = f"127.0.0.1:{free_port()}"
        return [start(store, address=address, index=index, patience=patience) for index in range(2)]

    first, second = both(5)
    kill_when_some_is_done(second, store, 2, 0.0)
    # The other one brings its own share all the same.
    finish(first)
    assert 0 < np.sum(~MapStore.open(store).done()) <= 5
    for process in both(300):
        finish(process)
    found = contents(store)
    assert {name: found[name] for name in uninterrupted} == uninterrupted


class TestStore:
    """Stores that are damaged, of another map, in use or out of room: nothing is computed here."""

    @pytest.fixture
    def copy(self, stored, tmp_path):
        return Path(shutil.copytree(stored, tmp_path / "copy.zarr"))

    def test_xarray_opens_it_without_us(self, stored):
        import xarray

        with xarray.open_zarr(stored, consolidated=False) as opened:
            assert opened.x.attrs["units"] == "m"
            assert float(opened.reachability_index.max()) > 0.5
            again, robot = ws.robot_of(opened), scara()
        for field in ("screws", "home", "lower", "upper"):
            np.testing.assert_array_equal(getattr(again, field), getattr(robot, field))

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"voxel": 0.02}, "voxel = 0.03, not 0.02"),
            ({"orientations": 7}, "orientations = 16, not 7"),
            ({"dexterous": 0.1}, "dexterous = 0.05, not 0.1"),
            ({"full": False}, "full = 1, not 0"),
            ({"robot": nj.robots.load("niryo_ned")}, "robot_name"),
        ],
    )
    def test_other_parameters_are_refused_by_name(self, copy, stored, change, message):
        asked = {"robot": scara(), "voxel": 0.03, "orientations": turns(), "full": True, **change}
        with pytest.raises(ws.StoreError, match=message):
            ws.capability_map(store=copy, **asked)
        assert contents(copy) == contents(stored)

    def test_the_same_number_of_other_orientations_is_refused(self, copy):
        others = ws.given(turns().rotations[::-1])
        with pytest.raises(ws.StoreError, match="other orientations"):
            ws.capability_map(scara(), 0.03, orientations=others, store=copy, full=True)

    def test_other_precision_is_refused(self, copy):
        with jax.enable_x64(False), pytest.raises(ws.StoreError, match="dtype = float64"):
            ws.resume(copy)

    def test_a_finished_map_costs_nothing(self, copy, monkeypatch):
        monkeypatch.setattr("niryo_jax.workspace.capability.TileProgram", None)
        before = contents(copy)
        ws.resume(copy)
        assert contents(copy) == before

    @pytest.mark.parametrize("damage", [b"", b"nonsense"])
    def test_a_damaged_chunk_is_found_and_mended(self, copy, stored, damage):
        (copy / "reachability_index" / "c" / "0" / "0" / "0").write_bytes(damage)
        with pytest.raises(ws.StoreError, match="chunks 0 are damaged"):
            ws.open_map(copy)
        with pytest.warns(UserWarning, match="chunk 0 is damaged"):
            ws.resume(copy)
        assert contents(copy) == contents(stored)

    def test_a_lost_chunk_is_found(self, copy):
        shutil.rmtree(copy / "pose_manipulability" / "c" / "0")
        with pytest.raises(ws.StoreError, match="damaged"):
            ws.open_map(copy)

    def test_what_is_no_map_is_left_alone(self, tmp_path):
        place = tmp_path / "thesis"
        place.mkdir()
        (place / "chapter.tex").write_text("precious")
        with pytest.raises(ws.StoreError, match="no capability map"):
            ws.capability_map(scara(), 0.2, store=place)
        assert contents(place) == {"chapter.tex": b"precious"}
        with pytest.raises(ws.StoreError, match="no such store"):
            ws.resume(tmp_path / "nowhere")

    def test_damaged_metadata_are_named(self, copy):
        (copy / "zarr.json").write_text("{")
        with pytest.raises(ws.StoreError, match="damaged"):
            ws.open_map(copy)

    def test_a_map_in_the_making_is_not_opened_by_mistake(self, copy):
        shutil.rmtree(copy / "chunk_checksum" / "c")
        with pytest.raises(ws.StoreError, match=r"0 of \d+ chunks are done"):
            ws.open_map(copy)
        assert ws.open_map(copy, partial=True).attrs["chunks_missing"] >= 1

    def test_two_processes_do_not_share_a_share(self, copy):
        with MapStore.open(copy).locked(0), pytest.raises(ws.StoreError, match="another process"):
            ws.resume(copy)

    @pytest.mark.skipif(sys.platform == "win32", reason="no limits of a process on this system")
    def test_no_room_is_said_and_nothing_is_lost(self, copy, stored):
        """As on a full disk: the system refuses files of more than so many bytes."""
        shutil.rmtree(copy / "chunk_checksum" / "c")
        script = """
            import resource, signal, sys
            import jax
            jax.config.update("jax_enable_x64", True)
            from niryo_jax import workspace as ws
            from niryo_jax.workspace.store import MapStore
            from pathlib import Path
            full = MapStore.open(Path(sys.argv[1]))
            chunk = next(full.spec().chunks())
            arrays = {name: found.values[tuple(chunk.place)] for name, found in
                      full.dataset().data_vars.items() if found.dims[:1] == ("x",)}
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (20, 20))
            try:
                full.write(chunk, arrays)
            except ws.StoreError as error:
                print(error)
        """
        said = run_script(script, copy).stdout
        assert "cannot write chunk 0" in said
        assert "kept" in said
        assert not any(path.name.endswith(".partial") for path in copy.rglob("*"))

    @pytest.mark.skipif(sys.platform == "win32", reason="whoever asks may make a folder /proc")
    def test_a_place_that_cannot_be_written_is_named(self):
        with pytest.raises(ws.StoreError, match=r"/proc/map\.zarr: cannot make the store"):
            ws.capability_map(scara(), 0.2, orientations=2, store="/proc/map.zarr")

    @pytest.mark.parametrize(
        "change", [{"voxel": "abc"}, {"robot": 5}, {"shape": [4000, 40, 40]}, {"method": None}]
    )
    def test_tampered_attributes_are_named(self, copy, change):
        document = json.loads((copy / "zarr.json").read_text())
        if change == {"method": None}:
            change, document["attributes"] = {}, {}
        document["attributes"].update(change)
        (copy / "zarr.json").write_text(json.dumps(document))
        with pytest.raises(ws.StoreError, match=r"copy\.zarr"):
            ws.open_map(copy)

    def test_a_share_that_is_none_leaves_nothing_behind(self, tmp_path):
        with pytest.raises(ValueError, match="share"):
            ws.capability_map(scara(), 0.2, store=tmp_path / "new.zarr", share=(2, 2))
        assert not (tmp_path / "new.zarr").exists()
