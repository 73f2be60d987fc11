"""What the site is built of: every page has its place in the menu, dead links are seen."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(autouse=True)
def _from_the_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def pages_of(menu: Any) -> Iterator[str]:
    if isinstance(menu, str):
        yield menu
    else:
        for entry in menu.values() if isinstance(menu, dict) else menu:
            yield from pages_of(entry)


def test_every_page_is_in_the_menu_once():
    menu = tomllib.loads((ROOT / "zensical.toml").read_text())["project"]["nav"]
    docs = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    scripts = [
        *(ROOT / "examples").glob("[0-9]*.py"),
        *(ROOT / "examples" / "notebooks").glob("*.py"),
    ]
    made = {f"examples/{path.stem}.md" for path in scripts}
    assert sorted(pages_of(menu)) == sorted(docs | made | {"changelog.md", "contributing.md"})


def test_dead_links_are_seen(tmp_path: Path):
    dead_links = importlib.import_module("docs.site.links").dead_links
    (tmp_path / "a.html").write_text(
        '<h2 id="here"></h2><a href="b.html#there"></a><a href="#here"></a><img src="c.png">'
        '<a href="https://example.org/none"></a><a href="d.html"></a><a href="b.html#not"></a>'
    )
    (tmp_path / "b.html").write_text('<h2 id="there"></h2><a href="a.html"></a>')
    assert dead_links(tmp_path) == ["a.html: c.png", "a.html: d.html", "a.html: b.html#not"]


def test_formulas_are_drawn_or_refused(tmp_path: Path):
    pytest.importorskip("latex2mathml")
    pytest.importorskip("ziamath")
    render = importlib.import_module("docs.site.mathml").render_formulas
    (tmp_path / "site").mkdir()
    page = tmp_path / "a.html"
    page.write_text(
        r'<span class="arithmatex">\(a &lt; \theta\)</span>'
        r'<div class="arithmatex">\[x^2 \tag{3}\]</div>'
    )
    assert render(tmp_path) == 2
    assert page.read_text().count("<math") == 2
    assert '<span class="number">(3)</span>' in page.read_text()
    page.write_text(r'<span class="arithmatex">\(\nosuchthing\)</span>')
    with pytest.raises(ValueError, match="nosuchthing"):
        render(tmp_path)


def test_links_of_the_changelog_fit_the_site(tmp_path: Path):
    stage = importlib.import_module("docs.site.stage").stage
    stage(ROOT, tmp_path)
    assert "](architecture.md)" in (tmp_path / "contributing.md").read_text()
    assert (tmp_path / "theory" / "complete-ik.svg").exists()
    assert not list(tmp_path.rglob("*.py"))
