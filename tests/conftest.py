"""One precision, one compilation cache and one set of profiles for the whole test session."""

from __future__ import annotations

import ctypes
import gc
import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from quick_compiling import XLA_FLAGS

# Compiling is nearly all that the tests do: programs are made for the compiler's speed, unless the
# caller says otherwise. `test_compiling.py` has those made for the machine's beside them.
os.environ.setdefault("XLA_FLAGS", XLA_FLAGS)

import hypothesis
import jax
import numpy as np
import pytest

import niryo_jax as nj

# A shell that runs the tests in the background has Ctrl-C ignored, which programs inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)

jax.config.update("jax_enable_x64", True)  # float32 is tested through float32 inputs
if cache := os.environ.get("JAX_COMPILATION_CACHE_DIR"):
    jax.config.update("jax_compilation_cache_dir", cache)
    # What two workers both need is compiled by one of them.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
# A twentieth of all time each: to look for garbage among what traces leave, most of which stays,
# and to say of each operation which line it comes from.
gc.freeze()
gc.set_threshold(50_000, 10, 5)
jax.config.update("jax_traceback_in_locations_limit", 0)

FAST = frozenset(
    f"test_{name}"
    for name in (
        *("chain", "dh", "jacobian", "lanes", "mjcf", "packing", "se3"),
        *("simulator", "so3", "structure", "subproblems", "urdf"),
    )
)
"""Modules of the tier `fast`: a first signal in a minute."""

hypothesis.settings.register_profile("local", deadline=None, max_examples=60)
hypothesis.settings.register_profile("ci", deadline=None, max_examples=60, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of the modules that are fast."""
    for item in items:
        if item.path.stem in FAST:
            item.add_marker(pytest.mark.fast)


_MOST_MAPS = 30_000
_MOST_BYTES = 4e9


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Release all programs where there are many: a process may map 65,530 pieces of memory, beyond
    which jaxlib crashes; and two workers must fit into the memory of a small machine."""
    yield
    # What the compiler has freed stays with the C library until it is asked for.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
    if trim is not None:
        trim(0)
    process = Path("/proc/self")
    if (process / "maps").exists():
        pages = int((process / "statm").read_text().split()[1])
        maps = (process / "maps").read_bytes().count(b"\n")
        if maps < _MOST_MAPS and pages * os.sysconf("SC_PAGE_SIZE") < _MOST_BYTES:
            return
    jax.clear_caches()
    gc.collect()
    if trim is not None:
        trim(0)


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator in the same state for every test."""
    return np.random.default_rng(20240624)


@pytest.fixture(scope="session")
def niryo() -> nj.Robot:
    """The Niryo One."""
    return nj.robots.niryo_one()


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command; its exit code, its stdout and its stderr."""
    run = pytest.importorskip("niryo_jax.cli.app").run

    def command(*arguments: object) -> tuple[int, str, str]:
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return command


@pytest.fixture
def as_json(cli: Callable[..., tuple[int, str, str]]) -> Callable[..., tuple[int, dict[str, Any]]]:
    """Run a command with --json; its exit code and the one document on stdout."""

    def command(*arguments: object) -> tuple[int, dict[str, Any]]:
        code, out, _ = cli(*arguments, "--json")
        return code, json.loads(out, parse_constant=pytest.fail)

    return command


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the figures that tests recorded as property `figure`, from all workers."""
    reports = [report for group in terminalreporter.stats.values() for report in group]
    figures = [
        text
        for report in reports
        if getattr(report, "when", None) == "call"
        for name, text in report.user_properties
        if name == "figure"
    ]
    if figures:
        terminalreporter.section("figures")
        terminalreporter.write_line("\n".join(figures))
