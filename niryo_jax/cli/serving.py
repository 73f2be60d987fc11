"""Commands that serve until they are told to end."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

_LOOK = 0.2
"""Seconds between looks at whether to end."""


def until_stopped() -> Callable[[], None]:
    """Listen for Ctrl-C and requests to terminate, and return the wait for one of them.

    Whoever reads that this command serves may end it at once: call this before it is said. Both end
    it also where a script runs this command in the background, with Ctrl-C ignored.
    """
    told: list[int] = []

    def on_signal(number: int, _: object) -> None:
        told.append(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)

    def wait() -> None:
        # No event: its lock may be held where the signal interrupts, which then waits for itself;
        # and on Windows nothing interrupts a wait for it.
        while not told:
            time.sleep(_LOOK)

    return wait
