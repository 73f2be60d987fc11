"""Between arrays and lanes: the edge where batch axes, shapes and types are dealt with once."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.arguments import real_dtype, shown
from niryo_jax.lanes.scalar import Lane, Lanes, lanes_of, materialise, pack, unpack
from niryo_jax.lanes.trigonometry import Angle, sincos

Given = ParamSpec("Given")
Result = TypeVar("Result")

Edge = tuple[str, ArrayLike, tuple[int, ...]]
"""An argument's name, its value and the shape of its last axes (-1: any length)."""


def check_shape(name: str, array: jax.Array | np.ndarray, shape: tuple[int, ...]) -> None:
    """Raise a ValueError that names the argument unless its last axes have this shape."""
    last = array.shape[array.ndim - len(shape) :] if array.ndim >= len(shape) else None
    if last is None or any(want not in (-1, have) for want, have in zip(shape, last)):
        expected = ", ".join("n" if size == -1 else str(size) for size in shape)
        raise ValueError(f"{name}: expected shape (..., {expected}), got {tuple(array.shape)}")


def as_floating(name: str, value: ArrayLike) -> jax.Array:
    """The value as a real floating-point array, integers in the precision that JAX is set to.

    Raises:
        TypeError: no array of real numbers, or one of less than 32 bits each.
    """
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name}: expected an array of numbers, got {shown(value)}") from None
    dtype = real_dtype(name, array.dtype)
    return array if array.dtype == dtype else array.astype(dtype)


def broadcast_batch(*arrays: tuple[str, Any, int]) -> tuple[Any, ...]:
    """The batch axes of arrays, of which the number of last axes is given with a name.

    Raises:
        ValueError: they do not broadcast.
    """
    batches = [array.shape[: array.ndim - last] for _, array, last in arrays]
    try:
        return jnp.broadcast_shapes(*batches)
    except ValueError:
        names = ", ".join(name for name, *_ in arrays)
        shapes = ", ".join(map(str, batches))
        raise ValueError(
            f"{names}: expected batch axes that broadcast against each other, got {shapes}"
        ) from None


def compiled(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """`jax.jit` of a function of arrays, whose errors name the argument that is no array."""
    jitted = jax.jit(function)

    @functools.wraps(function)
    def public(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        try:
            return jitted(*args, **kwargs)
        except TypeError as error:
            problem = error
        # JAX refuses what is no array before the function can.
        given = inspect.signature(function).bind(*args, **kwargs)
        for name, value in given.arguments.items():
            as_floating(name, value)
        raise problem

    return public


def on_lanes(function: Callable[..., Any], *edges: Edge) -> Any:
    """Call `function` with the lanes of each array and pack what it returns.

    The batch axes of the arrays (and of any lanes that the function brings along) broadcast against
    each other and return in front of the results; the dtype is that of the arrays. The function
    returns lanes, a lane, or a tuple of these.
    """
    arrays = [as_floating(name, value) for name, value, _ in edges]
    for (name, _, shape), array in zip(edges, arrays):
        check_shape(name, array, shape)
    dtype = jnp.result_type(*arrays)
    batch = broadcast_batch(
        *((name, array, len(shape)) for (name, _, shape), array in zip(edges, arrays))
    )
    lanes = [unpack(array.astype(dtype), len(shape)) for (_, _, shape), array in zip(edges, arrays)]
    result = function(*lanes)

    def pack_one(value: Lane | Lanes) -> jax.Array:
        lanes = value if isinstance(value, np.ndarray) else np.array(value, dtype=object)
        shapes = [jnp.shape(lane.value) for lane in lanes.ravel()]
        return pack(lanes, jnp.broadcast_shapes(batch, *shapes), dtype)

    return tuple(map(pack_one, result)) if isinstance(result, tuple) else pack_one(result)


def on_joints(
    function: Callable[..., Any],
    q: ArrayLike,
    joints: int,
    *edges: Edge,
    batch_last: bool = False,
) -> Any:
    """`on_lanes` of a function whose first argument is a joint vector (..., n).

    Sines and cosines are computed for whole arrays of joint vectors, which are contiguous in
    memory, and kept: XLA would compute them for one pose at a time, and again for each result.
    With `batch_last` the joint vectors are (n, ...), and so are the batch axes of the result.
    """
    q = as_floating("q", q)
    sin, cos = (materialise(part).array for part in sincos(Lane(q)))

    def with_angles(q: Lanes, sin: Lanes, cos: Lanes, *rest: Lanes) -> Any:
        angles = np.empty(len(q), dtype=object)
        for i, of_joint in enumerate(zip(q, sin, cos)):
            angles[i] = Angle(*of_joint)
        return function(angles, *rest)

    if batch_last:
        if q.ndim == 0 or len(q) != joints:
            raise ValueError(f"q: expected shape ({joints}, ...), got {q.shape}")
        result = with_angles(*(lanes_of([Lane(x) for x in part]) for part in (q, sin, cos)))
        lanes = [jnp.broadcast_to(jnp.asarray(x.value, q.dtype), q.shape[1:]) for x in result.flat]
        return jnp.stack(lanes).reshape(*result.shape, *q.shape[1:])
    shape = (joints,)
    return on_lanes(with_angles, ("q", q, shape), ("q", sin, shape), ("q", cos, shape), *edges)
