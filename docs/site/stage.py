"""The sources of the site in one folder: docs/, and pages of the repository's top level."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

TOP = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
"""Pages of the repository's top level, and what they are called in the site."""

_KINDS = {".md", ".png", ".svg", ".webp", ".css"}
_INTO_DOCS = re.compile(r"\]\(docs/")
_SCRIPT = re.compile(r"\]\(\.\./((?:\.\./)*)examples/(?:notebooks/)?(\w+)\.py\)")
"""A link of a page in docs/ to a script, which the site has as a page."""


def stage(root: Path, pages: Path) -> None:
    """Copy pages, pictures and styles; links from the top level and to scripts are made to fit."""
    docs = root / "docs"
    for source in sorted(docs.rglob("*")):
        if source.suffix in _KINDS:
            target = pages / source.relative_to(docs)
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.suffix == ".md":
                target.write_text(_SCRIPT.sub(r"](\1examples/\2.md)", source.read_text()))
            else:
                shutil.copyfile(source, target)
    for name, target in TOP.items():
        (pages / target).write_text(_INTO_DOCS.sub("](", (root / name).read_text()))
