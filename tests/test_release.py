"""What a release is made of: one version, a README whose links and exit codes are true."""

from __future__ import annotations

import importlib
import re
import tomllib
from pathlib import Path

import pytest

import niryo_jax as nj

pytestmark = pytest.mark.fast
ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_all_files_name_one_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, newest = re.findall(r"^## \[([^\]]+)\](?: - (.+))?$", changes, re.MULTILINE)[:2]
    assert unreleased == ("Unreleased", "")
    (said,) = re.findall(r"^version: (\S+)$", citation, re.MULTILINE)
    (day,) = re.findall(r'^date-released: "(\S+)"$', citation, re.MULTILINE)
    assert project["version"] == nj.__version__ == said == newest[0]
    assert day == newest[1]


def test_the_links_of_the_readme_lead_to_files():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)(?:#[^)]*)?\)", README):
        assert (ROOT / target).is_file(), target


def test_the_readme_knows_every_example():
    count = len(list((ROOT / "examples").glob("[0-9]*.py")))
    assert f"`examples/` has {count} scripts" in README


@pytest.mark.parametrize("page", ["README.md", "docs/command.md"])
def test_exit_codes_are_those_of_the_command(page: str):
    pytest.importorskip("typer")
    from niryo_jax.cli.outcome import ExitCode

    text = (ROOT / page).read_text(encoding="utf-8")
    for code in ExitCode:
        assert re.search(rf"\| {int(code)} \| {re.escape(code.message)}( \(.*?\))? \|", text), code


def test_the_readme_of_pypi_has_whole_addresses(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT))
    absolute = importlib.import_module("docs.pypi_readme").absolute
    at = "https://github.com/me/it"
    assert (
        absolute("![a](docs/a.webp) [b](b.md#c) [d](#d) [e](https://e.org/)", at, "v1.2.3")
        == "![a](https://raw.githubusercontent.com/me/it/v1.2.3/docs/a.webp) "
        "[b](https://github.com/me/it/blob/v1.2.3/b.md#c) [d](#d) [e](https://e.org/)"
    )
    links = re.findall(r"\]\(([^)]+)\)", absolute(README, at, "v1.2.3"))
    assert links
    assert all(link.startswith("https://") for link in links)
