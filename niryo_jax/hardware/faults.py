"""Faults that a simulated robot can be told to show."""

from __future__ import annotations

import dataclasses
import enum
import threading
from collections.abc import Iterable


class FaultKind(enum.Enum):
    """What goes wrong with a command."""

    REFUSE = "answer KO with `message` and do nothing"
    DROP = "close the connection half-way through the command, which goes on"
    DELAY = "answer `seconds` of real time late"
    GARBAGE = "answer `data` instead of a frame of the protocol"
    CUT = "close the connection after half of the answer"
    SILENT = "carry the command out and never answer"
    STILL = "answer OK and do nothing"


@dataclasses.dataclass(frozen=True)
class Fault:
    """One fault, and when it shows.

    Attributes:
        kind: what goes wrong.
        command: name of the command on the wire, e.g. "MOVE_JOINTS"; every command where None.
        occurrence: at which such command after the fault was injected, counted from 1; at each
            where None.
        message: the robot's words, for REFUSE.
        seconds: real time, for DELAY.
        data: bytes, for GARBAGE. The default is a frame whose body is not JSON.
    """

    kind: FaultKind
    command: str | None = None
    occurrence: int | None = None
    message: str = "Injected fault"
    seconds: float = 0.2
    data: bytes = b"\x05\x00hello"


class FaultPlan:
    """The faults still to come. Thread-safe."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._lock = threading.Lock()
        self._seen = dict.fromkeys(faults, 0)

    def add(self, fault: Fault) -> None:
        """Let `fault` show from the next command on."""
        with self._lock:
            self._seen[fault] = 0

    def clear(self) -> None:
        """Forget all faults."""
        with self._lock:
            self._seen.clear()

    def next_for(self, command: str) -> Fault | None:
        """The fault that shows at this command, which is counted."""
        due = None
        with self._lock:
            for fault in self._seen:
                if fault.command in (None, command):
                    self._seen[fault] += 1
                    if due is None and fault.occurrence in (None, self._seen[fault]):
                        due = fault
        return due
