"""Programs that the command keeps: nothing but the time of an answer depends on them."""

from __future__ import annotations

import dataclasses
import functools
import os
import stat
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("typer")
pytest.importorskip("platformdirs")

import niryo_jax as nj
from niryo_jax._jax import Compiled
from niryo_jax.cli import cache
from niryo_jax.cli.cache import KeptPrograms

posix = pytest.mark.skipif(os.name == "nt", reason="Windows keeps users apart by itself")


@pytest.fixture
def kept(tmp_path):
    """A store in a folder of its own."""
    folder = tmp_path / "private"
    folder.mkdir(mode=0o700)
    return KeptPrograms(folder)


def only(folder):
    """The one file of a folder."""
    (file,) = folder.iterdir()
    return file


# --- files


def test_what_is_saved_is_loaded_under_its_key_alone(kept, tmp_path):
    assert kept.load("a") is None
    kept.save("a", b"program of a")
    kept.save("b", b"")
    assert (kept.load("a"), kept.load("b"), kept.load("c")) == (b"program of a", b"", None)
    kept.save("a", b"another")
    assert kept.load("a") == b"another"
    assert len(list((tmp_path / "private").iterdir())) == 2


def test_a_file_that_is_damaged_anywhere_or_of_another_key_is_none(kept, tmp_path):
    program = bytes(range(256)) * 4
    kept.save("a", program)
    file = only(tmp_path / "private")
    whole = file.read_bytes()
    for place in range(len(whole)):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert kept.load("a") is None
        file.write_bytes(whole[:place])
        assert kept.load("a") is None
    file.write_bytes(whole)
    assert kept.load("a") == program
    kept.save("b", b"of b")
    (other,) = set((tmp_path / "private").iterdir()) - {file}
    other.write_bytes(whole)
    assert kept.load("b") is None


@posix
def test_a_file_of_another_user_or_that_others_can_write_is_none(kept, tmp_path, monkeypatch):
    kept.save("a", b"program")
    file = only(tmp_path / "private")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    for mode in (0o620, 0o602, 0o666):
        file.chmod(mode)
        assert kept.load("a") is None
    file.chmod(0o600)
    assert kept.load("a") == b"program"
    monkeypatch.setattr(os, "geteuid", lambda: file.stat().st_uid + 1)
    assert kept.load("a") is None


def test_other_source_or_another_machine_has_programs_of_its_own(kept, monkeypatch):
    kept.save("a", b"program")
    for name in ("_source", "_machine"):
        with monkeypatch.context() as patch:
            patch.setattr(cache, name, lambda: "another")
            assert kept.load("a") is None
    assert kept.load("a") == b"program"


def test_the_folder_is_bounded_and_what_is_used_stays(tmp_path):
    kept = KeptPrograms(tmp_path, most=50_000)
    programs = {str(i): np.random.default_rng(i).bytes(10_000) for i in range(12)}
    for i, (key, program) in enumerate(programs.items()):
        kept.save(key, program)
        for age, file in enumerate(sorted(tmp_path.iterdir(), key=lambda x: -x.stat().st_mtime)):
            os.utime(file, (1e9 - age, 1e9 - age))
        assert kept.load("0") == programs["0"], i
        assert sum(file.stat().st_size for file in tmp_path.iterdir()) <= 50_000
    assert kept.load("11") == programs["11"]
    assert kept.load("1") is None


def test_where_nothing_can_be_written_nothing_is_raised(tmp_path, monkeypatch):
    for folder in (tmp_path / "absent", tmp_path / "file"):
        (tmp_path / "file").touch()
        kept = KeptPrograms(folder)
        kept.save("a", b"program")
        assert kept.load("a") is None

    def full(*_: object) -> None:
        raise OSError("no space left on device")

    kept = KeptPrograms(tmp_path)
    (tmp_path / "file").unlink()
    monkeypatch.setattr("pathlib.Path.replace", full)
    kept.save("a", b"program")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def forget_settings(monkeypatch):
    """Settings of JAX and the store as they were."""
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    names = [name for name in jax.config.values if "cache" in name]
    before = {name: jax.config.values[name] for name in names}
    yield
    Compiled.store = None
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.mark.usefixtures("forget_settings")
def test_the_folder_is_private_or_not_used(tmp_path, monkeypatch):
    def used(parent) -> bool:
        Compiled.store = None
        monkeypatch.setenv(cache.VARIABLE, str(parent))
        cache.keep_programs()
        return Compiled.store is not None

    assert used(tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder" / "private"
    assert jax.config.values["jax_compilation_cache_dir"] == str(folder)
    assert used(tmp_path / "new" / "folder")
    assert not used("")
    (tmp_path / "file").touch()
    assert not used(tmp_path / "file")
    if os.name != "nt":
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        (tmp_path / "private").symlink_to(folder)
        assert not used(tmp_path)
        for mode in (0o755, 0o770, 0o701):
            folder.chmod(mode)
            assert not used(tmp_path / "new" / "folder")
        folder.chmod(0o700)
        monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
        assert not used(tmp_path / "new" / "folder")


# --- programs


class Remembered(dict):
    """A store that says what is asked of it."""

    def __init__(self) -> None:
        super().__init__()
        self.saved = []

    def load(self, key: str) -> bytes | None:
        return self.get(key)

    def save(self, key: str, program: bytes) -> None:
        self.saved.append(key)
        self[key] = program


@pytest.fixture
def store(monkeypatch):
    """A store for all compiled functions."""
    remembered = Remembered()
    monkeypatch.setattr(Compiled, "store", remembered)
    return remembered


def summed(options: tuple[float, ...], x, y):
    return {"sum": x + y * options[0], "last": (y,)}


def fresh(options: tuple[float, ...] = (0.1,), name: str = "test.summed") -> Compiled:
    """The function in a process of its own, as it were."""
    return Compiled(functools.partial(summed, options), {}, (name, options))


def test_a_kept_program_answers_as_a_new_one(store):
    x, y = np.arange(3.0), jnp.ones(())
    expected = fresh((0.1,))(True, x, y)
    assert len(store.saved) == 1
    for _ in range(2):
        again = fresh((0.1,))(True, x, y)
        assert len(store.saved) == 1
        assert jax.tree.structure(again) == jax.tree.structure(expected)
        jax.tree.map(np.testing.assert_array_equal, again, expected)


def test_whatever_a_program_depends_on_gives_a_program_of_its_own(store, monkeypatch):
    x, y = np.arange(3.0), np.ones(())
    calls = [
        lambda: fresh((0.1,))(True, x, y),
        lambda: fresh(name="test.other")(True, x, y),
        lambda: fresh((float(np.nextafter(0.1, 1.0)),))(True, x, y),
        lambda: fresh((0.1, 1.0))(True, x, y),
        lambda: fresh((1,))(True, x, y),
        lambda: fresh((1.0,))(True, x, y),
        lambda: fresh((0.1,))(True, np.arange(4.0), y),
        lambda: fresh((0.1,))(True, x.astype(np.float32), y.astype(np.float32)),
        lambda: fresh((0.1,))(True, x, x),
    ]
    for call in calls:
        call()
    assert len(store) == len(calls)
    monkeypatch.setenv("XLA_FLAGS", f"{os.environ.get('XLA_FLAGS', '')} ")
    calls[0]()
    assert len(store) == len(calls) + 1
    jax.config.update("jax_default_matmul_precision", "highest")
    try:
        calls[0]()
    finally:
        jax.config.update("jax_default_matmul_precision", None)
    assert len(store) == len(calls) + 2


@pytest.mark.parametrize("damage", ["nothing", "rubbish", "cut", "another"])
def test_a_program_that_cannot_be_used_is_compiled_again(store, damage):
    x, y = np.arange(3.0), np.ones(())
    expected = fresh((0.1,))(True, x, y)
    (key,) = store
    whole = store[key]
    fresh((0.1,))(True, np.arange(5.0), y)
    other = store[store.saved[-1]]
    store[key] = {"nothing": b"", "rubbish": b"x" * 99, "cut": whole[:-99], "another": other}[
        damage
    ]
    answer = fresh((0.1,))(True, x, y)
    jax.tree.map(np.testing.assert_array_equal, answer, expected)
    assert store.saved[-1] == key
    assert len(store.saved) == 3


def test_what_cannot_be_spelled_or_is_traced_is_not_kept(store):
    def function(x):
        return x + 1

    assert Compiled(function, {}, ("test.by_function", function))(True, 2.0) == 3.0
    x, y = np.arange(3.0), np.ones(())
    traced = jax.jit(lambda x: fresh((2.0,))(False, x, y))(x)
    np.testing.assert_array_equal(traced["sum"], x + 2)
    assert not store
    with pytest.raises(TypeError, match="add"):
        fresh((2.0,))(True, x, np.arange(4.0))


def test_kinematics_by_kept_programs_are_those_of_the_library(store, monkeypatch, rng):
    robot = nj.robots.niryo_one()
    q = rng.uniform(robot.lower, robot.upper)
    answers = [nj.forward_kinematics(robot, q)]
    moved = dataclasses.replace(robot, screws=np.array(robot.screws) * 1.0)
    answers.append(nj.forward_kinematics(moved, q))
    assert len(store.saved) == 1
    monkeypatch.setattr(Compiled, "store", None)
    for answer in answers:
        np.testing.assert_allclose(answer, nj.forward_kinematics(robot, q), rtol=0, atol=1e-15)


# --- the command


@pytest.mark.skipif(os.name == "nt", reason="the folder of a test is no secret there")
def test_the_command_answers_the_same_whatever_becomes_of_its_folder(tmp_path):
    def answer(**environment: str) -> str:
        env = {key: x for key, x in os.environ.items() if key != "JAX_COMPILATION_CACHE_DIR"}
        done = subprocess.run(
            [sys.executable, "-m", "niryo_jax.cli", "fk", *["0.1"] * 6, "--radians", "--json"],
            env={**env, cache.VARIABLE: str(tmp_path), **environment},
            capture_output=True,
            text=True,
        )
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    expected = answer()
    folder = tmp_path / "private"
    (program,) = folder.glob("*.program")
    assert answer() == expected
    whole = program.read_bytes()
    program.write_bytes(whole[: len(whole) // 2])
    assert answer() == expected
    assert program.read_bytes() != whole[: len(whole) // 2]
    folder.chmod(0o755)
    assert answer() == expected
    assert answer(**{cache.VARIABLE: ""}) == expected
