"""A TCP socket whose every operation ends by a deadline, and whose errors are sentences.

Sockets that block without limit cannot be interrupted on every system, and hang for ever on an
answer that never comes.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from typing import Any

from niryo_jax.hardware.errors import CallTimeout, ConnectionFailed, ConnectionLost

# Windows delivers Ctrl-C only between socket operations, so none may wait longer than this.
_POLL = 0.2

_LATE = "a move that was under way goes on to its end"


class BoundedSocket:
    """A connected socket, each of whose operations is bounded by the last `begin`.

    Attributes:
        address: host:port.
        received: whether any byte came since `begin`.

    Raises, on construction:
        ConnectionFailed: see `niryo_jax.hardware.errors`.
    """

    def __init__(self, host: str, port: int, timeout: float) -> None:
        self.address = f"{host}:{port}"
        self.begin("connect", timeout)
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except TimeoutError:
            raise ConnectionFailed(
                f"{self.address} did not answer within {timeout:g} s; expected a switched-on robot "
                "at this address, on the same network (nor does one answer that several programs "
                "wait for: the arm is finishing a move of an earlier program, or one is connected)"
            ) from None
        except ConnectionRefusedError:
            raise ConnectionFailed(
                f"{self.address} refused the connection: the machine answers, but no robot server "
                "listens on this port"
            ) from None
        except (OSError, UnicodeError) as error:
            raise ConnectionFailed(f"{self.address} cannot be reached: {error}") from error

    def begin(self, call: str, timeout: float) -> None:
        """Bound what follows, up to the next `begin`, by `timeout` seconds."""
        self.call = call
        self.received = False
        self._timeout = timeout
        self._deadline = time.monotonic() + timeout

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        view = memoryview(data)
        while view:
            view = view[self._attempt(self._socket.send, view) :]

    def read(self, size: int) -> bytes:
        """Receive exactly `size` bytes."""
        data = b""
        while len(data) < size:
            part: bytes = self._attempt(self._socket.recv, size - len(data))
            if not part:
                raise ConnectionLost(
                    f"{self.address} closed the connection during {self.call}; {_LATE}"
                )
            self.received = True
            data += part
        return data

    def end_writing(self) -> None:
        """Tell the other side that nothing more will be sent."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """Close the connection; again is allowed, and from another thread."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _attempt(self, operation: Callable[[Any], Any], argument: object) -> Any:
        while (left := self._deadline - time.monotonic()) > 0:
            try:
                self._socket.settimeout(min(left, _POLL))
                return operation(argument)
            except TimeoutError:
                continue
            except OSError as error:
                raise ConnectionLost(
                    f"the connection to {self.address} broke during {self.call} ({error}); {_LATE}"
                ) from error
        raise CallTimeout(
            f"{self.address} did not answer {self.call} within {self._timeout:.3g} s; the "
            f"connection is closed, and {_LATE}"
        )
