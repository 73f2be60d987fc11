"""Ctrl-C in a process that is the command `niryo-jax`, from the first line of the package on.

Most of a short command is the import of JAX. A KeyboardInterrupt in there comes out as a traceback,
as an ImportError of what was being initialised, or not at all. So while nothing is to be cleaned up
Ctrl-C ends the process on the spot; this module, which imports nothing of weight, is the first that
the package imports, and sees to it.
"""

from __future__ import annotations

import os
import signal
import sys

INTERRUPTED = 130
"""The exit code of a command that was interrupted."""

_MODULE, _SCRIPT = "niryo_jax.cli", "niryo-jax"
_DOCUMENT = f'{{\n  "error": "interrupted",\n  "exit_code": {INTERRUPTED}\n}}\n'
_LINE = "error: interrupted\n"
_OVER_WHAT_IS_SHOWN = "\r\x1b[K\x1b[?25h"
"""To a terminal: to the start of the line, which is cleared, and with the cursor visible."""


def is_command() -> bool:
    """Whether this process is the command, and not a program that imports the package."""
    name = sys.argv[0] if sys.argv else ""
    if name == "-m":  # As it is called until its module is found, after the package.
        return _MODULE in sys.orig_argv or f"-m{_MODULE}" in sys.orig_argv
    stem = os.path.basename(name).removesuffix(".exe").removesuffix("-script.py")
    # Processes that it starts inherit its name, but not the line by which it was started.
    return stem == _SCRIPT and name in sys.orig_argv


def end_at_once() -> None:
    """Let Ctrl-C end this process in one line, at once."""
    # Where a shell in the background has it ignored, it stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def raise_again() -> None:
    """Let Ctrl-C raise KeyboardInterrupt from now on, since there is something to clean up."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ignore() -> None:
    """Let Ctrl-C be: all is done, and what Python does at its end would show a traceback."""
    if signal.getsignal(signal.SIGINT) in (_end, signal.default_int_handler):
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end(*_: object) -> None:
    # Past Python's streams, which may be in use, and past whatever is being imported.
    as_json = "--json" in sys.argv
    said = _DOCUMENT if as_json else _LINE
    try:
        if not as_json and os.isatty(2):
            said = _OVER_WHAT_IS_SHOWN + said
        os.write(1 if as_json else 2, said.encode())
    finally:
        os._exit(INTERRUPTED)


if is_command():
    end_at_once()
