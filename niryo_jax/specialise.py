"""From robots to lanes, and from functions of lanes to compiled functions of robots.

A concrete robot's zeros and ones are part of the compiled program and its other numbers are
arguments of it: two robots with zeros in the same places share one program. Inside a caller's own
transformation a concrete robot is folded whole. A traced robot (differentiated, batched, or an
argument of the caller's jit) is nothing but arguments, so that every derivative with respect to
its geometry is right.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax._jax import COMPILE_FAST, RUN_FAST, Compiled, is_concrete
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import as_floating
from niryo_jax.programs import PROGRAMS
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.structure.axes import joint_kinds


class Pattern(NamedTuple):
    """Which numbers of a robot's screws and home pose are known to a program (None: arguments)."""

    known: tuple[float | None, ...]
    kinds: tuple[str, ...]

    def geometry(self, arguments: Iterable[jax.Array]) -> Geometry:
        """The lanes of the robot: the known numbers, and the arguments in the places between."""
        rest = iter(arguments)
        entries = np.empty(len(self.known), dtype=object)
        for i, number in enumerate(self.known):
            entries[i] = Lane(next(rest)) if number is None else Lane(number)
        joints = len(self.kinds)
        screws, home = entries[: 6 * joints], entries[6 * joints :]
        return Geometry(screws.reshape(joints, 6), home.reshape(4, 4), self.kinds)


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True)
class Geometry:
    """A robot's screws and home pose as lanes; a pytree whose leaves are the lanes not known.

    Attributes:
        screws: (n, 6) lanes; home: (4, 4) lanes.
        kinds: what is known of each joint while tracing: "revolute", "prismatic", "helical", or
            "any" for a screw that is traced, may have any magnitude, and is differentiated as such.
    """

    screws: Lanes
    home: Lanes
    kinds: tuple[str, ...]

    @property
    def joints(self) -> int:
        """The number of joints n."""
        return len(self.kinds)

    def at(self, rows: jax.Array) -> Geometry:
        """The arms of some rows, where every row of a batch has an arm of its own."""
        return jax.tree.map(lambda x: x[rows] if jnp.ndim(x) else x, self)

    def tree_flatten(self) -> tuple[list[jax.Array], Pattern]:
        """The traced numbers, and the pattern of the known ones."""
        entries = [lane.value for lane in (*self.screws.ravel(), *self.home.ravel())]
        known = tuple(value if isinstance(value, float) else None for value in entries)
        return [value for value in entries if not isinstance(value, float)], Pattern(
            known, self.kinds
        )

    @classmethod
    def tree_unflatten(cls, pattern: Pattern, arguments: Iterable[jax.Array]) -> Geometry:
        """The geometry of a pattern and its arguments."""
        return pattern.geometry(arguments)


def traced_geometry(robot: Robot, dtype: np.dtype) -> Geometry:
    """The lanes of a traced robot: every number an argument, in the dtype of the computation."""
    screws, home = (lanes.unpack(jnp.asarray(x, dtype), 2) for x in (robot.screws, robot.home))
    return Geometry(screws, home, ("any",) * robot.joints)


def _dtype_of(arrays: tuple[Any, ...]) -> np.dtype:
    """The floating-point type that a function of these arrays computes in."""
    dtypes = [jnp.result_type(leaf) for leaf in jax.tree.leaves(arrays)]
    floating = [dtype for dtype in dtypes if jnp.issubdtype(dtype, jnp.floating)]
    return jnp.result_type(*floating) if floating else jnp.result_type(float)


Result = TypeVar("Result")


Known = Literal["all", "units", "units of screws"]
"""What of a concrete robot is part of a program: all numbers, or the zeros and ones."""


def _pattern_of(robot: Robot, which: Known) -> tuple[Pattern, jax.Array]:
    """The pattern and the arguments of a concrete robot."""
    cache: dict[tuple[Known, bool], tuple[Pattern, jax.Array]]
    cache = robot.__dict__.setdefault("_patterns", {})
    # Not `jnp.result_type(float)`, which is slow.
    key = which, bool(jax.config.jax_enable_x64)  # pyright: ignore[reportAttributeAccessIssue]
    if key not in cache:
        screws, home = np.asarray(robot.screws), np.asarray(robot.home)
        numbers = np.concatenate([screws.ravel(), home.ravel()])
        of_screws = np.arange(len(numbers)) < screws.size
        free = ~np.isin(numbers, (0.0, 1.0, -1.0)) | (~of_screws & (which == "units of screws"))
        free &= which != "all"
        # A negative zero plus 0.0 is a positive one, so that both give one program.
        known = [None if x_free else float(x) + 0.0 for x, x_free in zip(numbers, free)]
        rest = np.array([x for x, number in zip(numbers, known) if number is None])
        # On the device once for all calls; also where the first one comes from a traced function.
        with jax.ensure_compile_time_eval():
            cache[key] = Pattern(tuple(known), joint_kinds(screws)), jax.device_put(rest)
    return cache[key]


def _is_argument(value: Any) -> bool:
    """Whether JAX takes it as it is: an array, or a record of arrays.

    Lists would be taken for pytrees of numbers, each an argument of its own.
    """
    numbers = isinstance(value, np.ndarray) and value.dtype.kind in "biuf"
    return numbers or isinstance(value, jax.Array) or hasattr(value, "_fields")


def specialised(function: Callable[..., Result]) -> Callable[..., Result]:
    """Make `function(geometry, *arrays, **options)` a jitted `function(robot, *arrays, **options)`.

    Options are static: they are given by keyword and hashable. One of them is taken away: with
    `quick` the program is compiled fast rather than to run fast (`_jax.COMPILE_FAST`).
    """
    return _specialised(function, "units")


def specialised_for_any_tool(function: Callable[..., Result]) -> Callable[..., Result]:
    """`specialised`, where arms that differ in their home poses alone share their programs."""
    return _specialised(function, "units of screws")


def _specialised(function: Callable[..., Result], units: Known) -> Callable[..., Result]:
    names = list(inspect.signature(function).parameters)[1:]

    def of_pattern(
        pattern: Pattern, options: Mapping[str, Any], rest: jax.Array, *arrays: Any
    ) -> Result:
        rest = rest.astype(_dtype_of(arrays))
        return function(pattern.geometry(list(rest)), *arrays, **options)

    name = f"{function.__module__}.{function.__qualname__}"

    def of_robot(options: Mapping[str, Any], robot: Robot, *arrays: Any) -> Result:
        return function(traced_geometry(robot, _dtype_of(arrays)), *arrays, **options)

    @functools.wraps(function)
    def public(robot: Robot, *arrays: Any, quick: bool = False, **options: Any) -> Result:
        check_is_robot(robot)
        static = tuple(sorted(options.items()))
        arrays = tuple(
            array if _is_argument(array) else as_floating(name, array)
            for name, array in zip(names, arrays)
        )
        if not is_concrete(robot.screws, robot.home) or robot.screws.ndim + robot.home.ndim > 4:
            key = function, jax.tree.structure(robot), static
            partial = functools.partial(of_robot, options)
            return PROGRAMS.run(key, lambda: Compiled(partial, {}), False, robot, *arrays)
        # The options are those of the compiler for CPUs.
        quick = quick and jax.default_backend() == "cpu"
        concrete = is_concrete(*jax.tree.leaves(arrays))
        pattern, rest = _pattern_of(robot, units if concrete else "all")

        def make() -> Compiled:
            partial = functools.partial(of_pattern, pattern, options)
            chosen = COMPILE_FAST if quick else RUN_FAST
            return Compiled(partial, chosen, (name, pattern, static))

        key = function, quick, pattern, static
        return PROGRAMS.run(key, make, concrete, rest, *arrays)

    return public
