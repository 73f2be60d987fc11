"""The progress of long computations, on stderr: rate and time left."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from niryo_jax.extras import need

Progress = Callable[[int, int], None]
"""Called now and then with how much is done, and with how much there is in all."""


@contextmanager
def progress_bar(what: str, unit: str) -> Generator[Progress]:
    """A bar on stderr; the context gives the function that moves it.

    Args:
        what: what is computed.
        unit: what is counted.

    Raises:
        ImportError: the extra `workspace` is not installed.
    """
    progress = need("rich.progress")

    class Rate(progress.ProgressColumn):
        """How much is done in a second."""

        def render(self, task: Any) -> Any:
            speed = task.finished_speed or task.speed
            said = "" if speed is None else f"{_short(speed)} {unit}/s"
            return need("rich.text").Text(said, style="progress.data.speed")

    columns = (
        progress.TextColumn("{task.description}", markup=False),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        Rate(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
    )
    console = need("rich.console").Console(file=sys.stderr)
    with progress.Progress(*columns, console=console) as bar:
        task: Any = None

        def move(done: int, total: int) -> None:
            nonlocal task
            if task is None:
                # What was there before is not part of the rate.
                task = bar.add_task(what, total=total, completed=done)
            else:
                bar.update(task, completed=done)

        yield move


def _short(number: float) -> str:
    """A number with a suffix: 1,234,567 is 1.23 M."""
    for size, suffix in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if number >= size:
            return f"{number / size:.3g}{suffix}"
    return f"{number:.3g}"
