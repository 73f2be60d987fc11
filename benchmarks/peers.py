"""Adapters to other libraries that return all solutions of inverse kinematics, and their timing.

None is a dependency: each is used where it is installed. An adapter builds a solver from the axes
of an `Arm` and hands back functions from one pose, or a list of poses, to whatever the library
answers. Its input is put into the library's form, and its answers into joint vectors, outside the
measured time.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import gc
import hashlib
import importlib.metadata
import importlib.util
import io
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from benchmarks.poses import Answers, Arm, poses_of, random_joints

ROUND = 1.0
"""Seconds that a round of a library which solves one pose at a time should last, if it can."""

SINGLES = 50
"""Single poses timed for the latency."""


class UnsuitedError(Exception):
    """A library is not there, or refuses the arm; the message says which."""


@dataclasses.dataclass(frozen=True)
class Solver:
    """A library ready to solve one arm.

    Attributes:
        name: as printed.
        one: one pose, as the library wants it -> the library's answer.
        answers: the library's answer -> (k, 6) claimed joint vectors, radians.
        many: a list of poses -> a sequence of answers; None where there is no such call.
        preparation: seconds spent once for the arm, on this machine; its result is kept on disk.
        load: seconds to make the solver ready in a new process after that, imports included; None
            where the preparation was made in this process.
        given: a pose (4, 4) -> what `one` takes, outside the measured time.
    """

    name: str
    one: Callable[[Any], Any]
    answers: Callable[[Any], np.ndarray]
    many: Callable[[list[Any]], Sequence[Any]] | None = None
    preparation: float = 0.0
    load: float | None = 0.0
    given: Callable[[np.ndarray], Any] = np.asarray


@dataclasses.dataclass(frozen=True)
class Library:
    """A library as its users install it.

    Attributes:
        package: the name that pip takes.
        module: the name that Python imports.
        tried: the version the adapter was written for.
        licence: of the library.
        about: what it does better than, or otherwise than, niryo_jax.
        build: the solvers it offers for an arm; the path is a folder for what takes long to make.
    """

    package: str
    module: str
    tried: str
    licence: str
    about: str
    build: Callable[[Arm, Path], list[Solver]]

    @property
    def version(self) -> str | None:
        """The version installed, if any."""
        if importlib.util.find_spec(self.module) is None:
            return None
        return importlib.metadata.version(self.package)

    def solvers(self, arm: Arm, cache: Path) -> list[Solver]:
        """The solvers for an arm.

        Raises:
            UnsuitedError: not installed, or no solver for the arm.
        """
        if self.version is None:
            raise UnsuitedError(f"not installed (pip install {self.package}=={self.tried})")
        return self.build(arm, cache / f"{self.package}-{self.version}")


@contextlib.contextmanager
def _stopwatch() -> Iterator[list[float]]:
    started, elapsed = time.perf_counter(), [0.0]
    yield elapsed
    elapsed[0] = time.perf_counter() - started


def _ssik(arm: Arm, cache: Path) -> list[Solver]:
    """ssik as a class and as the artefact that `ssik build` writes.

    The artefact of a general 6R arm uses ssik's native code only where a table of coefficients lies
    beside it. `ssik build` 8.2.0 does not write the table; the function that makes it does.
    """
    geometry = hashlib.sha256(arm.axes.tobytes() + arm.steps.tobytes()).hexdigest()[:12]
    folder = cache / f"{arm.name}-{geometry}"
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("SSIK_DERIVATION_CACHE", str(cache / "derivations"))
    record = folder / "preparation.json"
    kept = record.exists()
    with _stopwatch() as imported:
        import ssik
    with _stopwatch() as prepared:
        limits = np.stack([arm.robot.lower, arm.robot.upper], axis=1)
        manipulator = ssik.Manipulator.from_axes(arm.axes, arm.steps, limits=limits)
        manipulator.prepare()
    artefact = folder / f"{arm.name}_ik.py"
    if not kept:
        _ssik_build(manipulator, artefact)
        spent = prepared[0] + _ssik_table(manipulator, artefact)
        record.write_text(
            json.dumps({"seconds": spent, "date": datetime.date.today().isoformat()}) + "\n"
        )
    preparation = json.loads(record.read_text())["seconds"]
    with _stopwatch() as read:
        module = _module(artefact)

    def joints(answer: Any) -> np.ndarray:
        return np.array([solution.q for solution in answer]).reshape(-1, 6)

    def solver(
        name: str, solve: Callable[..., Any], seconds: float | None, **options: Any
    ) -> Solver:
        def one(pose: np.ndarray) -> Any:
            return solve(pose, respect_limits=False, **options)

        return Solver(name, one, joints, None, preparation, seconds)

    again = imported[0] + prepared[0] if kept else None
    load = imported[0] + read[0]
    found = [
        solver("ssik, Manipulator", manipulator.solve, again),
        solver("ssik, artefact, Python", module.solve, load, native=False),
    ]
    if _ssik_native(module):
        found.append(solver("ssik, artefact, native", module.solve, load))
    return found


def _ssik_build(manipulator: Any, artefact: Path) -> None:
    """What `ssik build` does with a robot description."""
    from ssik.core.codegen import emit_artifact

    emit_artifact(
        kb=manipulator.kinbody,
        plan=manipulator.dispatch_plan,
        module_name=artefact.stem,
        output_path=str(artefact),
    )


def _ssik_table(manipulator: Any, artefact: Path) -> float:
    """Write the native code's coefficients where the artefact looks for them; seconds taken."""
    with _stopwatch() as seconds, contextlib.suppress(ImportError, AttributeError):
        from ssik._native import bake_rr_tensor_npz

        if manipulator.solver_name == "ikgeo.general_6r":
            table = artefact.with_name(artefact.stem.removesuffix("_ik") + "_rr.npz")
            bake_rr_tensor_npz(manipulator.kinbody, str(table))
    return seconds[0]


def _ssik_native(module: ModuleType) -> bool:
    try:
        from ssik._native import native_available
    except ImportError:
        return False
    table = getattr(module, "_rr_native_geometry", lambda: True)()
    return bool(native_available()) and table is not None


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise UnsuitedError(f"{path} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def _ikdh(arm: Arm, cache: Path) -> list[Solver]:
    """ikdh from Denavit-Hartenberg parameters of the arm, with the tool frame split off."""
    del cache
    with _stopwatch() as load:
        import ikdh

        (_, _, shoulder), (_, _, elbow) = arm.points[1:3]
        wrist, tool, quarter = arm.points[3], arm.points[6], np.pi / 2
        table = ikdh.DHTable(
            [0, elbow - shoulder, wrist[2] - elbow, 0, arm.offset, 0],
            [shoulder, 0, 0, wrist[0], 0, tool[0] - wrist[0]],
            [quarter, 0, quarter, -quarter, quarter, 0],
            [0, quarter, 0, 0, 0, 0],
        )
        flange = np.linalg.inv(ikdh.forward_kin(table, np.zeros(6))) @ arm.robot.home
        to_flange = np.linalg.inv(flange)
        solver = ikdh.Solver(table)
    q = random_joints(arm.robot, 8, seed=0)
    reached = np.array([ikdh.forward_kin(table, np.rad2deg(x)) @ flange for x in q])
    if np.max(np.abs(reached - poses_of(arm.robot, q))) > 1e-12:
        raise UnsuitedError("the Denavit-Hartenberg parameters do not describe the arm")

    def joints(answer: Any) -> np.ndarray:
        return np.deg2rad(np.array(answer)).reshape(-1, 6)

    return [Solver("ikdh", solver.solve, joints, load=load[0], given=lambda pose: pose @ to_flange)]


def _eaik(arm: Arm, cache: Path) -> list[Solver]:
    """eaik from the axes, one pose at a time and by its batched call with one and four threads."""
    del cache
    with _stopwatch() as load, contextlib.redirect_stdout(io.StringIO()):
        from eaik.IK_HP import HPRobot

        robot = HPRobot(arm.axes, arm.steps)
    if not robot.hasKnownDecomposition():
        raise UnsuitedError(f"refuses the arm: {robot.getKinematicFamily()}")

    def joints(answer: Any) -> np.ndarray:
        exact = ~np.array(answer.is_LS, dtype=bool)
        return np.array(answer.Q).reshape(-1, 6)[exact]

    def batched(threads: int) -> Solver:
        def many(poses: list[np.ndarray]) -> Sequence[Any]:
            return robot.IK_batched(poses, num_worker_threads=threads)

        name = f"eaik, batched, {threads} thread{'s' * (threads > 1)}"
        return Solver(name, robot.IK, joints, many, load=load[0])

    return [Solver("eaik, one by one", robot.IK, joints, load=load[0]), batched(1), batched(4)]


def _ik_geo(arm: Arm, cache: Path) -> list[Solver]:
    """ik-geo (Rust) from the axes; the caller of that library names the family of the arm."""
    del cache
    if arm.offset != 0:
        raise UnsuitedError("has no family for the arm that gives a right answer")
    with _stopwatch() as load:
        import ik_geo

        robot = ik_geo.Robot.spherical_two_intersecting(arm.axes.tolist(), arm.steps.tolist())

    def one(pose: tuple[list[list[float]], list[float]]) -> Any:
        return robot.get_ik(*pose)

    def given(pose: np.ndarray) -> tuple[list[list[float]], list[float]]:
        # The library takes the columns of the rotation.
        return pose[:3, :3].T.tolist(), pose[:3, 3].tolist()

    def joints(answer: Any) -> np.ndarray:
        return np.array([q for q, least_squares in answer if not least_squares]).reshape(-1, 6)

    return [Solver("ik-geo", one, joints, load=load[0], given=given)]


LIBRARIES: dict[str, Library] = {
    "ssik": Library(
        "ssik",
        "ssik",
        "8.2.0",
        "BSD-3-Clause",
        "any arm with six or seven revolute joints, offset wrists and redundant arms included; "
        "72 arms ready to import; code for C++ without Python; needs no JAX at run time",
        _ssik,
    ),
    "ikdh": Library(
        "ikdh",
        "ikdh",
        "1.2.0",
        "PolyForm Noncommercial",
        "any arm with six revolute joints from its Denavit-Hartenberg parameters, no preparation; "
        "1,178 robots described; a C++ library; needs no JAX",
        _ikdh,
    ),
    "eaik": Library(
        "eaik",
        "eaik",
        "1.2.2",
        "BSD-3-Clause",
        "finds by itself which of many families an arm belongs to, three parallel axes and arms "
        "with one to five joints included; C++ with threads; needs no JAX",
        _eaik,
    ),
    "ik-geo": Library(
        "ik-geo",
        "ik_geo",
        "1.0.3",
        "BSD-3-Clause",
        "eight families, searches in one and two dimensions for arms without closed form; Rust, "
        "no dependency at all",
        _ik_geo,
    ),
}


class Row(NamedTuple):
    """One solver on one arm: times in seconds, answers, and whether they come from float32."""

    name: str
    poses: int
    rounds: list[float]
    first: float
    latency: float
    preparation: float
    load: float | None
    answers: Answers
    single: bool

    @property
    def rate(self) -> float:
        """Poses a second, median of the rounds."""
        return self.poses / statistics.median(self.rounds)

    @property
    def spread(self) -> float:
        """(slowest - fastest) / median."""
        return (max(self.rounds) - min(self.rounds)) / statistics.median(self.rounds)


class Subject:
    """A solver being measured: `run` is timed, `answers` is not."""

    def __init__(
        self,
        name: str,
        run: Callable[[], Any],
        one: Callable[[int], Any],
        answers: Callable[[Any], Answers],
        poses: int,
        single: bool = False,
        first: float | None = None,
        solver: Solver | None = None,
    ) -> None:
        self.name, self.run, self.one, self.to_answers = name, run, one, answers
        self.poses, self.single, self.solver = poses, single, solver
        self.rounds: list[float] = []
        self.result: Any = None
        self.first = self._timed() if first is None else first

    def round(self) -> None:
        """One timed run over all its poses."""
        self.rounds.append(self._timed())

    def _timed(self) -> float:
        """Without the collector of cyclic garbage, which would charge a library that answers with
        many small objects for all those of the others."""
        self.result = None
        gc.collect()
        gc.disable()
        started = time.perf_counter()
        self.result = self.run()
        elapsed = time.perf_counter() - started
        gc.enable()
        return elapsed

    def row(self) -> Row:
        """What was measured; times single poses now."""
        self.one(0)
        singles = []
        for i in range(SINGLES):
            started = time.perf_counter()
            self.one(i)
            singles.append(time.perf_counter() - started)
        preparation, load = (self.solver.preparation, self.solver.load) if self.solver else (0, 0)
        return Row(
            self.name,
            self.poses,
            self.rounds,
            self.first,
            statistics.median(singles),
            preparation,
            load,
            self.to_answers(self.result),
            self.single,
        )


def theirs(solver: Solver, pose: np.ndarray, least: int) -> Subject:
    """Another library on as many of the poses as take about a second, at least `least`."""
    started = time.perf_counter()
    solver.one(solver.given(pose[0]))
    first = time.perf_counter() - started
    started = time.perf_counter()
    for p in pose[:20]:
        solver.one(solver.given(p))
    each = (time.perf_counter() - started) / 20
    count = min(len(pose), max(least, int(ROUND / each)))
    given = [solver.given(p) for p in pose[:count]]
    one, many = solver.one, solver.many

    def run() -> Sequence[Any]:
        return [one(p) for p in given] if many is None else many(given)

    def answers(result: Sequence[Any]) -> Answers:
        return Answers.of([solver.answers(x) for x in result])

    return Subject(
        solver.name, run, lambda i: one(given[i]), answers, count, first=first, solver=solver
    )
