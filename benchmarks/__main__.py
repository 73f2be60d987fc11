"""Every benchmark, or those named, each in processes of its own.

    python -m benchmarks [lanes floors kinematics lie compiling first_answer devices complete_ik
                          robots honesty arms workspace uncertainty collision collision_maps motion
                          velocity viewer] [--save]
    python -m benchmarks --gate [--save]      whether anything has become slower (`gate`)

Peers that are not installed are left out and named. Install them with `pip install --group peers`;
they are of many licences, and none is a dependency of niryo_jax.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

from benchmarks import arms_page
from benchmarks.measure import RESULTS

PARTS = (
    "lanes",
    "floors",
    "kinematics",
    "lie",
    "compiling",
    "first_answer",
    "devices",
    "complete_ik",
    "robots",
    "honesty",
    "arms",
    "workspace",
    "uncertainty",
    "collision",
    "collision_maps",
    "motion",
    "velocity",
    "viewer",
)

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"

_HEAD = """# Benchmarks: the last run of each part

Made by `python -m benchmarks --save`; [how to read it](performance.md).
"""


def collect() -> None:
    """Write the latest table of each part to one page, and that of real arms to its own."""
    pages = [_HEAD]
    for part in PARTS:
        for path in sorted(RESULTS.glob(f"*-{part.replace('_', '-')}.md"))[-1:]:
            # A level deeper, below the title of the page.
            pages.append(re.sub(r"^#", "##", path.read_text(), flags=re.MULTILINE))
    PAGE.write_text("\n".join(pages))
    arms_page.collect()


def main() -> int:
    """Run the parts; the exit code is 1 when an answer of niryo_jax is wrong in any."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__.splitlines()[0]
    )
    parser.add_argument("parts", nargs="*", metavar="part", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    parser.add_argument("--gate", action="store_true", help="whether anything has become slower")
    options = parser.parse_args()
    if options.gate:
        command = [sys.executable, "-m", "benchmarks.gate", *["--save"] * options.save]
        return subprocess.run(command, cwd=Path(__file__).parents[1], check=False).returncode
    unknown = sorted(set(options.parts) - set(PARTS))
    if unknown:
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(PARTS)}")
    failed = []
    for part in options.parts or PARTS:
        print(f"== {part}", flush=True)
        command = [sys.executable, "-m", f"benchmarks.{part}", *["--save"] * options.save]
        if subprocess.run(command, cwd=Path(__file__).parents[1], check=False).returncode:
            failed.append(part)
    if options.save:
        collect()
    if failed:
        print(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
