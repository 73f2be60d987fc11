"""Results to stdout; whatever else there is to say to stderr."""

from __future__ import annotations

import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

# Width of tables that go to a file or to another program.
_WIDTH = 110

# A pose this far from a rigid motion was rounded by whoever wrote it.
_ROUNDED = 1e-9

# Seconds.
_PATIENCE = 1.0


def stdout() -> Console:
    """The console of results."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH, highlight=False)


def show_table(table: Table) -> None:
    """Print a table to stdout, no narrower than its longest words: half a number is none."""
    console = stdout()
    wide = console.options.update(max_width=10_000)
    console.width = max(console.width, Measurement.get(console, wide, table).minimum)
    console.print(table)


def show_lines(*lines: str) -> None:
    """Print text to stdout as it is, for it may be copied, or look like markup."""
    for line in lines:
        stdout().print(line, markup=False, emoji=False, soft_wrap=True)


def stderr() -> Console:
    """The console of progress and remarks."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


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
