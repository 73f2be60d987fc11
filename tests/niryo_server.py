"""A stand-in for the robot's own server, with its two threads, its lock and its queue of one.

It wedges as the robot's does: where three requests wait behind a command, the reading thread holds
the lock and waits for room in the queue, and the working thread holds a request and waits for the
lock. `SimulatedNiryo` does not, so only this can show that `NiryoArm` never brings it about.
"""

from __future__ import annotations

import contextlib
import queue
import select
import socket
import threading
import time
from typing import Any

from niryo_jax.hardware import protocol
from niryo_jax.hardware.protocol import ProtocolError, Request

_TICK = 0.02


class RobotServer:
    """Knows GET_JOINTS, and MOVE_JOINTS, which takes `move` seconds.

    The reading thread may be ahead of the working one by `head_start` seconds, so that what may
    wait behind a command does.
    """

    def __init__(self, move: float, head_start: float = 0.0) -> None:
        self.joints = [0.0, 0.3, -1.3, 0.0, 0.0, 0.0]
        self.wedged = False
        self._move = move
        self._head_start = head_start
        self._client: socket.socket | None = None
        self._lock = threading.Lock()
        self._queue: queue.Queue[Request] = queue.Queue(1)
        self._ending = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=1)
        self.address = "{}:{}".format(*self._listener.getsockname())
        self._threads = [
            threading.Thread(target=target, daemon=True) for target in (self._read, self._work)
        ]

    def __enter__(self) -> RobotServer:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        for thread in self._threads:
            thread.join()
        self._listener.close()
        if self._client is not None:
            self._client.close()

    def _read(self) -> None:
        while not self._ending.is_set():
            waiting = self._listener if self._client is None else self._client
            if not select.select([waiting], [], [], _TICK)[0]:
                continue
            if self._client is None:
                self._client = self._listener.accept()[0]
                self._client.settimeout(5.0)
                continue
            request = self._request(self._client)
            if request is None:
                gone, self._client = self._client, None
                gone.close()
                continue
            if self._locked():
                self._put(request)
                self._lock.release()

    def _put(self, request: Request) -> None:
        """Wait for room, with the lock; for ever on the robot."""
        deadline = time.monotonic() + 1.0
        while not self._ending.is_set():
            with contextlib.suppress(queue.Full):
                self._queue.put(request, timeout=_TICK)
                return
            self.wedged |= time.monotonic() > deadline

    def _locked(self) -> bool:
        while not self._ending.is_set():
            if self._lock.acquire(timeout=_TICK):
                return True
        return False

    @staticmethod
    def _request(client: socket.socket) -> Request | None:
        with contextlib.suppress(OSError, ProtocolError):
            head = client.recv(2)
            if len(head) == 2:
                size = int.from_bytes(head, "little")
                return protocol.parse_request(client.recv(size, socket.MSG_WAITALL))
        return None

    def _work(self) -> None:
        while not self._ending.is_set():
            with contextlib.suppress(queue.Empty):
                request = self._queue.get(timeout=_TICK)
                time.sleep(self._head_start)
                if self._locked():
                    answer = self._answer(request)
                    client = self._client
                    if client is not None:
                        with contextlib.suppress(OSError):
                            client.sendall(protocol.encode_frame(answer))
                    self._lock.release()

    def _answer(self, request: Request) -> dict[str, Any]:
        match request.command, len(request.params):
            case "MOVE_JOINTS", 6:
                self._ending.wait(self._move)
                self.joints = list(request.params)
                return protocol.ok("MOVE_JOINTS")
            case "GET_JOINTS", 0:
                return protocol.ok("GET_JOINTS", self.joints)
            case ("GET_LEARNING_MODE" | "GET_JOINTS" | "MOVE_JOINTS") as command, given:
                words = f"0 parameters expected but {given} given\nIn function"
                return protocol.ko(command, words)
            case _:
                return protocol.ko("", "Unknown command")
