"""The only place that touches pyniryo: which one is installed, and calls that cannot hang.

pyniryo's own sockets block without limit after the connect and loop for ever on an answer that a
close cut short. The client is therefore given a socket of ours, whose every operation ends by a
deadline and raises when the connection has ended. No thread is needed, so none can be left over.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import importlib.metadata
import socket
import sys
import threading
import time
import types
import warnings
from collections.abc import Generator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware.errors import (
    CallTimeout,
    CommandRefused,
    ConnectionFailed,
    ConnectionLost,
    NiryoError,
    NotANiryo,
    PyniryoMissing,
    RobotBusy,
)

_INSTALL = 'install it with: pip install "niryo_jax[robot]"'

# Windows delivers Ctrl-C only between socket operations, so none may wait longer than this.
_POLL = 0.2


@dataclasses.dataclass(frozen=True)
class PyniryoInfo:
    """The installed pyniryo.

    Attributes:
        version: as installed, e.g. "1.1.2".
        systems: versions of the robot's system it is made for.
        fits: names of the robots of `niryo_jax.robots` it is made for.
    """

    version: str
    systems: str
    fits: tuple[str, ...]


def pyniryo_version() -> PyniryoInfo:
    """Which pyniryo is installed and what it fits. pyniryo itself is not imported.

    Raises:
        PyniryoMissing: none is installed, or one whose workings this package does not know.
    """
    try:
        version = importlib.metadata.version("pyniryo")
    except importlib.metadata.PackageNotFoundError:
        raise PyniryoMissing(f"pyniryo, the robot's client, is not installed; {_INSTALL}") from None
    match version.split(".")[:2]:
        case ["1", "1"]:
            return PyniryoInfo(version, "4.0 to 4.1", ("niryo_one", "niryo_ned", "niryo_ned2"))
        case ["1", "2"]:
            return PyniryoInfo(version, "5.5 and later", ("niryo_ned2",))
        case _:
            raise PyniryoMissing(
                f"pyniryo {version} is installed and not supported; expected 1.1.2 (Niryo One, "
                f"Ned, Ned2 with system 4.1.1) or 1.2.5 (Ned2 with system 5.5 or later); {_INSTALL}"
            )


class _NoOpenCV(types.ModuleType):
    """Stands in for OpenCV, whose constants pyniryo puts into enums on import."""

    def __getattr__(self, name: str) -> str:
        if name.startswith("__"):
            raise AttributeError(name)
        return name


@contextlib.contextmanager
def _opencv_or_none() -> Generator[None, None, None]:
    """Let pyniryo import where OpenCV cannot: its wheel needs libraries of the desktop (libGL).

    Only the camera functions of pyniryo use it, and nothing here uses those.
    """
    try:
        importlib.import_module("cv2")
    except ImportError:
        sys.modules["cv2"] = _NoOpenCV("cv2")
        try:
            yield
        finally:
            del sys.modules["cv2"]
    else:
        yield


def _load() -> Any:
    pyniryo_version()
    try:
        with _opencv_or_none():
            return importlib.import_module("pyniryo")
    except ImportError as error:
        raise PyniryoMissing(f"pyniryo does not import ({error}); {_INSTALL}") from error


class GuardedSocket:
    """A connected TCP socket with the methods pyniryo calls, each bounded by `deadline`."""

    def __init__(self, host: str, port: int, timeout: float) -> None:
        self.address = f"{host}:{port}"
        self.begin("connect", timeout)
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except TimeoutError:
            raise ConnectionFailed(
                f"{self.address} did not answer within {timeout:g} s; expected a switched-on robot "
                "at this address, on the same network"
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
        self.answered = False
        self._call = call
        self._timeout = timeout
        self._deadline = time.monotonic() + timeout

    def send(self, data: bytes) -> int:
        """Send all of `data`."""
        view = memoryview(data)
        while view:
            view = view[self._attempt(self._socket.send, view) :]
        return len(data)

    def recv(self, size: int) -> bytes:
        """Receive exactly `size` bytes: pyniryo takes a shorter first read for a lost robot."""
        data = b""
        while len(data) < size:
            part: bytes = self._attempt(self._socket.recv, size - len(data))
            if not part:
                raise ConnectionLost(
                    f"{self.address} closed the connection during {self._call}; a move that was "
                    "under way goes on to its end"
                )
            self.answered = True
            data += part
        return data

    def shutdown(self, how: int) -> None:
        """Called by pyniryo when it is dropped without having been closed."""
        self._socket.shutdown(how)

    def close(self) -> None:
        """Close the connection; again is allowed."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _attempt(self, operation: Any, argument: object) -> Any:
        while (left := self._deadline - time.monotonic()) > 0:
            try:
                self._socket.settimeout(min(left, _POLL))
                return operation(argument)
            except TimeoutError:
                continue
            except OSError as error:
                raise ConnectionLost(
                    f"the connection to {self.address} broke during {self._call} ({error}); a move "
                    "that was under way goes on to its end"
                ) from error
        raise CallTimeout(
            f"{self.address} did not answer {self._call} within {self._timeout:.3g} s; the "
            "connection is closed, and a move that was under way goes on to its end"
        )


class PyniryoClient:
    """A connected `pyniryo.NiryoRobot` whose calls end in time.

    Raises, on construction:
        PyniryoMissing: pyniryo does not import.
        ConnectionFailed, RobotBusy, NotANiryo: see `niryo_jax.hardware.errors`.
    """

    def __init__(self, host: str, port: int, timeout: float) -> None:
        module = _load()
        self._refused: type[Exception] = module.NiryoRobotException
        self._lock = threading.RLock()
        self._closed = False
        self._robot = module.NiryoRobot()
        self._socket = GuardedSocket(host, port, timeout)
        try:
            self._adopt(timeout)
        except BaseException:
            self.close()
            raise

    def _adopt(self, timeout: float) -> None:
        """Give the client our socket, and see that what answers is a Niryo.

        The client offers no way to choose its port or its socket, hence its private names.
        """
        self._robot._NiryoRobot__client_socket = self._socket
        self._robot._NiryoRobot__is_connected = True
        try:
            if hasattr(self._robot, "_NiryoRobot__handshake"):
                self._robot._NiryoRobot__logger.setLevel("ERROR")
                self.call("_NiryoRobot__handshake", timeout=timeout)
            self.joints(timeout)
        except CallTimeout:
            if not self._socket.answered:
                raise RobotBusy(
                    f"{self._socket.address} accepted the connection and answered nothing within "
                    f"{timeout:g} s; a Niryo serves one program at a time, so close the other "
                    "program (Niryo Studio included), or check that this is the robot"
                ) from None
            raise NotANiryo(
                f"{self._socket.address} began an answer and never ended it; expected the server "
                "of a Niryo with system 4.0 or later"
            ) from None
        except ConnectionLost as error:
            raise NotANiryo(
                f"{self._socket.address} closed the connection without a whole answer; expected "
                "the server of a Niryo with system 4.0 or later"
            ) from error

    def call(self, name: str, *args: object, timeout: float) -> Any:
        """What the client's method `name` returns.

        After any error but CommandRefused the connection is closed, since a late answer would be
        taken for that of the next call.

        Raises:
            CommandRefused: the robot answered KO.
            CallTimeout: no whole answer within `timeout` seconds.
            ConnectionLost: the connection ended, now or earlier.
            NotANiryo: the answer cannot be read.
        """
        label = name.removeprefix("_NiryoRobot__")
        with self._lock:
            if self._closed:
                raise ConnectionLost(
                    f"{label} was not sent: the connection to {self._socket.address} is closed; "
                    "connect again"
                )
            self._socket.begin(label, timeout)
            try:
                with warnings.catch_warnings():
                    # pyniryo 1.2 deprecates move_joints for a command that system 4 lacks.
                    warnings.simplefilter("ignore", DeprecationWarning)
                    return getattr(self._robot, name)(*args)
            except self._refused as error:
                reason = str(error).partition("KO : ")[2] or str(error)
                raise CommandRefused(f"the robot refused {label}: {reason}", reason) from error
            except NiryoError:
                self.close()
                raise
            except Exception as error:
                self.close()
                raise NotANiryo(
                    f"{self._socket.address} answered {label} with something that pyniryo cannot "
                    f"read ({type(error).__name__}: {error}); expected the server of a Niryo with "
                    "system 4.0 or later"
                ) from error
            except BaseException:
                self.close()
                raise

    def joints(self, timeout: float) -> NDArray[np.float64]:
        """(6,) joints read from the robot, radians. Raises as `call` does."""
        answer = self.call("get_joints", timeout=timeout)
        try:
            joints = np.array([float(angle) for angle in answer])
        except (TypeError, ValueError):
            joints = np.empty(0)
        if joints.shape != (6,) or not np.all(np.isfinite(joints)):
            self.close()
            raise NotANiryo(
                f"{self._socket.address} answered get_joints with {answer!r}; expected the six "
                "joint angles of a Niryo"
            )
        return joints

    def close(self) -> None:
        """Close the connection; again is allowed, and from another thread."""
        self._closed = True
        self._socket.close()
        self._robot._NiryoRobot__is_connected = False
