"""What Windows and macOS lack is done without: each test takes it away, or says what they say."""

from __future__ import annotations

import errno
import os
import pathlib
import signal
import socket
import subprocess
import sys
import textwrap
from collections.abc import Callable

import pytest

from niryo_jax import arguments, programs
from niryo_jax.execution import devices

pytestmark = pytest.mark.fast


def test_a_system_that_tells_no_size_of_its_memory(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(os, "sysconf", raising=False)
    arguments.memory_size.cache_clear()
    try:
        assert arguments.memory_size() == 2**40
    finally:
        arguments.memory_size.cache_clear()


def test_a_system_that_gives_a_process_no_cores_of_its_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert devices.cores() == (os.cpu_count() or 1)


def test_a_system_without_proc(monkeypatch: pytest.MonkeyPatch):
    cache = _cache()

    def absent(path: pathlib.Path, *_: object, **__: object) -> str:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))

    cache._machine.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(pathlib.Path, "read_text", absent)
        share, machine = programs.mapped_share(), cache._machine()
    cache._machine.cache_clear()
    assert share == 0.0
    assert "uname_result" in machine


def test_windows_has_no_owners_of_files(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path):
    cache, facts = _cache(), tmp_path.stat()
    with monkeypatch.context() as patch:
        patch.setattr(os, "name", "nt")
        patch.delattr(os, "geteuid", raising=False)
        assert cache._is_own(facts, others=0o777)


def test_a_command_that_serves_waits_in_pieces(monkeypatch: pytest.MonkeyPatch):
    """On Windows a wait for an event is never interrupted; a short sleep ends anywhere."""
    pytest.importorskip("typer")
    from niryo_jax.cli import serving

    handlers: dict[int, Callable[[int, object], None]] = {}
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 3:
            handlers[signal.SIGINT](signal.SIGINT, None)

    monkeypatch.setattr(signal, "signal", handlers.__setitem__)
    monkeypatch.setattr(serving.time, "sleep", sleep)
    serving.until_stopped()()
    assert len(slept) == 3
    assert all(0 < seconds <= 1 for seconds in slept)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_command_that_serves_ends_at_whatever_line_it_is_told_to():
    """A handler that takes a lock waits for itself where the signal comes inside of that lock."""
    pytest.importorskip("typer")
    code = """
        import signal, sys
        from niryo_jax.cli import serving
        wait = serving.until_stopped()
        serving._LOOK = 1e-6
        signal.setitimer(signal.ITIMER_REAL, 10)
        left = [1000]
        def told(frame, event, argument):
            left[0] -= 1
            if not left[0]:
                signal.raise_signal(signal.SIGTERM)
            return told
        for lines in range(1, 60):
            left[0] = lines
            wait = serving.until_stopped()
            sys.settrace(told)
            wait()
            sys.settrace(None)
        print("ended")
    """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    done = subprocess.run(command, capture_output=True, timeout=60)
    assert done.stdout == b"ended\n", done.stderr


@pytest.mark.parametrize(("system", "name"), [("win32", "PIPE"), ("linux", "OUTPUT")])
def test_a_broken_pipe_is_an_invalid_argument_on_windows(
    monkeypatch: pytest.MonkeyPatch, system: str, name: str
):
    pytest.importorskip("typer")
    from niryo_jax.cli.outcome import ExitCode
    from niryo_jax.cli.streams import OutputLost, _Results

    class Ended:
        def write(self, text: str) -> int:
            raise OSError(errno.EINVAL, "Invalid argument")

        def fileno(self) -> int:
            raise OSError(errno.EBADF, "no descriptor")

    monkeypatch.setattr(sys, "platform", system)
    with pytest.raises(OutputLost) as lost:
        _Results(Ended()).write("a result")
    assert lost.value.code is ExitCode[name]


def test_a_port_is_listened_on_by_one_program_on_windows(monkeypatch: pytest.MonkeyPatch):
    """There SO_REUSEADDR lets a second program listen on a port that is taken."""
    pytest.importorskip("viser")
    from niryo_jax.viewer.app import free_port

    asked: list[int] = []

    class Probe(socket.socket):
        def setsockopt(self, level: int, option: int, *value: object) -> None:  # type: ignore[override]
            asked.append(option)

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(socket, "socket", Probe)
    assert free_port("127.0.0.1", 0) > 0
    assert socket.SO_REUSEADDR not in asked


def _cache():
    pytest.importorskip("platformdirs")
    from niryo_jax.cli import cache

    return cache
