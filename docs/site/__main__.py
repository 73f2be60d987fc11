"""Build the site: pages, executed notebooks, reference, formulas; then look at every link.

pip install -e ".[test]" --group docs
python -m docs.site                  # into build/site; fails at a warning, an error or a dead link
python -m docs.site --run notebooks  # not the examples, which the tests run; or --run none
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from docs.site.links import dead_links
from docs.site.mathml import render_formulas
from docs.site.notebooks import write_notebooks
from docs.site.stage import stage

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "build" / "docs"
SITE = ROOT / "build" / "site"


def main() -> int:
    """Build; 1 where something is wrong, which is said on stderr."""
    parser = argparse.ArgumentParser(prog="python -m docs.site", description=__doc__)
    parser.add_argument("--run", choices=("all", "notebooks", "none"), default="all")
    run = parser.parse_args().run

    for folder in (PAGES, SITE):
        shutil.rmtree(folder, ignore_errors=True)
    stage(ROOT, PAGES)
    write_notebooks(ROOT / "examples", PAGES / "examples", run)
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict"]
    if subprocess.run(command, cwd=ROOT).returncode:
        return 1
    formulas = render_formulas(SITE)
    dead = dead_links(SITE)
    for link in dead:
        print(f"dead link: {link}", file=sys.stderr)
    pages = len(list(SITE.rglob("*.html")))
    print(f"{pages} pages, {formulas} formulas, {len(dead)} dead links: {SITE.relative_to(ROOT)}")
    return 1 if dead else 0


if __name__ == "__main__":
    sys.exit(main())
