"""Where the time of a compiled program goes: what XLA's CPU runs one after the other.

    python -m benchmarks.thunks [niryo_one] [--poses 16384] [--most 40]

Each event of the trace is a thunk: a fused loop, a copy, a sort, or a loop over others, which
counts what it holds as well. Watching takes 1 to 2 us an event, so that many small ones look worse
than they are: the time without it is printed first. To see what a thunk computes, run with

    XLA_FLAGS="--xla_dump_to=DIR --xla_dump_hlo_as_text --xla_dump_hlo_module_re=.*of_pattern.*"

and look for its name in DIR/*cpu_after_optimizations.txt, and for how it was compiled (vectors or
not) in DIR/*NAME*ir-with-opt.ll. A `copy` of a large array in a loop means that something reads
what another thunk writes in place; many more operations in the files than the formula has, that
shared values are worked out again for each use (`lanes.materialise`).
"""

from __future__ import annotations

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import argparse
import collections
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.profiler import ProfileData, ProfileOptions

import niryo_jax as nj
from benchmarks import reference
from benchmarks.arms import at_random
from benchmarks.measure import table


def thunks_of(call: Callable[[], Any]) -> list[tuple[str, int, float]]:
    """Name, number and seconds of all that one call runs, the longest first."""
    options = ProfileOptions()
    options.host_tracer_level, options.python_tracer_level = 3, 0
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder, profiler_options=options):
            jax.block_until_ready(call())
        (path,) = Path(folder).rglob("*.xplane.pb")
        seconds, number = collections.Counter[str](), collections.Counter[str]()
        for plane in ProfileData.from_file(str(path)).planes:
            for line in plane.lines:
                for event in line.events:
                    seconds[event.name] += event.duration_ns / 1e9
                    number[event.name] += 1
    return [(name, number[name], spent) for name, spent in seconds.most_common()]


def main() -> int:
    """Print the thunks of complete inverse kinematics of an arm."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("robot", nargs="?", default="niryo_one", help="a name, or 'random'")
    parser.add_argument("--poses", type=int, default=16384)
    parser.add_argument("--most", type=int, default=40)
    args = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    robot = at_random(0) if args.robot == "random" else nj.robots.load(args.robot)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (args.poses, robot.joints))
    pose = jax.numpy.asarray(reference.forward_kinematics(robot, q))

    def call() -> Any:
        return jax.block_until_ready(nj.inverse_kinematics(robot, pose, method="complete"))

    call()
    start = time.perf_counter()
    call()
    each = 1e6 / args.poses
    print(f"{robot.name}: {(time.perf_counter() - start) * each:.2f} us a pose, not watched\n")
    rows = [
        [name, str(number), f"{seconds * each:.3f}"]
        for name, number, seconds in thunks_of(call)[: args.most]
    ]
    print(table(["thunk", "number", "us a pose"], rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
