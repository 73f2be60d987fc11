"""One map in a process of its own, for `benchmarks.workspace`: prints what it cost as JSON.

python -m benchmarks.workspace_run STORE --voxel 0.025 --orientations 200 [--robot ur16e]
    [--devices 8] [--address 127.0.0.1:1234 --index 0] [--full]
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import jax

from niryo_jax import workspace as ws
from niryo_jax.robots import catalogue


def main() -> None:
    """Make or resume the map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("store")
    parser.add_argument("--robot", default="niryo_one")
    parser.add_argument("--voxel", type=float, default=0.025)
    parser.add_argument("--orientations", type=int, default=200)
    parser.add_argument("--devices", type=int, default=1)
    parser.add_argument("--address")
    parser.add_argument("--index", type=int, default=0)
    parser.add_argument("--full", action="store_true")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_num_cpu_devices", options.devices)
    if options.address:
        with ws.one_of_many(options.address, 2, options.index, heartbeat_timeout_seconds=10):
            make(options)
    else:
        make(options)


def make(options: argparse.Namespace) -> None:
    """Make the map and print what it cost."""
    robot = catalogue.load(options.robot)
    times: list[tuple[float, int]] = []
    started = time.perf_counter()
    ws.capability_map(
        robot,
        options.voxel,
        orientations=options.orientations,
        store=options.store,
        full=options.full,
        progress=lambda done, total: times.append((time.perf_counter(), done)),
    )
    ended = time.perf_counter()
    cost = {
        "seconds": ended - started,
        "poses": times[-1][1] if times else 0,
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    if len(times) > 1:
        # The first tile waits for the compiler; what it brought is left out with its time.
        (begun, there), (last, done) = times[1], times[-1]
        cost |= {"computing": last - begun, "computed": done - there}
    print(json.dumps(cost))


if __name__ == "__main__":
    main()
