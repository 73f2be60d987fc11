"""Results to stdout; whatever else there is to say to stderr."""

from __future__ import annotations

import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

# Names and addresses may look like markup: [red], or :b:.
_AS_IT_IS: Any = {"markup": False, "emoji": False, "highlight": False}

# Width of tables that go to a file or to another program.
_WIDTH = 110

# A pose this far from a rigid motion was rounded by whoever wrote it.
_ROUNDED = 1e-9

# Seconds.
_PATIENCE = 1.0


def stdout() -> Console:
    """The console of results."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH, **_AS_IT_IS)


def show_table(table: Table) -> None:
    """Print a table to stdout, no narrower than its numbers and longest words ask for."""
    console = stdout()
    for column in table.columns:
        if column.no_wrap or column.justify == "right":
            lines = [line for cell in column.cells for line in str(cell).splitlines()]
            lines += str(column.header).splitlines()
            column.no_wrap, column.min_width = True, max(map(cell_len, lines), default=0)
    wide = console.options.update(max_width=10_000)
    console.width = max(console.width, Measurement.get(console, wide, table).minimum)
    console.print(table)


def show_lines(*lines: str) -> None:
    """Print lines to stdout that may be copied: however narrow the terminal, none is broken."""
    for line in lines:
        stdout().print(line, soft_wrap=True)


def stderr() -> Console:
    """The console of progress and remarks."""
    return Console(stderr=True, soft_wrap=True, **_AS_IT_IS)


def note_rounding(distance: float) -> None:
    """Remark that a pose was not quite a rigid motion, as rounded numbers are."""
    if distance > _ROUNDED:
        stderr().print(
            f"note: a pose as written is {distance:.1e} (Frobenius norm) away from a rigid motion; "
            "the nearest one was solved"
        )


@contextmanager
def busy(what: str) -> Generator[None]:
    """Show on a terminal what is being done, once it has taken a second."""
    status = stderr().status(f"{what} (the first time JAX compiles, which takes some seconds) ...")
    timer = threading.Timer(_PATIENCE, status.start)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        status.stop()
