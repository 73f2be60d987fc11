"""One thing that takes its time, done beside everything else."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Task:
    """Runs a function in a thread of its own, one at a time.

    Args:
        on_error: called with what a function raises.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def running(self) -> bool:
        """Whether a function is under way."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, run: Callable[[threading.Event], None]) -> None:
        """Run a function, once the one before has ended, which is asked to.

        Args:
            run: called with an event that is set when it is to end soon.
        """
        with self._lock:
            self._end()
            self._stop = stop = threading.Event()

            def guarded() -> None:
                try:
                    run(stop)
                except Exception as error:
                    if not stop.is_set():
                        self._on_error(error)

            self._thread = threading.Thread(target=guarded, name="niryo-jax-task", daemon=True)
            self._thread.start()

    def stop(self, timeout: float | None = None) -> None:
        """Ask the function that is under way to end, and wait until it has, or for so long."""
        with self._lock:
            self._end(timeout)

    def _end(self, timeout: float | None = None) -> None:
        self._stop.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout)
