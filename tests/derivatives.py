"""How a public function is differentiated in both modes, and what its derivatives are held against.

A `Case` says how a function is called, where it has a derivative and where it has none.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import types
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from support import LD, adjoint_matrix, expm, hat3, hat6, rigid

import niryo_jax as nj

Kind = Literal["free", "rotation", "motion", "screw", "axis", "symmetric"]
"""What an argument is, and so how it may move: a rotation stays one, axes move as one."""

Tier = Literal["quick", "heavy", "slow"]


@dataclasses.dataclass(frozen=True)
class NoDerivative:
    """A point at which there is no derivative.

    Attributes:
        at: the arguments there.
        given: what is returned in its place, in words.
        flag: the number by which the answer says so; None where it does not.
    """

    at: tuple[Any, ...]
    given: str
    flag: int | None = None


class Answer(NamedTuple):
    """What a call answers where it says more than numbers.

    Attributes:
        values: floating-point results, each with the points in front.
        flag: (points,) the integer by which it says what it is.
        counts: of the shape of `values`, where that is one array: which of them the point has.
    """

    values: Any
    flag: Any = None
    counts: Any = None


@dataclasses.dataclass(frozen=True)
class Case:
    """One way to call a function.

    Attributes:
        of: its public name.
        call: from all arguments to its floating-point results, each with the points in front, or
            to an `Answer`.
        by: the arguments that it is differentiated by, and what they are; those in `shared` first.
        regular: points at which there is a derivative, by what is special about them.
        singular: points at which there is none.
        shared: values of arguments that all points have in common.
        note: what tells this case from others of the same function.
        jitted: whether everything is one program; False for solvers that bring their own.
        step: of the finite differences.
        turns: whether values are angles, of which whole turns do not count.
        joints: where values are joint vectors in no order of their own, of how many joints.
        single: by how much derivatives in float32 may differ from those in float64, of the largest.
        tier: "quick": in the default run; "heavy": in float32 only in the tier `completeness`;
            "slow": only there.
    """

    of: str
    call: Callable[..., Any]
    by: Mapping[str, Kind]
    regular: Mapping[str, tuple[Any, ...]]
    singular: Mapping[str, NoDerivative] = dataclasses.field(default_factory=dict)
    shared: tuple[Any, ...] = ()
    note: str = ""
    jitted: bool = True
    step: float = 1e-4
    turns: bool = False
    joints: int = 0
    single: float = 2e-4
    tier: Tier = "quick"

    def __post_init__(self) -> None:
        for name, at in {**self.regular, **{k: p.at for k, p in self.singular.items()}}.items():
            assert len(self.shared) + len(at) == len(self.by), f"{self.label}, {name}"

    @property
    def label(self) -> str:
        """Name and note."""
        return f"{self.of}, {self.note}" if self.note else self.of

    @property
    def names(self) -> list[str]:
        """The names of all points, regular ones first."""
        return [*self.regular, *self.singular]

    @property
    def flags(self) -> list[int | None]:
        """The flag that each singular point has to carry."""
        return [point.flag for point in self.singular.values()]

    def arguments(self, dtype: Any) -> tuple[np.ndarray, ...]:
        """All arguments: shared ones, then the others with the points in front."""
        points = [*self.regular.values(), *(point.at for point in self.singular.values())]
        rows = (np.stack([np.asarray(part, LD) for part in column]) for column in zip(*points))
        shared = (np.asarray(value, LD) for value in self.shared)
        return tuple(part.astype(dtype) for part in (*shared, *rows))


def moved(kind: Kind, x: np.ndarray, direction: np.ndarray, step: float) -> np.ndarray:
    """The argument after a step along a curve of its kind, in float64."""
    x, direction = np.asarray(x, LD), np.asarray(direction, LD) * LD(step)
    if kind == "rotation":
        x = x @ expm(hat3(direction))
    elif kind == "motion":
        x = x @ expm(hat6(direction))
    elif kind in ("screw", "axis"):
        x = (adjoint_matrix(expm(hat6(direction))) @ x[..., None])[..., 0]
    else:
        x = x + direction
    return x.astype(np.float64)


def rate(kind: Kind, x: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The derivative of `moved` with respect to the step."""
    if kind == "rotation":
        return x @ hat3(direction)
    if kind == "motion":
        return x @ hat6(direction)
    if kind in ("screw", "axis"):
        w, v = direction[..., :3], direction[..., 3:]
        turn = np.cross(w, x[..., :3])
        return np.concatenate([turn, np.cross(v, x[..., :3]) + np.cross(w, x[..., 3:])], -1)
    return direction


def directions(case: Case, x: tuple[np.ndarray, ...], rng: np.random.Generator) -> list[np.ndarray]:
    """A random direction for each argument."""
    out = []
    rigid = rng.standard_normal((len(case.names), 6))
    for kind, part in zip(case.by.values(), x):
        if kind == "axis":
            out.append(rigid)
            continue
        shape = {"rotation": (*part.shape[:-2], 3), "motion": (*part.shape[:-2], 6)}
        drawn = rng.standard_normal(shape.get(kind, part.shape))
        out.append(drawn + np.swapaxes(drawn, -1, -2) if kind == "symmetric" else drawn)
    return out


class Derivatives(NamedTuple):
    """Values (points, m), which of them count, flags, their rate, and weights pulled back."""

    value: np.ndarray
    counts: np.ndarray
    flag: np.ndarray
    rate: np.ndarray
    bars: tuple[np.ndarray, ...]


class Differentiated:
    """Value and both modes of a case, in one program for each dtype."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self._run = jax.jit(self._both) if case.jitted else self._both

    def _flat(self, *x: Any) -> tuple[jax.Array, Any]:
        answer = self.case.call(*x)
        points = len(self.case.names)
        values, flag, counts = answer if isinstance(answer, Answer) else Answer(answer)
        rows = [jnp.reshape(part, (points, -1)) for part in jax.tree.leaves(values)]
        flat = jnp.concatenate(rows, axis=1)
        flag = jnp.zeros(points, jnp.int32) if flag is None else flag
        counts = jnp.ones(flat.shape, bool) if counts is None else counts.reshape(flat.shape)
        return flat, (flat, counts, flag)

    def _both(self, x: Any, u: Any, weights: Any) -> Any:
        # Reverse mode is what JAX makes of this linear map in any case: it is made once.
        _, rates, others = jax.linearize(self._flat, *x, has_aux=True)
        pull = jax.linear_transpose(rates, *x)
        return *others, rates(*u), pull(weights[:, : others[0].shape[1]])

    def at(self, x: Any, u: Any, weights: np.ndarray) -> Derivatives:
        """Everything at arguments x, along u; weights (points, 4096) of the values."""
        x, u = tuple(map(jnp.asarray, x)), tuple(map(jnp.asarray, u))
        *parts, bars = self._run(x, u, jnp.asarray(weights, x[0].dtype))
        return Derivatives(*map(np.asarray, parts), tuple(map(np.asarray, bars)))


def public_functions() -> dict[str, Callable[..., Any]]:
    """Every public function and method of the package by its name, each once.

    Public is what stands in an `__all__` of the package or of what is right below it, and in the
    modules that these offer as a whole. Functions on lanes are what the others are made of.
    """
    found: dict[str, Callable[..., Any]] = {}
    seen: set[int] = set()
    for prefix, module in _modules():
        for name in getattr(module, "__all__", None) or vars(module):
            value = getattr(module, name)
            if name.startswith("_") or getattr(value, "__module__", "")[:9] != "niryo_jax":
                continue
            if not hasattr(module, "__all__") and value.__module__ != module.__name__:
                continue
            if inspect.isclass(value):
                members = ((f"{name}.{key}", one) for key, one in _methods(value))
            else:
                members = iter([(name, value)])
            for key, one in members:
                if callable(one) and id(one) not in seen and not _is_on_lanes(one):
                    seen.add(id(one))
                    found[f"{prefix}{key}"] = one
    return found


_OUTSIDE = "cli", "hardware", "lanes", "viewer"
"""Commands, machines and pictures have nothing to differentiate; lanes are what the others use."""


def _modules() -> Iterator[tuple[str, types.ModuleType]]:
    """The package, the modules that it offers, and all else right below it that is no program."""
    yield "", nj
    offered = [name for name in nj.__all__ if isinstance(getattr(nj, name), types.ModuleType)]
    for name in offered:
        if name not in _OUTSIDE:
            yield f"{name}.", getattr(nj, name)
    for info in pkgutil.iter_modules(nj.__path__):
        if info.name.startswith("_") or info.name in (*offered, *_OUTSIDE):
            continue
        module = importlib.import_module(f"niryo_jax.{info.name}")
        if hasattr(module, "__all__"):
            yield f"{info.name}.", module


def _methods(kind: type) -> Iterator[tuple[str, Any]]:
    for name, member in vars(kind).items():
        if name.startswith(("_", "tree_")):
            continue
        if isinstance(member, property):
            member = member.fget
        elif isinstance(member, (classmethod, staticmethod)):
            member = member.__func__
        if inspect.isfunction(member):
            yield name, member


def _is_on_lanes(function: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError:
        return False
    return any(str(one.annotation) in ("Lane", "Lanes") for one in parameters)


def rotation(*vector: float) -> np.ndarray:
    """(3, 3) the rotation by a rotation vector, in extended precision."""
    return expm(hat3(np.array(vector, LD)))


def motion(*twist: float) -> np.ndarray:
    """(4, 4) the rotation by the first three numbers, and the position that the others are."""
    return rigid(rotation(*twist[:3]), np.array(twist[3:], LD))
