"""Commands that serve until they are told to end."""

from __future__ import annotations

import signal
import threading

_LOOK = 0.2
"""Seconds between looks at whether to end: on Windows a wait without end is not interrupted."""


def wait_for_stop() -> None:
    """Wait for Ctrl-C or a request to terminate; both also where a script runs this command in
    the background, with Ctrl-C ignored."""
    stop = threading.Event()

    def on_signal(*_: object) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    while not stop.wait(_LOOK):
        pass
