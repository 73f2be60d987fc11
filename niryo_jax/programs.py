"""The compiled programs of arms, of which those that were used last are kept.

A solver's program takes tens of megabytes and, on a CPU, hundreds to thousands of pieces of memory.
Linux lets a process map 65,530 pieces, and jaxlib ends the interpreter that asks for more. So what
was compiled for arms that have not been used for long is let go, and compiled again where such an
arm comes back.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

from niryo_jax._jax import Compiled

_MOST = 128
"""So many functions of arms are kept, each with its programs for batches of all sizes..."""

_LEAST = 8
"""... and these few at least, also where it is other programs that fill the memory."""

_SHARE = 0.5
"""The share of the pieces of memory that a process may have, above which programs are let go."""


class Programs:
    """Compiled functions by what they are compiled for; those used last are kept.

    Args:
        most, least: how many are kept at most, and whatever memory they take.
    """

    def __init__(self, most: int = _MOST, least: int = _LEAST) -> None:
        self._most, self._least = most, least
        self._kept: OrderedDict[Hashable, Compiled] = OrderedDict()
        # Batches are solved in several threads.
        self._lock = threading.Lock()

    def __len__(self) -> int:
        """How many are kept."""
        return len(self._kept)

    def run(
        self, key: Hashable, make: Callable[[], Compiled], concrete: bool, *arguments: Any
    ) -> Any:
        """Call the function of a key, which `make` makes where it is not kept."""
        with self._lock:
            function = self._kept.get(key)
            if function is None:
                function = self._kept[key] = make()
                if len(self._kept) > self._most:
                    self._kept.popitem(last=False)
            else:
                self._kept.move_to_end(key)
        try:
            return function(concrete, *arguments)
        finally:
            if function.has_grown():
                self._let_go()

    def _let_go(self) -> None:
        """Forget what was used longest ago, until the memory has few enough pieces."""
        with self._lock:
            while len(self._kept) > self._least and mapped_share() > _SHARE:
                self._kept.popitem(last=False)


PROGRAMS = Programs()
"""Those of all arms."""


def mapped_share() -> float:
    """The share of the pieces of memory that this process may map, which it has mapped.

    0 where the system has no such limit, or does not tell.
    """
    try:
        most = int(Path("/proc/sys/vm/max_map_count").read_text())
        return Path("/proc/self/maps").read_bytes().count(b"\n") / most
    except (OSError, ValueError):
        return 0.0
