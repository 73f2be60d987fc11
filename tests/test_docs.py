"""The code of README.md and of the pages in docs/ runs as it stands.

The blocks of a page are one program, in order. A block below `<!-- not run: reason -->` is left
out; a `text` block right below one is what it prints. Where a page names a robot's host, the
simulated robot answers in its place.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import io
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
HOST = "10.10.10.10"
"""The host of a robot, on every page."""

NEEDS = {
    "zarr": "nj.workspace",
    "pyniryo": "NiryoArm",
    "yourdfpy": "urdf",
    "mujoco": "mjcf",
    "viser": "Viewer",
}
"""Packages that are not always installed, and the word by which a block asks for one."""

_FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NOT_RUN = re.compile(r"<!-- not run: .+ -->\n+\Z")


_SHOWN = re.compile(r"\A\n*```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    line: int
    """Of the page, of the first line of the code, from 1."""
    code: str
    shown: str | None
    """What the page shows right below it as printed; None where it shows nothing."""


def blocks(page: Path, language: str) -> list[Block]:
    """The blocks of a page that are run."""
    text = page.read_text()
    return [
        Block(text.count("\n", 0, match.start(2)) + 1, match[2], _shown(text[match.end() :]))
        for match in _FENCE.finditer(text)
        if match[1] == language and not _NOT_RUN.search(text[: match.start()])
    ]


def _shown(below: str) -> str | None:
    match = _SHOWN.match(below)
    return match[1] if match else None


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def run(page: Path, block: Block, names: dict[str, Any]) -> None:
    """Run a block, and hold what it prints against the page; a traceback shows the page's line."""
    tree = ast.parse(block.code, str(page))
    ast.increment_lineno(tree, block.line - 1)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(tree, str(page), "exec"), names)
    if block.shown is not None:
        assert printed.getvalue() == block.shown


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=name_of)
@pytest.mark.filterwarnings("ignore:pyniryo .* is made for:UserWarning")
def test_python(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    found = blocks(page, "python")
    text = "".join(block.code for block in found)
    for package, word in NEEDS.items():
        if word in text and importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    if HOST not in text:
        for block in found:
            run(page, block, names)
        return
    from niryo_jax.hardware import SimulatedNiryo

    with SimulatedNiryo(time_scale=50) as simulated:
        for block in found:
            code = block.code.replace(HOST, simulated.address)
            run(page, block._replace(code=code), names)


COMMANDS = [
    pytest.param(command.partition(" #")[0].strip(), id=f"{name_of(page)}-{command}")
    for page in PAGES
    for block in blocks(page, "bash")
    for command in block.code.splitlines()
    if command.startswith("niryo-jax ")
]


@pytest.mark.parametrize("command", COMMANDS)
def test_command(
    command: str,
    cli: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    _, *arguments = shlex.split(command)
    code, out, err = cli(*arguments)
    assert code == 0, err
    assert out
