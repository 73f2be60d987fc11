"""Which robots were left with a request unanswered, remembered from one program to the next.

A note is an empty file in the folder for temporary files. It costs a careful connection where it is
out of date, so nothing depends on its being there.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
import time
from pathlib import Path

# Seconds after which a note is out of date: no command takes longer.
_LIFETIME = 600.0


def note(address: str) -> None:
    """Remember that a request to host:port was left unanswered."""
    with contextlib.suppress(OSError):
        path = _path(address)
        path.unlink(missing_ok=True)
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))


def noted(address: str) -> bool:
    """Whether a request to host:port was left unanswered of late."""
    with contextlib.suppress(OSError):
        return abs(time.time() - _path(address).lstat().st_mtime) < _LIFETIME
    return False


def forget(address: str) -> None:
    """Forget it: the robot has answered since."""
    with contextlib.suppress(OSError):
        _path(address).unlink(missing_ok=True)


def _path(address: str) -> Path:
    name = re.sub(r"[^A-Za-z0-9.-]", "_", address)[:100]
    return Path(tempfile.gettempdir()) / f"niryo_jax-unanswered-{name}"
