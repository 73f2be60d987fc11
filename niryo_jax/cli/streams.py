"""Standard output and standard error that may be closed, full, or read by no one any more."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Generator
from typing import Any

from niryo_jax.cli.outcome import ExitCode, Failure


class OutputLost(Failure):
    """Results that could not be written; it is told on standard error, whatever was asked for."""

    def report(self, *, as_json: bool) -> int:
        """Write the error to stderr and return the exit code."""
        return super().report(as_json=False)


def guard_streams() -> None:
    """Let what becomes of the streams of this process be told in words.

    Raises:
        OutputLost: standard output is closed.
    """
    for stream in filter(None, (sys.stdout, sys.stderr)):
        # A name in letters that the terminal has not is no reason to lose a result.
        stream.reconfigure(errors="backslashreplace")  # pyright: ignore[reportAttributeAccessIssue]
    # A print to a closed standard error would go to standard output.
    sys.stderr = _Remarks(sys.stderr or io.StringIO())
    if sys.stdout is None:  # pyright: ignore[reportUnnecessaryComparison]
        raise OutputLost("standard output is closed", ExitCode.OUTPUT)
    sys.stdout = _Results(sys.stdout)


def read_stdin() -> str:
    """All of standard input.

    Raises:
        OSError: it is closed.
        UnicodeDecodeError: it is no text.
    """
    if sys.stdin is None:  # pyright: ignore[reportUnnecessaryComparison]
        raise OSError("standard input is closed")
    return sys.stdin.read()


class _Stream:
    """A text stream of which errors are told in another way."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with self._told():
            return self._stream.write(text)
        return 0

    def flush(self) -> None:
        with self._told():
            self._stream.flush()

    @contextlib.contextmanager
    def _told(self) -> Generator[None]:
        try:
            yield
        except OSError as error:
            # What is buffered still would fail again when Python ends.
            with contextlib.suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())
            self._tell(error)

    def _tell(self, error: OSError) -> None:
        """Nothing can be done."""


class _Remarks(_Stream):
    """Standard error, where what cannot be written is lost."""


def _is_lost_pipe(error: OSError) -> bool:
    """Whether it is what Windows says in the place of a broken pipe."""
    return sys.platform == "win32" and error.errno == errno.EINVAL


class _Results(_Stream):
    """Standard output, where what cannot be written ends the command."""

    def _tell(self, error: OSError) -> None:
        if isinstance(error, BrokenPipeError) or _is_lost_pipe(error):
            said = "the program that read the output ended before its end (broken pipe)"
            raise OutputLost(said, ExitCode.PIPE) from error
        raise OutputLost(
            f"cannot write to standard output: {error.strerror or error}", ExitCode.OUTPUT
        ) from error
