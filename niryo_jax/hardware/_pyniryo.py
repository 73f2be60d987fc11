"""The only place that touches pyniryo: which one is installed, and calls that cannot hang.

pyniryo's own sockets block without limit after the connect, and it takes any answer for that of its
last request. It is therefore given a `Connection` of ours. No thread is needed, so none can be left
over.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import importlib.metadata
import sys
import threading
import types
import warnings
from collections.abc import Generator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware.connection import Connection, refusal
from niryo_jax.hardware.errors import (
    CommandRefused,
    ConnectionLost,
    NiryoError,
    NotANiryo,
    PyniryoMissing,
    WrongArm,
)
from niryo_jax.hardware.protocol import ProtocolError
from niryo_jax.hardware.status import HardwareStatus, parse_status

_INSTALL = 'install it with: pip install "niryo_jax[robot]"'


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


class PyniryoClient:
    """A connected `pyniryo.NiryoRobot` whose calls end in time.

    Args:
        host, port: where the robot's server listens.
        connect_timeout: seconds for the connection, and again for its first answer.
        timeout: seconds for each answer.
        model: what the robot must say it is, as `robots.MODELS` has it; anything where None.

    Raises, on construction:
        PyniryoMissing: pyniryo does not import.
        ConnectionFailed, RobotBusy, NotANiryo, WrongArm: see `niryo_jax.hardware.errors`.
    """

    def __init__(
        self, host: str, port: int, connect_timeout: float, timeout: float, model: str | None
    ) -> None:
        module = _load()
        self._refused: type[Exception] = module.NiryoRobotException
        self._lock = threading.RLock()
        self._closed = False
        self._robot = module.NiryoRobot()
        self._connection = Connection(host, port, connect_timeout, timeout)
        try:
            self._adopt(timeout)
            self._check_model(model, timeout)
        except BaseException:
            self.close()
            raise

    def _adopt(self, timeout: float) -> None:
        """Give the client our connection, and see that what answers has six joints.

        The client offers no way to choose its port or its socket, hence its private names.
        """
        self._robot._NiryoRobot__client_socket = self._connection
        self._robot._NiryoRobot__is_connected = True
        if hasattr(self._robot, "_NiryoRobot__handshake"):
            self._robot._NiryoRobot__logger.setLevel("ERROR")
            self.call("_NiryoRobot__handshake", timeout=timeout)
        self.joints(timeout)

    def _check_model(self, expected: str | None, timeout: float) -> None:
        try:
            found = self.status(timeout).model
        except (CommandRefused, ProtocolError):
            return  # It does not say what it is.
        if expected is not None and found is not None and found != expected:
            raise WrongArm(
                f"{self._connection.address} is a {found}; expected a {expected}, whose joints "
                "bring the tool elsewhere: use the robot that is there, or name the model that may "
                f"answer, model={found!r}"
            )

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
        with self._bounded(label, timeout):
            try:
                with warnings.catch_warnings():
                    # pyniryo 1.2 deprecates move_joints for a command that system 4 lacks.
                    warnings.simplefilter("ignore", DeprecationWarning)
                    return getattr(self._robot, name)(*args)
            except self._refused as error:
                words = str(error)
                raise refusal(label, words.partition("KO : ")[2] or words) from error
            except (NiryoError, KeyboardInterrupt):
                raise
            except Exception as error:
                raise NotANiryo(
                    f"{self._connection.address} answered {label} with something that pyniryo "
                    f"cannot read ({type(error).__name__}: {error}); expected the server of a "
                    "Niryo with system 4.0 or later"
                ) from error

    def exchange(self, command: str, *params: object, timeout: float) -> tuple[Any, ...]:
        """What a command of the server returns, by its name on the wire. Raises as `call` does."""
        with self._bounded(command.lower(), timeout):
            return self._connection.exchange(command, *params)

    @contextlib.contextmanager
    def _bounded(self, label: str, timeout: float) -> Generator[None]:
        """One call at a time, in time; whatever but a refusal goes wrong closes the connection."""
        with self._lock:
            if self._closed:
                raise ConnectionLost(
                    f"{label} was not sent: the connection to {self._connection.address} is "
                    "closed; connect again"
                )
            self._connection.begin(label, timeout)
            try:
                yield
            except CommandRefused:
                raise
            except BaseException:
                self.close()
                raise

    def status(self, timeout: float) -> HardwareStatus:
        """What the robot says of its hardware.

        Raises:
            ProtocolError: the answer is none. Otherwise as `call` does.
        """
        return parse_status(self.exchange("GET_HARDWARE_STATUS", timeout=timeout))

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
                f"{self._connection.address} answered get_joints with {answer!r}; expected the six "
                "joint angles of a Niryo"
            )
        return joints

    def close(self) -> None:
        """Close the connection; again is allowed, and from another thread."""
        self._closed = True
        self._connection.close()
        self._robot._NiryoRobot__is_connected = False
