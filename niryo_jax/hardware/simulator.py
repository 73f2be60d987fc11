"""A simulated Niryo: a TCP server on this machine that speaks the robot's protocol."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from niryo_jax.hardware import protocol
from niryo_jax.hardware.commands import Commands, Execution
from niryo_jax.hardware.faults import Fault, FaultKind, FaultPlan
from niryo_jax.hardware.protocol import ProtocolError, Request
from niryo_jax.hardware.simulated_arm import SimulatedArm
from niryo_jax.robots import NIRYO_ONE, NiryoModel

# Longest time that the server's thread is deaf to `close`.
_POLL = 0.05


class SimulatedNiryo:
    """A Niryo that exists in this process only; use it in a `with` statement.

    It serves one client at a time, as the robot does: a second one is accepted by the operating
    system and served after the first has left. Losing the client does not stop the arm.

    Args:
        model: which arm.
        host: address to listen on.
        port: port to listen on; 0 chooses a free one. The robot's own is 40001.
        time_scale: how many times faster than the robot the arm moves.
        faults: faults to show from the start.
        version: the robot's system: "4.1.1", or "5.6.3", which answers OK to moves it refuses.
        tool: the tool mounted on the arm, detected on UPDATE_TOOL; one of `model.tools`.

    Attributes:
        arm: the simulated arm: joints, tool and object.
        host, port: where the server listens.

    Raises:
        ValueError: a time scale that is not positive, an unknown version or tool.
        OSError: the port is taken.
    """

    def __init__(
        self,
        model: NiryoModel = NIRYO_ONE,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        time_scale: float = 1.0,
        faults: Iterable[Fault] = (),
        version: Literal["4.1.1", "5.6.3"] = "4.1.1",
        tool: str = "gripper_1",
    ) -> None:
        if not time_scale > 0:
            raise ValueError(f"time_scale: expected a positive number, got {time_scale!r}")
        if version not in ("4.1.1", "5.6.3"):
            raise ValueError(f'version: expected "4.1.1" or "5.6.3", got {version!r}')
        if tool not in model.tools:
            known = ", ".join(model.tools)
            raise ValueError(f"tool: expected one of {known} for {model.name}, got {tool!r}")
        self.arm = SimulatedArm(model, time_scale=time_scale, mounted_tool=tool)
        self._commands = Commands(self.arm, modern=version == "5.6.3")
        self._plan = FaultPlan(faults)
        self._log: list[Request] = []
        self._closing = threading.Event()
        self._listener = socket.create_server((host, port))
        self._listener.settimeout(_POLL)
        self.host, self.port = self._listener.getsockname()[:2]
        self._thread = threading.Thread(
            target=self._run, name=f"simulated-niryo-{self.port}", daemon=True
        )
        self._thread.start()

    @property
    def address(self) -> str:
        """host:port, as `NiryoArm` takes it."""
        return f"{self.host}:{self.port}"

    @property
    def received(self) -> tuple[Request, ...]:
        """The requests that came so far, in order."""
        return tuple(self._log)

    def place_object(self, position: Sequence[float]) -> None:
        """Put the object to be gripped at a position (3,) in the space frame, metres."""
        self.arm.place_object(position)

    @property
    def object_position(self) -> NDArray[np.float64] | None:
        """(3,) position of the object in the space frame, metres; None before one is placed."""
        return self.arm.object_position

    def inject(self, fault: Fault) -> None:
        """Let a fault show from the next request on."""
        self._plan.add(fault)

    def clear_faults(self) -> None:
        """Forget all faults."""
        self._plan.clear()

    def close(self) -> None:
        """Stop serving: every connection is closed and the server's thread has ended."""
        self._closing.set()
        self._thread.join()
        self._listener.close()

    def __enter__(self) -> SimulatedNiryo:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            with connection:
                connection.settimeout(_POLL)
                try:
                    while self._answer_next(connection):
                        pass
                except (OSError, ProtocolError):
                    # The client left or wrote something else: on to the next one.
                    continue

    def _answer_next(self, connection: socket.socket) -> bool:
        """Serve one request; whether the connection stays open."""
        request = protocol.parse_request(
            protocol.read_frame(lambda size: self._read(connection, size))
        )
        self._log.append(request)
        fault = self._plan.next_for(request.command)
        kind = fault.kind if fault else None
        if fault and kind is FaultKind.REFUSE:
            execution = self._commands.refusal(request.command, fault.message)
        elif kind is FaultKind.STILL:
            execution = Execution(protocol.ok(request.command))
        else:
            execution = self._commands.execute(request)
        if kind is FaultKind.SILENT:
            return True
        remaining = execution.due - time.monotonic()
        self._wait(remaining / 2 if kind is FaultKind.DROP else remaining)
        if fault and kind is FaultKind.DELAY:
            self._wait(fault.seconds)
        if kind is FaultKind.DROP:
            return False
        frame = protocol.encode_frame(execution.answer)
        if fault and kind is FaultKind.GARBAGE:
            frame = fault.data
        elif kind is FaultKind.CUT:
            frame = frame[: len(frame) // 2]
        connection.sendall(frame)
        return kind is not FaultKind.CUT

    def _read(self, connection: socket.socket, size: int) -> bytes:
        data = b""
        while len(data) < size:
            try:
                part = connection.recv(size - len(data))
            except TimeoutError:
                if self._closing.is_set():
                    raise ConnectionAbortedError("the simulator is closing") from None
                continue
            if not part:
                raise ConnectionResetError("the client left")
            data += part
        return data

    def _wait(self, seconds: float) -> None:
        if seconds > 0 and self._closing.wait(seconds):
            raise ConnectionAbortedError("the simulator is closing")
