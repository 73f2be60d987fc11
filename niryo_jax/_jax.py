"""The parts of JAX that it does not document, or may change: everything of them that is used.

`jax.interpreters`, `jax.extend`, tracers, the options of XLA's compiler, serialised programs and
the flags of `jax.distributed` have no promise of stability. Whatever of them moves, moves here.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import pickle
import platform
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, Protocol

import jax
import jaxlib.version
from jax.core import Tracer, eval_context
from jax.experimental import serialize_executable
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


_GONE_SINCE: Mapping[str, tuple[int, ...]] = {"xla_cpu_use_fusion_emitters": (0, 11)}
_NEWEST_TRIED = (0, 12)


def environment_flags(jaxlib_version: str = jaxlib.version.__version__) -> str:
    """`COMPILE_FAST` as the variable XLA_FLAGS of a process may say it.

    A process ends where XLA meets an option in there that it does not know. So those that are gone
    are left out, and all of them with a jaxlib that is newer than any that has been tried.
    """
    version = tuple(int(part) for part in jaxlib_version.split(".")[:2])
    if version > _NEWEST_TRIED:
        return ""
    return " ".join(
        f"--{name}={str(value).lower() if isinstance(value, bool) else value}"
        for name, value in COMPILE_FAST.items()
        if name not in _GONE_SINCE or version < _GONE_SINCE[name]
    )


@functools.cache
def _is_known(option: str, value: Any) -> bool:
    """Whether this version of XLA knows an option of its compiler; they come and go."""
    with contextlib.suppress(ValueError, jax.errors.JaxRuntimeError):
        jax.jit(lambda x: x, compiler_options={option: value}).lower(0.0).compile()
        return True
    return False


class ProgramStore(Protocol):
    """Where serialised programs are kept from one process to the next."""

    def load(self, key: str) -> bytes | None:
        """The program of a key as it was saved; None where there is none."""
        ...

    def save(self, key: str, program: bytes) -> None:
        """Keep a program."""
        ...


class Compiled:
    """A jitted function whose programs are compiled with options of their own where possible.

    JAX refuses compiler options inside a function that a caller compiles: there the function is
    compiled as any other. Options that this version of XLA does not know are left out.

    Args:
        function: to be compiled.
        options: of XLA's compiler.
        identity: what the function is, in values that are spelled the same in every process; None
            for one that no store keeps.

    Attributes:
        store: where programs are kept, which are neither traced nor compiled there again; set by a
            command for its process.
    """

    store: ProgramStore | None = None

    def __init__(
        self,
        function: Callable[..., Any],
        options: Mapping[str, Any],
        identity: tuple[Any, ...] | None = None,
    ) -> None:
        self._plain = jax.jit(function)
        self._function, self._options, self._identity = function, options, identity
        self._programs = 0
        self._kept: dict[str, Callable[..., Any]] = {}
        self._lock = threading.Lock()

    @functools.cached_property
    def _own(self) -> Any:
        # Asked of XLA at the first call: an import must not start its devices.
        with untraced():
            known = {key: value for key, value in self._options.items() if _is_known(key, value)}
        return jax.jit(self._function, compiler_options=known)

    def has_grown(self) -> bool:
        """Whether it has compiled another program since this was last asked."""
        before = self._programs
        functions: tuple[Any, Any] = self._plain, self.__dict__.get("_own")
        self._programs = functions[0]._cache_size() + len(self._kept)
        if functions[1] is not None:
            self._programs += functions[1]._cache_size()
        return self._programs > before

    def __call__(self, concrete: bool, *arguments: Any) -> Any:
        """The function of arguments that are `concrete` (`is_concrete`) or not."""
        if concrete:
            with contextlib.suppress(ValueError):
                key = None if self.store is None else self._key(arguments)
                if self.store is None or key is None:
                    return self._own(*arguments)
                return self._of_store(self.store, key, arguments)
        return self._plain(*arguments)

    def _key(self, arguments: tuple[Any, ...]) -> str | None:
        """All that the program of these arguments depends on; None for one that is not kept."""
        if self._spelled_identity is None or not _run_on_first_cpu(arguments):
            return None
        return f"{self._spelled_identity}\n{_context(arguments)}"

    @functools.cached_property
    def _spelled_identity(self) -> str | None:
        if self._identity is not None:
            with contextlib.suppress(TypeError):
                return _spelled((self._options, *self._identity))
        return None

    def _of_store(self, store: ProgramStore, key: str, arguments: tuple[Any, ...]) -> Any:
        """The function by a program of this process, of the store, or a new one."""
        with self._lock:
            if key not in self._kept and (saved := store.load(key)) is not None:
                # Only when it runs is it seen whether a program is whole.
                with contextlib.suppress(Exception):
                    program = _deserialised(saved)
                    answer = jax.block_until_ready(program(*arguments))
                    self._kept[key] = program
                    return answer
            if key not in self._kept:
                with _not_kept_by_jax():
                    program = self._own.lower(*arguments).compile()
                self._kept[key] = program
                # A program that closes over arrays cannot be serialised.
                with contextlib.suppress(ValueError, NotImplementedError):
                    store.save(key, pickle.dumps(serialize_executable.serialize(program)))
        return self._kept[key](*arguments)


@contextlib.contextmanager
def _not_kept_by_jax() -> Generator[None]:
    """Let JAX's own cache be: a program that came from there cannot be serialised again."""
    name = "jax_persistent_cache_min_compile_time_secs"
    before = jax.config.values[name]
    jax.config.update(name, float("inf"))
    try:
        yield
    finally:
        jax.config.update(name, before)


def _deserialised(program: bytes) -> Callable[..., Any]:
    """A program as it was serialised, on the first device."""
    device = jax.devices()[0]
    return serialize_executable.deserialize_and_load(
        *pickle.loads(program), backend=device.client, execution_devices=[device]
    )


def _run_on_first_cpu(arrays: Any) -> bool:
    """Whether programs of these arrays run on the first device, and that is a CPU."""
    device, default = jax.devices()[0], jax.config.values["jax_default_device"]
    placed = [x for x in jax.tree.leaves(arrays) if isinstance(x, jax.Array)]
    on_it = all(x.devices() == {device} for x in placed)
    return device.platform == "cpu" and default is None and on_it


def _context(arrays: Any) -> str:
    """Shapes and types of arrays, and what of JAX and its settings a program depends on."""
    leaves, structure = jax.tree.flatten(arrays)
    types = [(x.shape, str(x.dtype), getattr(x, "weak_type", False)) for x in leaves]
    flags = os.environ.get("XLA_FLAGS")
    # Not those that say what JAX keeps, and where.
    settings = sorted(item for item in jax.config.values.items() if "cache" not in item[0])
    versions = jax.__version__, jaxlib.version.__version__
    return repr((structure, types, versions, flags, settings))


def _spelled(value: Any) -> str:
    """A static argument in full, the same in each process; a TypeError where that cannot be."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = [getattr(value, field.name) for field in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        parts = list(value.items())
    elif isinstance(value, tuple):
        parts = list(value)
    elif value is None or isinstance(value, (str, int, float)):
        return repr(value)
    else:
        raise TypeError(f"expected a value that can be spelled, got {value!r}")
    return f"{type(value).__qualname__}({', '.join(map(_spelled, parts))})"


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
