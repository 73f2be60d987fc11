"""Nanoseconds a lane of the arithmetic that everything here is made of.

    python -m benchmarks.lanes [--lanes 65536] [--rounds 7] [--save]

Each operation of `niryo_jax.lanes` beside an addition and beside what it stands for in `jax.numpy`,
in the same run, on one core. The exit code is 1 when a result is wrong.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable
from typing import Any

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.measure import Report, Timed, about, alternate, header, table
from niryo_jax import lanes
from niryo_jax.lanes import Lane

LEAST = 0.02

ULPS = 4
"""Units in the last place by which a result may miss, of the greater of it and one."""

Operation = tuple[Callable[..., Any], Callable[..., Any], int]


def operations() -> dict[str, Operation]:
    """Ours, jax.numpy's, and how many arguments."""

    def ours(function: Callable[..., Lane]) -> Callable[..., jax.Array]:
        return lambda *x: function(*map(Lane, x)).array

    return {
        "add": (ours(lambda a, b: a + b), jnp.add, 2),
        "divide": (ours(lambda a, b: a / b), jnp.divide, 2),
        "square root": (ours(lanes.sqrt), jnp.sqrt, 1),
        "sine": (ours(lambda a: lanes.sincos(a)[0]), jnp.sin, 1),
        "sine and cosine, added": (
            ours(lambda a: lanes.sincos(a)[0] + lanes.sincos(a)[1]),
            lambda a: jnp.sin(a) + jnp.cos(a),
            1,
        ),
        "atan2": (ours(lanes.atan2), jnp.arctan2, 2),
        "acos": (ours(lambda a: lanes.acos(a * 0.25)), lambda a: jnp.arccos(a * 0.25), 1),
        "materialise": (ours(lanes.materialise), lambda a: a, 1),
    }


def measure(count: int, rounds: int) -> Report:
    """Everything in both precisions."""
    facts = about(rounds=rounds, lanes=count)
    report = Report("Lanes", {"about": facts}, [header(facts)])
    rng = np.random.default_rng(0)
    lines = []
    for dtype in ("float64", "float32"):
        arguments = [jnp.asarray(rng.uniform(0.1, 3.0, count), dtype) for _ in range(2)]
        rows = list[tuple[str, Timed, Timed]]()
        for name, (mine, its, arity) in operations().items():
            given = arguments[:arity]
            pair = [Timed(name, count, functools.partial(jax.jit(f), *given)) for f in (mine, its)]
            exact = np.asarray(its(*(np.asarray(x, np.float64) for x in given)))
            miss = np.abs(np.asarray(pair[0].result, np.float64) - exact)
            far = float(np.max(miss / np.maximum(1, np.abs(exact))) / np.finfo(dtype).eps)
            if not far < ULPS:
                report.wrong.append(f"{name}, {dtype}: misses by {far:.1f} units")
            rows.append((name, pair[0], pair[1]))
        alternate([timed for _, *pair in rows for timed in pair], rounds, LEAST)
        add = rows[0][1].seconds
        for name, mine, its in rows:
            each = [1e9 * timed.seconds / count for timed in (mine, its)]
            lines.append(
                [
                    name,
                    dtype,
                    f"{each[0]:.2f}",
                    f"{mine.spread:.0%}",
                    f"{mine.seconds / add:.1f}",
                    f"{each[1]:.2f}",
                    f"{each[1] / each[0]:.1f}",
                ]
            )
            report.data[f"{name}, {dtype}"] = {"ours": mine.facts(), "jax.numpy": its.facts()}
    head = ["operation", "type", "ns a lane", "spread", "over an addition", "jax.numpy (ns)"]
    report.sections.append(table([*head, "its / ours"], lines))
    return report


def main() -> int:
    """Measure, print, and fail where a result is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lanes", type=int, default=65_536)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    return measure(options.lanes, options.rounds).finish("lanes" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
