"""A connection to the robot's server on which no answer can be taken for another's.

The server carries out one command after the other, and sends each answer to whoever is connected by
then: a program that connects while the move of an earlier one is under way gets that move's answer.
It wedges, until it is restarted, where three requests wait behind one command. Hence:

- The first request is one whose answer names a number of our choice. Answers before it are dropped.
- From then on each answer must name the command that was asked.
- Where a request was left unanswered, nothing is sent before the server is seen to serve. A
  *knock*, a connection closed for writing at once, is closed by a server that is free to read, and
  leaves nothing behind where it is given up: of all attempts during a move one request waits.
"""

from __future__ import annotations

import contextlib
import json
import random
import re
from typing import Any

from niryo_jax.hardware import abandoned, protocol
from niryo_jax.hardware.bounded_socket import BoundedSocket
from niryo_jax.hardware.errors import (
    CallTimeout,
    CommandRefused,
    ConnectionLost,
    NotANiryo,
    RobotBusy,
)
from niryo_jax.hardware.protocol import Answer, ProtocolError

# Seconds. The robot closes a knock within milliseconds; a server that only does so when it takes
# the next client is given one after this time.
_KNOCK = 0.5

# Asked with too many parameters, it is refused by the number of them and does nothing.
_PROBE = "GET_LEARNING_MODE"
_COUNTS = range(100, 1000)


class Connection:
    """A connection to a Niryo, with the methods of a socket that pyniryo calls.

    Args:
        host, port: where the robot's server listens.
        timeout: seconds for the connection, and again for its first answer.
        busy_timeout: seconds for the first answer where a request was left unanswered.

    Raises, on construction:
        ConnectionFailed, RobotBusy, NotANiryo: see `niryo_jax.hardware.errors`.
    """

    def __init__(self, host: str, port: int, timeout: float, busy_timeout: float) -> None:
        self._expected = ""
        self._rest = b""
        self._unanswered = False
        careful = abandoned.noted(f"{host}:{port}")
        self._socket = (_open_after_knock if careful else BoundedSocket)(host, port, timeout)
        try:
            self._synchronise(busy_timeout if careful else timeout, served=careful)
        except BaseException:
            self.close()
            raise
        abandoned.forget(self.address)

    @property
    def address(self) -> str:
        """host:port."""
        return self._socket.address

    def begin(self, call: str, timeout: float) -> None:
        """Bound what follows, up to the next `begin`, by `timeout` seconds."""
        self._socket.begin(call, timeout)

    def send(self, data: bytes) -> int:
        """Send one frame, a request, and note which command is to be answered."""
        self._expected = str(json.loads(data[2:])["command"])
        self._rest = b""
        self._unanswered = True
        self._socket.write(data)
        return len(data)

    def recv(self, size: int) -> bytes:
        """The next `size` bytes of the answer to what was sent last.

        pyniryo takes a short first read for a lost robot, and loops for ever on a closed socket:
        it gets whole answers only.
        """
        if not self._rest:
            body, answer = _next_answer(self._socket)
            while answer.command != self._expected and (answer.ok or answer.command):
                body, answer = _next_answer(self._socket)
            self._rest = len(body).to_bytes(2, "little") + body
            self._unanswered = False
        part, self._rest = self._rest[:size], self._rest[size:]
        return part

    def exchange(self, command: str, *params: object) -> tuple[Any, ...]:
        """What a command returns, also one that the installed pyniryo does not have.

        Raises:
            CommandRefused: the robot answered KO.
        """
        self.send(protocol.encode_frame(protocol.request(command, *params)))
        answer = protocol.parse_answer(protocol.read_frame(self.recv))
        if not answer.ok:
            raise refusal(command.lower(), answer.message)
        return answer.values

    def shutdown(self, how: int) -> None:
        """Called by pyniryo when it is dropped without having been closed."""
        self.close()

    def close(self) -> None:
        """Close the connection; again is allowed, and from another thread."""
        if self._unanswered:
            abandoned.note(self.address)
        self._socket.close()

    def _synchronise(self, timeout: float, *, served: bool) -> None:
        """See that a Niryo answers us, and drop what it answers to others."""
        count = random.choice(_COUNTS)
        self._socket.begin("connect", timeout)
        self.send(protocol.encode_frame(protocol.request(_PROBE, *[0] * count)))
        try:
            while not _is_ours(_next_answer(self._socket), count):
                pass
        except CallTimeout:
            if self._socket.received:
                raise _stranger(self._socket, "began an answer and never ended it") from None
            if served:
                raise RobotBusy(
                    f"{self.address} serves, and answered nothing within {timeout:g} s: the arm is "
                    "finishing a move of an earlier program; wait for its end and connect again "
                    "(or check that this is the robot)"
                ) from None
            raise _busy(self.address, timeout) from None
        except ConnectionLost:
            words = "closed the connection without a whole answer"
            raise _stranger(self._socket, words) from None
        self._unanswered = False


def refusal(call: str, message: str) -> CommandRefused:
    """The error of a command that was answered KO, on one line, without the server's additions."""
    words = message.removeprefix("An error occured while executing the last command : ")
    reason = " ".join(words.partition("\nNo handshake has been made")[0].split())
    return CommandRefused(f"the robot refused {call}: {reason}", reason)


def _open_after_knock(host: str, port: int, timeout: float) -> BoundedSocket:
    """A connection to a server that has been seen to serve."""
    with contextlib.closing(BoundedSocket(host, port, timeout)) as knock:
        knock.end_writing()
        wait = min(timeout / 2, _KNOCK)
        served = _is_closed(knock, wait)
        connection = BoundedSocket(host, port, timeout)
        try:
            if not (served or _is_closed(knock, timeout - wait)):
                raise _busy(knock.address, timeout)
        except BaseException:
            connection.close()
            raise
        return connection


def _busy(address: str, timeout: float) -> RobotBusy:
    return RobotBusy(
        f"{address} accepted the connection and answered nothing within {timeout:g} s: a Niryo "
        "serves one program at a time, so close the other program (Niryo Studio included); or the "
        "arm is finishing a move of an earlier program, so wait for its end; or this is no robot"
    )


def _is_closed(knock: BoundedSocket, seconds: float) -> bool:
    """Whether the server closes a knock in time; late answers that it sends there are dropped."""
    knock.begin("connect", seconds)
    try:
        while True:
            _next_answer(knock)
    except (ConnectionLost, CallTimeout) as error:
        if knock.received:
            raise _stranger(knock, "began an answer and never ended it") from None
        return isinstance(error, ConnectionLost)


def _next_answer(connection: BoundedSocket) -> tuple[bytes, Answer]:
    body = protocol.read_frame(connection.read)
    connection.received = False
    try:
        return body, protocol.parse_answer(body)
    except ProtocolError as error:
        words = f"answered {connection.call} with something that is no answer ({error})"
        raise _stranger(connection, words) from error


def _stranger(connection: BoundedSocket, words: str) -> NotANiryo:
    return NotANiryo(
        f"{connection.address} {words}; expected the server of a Niryo with system 4.0 or later"
    )


def _is_ours(received: tuple[bytes, Answer], count: int) -> bool:
    """Whether this answers the probe of so many parameters, and not that of an earlier program."""
    _, answer = received
    if answer.command != _PROBE:
        return False
    named = [int(number) for number in re.findall(r"\d{1,6}", answer.message)]
    # Python's own words count the object among the parameters.
    return count in named or count + 1 in named or not any(number in _COUNTS for number in named)
