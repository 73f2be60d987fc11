"""The lane: one scalar over the batch, with the arithmetic that folds known zeros and ones."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jax import lax

from niryo_jax.lanes.packing import pack_columns, unpack_columns

Lanes = npt.NDArray[np.object_]
"""An array of lanes: numpy, dtype object."""

Condition = jax.Array | np.bool_
"""A truth over the batch, or one that is known while tracing."""


def _elementwise(operation: Callable[[Lane, Lane], Lane]) -> Callable[[Lane, Any], Lane]:
    """An operator of two lanes that leaves arrays of lanes to numpy, which calls it per element."""

    def method(self: Lane, other: Any) -> Lane:
        return NotImplemented if isinstance(other, np.ndarray) else operation(self, as_lane(other))

    return method


Value = jax.Array | float


def _apply(
    strict: Callable[[Any, Any], Any], general: Callable[[Any, Any], Any], a: Value, b: Value
) -> Any:
    """An operation on arrays or known numbers.

    Tracing is most of what a program from the compilation cache costs, and the strict operations
    of `jax.lax`, which neither broadcast nor promote, are traced several times faster.
    """
    if isinstance(a, int | float):
        if isinstance(b, int | float) or not _is_strict(b):
            return general(a, b)
        return strict(b.dtype.type(a), b)
    if not _is_strict(a):
        return general(a, b)
    if isinstance(b, int | float):
        return strict(a, a.dtype.type(b))
    alike = a.shape == b.shape and a.dtype == b.dtype and _is_strict(b)
    return (strict if alike else general)(a, b)


def _is_strict(array: jax.Array) -> bool:
    """Whether an array has a floating-point dtype that a number beside it must take."""
    return array.dtype.kind == "f" and not getattr(array, "weak_type", True)


class Lane:
    """One scalar over the batch: an array of the batch's shape, or a float known while tracing."""

    __slots__ = ("value",)
    value: Value

    def __init__(self, value: Value) -> None:
        self.value = value

    @property
    def array(self) -> jax.Array:
        """The value as an array, also where it is known."""
        return jnp.asarray(self.value)

    @property
    def known(self) -> bool:
        """Whether this is a number that is known while tracing."""
        return isinstance(self.value, float)

    def is_known(self, number: float) -> bool:
        """Whether this is known while tracing to be exactly `number`."""
        return isinstance(self.value, float) and self.value == number

    def astype(self, dtype: jax.typing.DTypeLike) -> Lane:
        """The same in a dtype; what is known while tracing has none."""
        return self if self.known else Lane(jnp.asarray(self.value, dtype))

    @_elementwise
    def __add__(self, other: Lane) -> Lane:
        if other.is_known(0.0):
            return self
        if self.is_known(0.0):
            return other
        return Lane(_apply(lax.add, operator.add, self.value, other.value))

    @_elementwise
    def __sub__(self, other: Lane) -> Lane:
        if other.is_known(0.0):
            return self
        if self.is_known(0.0):
            return -other
        return Lane(_apply(lax.sub, operator.sub, self.value, other.value))

    @_elementwise
    def __mul__(self, other: Lane) -> Lane:
        for one, rest in ((self, other), (other, self)):
            if one.is_known(0.0):
                return ZERO
            if one.is_known(1.0):
                return rest
            if one.is_known(-1.0):
                return -rest
        return Lane(_apply(lax.mul, operator.mul, self.value, other.value))

    @_elementwise
    def __truediv__(self, other: Lane) -> Lane:
        if self.is_known(0.0):
            return ZERO
        if other.is_known(1.0):
            return self
        return Lane(_apply(lax.div, operator.truediv, self.value, other.value))

    def __neg__(self) -> Lane:
        # A known zero stays +0.0, so that folding never makes a negative zero out of nothing.
        return ZERO if self.is_known(0.0) else Lane(-self.value)

    def __abs__(self) -> Lane:
        return Lane(abs(self.value))

    def __radd__(self, other: float) -> Lane:
        return as_lane(other) + self

    def __rsub__(self, other: float) -> Lane:
        return as_lane(other) - self

    def __rmul__(self, other: float) -> Lane:
        return as_lane(other) * self

    def __rtruediv__(self, other: float) -> Lane:
        return as_lane(other) / self

    def __lt__(self, other: Lane | float) -> Condition:
        return _condition(_apply(lax.lt, operator.lt, self.value, as_lane(other).value))

    def __le__(self, other: Lane | float) -> Condition:
        return _condition(_apply(lax.le, operator.le, self.value, as_lane(other).value))

    def __gt__(self, other: Lane | float) -> Condition:
        return _condition(_apply(lax.gt, operator.gt, self.value, as_lane(other).value))

    def __ge__(self, other: Lane | float) -> Condition:
        return _condition(_apply(lax.ge, operator.ge, self.value, as_lane(other).value))

    def __repr__(self) -> str:
        return f"Lane({self.value})"


ZERO = Lane(0.0)


def _condition(value: Any) -> Condition:
    # A plain bool would turn into an integer under the operator ~.
    return np.bool_(value) if isinstance(value, bool) else value


_SELECT_COLUMNS = 36


def as_lane(value: Lane | jax.Array | float) -> Lane:
    """A lane of a number, an array over the batch, or a lane."""
    if isinstance(value, Lane):
        return value
    if isinstance(value, int | float | np.number):
        return Lane(float(value))
    return Lane(value)


def lanes_of(values: Any) -> Lanes:
    """A vector or matrix of lanes from (nested lists of) numbers and lanes."""
    return map_lanes(as_lane, np.array(values, dtype=object))


def map_lanes(function: Callable[[Any], Lane], lanes: Lanes) -> Lanes:
    """`function` of every element, in the same shape."""
    out = np.empty(lanes.shape, dtype=object)
    for index in np.ndindex(lanes.shape):
        out[index] = function(lanes[index])
    return out


def unpack(array: jax.Array | np.ndarray, axes: int = 1) -> Lanes:
    """The lanes of an array's last `axes` axes; the axes before them are the batch.

    A numpy array without batch axes is data known while tracing: its lanes are plain numbers.
    """
    batch = array.ndim - axes
    shape = array.shape[batch:]
    out = np.empty(shape, dtype=object)
    if isinstance(array, np.ndarray) and batch == 0:
        for index in np.ndindex(shape):
            out[index] = Lane(float(array[index]))
        return out
    size = math.prod(shape)
    rows = jnp.asarray(array).reshape(*array.shape[:batch], size)
    for index, column in zip(np.ndindex(shape), unpack_columns(rows)):
        out[index] = Lane(column)
    return out


def pack(lanes: Lanes, batch: tuple[int, ...], dtype: jax.typing.DTypeLike) -> jax.Array:
    """The array of shape `batch + lanes.shape` whose last axes are the lanes."""
    if lanes.ndim > 2 or (lanes.ndim == 2 and lanes.size > _SELECT_COLUMNS):
        return jnp.stack([pack(part, batch, dtype) for part in lanes], axis=len(batch))
    columns = [jnp.broadcast_to(jnp.asarray(x.value, dtype), batch) for x in lanes.ravel()]
    if lanes.ndim == 0:
        return columns[0]
    return pack_columns(columns, lanes.shape) if columns else jnp.zeros(batch + lanes.shape, dtype)


def select(condition: Condition, if_true: Lane | float, if_false: Lane | float) -> Lane:
    """`if_true` where the condition holds, `if_false` elsewhere; folded when it is known."""
    if isinstance(condition, np.bool_):
        return as_lane(if_true if condition else if_false)
    if_true, if_false = as_lane(if_true), as_lane(if_false)
    if if_true.known and if_false.known and if_true.value == if_false.value:
        return if_true
    return Lane(_where(condition, if_true.value, if_false.value))


def _where(condition: jax.Array, a: Value, b: Value) -> jax.Array:
    if isinstance(a, int | float) or isinstance(b, int | float):
        array = b if isinstance(a, int | float) else a
        if isinstance(array, int | float) or not _is_strict(array):
            return jnp.where(condition, a, b)
        a, b = (lax.full_like(array, x) if isinstance(x, int | float) else x for x in (a, b))
    alike = condition.shape == a.shape == b.shape and a.dtype == b.dtype
    return (lax.select if alike else jnp.where)(condition, a, b)


def choose(condition: Condition, if_true: Lanes, if_false: Lanes) -> Lanes:
    """`select` of every pair of elements of two arrays of one shape."""
    pairs = zip(if_true.ravel().tolist(), if_false.ravel().tolist())
    chosen = [select(condition, a, b) for a, b in pairs]
    return lanes_of(chosen).reshape(if_true.shape)


def maximum(a: Lane | float, b: Lane | float) -> Lane:
    """The larger of two lanes."""
    a, b = as_lane(a), as_lane(b)
    if a.known and b.known:
        return Lane(max(float(a.value), float(b.value)))
    return Lane(_apply(lax.max, jnp.maximum, a.value, b.value))


def minimum(a: Lane | float, b: Lane | float) -> Lane:
    """The smaller of two lanes."""
    return -maximum(-as_lane(a), -as_lane(b))


def sqrt(x: Lane) -> Lane:
    """The square root of the positive part: 0, with derivative 0, where x <= 0; NaN for NaN.

    A caller for whom a negative radicand means "no solution" tests its sign; here it only must
    not become NaN, neither in the value nor in the derivative of a branch not taken.
    """
    if isinstance(x.value, float):
        return Lane(0.0 if x.value <= 0 else math.sqrt(x.value))
    return Lane(_sqrt(jnp.asarray(x.value)))


# Where XLA works out x twice, the two may differ in the last bit: the root of a select on x <= 0
# can then be that of the other side.
@jax.custom_jvp
def _sqrt(x: jax.Array) -> jax.Array:
    return lax.sqrt(lax.max(lax.full_like(x, 0.0), x))


@_sqrt.defjvp
def _sqrt_jvp(primals: tuple[jax.Array], tangents: tuple[jax.Array]) -> tuple[jax.Array, jax.Array]:
    root = _sqrt(*primals)
    some = root > 0
    per = jnp.where(some, 0.5 / jnp.where(some, root, 1.0), 0.0)
    return root, tangents[0] * per


def reciprocal_root(x: Lane) -> Lane:
    """1 / sqrt(x) of a positive lane.

    XLA makes one operation of the reciprocal of a root, which does not vectorise on the CPU.
    """
    return sqrt(x) / x


def materialise(lane: Lane, by: Lane | None = None) -> Lane:
    """The same lane, computed once and kept, where XLA would compute it again for each user.

    XLA on the CPU fuses a cheap value into every loop that uses it, which multiplies the work of a
    chain of such values; but it never repeats a division. So this is a division by one, written
    such that it is not simplified away. (An optimization barrier is removed before fusion.)

    The one is 1 + 0 `by`; a lane that must stay linear for a transpose names another lane there.
    """
    if lane.known:
        return lane
    other = lax.stop_gradient((lane if by is None else by).value)
    one = _apply(lax.add, operator.add, _apply(lax.mul, operator.mul, other, 0.0), 1.0)
    return Lane(_apply(lax.div, operator.truediv, lane.value, one))


def materialised(lanes: Lanes) -> Lanes:
    """`materialise` of every element."""
    return map_lanes(materialise, lanes)


def kept_truth(condition: jax.Array, dtype: jax.typing.DTypeLike) -> jax.Array:
    """A truth, worked out once for all who ask for it (`materialise`), as a number of a dtype."""
    number = lax.select(condition, *(lax.full(condition.shape, x, dtype) for x in (1, 0)))
    return materialise(Lane(number)).array > 0


def contiguous_lanes(array: jax.Array, axes: int = 1) -> Lanes:
    """`unpack`, each lane contiguous in memory, which what reads many rows is faster with."""
    return materialised(unpack(array, axes))
