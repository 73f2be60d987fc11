"""Scripts as notebooks, executed, and their pages.

A script of `examples/` becomes three cells: its docstring, its code, and a call of its `main`. One
of `examples/notebooks/` is a notebook in the percent format already. All run in one kernel, emptied
between them, so that JAX is imported once. An error in a cell ends the build.
"""

from __future__ import annotations

import ast
import base64
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from nbclient import NotebookClient

from tests.quick_compiling import XLA_FLAGS

SMALLER = {
    "02_batch_inverse_kinematics": "200",
    "11_capability_map": "0.1, 24",
    "13_block_stacking": "1",
}
"""Arguments of `main` where its own take long; those of the tests where these have any."""

_BETWEEN = "%reset -f\n%matplotlib inline\n%config InlineBackend.figure_formats = ['svg']"
"""Run before each notebook: nothing is left of the one before."""

_ANSI = re.compile(r"\x1b\[[0-9;]*m")


def write_notebooks(examples: Path, pages: Path, *, execute: bool = True) -> None:
    """Write a page, its figures and the notebook for each script; `execute` them first."""
    pages.mkdir(parents=True, exist_ok=True)
    notebooks = {path.stem: from_script(path) for path in sorted(examples.glob("[0-9]*.py"))}
    for path in sorted((examples / "notebooks").glob("*.py")):
        notebooks[path.stem] = jupytext.read(path, fmt="py:percent")
    if execute:
        _execute(notebooks, pages)
    for name, notebook in notebooks.items():
        nbformat.write(notebook, pages / f"{name}.ipynb")
        (pages / f"{name}.md").write_text("\n".join(_page(name, notebook, pages)))


def from_script(path: Path) -> nbformat.NotebookNode:
    """The notebook of a script with a docstring and a `main`."""
    text = path.read_text()
    tree = ast.parse(text)
    words = ast.get_docstring(tree) or ""
    first = tree.body[0].end_lineno or 0
    code = "\n".join(text.splitlines()[first:]).partition('\nif __name__ == "__main__":')[0]
    title = path.stem.partition("_")[2].replace("_", " ").capitalize()
    v4 = nbformat.v4
    return v4.new_notebook(
        cells=[
            v4.new_markdown_cell(f"# {title}\n\n{words}"),
            v4.new_code_cell(code.strip()),
            v4.new_code_cell(f"result = main({SMALLER.get(path.stem, '')})"),
        ]
    )


def _execute(notebooks: dict[str, nbformat.NotebookNode], folder: Path) -> None:
    cells: list[nbformat.NotebookNode] = []
    for name, notebook in notebooks.items():
        first = nbformat.v4.new_code_cell(f"{_BETWEEN}\n# {name}")
        cells += [first, *notebook.cells]
    whole = nbformat.v4.new_notebook(cells=cells)
    # Compiling is nearly all that they do; what the tests have compiled is in the same cache.
    environment = {"XLA_FLAGS": XLA_FLAGS, **os.environ}
    place = {"metadata": {"path": str(folder)}}
    NotebookClient(
        whole,
        timeout=600,
        kernel_name="python3",
        startup_timeout=300,
        # For minutes on one machine it needs no encryption, and no warning that it has none.
        extra_arguments=["--IPKernelApp.log_level=ERROR"],
        resources=place,
        record_timing=False,
        on_cell_start=_say,
    ).execute(env=environment)
    done = iter(whole.cells)
    for notebook in notebooks.values():
        next(done)
        notebook.cells = [next(done) for _ in notebook.cells]


def _say(cell: nbformat.NotebookNode, cell_index: int) -> None:
    if cell.source.startswith(_BETWEEN):
        print(f"running {cell.source.rpartition(' ')[2]}", flush=True)


def _page(name: str, notebook: nbformat.NotebookNode, folder: Path) -> Iterator[str]:
    heading = True
    figures = 0
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            yield cell.source + "\n"
            if heading:
                yield f"[Download this page as a notebook]({name}.ipynb){{ .download }}\n"
                heading = False
            continue
        yield f"```python\n{cell.source}\n```\n"
        for output in cell.outputs:
            data: dict[str, Any] = output.get("data", {})
            if "image/svg+xml" in data or "image/png" in data:
                figures += 1
                yield f"![Figure {figures}]({_save(data, folder / f'{name}-{figures}')})\n"
                continue
            text = output.get("text") or data.get("text/plain") or ""
            if text.strip():
                yield f'```text title="output"\n{_ANSI.sub("", text).rstrip()}\n```\n'


def _save(data: dict[str, Any], stem: Path) -> str:
    """Write a figure; its file name."""
    if "image/svg+xml" in data:
        path = stem.with_suffix(".svg")
        path.write_text(data["image/svg+xml"])
    else:
        path = stem.with_suffix(".png")
        path.write_bytes(base64.b64decode(data["image/png"]))
    return path.name
