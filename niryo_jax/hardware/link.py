"""The connection of one arm: made, checked and closed."""

from __future__ import annotations

import warnings
from types import TracebackType
from typing import Any, Self

from niryo_jax.hardware import arguments
from niryo_jax.hardware._pyniryo import PyniryoClient, pyniryo_version
from niryo_jax.hardware.errors import ArgumentRejected, ConnectionLost
from niryo_jax.robot import Robot
from niryo_jax.robots import MODELS


class ArmLink:
    """The connection to one arm; `NiryoArm` has what can be done with it.

    Raises:
        ArgumentRejected: no robot, a malformed host or port, a time that is not positive.
    """

    def __init__(
        self,
        host: str,
        *,
        robot: Robot,
        port: int | None,
        model: str | None,
        connect_timeout: float,
        timeout: float,
    ) -> None:
        if not isinstance(robot, Robot):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentRejected(f"robot: expected a Robot, got {robot!r}")
        self._host, self._port = arguments.split_host(host, port)
        self._connect_timeout = arguments.positive("connect_timeout", connect_timeout)
        self._timeout = arguments.positive("timeout", timeout)
        self._robot_name = robot.name
        if model is not None:
            self._model = arguments.model_name(model, list(MODELS))
        else:
            self._model = robot.name if robot.name in MODELS else None
        self._client: PyniryoClient | None = None

    def connect(self) -> None:
        """Connect, and see that the right Niryo answers. Done by `with`.

        Where the arm is finishing a move of an earlier program its end is waited for, for
        `timeout` seconds. Warns where the installed pyniryo is not made for this robot.

        Raises:
            PyniryoMissing: pyniryo is not installed, not importable or not supported.
            ConnectionFailed: unknown host, no answer, connection refused.
            RobotBusy: another program is connected, or a move of an earlier one goes on for longer.
            NotANiryo: what answers does not speak the protocol.
            WrongArm: the robot says that it is another model.
        """
        info = pyniryo_version()
        if self._robot_name in MODELS and self._robot_name not in info.fits:
            warnings.warn(
                f"pyniryo {info.version} is made for {', '.join(info.fits)} with system "
                f"{info.systems}, not for {self._robot_name}; some commands may be unknown to it",
                stacklevel=3,
            )
        self.close()
        self._client = PyniryoClient(
            self._host, self._port, self._connect_timeout, self._timeout, self._model
        )

    def close(self) -> None:
        """Close the connection; again is allowed. A move that is under way goes on."""
        if self._client is not None:
            self._client.close()

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def _connected(self) -> PyniryoClient:
        if self._client is None:
            raise ConnectionLost(
                f"not connected to {self._host}:{self._port}; use the arm in a `with` statement, "
                "or call connect() first"
            )
        return self._client

    def _call(self, name: str, *args: object, timeout: float | None = None) -> Any:
        return self._connected.call(name, *args, timeout=timeout or self._timeout)
