"""How fast the machine could be: operations and bytes counted, against measured rates.

    python -m benchmarks.floors [--poses 65536] [--rounds 7] [--save]

The floor of a function is the greater of two times. One is its operations, counted once each before
XLA has seen them, at the rate at which one core adds and multiplies in vector registers. The other
is its input and output, at the rate at which it copies arrays of that size. Real programs also
shuffle, store intermediate results and wait: the ratio says how much.
"""

from __future__ import annotations

import argparse
import functools
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

if __name__ == "__main__":
    from benchmarks.measure import pin_to_one_core

    pin_to_one_core()

import jax
import jax.numpy as jnp
import numpy as np

import niryo_jax as nj
from benchmarks.measure import Report, Timed, about, alternate, header, table
from niryo_jax import lanes
from niryo_jax.chain import tool_motion
from niryo_jax.ik.complete.algorithms import Goal, algorithm_for
from niryo_jax.ik.complete.driver import _first_pass
from niryo_jax.ik.newton.pose_error import miss
from niryo_jax.ik.task import POSE
from niryo_jax.jacobian import pose_and_jacobian
from niryo_jax.lanes import Lane, Lanes, unpack
from niryo_jax.lie import se3
from niryo_jax.specialise import Geometry, _pattern_of
from niryo_jax.structure.offset_wrist import concrete_numbers

DTYPES = ("float64", "float32")

_CHAIN = 16
_LEAST = 0.05


class Floor(NamedTuple):
    """The least time of a function for one pose.

    Attributes:
        operations: how many.
        size: bytes read and written.
        arithmetic, memory: nanoseconds of each.
    """

    operations: float
    size: float
    arithmetic: float
    memory: float

    @property
    def nanoseconds(self) -> float:
        """The greater of the two."""
        return max(self.arithmetic, self.memory)

    def __str__(self) -> str:
        return (
            f"{self.nanoseconds:.1f} ns: {self.operations:,.0f} operations {self.arithmetic:.1f}, "
            f"{self.size:,.0f} bytes {self.memory:.1f}"
        )


def _fastest(function: Callable[..., Any], *arguments: Any) -> float:
    """Seconds of the fastest of many runs: a floor is no median."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(50):
        started = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - started)
    return min(times)


@functools.cache
def operation(dtype: str) -> float:
    """Nanoseconds of one addition or multiplication on one element, in vector registers."""

    def body(step: int, x: jax.Array) -> jax.Array:
        # Four independent sums, as the entries of a matrix are, keep the pipeline full.
        sums = [x + 0.1 * i for i in range(4)]
        for _ in range(_CHAIN):
            sums = [0.5 * a + x for a in sums]
        return 0.25 * (sums[0] + sums[1] + sums[2] + sums[3])

    x, steps = jnp.full(2048, 0.5, dtype), 256
    many = jax.jit(
        lambda x: jax.lax.fori_loop(0, steps, body, x),
        compiler_options={"xla_cpu_prefer_vector_width": 512},
    )
    return 1e9 * _fastest(many, x) / (steps * x.size * (8 * _CHAIN + 8))


@functools.cache
def byte(size: int) -> float:
    """Nanoseconds of a byte read or written while an array of so many bytes is copied."""
    x = np.ones(max(1, size // 8))
    out = np.empty_like(x)
    return 1e9 * _fastest(lambda: np.copyto(out, x)) / (2 * x.nbytes)


def floor_of(
    function: Callable[..., Any], batch: int, dtype: str, outputs: int, *shapes: tuple[int, ...]
) -> Floor:
    """The floor of a function of lanes, whose arguments have these shapes.

    `outputs` is how many numbers of a pose the public function writes.
    """

    def of_arrays(*arrays: jax.Array) -> list[jax.Array]:
        given = [
            unpack(jnp.moveaxis(array, -1, 0), len(shape)) for array, shape in zip(arrays, shapes)
        ]
        out = jax.tree.leaves(function(*given), is_leaf=lambda x: isinstance(x, Lane | np.ndarray))
        return [lane.array for part in out for lane in np.ravel(np.array(part, dtype=object))]

    arrays = [jax.ShapeDtypeStruct((*shape, batch), dtype) for shape in shapes]
    count = jax.jit(of_arrays).lower(*arrays).cost_analysis()["flops"] / batch
    numbers = sum(math.prod(shape) for shape in shapes) + outputs
    size = numbers * np.dtype(dtype).itemsize
    return Floor(count, size, count * operation(dtype), size * byte(size * batch // 2))


def _geometry() -> Geometry:
    """The Niryo One with its numbers folded into the program."""
    return _pattern_of(nj.robots.niryo_one(), "all")[0].geometry([])


def forward_kinematics(dtype: str, batch: int) -> Floor:
    """(N, 6) -> (N, 4, 4)."""
    return floor_of(lambda q: tool_motion(_geometry(), q), batch, dtype, 16, (6,))


def _newton_iteration(target: Lanes, q: Lanes) -> Lanes:
    missed = miss(_geometry(), target, q, "body", POSE)
    return q + lanes.solve(missed.jacobian, missed.twist, 0.0, 1e-14)


class Subject(NamedTuple):
    """A public function, the same on lanes, and what it reads and writes."""

    public: Callable[..., Any]
    on_lanes: Callable[..., Any]
    outputs: int
    shapes: tuple[tuple[int, ...], ...]


def subjects(robot: nj.Robot) -> dict[str, Subject]:
    """What is compared with its floor."""
    sub = nj.subproblems
    step = {"max_iterations": 1, "position_tolerance": 1e-300, "rotation_tolerance": 1e-300}
    return {
        "forward kinematics": Subject(
            lambda q: nj.forward_kinematics(robot, q),
            lambda q: tool_motion(_geometry(), q),
            16,
            ((6,),),
        ),
        "space Jacobian": Subject(
            lambda q: nj.space_jacobian(robot, q),
            lambda q: pose_and_jacobian(_geometry(), q, "space")[1],
            36,
            ((6,),),
        ),
        "body Jacobian": Subject(
            lambda q: nj.body_jacobian(robot, q),
            lambda q: pose_and_jacobian(_geometry(), q, "body")[1],
            36,
            ((6,),),
        ),
        "SE(3) exp": Subject(nj.se3.exp, se3.exp_lanes, 16, ((6,),)),
        "SE(3) log": Subject(nj.se3.log, lambda m: se3.log_lanes(*se3.split(m)), 6, ((4, 4),)),
        "Paden-Kahan 1": Subject(
            sub.paden_kahan_1, lambda *x: tuple(sub.paden_kahan_1_lanes(*x)), 4, ((6,), (3,), (3,))
        ),
        "Paden-Kahan 2": Subject(
            sub.paden_kahan_2,
            lambda *x: tuple(sub.paden_kahan_2_lanes(*x)),
            9,
            ((6,), (6,), (3,), (3,)),
        ),
        "Paden-Kahan 3": Subject(
            lambda s, p, k, d: sub.paden_kahan_3(s, p, k, d[:, 0]),
            lambda *x: tuple(sub.paden_kahan_3_lanes(*x)),
            7,
            ((6,), (3,), (3,), (1,)),
        ),
        "Newton-Raphson, one iteration and a check": Subject(
            lambda pose, q: nj.newton_raphson(robot, pose, q, **step),
            _newton_iteration,
            10,
            ((4, 4), (6,)),
        ),
    }


def inputs(
    robot: nj.Robot, name: str, shapes: tuple[tuple[int, ...], ...], batch: int
) -> list[Any]:
    """Random arguments of a public function, float64."""
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.lower, robot.upper, (batch, 6))
    if name == "SE(3) log":
        return [np.asarray(nj.forward_kinematics(robot, q))]
    if name.startswith("Newton"):
        return [np.asarray(nj.forward_kinematics(robot, q)), q + 0.02]
    return [rng.uniform(0.2, 1.0, (batch, *shape)) for shape in shapes]


def complete(robot: nj.Robot, batch: int) -> Floor:
    """The first pass of complete inverse kinematics, which settles nine poses of ten."""
    known = robot.offset_wrist
    assert known is not None
    numbers = concrete_numbers(np.asarray(robot.screws), np.asarray(robot.home)[:3, 3])
    free = [x for x, k in zip(numbers, known.entries) if k is None]
    limits = jnp.asarray(robot.lower), jnp.asarray(robot.upper)

    def block(target: jax.Array) -> Any:
        algorithm = algorithm_for(known, _geometry(), jnp.asarray(free))
        goal = Goal(target, jnp.zeros((len(target), 0)))
        valid = jnp.ones(len(target), bool)
        return _first_pass(algorithm, lanes.contiguous_lanes(target, 2), goal, valid, limits)

    shape = jax.ShapeDtypeStruct((256, 4, 4), "float64")
    count = jax.jit(block).lower(shape).cost_analysis()["flops"] / 256
    size = 8 * (16 + 16 * (6 + 2)) + 16 * 6 + 16
    return Floor(count, size, count * operation("float64"), size * byte(size * batch // 2))


def measure(poses: int, rounds: int) -> Report:
    """Every function in both precisions."""
    robot = nj.robots.niryo_one()
    facts = about(rounds=rounds, poses=poses)
    report = Report("Floors", {"about": facts})
    rates = [f"{dtype}: an operation on a lane {operation(dtype):.4f} ns" for dtype in DTYPES] + [
        f"a byte copied {byte(8 * 16 * poses):.4f} ns"
    ]
    report.sections += [header(facts), "; ".join(rates) + "."]
    rows = list[tuple[str, str, Timed, Floor]]()
    for dtype in DTYPES:
        for name, subject in subjects(robot).items():
            given = [
                jax.device_put(x.astype(dtype)) for x in inputs(robot, name, subject.shapes, poses)
            ]
            print(f"  {name}, {dtype}", flush=True)
            timed = Timed(name, poses, functools.partial(subject.public, *given))
            floor = floor_of(subject.on_lanes, poses, dtype, subject.outputs, *subject.shapes)
            rows.append((name, dtype, timed, floor))
    pose = nj.forward_kinematics(robot, inputs(robot, "", ((6,),), poses)[0])
    print("  complete inverse kinematics", flush=True)
    name = "complete inverse kinematics (floor: the first pass)"
    timed = Timed(name, poses, lambda: nj.inverse_kinematics(robot, pose))
    rows.append((name, "float64", timed, complete(robot, poses)))
    alternate([timed for _, _, timed, _ in rows], rounds, _LEAST)
    lines = []
    for name, dtype, timed, floor in rows:
        ours = 1e9 * timed.seconds / poses
        lines.append(
            [
                name,
                dtype,
                f"{ours:,.1f}",
                f"{timed.spread:.0%}",
                f"{floor.operations:,.0f}",
                f"{floor.size:,.0f}",
                f"{floor.arithmetic:,.1f}",
                f"{floor.memory:,.1f}",
                f"{ours / floor.nanoseconds:,.1f}",
            ]
        )
        report.data[f"{name}, {dtype}"] = {**timed.facts(), "floor": floor._asdict()}
    head = ["what", "type", "ns a pose", "spread", "operations", "bytes", "arithmetic (ns)"]
    report.sections.append(table([*head, "memory (ns)", "ours / floor"], lines))
    return report


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=65_536)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/")
    options = parser.parse_args()
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_enable_x64", True)
    return measure(options.poses, options.rounds).finish("floors" if options.save else None)


if __name__ == "__main__":
    raise SystemExit(main())
