"""How everything here is measured, printed and saved.

Rounds of what is compared alternate in one process, so that a slow moment of the machine hits all;
the figure is the median of the rounds. A benchmark fails where an answer is wrong, never where
something is slow.
"""

from __future__ import annotations

import dataclasses
import datetime
import gc
import importlib.metadata
import importlib.util
import json
import os
import platform
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"

ENOUGH = 3.0
"""Seconds of measuring one thing after which it gets no further round."""

PATIENCE = 900
"""Seconds after which a process of its own is given up."""


def pin_to_one_core() -> None:
    """Call before numpy and jax are imported: their threads inherit it, as subprocesses do."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, [max(os.sched_getaffinity(0))])


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclasses.dataclass(frozen=True)
class Claim:
    """A statement about speed or memory, and whether this run bears it out."""

    text: str
    holds: bool | None

    @property
    def verdict(self) -> str:
        """As printed."""
        return {True: "pass", False: "falls short", None: "not measured"}[self.holds]


@dataclasses.dataclass
class Report:
    """What one benchmark found.

    Attributes:
        title: of the page.
        data: for the JSON.
        sections: Markdown, a blank line between them.
        claims: in the order in which they are printed.
        wrong: a sentence for each wrong answer.
    """

    title: str
    data: dict[str, Any]
    sections: list[str] = dataclasses.field(default_factory=list)
    claims: list[Claim] = dataclasses.field(default_factory=list)
    wrong: list[str] = dataclasses.field(default_factory=list)

    def finish(self, stem: str | None) -> int:
        """Print all, write it to `results/` under a dated stem if given; returns the exit code."""
        text = list(self.sections)
        if self.claims:
            text.append("## Claims")
            text.append("\n".join(f"- {c.text}: {c.verdict}" for c in self.claims))
        text.append(
            "\n".join(f"- WRONG: {x}" for x in self.wrong) or "- every answer of ours: right"
        )
        print("\n" + "\n\n".join(text))
        if stem is not None:
            RESULTS.mkdir(exist_ok=True)
            path = RESULTS / f"{datetime.date.today().isoformat()}-{stem}"
            data = {
                **self.data,
                "claims": [[c.text, c.verdict] for c in self.claims],
                "wrong": self.wrong,
            }
            path.with_suffix(".json").write_text(json.dumps(data, indent=1) + "\n")
            page = "\n\n".join([f"# {self.title}", *text]) + "\n"
            path.with_suffix(".md").write_text(page)
        return 1 if self.wrong else 0


def about(*packages: str, **more: Any) -> dict[str, Any]:
    """Where and with what something was measured."""
    import jax

    versions = {name: version_of(name) for name in ("jax", "numpy", *packages)}
    return {
        "date": datetime.date.today().isoformat(),
        "machine": f"{platform.machine()} {_processor()}".strip(),
        "cores": cores(),
        "device": jax.devices()[0].device_kind,
        "python": platform.python_version(),
        **{name: version for name, version in versions.items() if version},
        **more,
    }


def header(facts: dict[str, Any]) -> str:
    """The same in one line."""
    return ", ".join(f"{key} {value}" for key, value in facts.items())


def version_of(package: str) -> str | None:
    """The version of an installed package, if it is."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def installed(
    packages: Mapping[str, tuple[str, Callable[..., list[Any]]]], robot: Any, skip: Sequence[str]
) -> tuple[list[Any], dict[str, str]]:
    """The adapters of the peers that are installed, and for the others why they take no part.

    `packages` names for each library the package that pip takes, and what builds its adapters for
    a robot.
    """
    found: list[Any] = []
    absent: dict[str, str] = {}
    for name, (package, build) in packages.items():
        if name in skip:
            absent[name] = "skipped"
        elif version_of(package) is None:
            absent[name] = f"not installed (pip install {package})"
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found += build(robot)
    return found, absent


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    return next((x.split(":")[1].strip() for x in lines if x.startswith("model name")), "")


class Timed:
    """Something being timed.

    Attributes:
        name: as printed.
        size: how many poses, or lanes, one run handles.
        first: seconds of the first run, compilation included.
        rounds: seconds of each round.
        result: of the latest run.
    """

    def __init__(self, name: str, size: int, run: Callable[[], Any]) -> None:
        self.name, self.size, self.run = name, size, run
        self.rounds: list[float] = []
        self.result: Any = None
        self.first = self._once()

    def round(self, least: float = 0.0) -> None:
        """The mean of as many runs as take `least` seconds, one at the least."""
        spent, runs = 0.0, 0
        while not runs or spent < least:
            spent += self._once()
            runs += 1
        self.rounds.append(spent / runs)

    def _once(self) -> float:
        import jax

        # The collector of cyclic garbage would charge one for the objects of another.
        self.result = None
        gc.disable()
        started = time.perf_counter()
        self.result = jax.block_until_ready(self.run())
        elapsed = time.perf_counter() - started
        gc.enable()
        return elapsed

    @property
    def seconds(self) -> float:
        """Median of the rounds."""
        return statistics.median(self.rounds)

    @property
    def rate(self) -> float:
        """Poses (lanes) a second."""
        return self.size / self.seconds

    @property
    def spread(self) -> float:
        """(slowest - fastest) / median."""
        return (max(self.rounds) - min(self.rounds)) / self.seconds

    def facts(self) -> dict[str, Any]:
        """For the JSON."""
        return {
            "name": self.name,
            "size": self.size,
            "first": self.first,
            "rounds": self.rounds,
            "rate": self.rate,
        }


def alternate(subjects: Sequence[Timed], rounds: int, least: float = 0.0) -> None:
    """So many rounds of each, in turn; fewer of what takes long."""
    for _ in range(rounds):
        for subject in subjects:
            if sum(subject.rounds) < ENOUGH:
                subject.round(least)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def in_a_process(module: str, *arguments: str, **env: str) -> dict[str, Any]:
    """The JSON that a module prints last, run in a process of its own on the same cores.

    What went wrong is under "error"; the seconds of the whole process are under "process".
    """
    started = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", module, *arguments],
            env={**os.environ, **env},
            cwd=Path(__file__).parents[1],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        return {"error": f"not done after {PATIENCE} s"}
    if done.returncode != 0:
        error = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        return {"error": error[0]}
    return {**json.loads(done.stdout.splitlines()[-1]), "process": time.perf_counter() - started}
