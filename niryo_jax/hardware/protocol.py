"""The wire of the Niryo TCP server: frames, requests and answers.

A frame is a 2-byte little-endian length and that many bytes of JSON. A request holds "command" and
"param_list"; an answer holds "status" ("OK" or "KO"), "command", "list_ret_param" and, on OK,
"payload_size".
"""

from __future__ import annotations

import ast
import dataclasses
import json
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

PORT = 40001
_LENGTH = struct.Struct("<H")


class ProtocolError(ValueError):
    """Bytes that are not a request; the robot's server ends the connection on them."""


@dataclasses.dataclass(frozen=True)
class Request:
    """One command as it came over the wire: its name and its parameters."""

    command: str
    params: tuple[Any, ...]


@dataclasses.dataclass(frozen=True)
class Answer:
    """What the server said to one command.

    Attributes:
        command: the name of the command that it answers; empty where the server does not know it.
        ok: whether it was carried out, or is said to have been.
        values: what it returns.
        message: why it was refused; empty where it was not.
    """

    command: str
    ok: bool
    values: tuple[Any, ...] = ()
    message: str = ""


def encode_frame(message: Mapping[str, object]) -> bytes:
    """The frame of one message.

    Raises:
        ProtocolError: the message is longer than the 65535 bytes that a frame can hold.
        ValueError: a number in it is not finite.
    """
    body = json.dumps(message, allow_nan=False).encode()
    if len(body) > 0xFFFF:
        raise ProtocolError(f"a frame holds at most 65535 bytes, got {len(body)}")
    return _LENGTH.pack(len(body)) + body


def read_frame(read: Callable[[int], bytes]) -> bytes:
    """The body of the next frame, where `read(n)` returns exactly n bytes."""
    (length,) = _LENGTH.unpack(read(_LENGTH.size))
    return read(length)


def parse_request(body: bytes) -> Request:
    """The request in a frame's body, read as a Python literal as the robot's server reads it.

    Raises:
        ProtocolError: not a literal (JSON's true, null and NaN are none), or not exactly the two
            keys of a request.
    """
    try:
        message = ast.literal_eval(body.decode())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError) as error:
        raise ProtocolError(f"not a Python literal: {body[:80]!r}") from error
    match message:
        case {"command": str(command), "param_list": list(params), **rest} if not rest:
            return Request(command, tuple(params))
        case _:
            raise ProtocolError(f"expected 'command' and 'param_list', got {body[:80]!r}")


def request(command: str, *params: object) -> dict[str, object]:
    """A command as pyniryo writes it; strings, numbers and lists only."""
    return {"command": command, "param_list": list(params)}


def parse_answer(body: bytes) -> Answer:
    """The answer in a frame's body.

    Raises:
        ProtocolError: not an answer of the server.
    """
    try:
        message: Any = json.loads(body.decode())
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"not JSON: {body[:80]!r}") from error
    match message:
        case {"status": "OK", "command": str(command), "list_ret_param": list(values)}:
            return Answer(command, True, values=tuple(values))
        case {"status": "KO", "command": str(command), "message": str(text)}:
            return Answer(command, False, message=text)
        case _:
            raise ProtocolError(f"expected an answer with its status and command: {body[:80]!r}")


def ok(command: str, values: Sequence[object] = ()) -> dict[str, object]:
    """The answer to a command that was carried out. Booleans in `values` must be "True"/"False"."""
    return {
        "status": "OK",
        "command": command,
        "list_ret_param": list(values),
        "payload_size": 0,
    }


def ko(command: str, reason: str) -> dict[str, object]:
    """The answer to a command that was refused."""
    return {"command": command, "status": "KO", "message": reason, "list_ret_param": []}
