"""Several processes, on one machine or on many, that make one map in one store."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

import jax

from niryo_jax._jax import survive_lost_processes

_PATIENCE = 600.0
"""Seconds without a new chunk after which other processes are given up: longer than it takes to
compile, on a busy machine too, and to compute a chunk."""

_FAREWELL = 3.0
"""Seconds that the process which holds all together stays when its work is done."""


@contextmanager
def one_of_many(
    coordinator_address: str | None = None,
    num_processes: int | None = None,
    process_id: int | None = None,
    **more: Any,
) -> Generator[None]:
    """Be one of several processes under `jax.distributed`, in which `capability_map` shares a map.

    A process that is lost costs the chunk that it was at: the others go on with theirs, and a new
    run brings what is missing. Without process 0, which holds all together, JAX ends the others.
    Called before anything is computed.

    Args:
        coordinator_address, num_processes, process_id, more: as `jax.distributed.initialize` takes
            them; none under Slurm, Open MPI or on cloud TPUs, which it finds by itself.
    """
    survive_lost_processes()
    jax.distributed.initialize(coordinator_address, num_processes, process_id, **more)
    try:
        yield
    finally:
        if jax.process_index() == 0:
            # JAX ends a process that takes its leave from one that is gone.
            time.sleep(_FAREWELL)
        jax.distributed.shutdown()


def await_others(missing: Callable[[], int]) -> None:
    """Wait while other processes bring what is missing of a map.

    Without `one_of_many`, JAX takes a process that leaves long before the others for lost.
    """
    least, since = missing(), time.monotonic()
    while least and time.monotonic() - since < _PATIENCE:
        time.sleep(0.2)
        if (left := missing()) < least:
            least, since = left, time.monotonic()
