"""The code of README.md and of the pages in docs/ runs as it stands.

The blocks of a page are one program, in order. A block below `<!-- not run: reason -->` is left
out; where a page names a robot's host, the simulated robot answers in its place.
"""

from __future__ import annotations

import ast
import importlib.util
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

NEEDS = {"zarr": "nj.workspace", "pyniryo": "NiryoArm", "yourdfpy": "urdf", "mujoco": "mjcf"}
"""Packages that are not always installed, and the word by which a block asks for one."""

_FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NOT_RUN = re.compile(r"<!-- not run: .+ -->\n+\Z")


class Block(NamedTuple):
    line: int
    """Of the page, of the first line of the code, from 1."""
    code: str


def blocks(page: Path, language: str) -> list[Block]:
    """The blocks of a page that are run."""
    text = page.read_text()
    return [
        Block(text.count("\n", 0, match.start(2)) + 1, match[2])
        for match in _FENCE.finditer(text)
        if match[1] == language and not _NOT_RUN.search(text[: match.start()])
    ]


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def run(page: Path, block: Block, names: dict[str, Any]) -> None:
    """Run a block; a traceback shows the line of the page."""
    tree = ast.parse(block.code, str(page))
    ast.increment_lineno(tree, block.line - 1)
    exec(compile(tree, str(page), "exec"), names)


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
        for line, code in found:
            run(page, Block(line, code.replace(HOST, simulated.address)), names)


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
