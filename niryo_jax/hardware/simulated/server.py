"""The server of a simulated robot: one thread that reads requests, one that carries them out.

As with the robot: one client at a time, one command after the other. While a command is carried out
one more request is read and waits; what comes after stays in the sockets, and no new client is
taken. An answer goes to whoever is connected when it is ready, so that a client may get that of an
earlier client's command. Unlike the robot's, this server does not wedge.
"""

from __future__ import annotations

import contextlib
import queue
import socket
import threading

from niryo_jax.hardware import protocol
from niryo_jax.hardware.faults import Fault, FaultKind, FaultPlan
from niryo_jax.hardware.protocol import ProtocolError, Request
from niryo_jax.hardware.simulated.arm import SimulatedArm
from niryo_jax.hardware.simulated.interpreter import Interpreter

# Longest time that the threads are deaf to `close`, and that a client may take to read its answer.
_POLL = 0.05
_SEND = 5.0


class Server:
    """Serves one simulated arm.

    Args:
        arm: the arm.
        modern: whether the system is 5.6.3.
        host, port: address to listen on; port 0 chooses a free one.
        faults: what goes wrong, and when.

    Attributes:
        address: where it listens.
        received: the requests that were read so far, in order.
    """

    def __init__(
        self, arm: SimulatedArm, *, modern: bool, host: str, port: int, faults: FaultPlan
    ) -> None:
        self.received: list[Request] = []
        self._faults = faults
        self._dropping = False
        self._interpreter = Interpreter(arm, modern=modern, wait=self._wait)
        self._client: socket.socket | None = None
        self._client_lock = threading.Lock()
        self._busy = threading.Lock()
        self._waiting: queue.Queue[Request] = queue.Queue()
        self._closing = threading.Event()
        self._listener = socket.create_server((host, port))
        self._listener.settimeout(_POLL)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]

    def run(self) -> None:
        """Serve until `stop`; every connection is closed and no thread is left then."""
        worker = threading.Thread(
            target=self._carry_out_requests, name=f"simulated-niryo-{self.address[1]}", daemon=True
        )
        worker.start()
        self._read_requests()
        worker.join()
        self._listener.close()

    def stop(self) -> None:
        """Let `run` end."""
        self._closing.set()

    def _read_requests(self) -> None:
        while not self._closing.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                continue
            with client:
                client.settimeout(_POLL)
                with self._client_lock:
                    self._client = client
                # The client left, or wrote something else: on to the next one.
                with contextlib.suppress(OSError, ProtocolError):
                    self._serve(client)
                with self._client_lock:
                    self._client = None

    def _serve(self, client: socket.socket) -> None:
        while True:
            length = self._receive(client, 2)
            request = protocol.parse_request(
                self._receive(client, int.from_bytes(length, "little"), whole=True)
            )
            while not self._busy.acquire(timeout=_POLL):
                self._check_open()
            try:
                self.received.append(request)
                self._waiting.put(request)
            finally:
                self._busy.release()

    def _receive(self, client: socket.socket, size: int, *, whole: bool = False) -> bytes:
        """The next bytes: `size` of them where `whole`, else what one read gives, or nothing.

        The robot takes a length that comes in two parts for the end of the connection.
        """
        data = b""
        while len(data) < size:
            try:
                part = client.recv(size - len(data))
            except TimeoutError:
                self._check_open()
                continue
            data += part
            if not part or not (whole or len(data) == size):
                raise ConnectionResetError("the client left")
        return data

    def _carry_out_requests(self) -> None:
        while not self._closing.is_set():
            try:
                request = self._waiting.get(timeout=_POLL)
            except queue.Empty:
                continue
            with self._busy, contextlib.suppress(OSError):
                self._carry_out(request)

    def _carry_out(self, request: Request) -> None:
        fault = self._faults.next_for(request.command)
        kind = fault.kind if fault else None
        self._dropping = kind is FaultKind.DROP
        if fault and kind is FaultKind.REFUSE:
            answer = self._interpreter.refusal(request.command, fault.message)
        elif kind is FaultKind.STILL:
            answer = protocol.ok(request.command)
        else:
            answer = self._interpreter.execute(request)
        if self._dropping:
            self._drop()
            return
        if kind is FaultKind.SILENT:
            return
        if fault and kind is FaultKind.DELAY:
            self._wait(fault.seconds)
        frame = self._frame(request, answer)
        if fault:
            frame = _spoiled(frame, fault)
        self._send(frame)
        if kind is FaultKind.CUT:
            self._drop()

    def _frame(self, request: Request, answer: dict[str, object]) -> bytes:
        try:
            return protocol.encode_frame(answer)
        except (ProtocolError, TypeError, ValueError) as error:
            return protocol.encode_frame(
                self._interpreter.refusal(request.command[:80], str(error))
            )

    def _send(self, frame: bytes) -> None:
        with self._client_lock:
            client = self._client
        if client is not None:
            # A handle of its own, whose time limit is not that of the reading thread.
            with contextlib.suppress(OSError), client.dup() as sender:
                sender.settimeout(_SEND)
                sender.sendall(frame)

    def _drop(self) -> None:
        self._dropping = False
        with self._client_lock:
            client = self._client
        if client is not None:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def _wait(self, seconds: float) -> None:
        """Wait while a command is carried out; a fault closes the connection half-way."""
        if self._dropping:
            self._pause(seconds / 2)
            self._drop()
            seconds /= 2
        self._pause(seconds)

    def _pause(self, seconds: float) -> None:
        if seconds > 0 and self._closing.wait(seconds):
            self._check_open()

    def _check_open(self) -> None:
        if self._closing.is_set():
            raise ConnectionAbortedError("the simulator is closing")


def _spoiled(frame: bytes, fault: Fault) -> bytes:
    if fault.kind is FaultKind.GARBAGE:
        return fault.data
    return frame[: len(frame) // 2] if fault.kind is FaultKind.CUT else frame
