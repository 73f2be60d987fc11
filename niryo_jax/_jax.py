"""The parts of JAX that it does not document, or may change: everything of them that is used.

`jax.interpreters`, `jax.extend`, tracers, the options of XLA's compiler and the flags of
`jax.distributed` have no promise of stability. Whatever of them moves, moves here.
"""

from __future__ import annotations

import contextlib
import functools
import platform
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
from jax.core import Tracer, eval_context
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

untraced = eval_context
"""A context in which JAX computes, and finds what it has compiled, whatever is being traced."""


def is_concrete(*values: object) -> bool:
    """Whether every value is known now, rather than traced by a JAX transformation."""
    return not any(isinstance(value, Tracer) for value in values)


RUN_FAST: Mapping[str, Any] = {"xla_cpu_prefer_vector_width": 512}
"""For programs that run long: XLA takes half of what AVX-512 offers unless told."""

COMPILE_FAST: Mapping[str, Any] = {
    "xla_backend_optimization_level": 0,
    "xla_cpu_use_fusion_emitters": False,
    # Without fused multiply-adds a number is the same each time that it is worked out again.
    **({"xla_cpu_max_isa": "AVX"} if platform.machine() in ("x86_64", "AMD64") else {}),
}
"""For programs whose compilation takes longer than they run: a third to a quarter of the time.

Without its newer emitters XLA computes shared values inside a fusion again for each use, and a
chain of many small steps can take all memory: a test watches each program that is so compiled.
Since jaxlib 0.11 there is no way to do without them, and such programs take twice as long."""


@functools.cache
def _is_known(option: str, value: Any) -> bool:
    """Whether this version of XLA knows an option of its compiler; they come and go."""
    with contextlib.suppress(ValueError, jax.errors.JaxRuntimeError):
        jax.jit(lambda x: x, compiler_options={option: value}).lower(0.0).compile()
        return True
    return False


class Compiled:
    """A jitted function whose programs are compiled with options of their own where possible.

    JAX refuses compiler options inside a function that a caller compiles: there the function is
    compiled as any other. Options that this version of XLA does not know are left out.

    Args:
        function: to be compiled.
        options: of XLA's compiler.
    """

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._plain = jax.jit(function)
        self._function, self._options = function, options
        self._programs = 0

    @functools.cached_property
    def _own(self) -> Callable[..., Any]:
        # Asked of XLA at the first call: an import must not start its devices.
        with untraced():
            known = {key: value for key, value in self._options.items() if _is_known(key, value)}
        return jax.jit(self._function, compiler_options=known)

    def has_grown(self) -> bool:
        """Whether it has compiled another program since this was last asked."""
        before = self._programs
        functions: tuple[Any, Any] = self._plain, self.__dict__.get("_own")
        self._programs = functions[0]._cache_size()
        if functions[1] is not None:
            self._programs += functions[1]._cache_size()
        return self._programs > before

    def __call__(self, concrete: bool, *arguments: Any) -> Any:
        """The function of arguments that are `concrete` (`is_concrete`) or not."""
        if concrete:
            with contextlib.suppress(ValueError):
                return self._own(*arguments)
        return self._plain(*arguments)


def linear_primitive(
    name: str,
    function: Callable[..., Any],
    shape_of: Callable[..., Any],
    transpose: Callable[..., Any],
    batch: Callable[..., Any],
    *,
    multiple_results: bool = False,
    static: Sequence[str] = (),
) -> Primitive:
    """A linear operation with a transpose and a rule of batching of its own.

    Args:
        name: for messages.
        function: what it computes, written in JAX's own operations.
        shape_of: what JAX knows of the arguments -> what it knows of the results.
        transpose: (rates of the results, arguments) -> rates of the arguments.
        batch: (batched arguments, their axes) -> results and their axes.
        multiple_results: whether the function returns a list.
        static: names of the arguments that are no arrays.
    """
    primitive = Primitive(name)
    primitive.multiple_results = multiple_results
    primitive.def_impl(jax.jit(function, static_argnames=tuple(static)))
    primitive.def_abstract_eval(shape_of)
    mlir.register_lowering(primitive, mlir.lower_fun(function, multiple_results=multiple_results))
    ad.deflinear2(primitive, transpose)
    batching.primitive_batchers[primitive] = batch
    return primitive


def instantiate_zeros(rate: Any) -> jax.Array:
    """The array of a rate that JAX may know to be zero without one."""
    return ad.instantiate_zeros(rate)


def survive_lost_processes() -> None:
    """Let a process of `jax.distributed` go on where another one of its group ends."""
    jax.config.update("jax_enable_recoverability", True)


def opaque(
    name: str, batch: Callable[..., Any]
) -> Callable[[Callable[..., Any], tuple[Any, ...]], Any]:
    """How to call functions such that concrete arguments are never traced.

    `call(function, arguments)` runs a hashable function of arrays, or of nests of them. Inside a
    caller's jit it becomes part of that program; `jax.vmap` hands it to `batch`. It has no
    derivative, so it stands inside a rule that gives one.

    Args:
        name: for messages.
        batch: (function, arguments, for each array whether it has the mapped axis in front, the
            size of that axis) -> results, and for each array whether it has it.
    """
    primitive = Primitive(name)
    primitive.multiple_results = True

    def run(*leaves: Any, function: Callable[..., Any], structure: Any, result: _Result) -> Any:
        return result.leaves_of(function(*jax.tree.unflatten(structure, leaves)))

    def avals(*leaves: Any, **parameters: Any) -> list[Any]:
        # What JAX's own operations make of the arguments says also what shard_map wants to know.
        return list(jax.make_jaxpr(functools.partial(run, **parameters))(*leaves).out_avals)

    def batched(
        leaves: Sequence[Any],
        axes: Sequence[int | None],
        *,
        function: Callable[..., Any],
        structure: Any,
        result: _Result,
    ) -> tuple[list[Any], list[int | None]]:
        moved = [
            x if axis is None else jax.numpy.moveaxis(x, axis, 0) for x, axis in zip(leaves, axes)
        ]
        size = next(x.shape[0] for x, axis in zip(moved, axes) if axis is not None)
        has = jax.tree.unflatten(structure, [axis is not None for axis in axes])
        answer, out = batch(function, jax.tree.unflatten(structure, moved), has, size)
        return result.leaves_of(answer), [0 if given else None for given in jax.tree.leaves(out)]

    primitive.def_impl(run)
    primitive.def_abstract_eval(avals)
    mlir.register_lowering(primitive, mlir.lower_fun(run, multiple_results=True))
    batching.primitive_batchers[primitive] = batched

    def call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        leaves, structure = jax.tree.flatten(arguments)
        if is_concrete(*leaves):
            with untraced():
                return function(*arguments)
        result = _Result()
        answer = primitive.bind(*leaves, function=function, structure=structure, result=result)
        return jax.tree.unflatten(result.structure, answer)

    return call


class _Result:
    """The structure of a result, known once it is worked out or traced."""

    structure: Any = None

    def leaves_of(self, result: Any) -> list[Any]:
        leaves, self.structure = jax.tree.flatten(result)
        return leaves
