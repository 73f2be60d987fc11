"""One thread that does what is asked for, of which only the newest of each kind matters."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Worker:
    """Does actions one after the other, in the order in which their kinds were first asked for.

    An action that is asked for while another of its kind waits takes its place: of a gizmo that is
    dragged faster than poses are solved the last pose is shown, and none of those before.

    Args:
        on_error: called with what an action raises; the thread goes on.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error
        self._waiting: dict[str, Callable[[], None]] = {}
        self._busy = self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="niryo-jax-viewer", daemon=True)
        self._thread.start()

    def post(self, kind: str, action: Callable[[], None]) -> None:
        """Ask for an action; nothing happens after `close`."""
        with self._changed:
            if not self._closed:
                self._waiting[kind] = action
                self._changed.notify_all()

    def settle(self, timeout: float = 60.0) -> bool:
        """Wait until nothing is left to do; whether that came in time."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._waiting and not self._busy, timeout)

    def close(self) -> None:
        """Forget what is waiting, and end after what is under way."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        while (action := self._next()) is not None:
            try:
                action()
            except Exception as error:
                self._on_error(error)

    def _next(self) -> Callable[[], None] | None:
        with self._changed:
            self._busy = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._waiting or self._closed)
            if self._closed:
                return None
            self._busy = True
            return self._waiting.pop(next(iter(self._waiting)))
