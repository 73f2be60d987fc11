"""Arguments, looked at where they come in: an error names one, what was given and what expected.

Of a traced array the shape and the type are known, and no more is looked at.
"""

from __future__ import annotations

import functools
import math
import operator
import os
import reprlib
import sys
from collections.abc import Callable, Collection, Hashable, Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax._jax import is_concrete
from niryo_jax.tolerances import MOTION, SCREW_NORM

Array = jax.Array | np.ndarray

_BYTES = 8
"""Of a number in float64."""


def real_dtype(name: str, dtype: Any) -> np.dtype:
    """The floating-point type in which numbers of a type are computed with.

    Raises:
        TypeError: numbers that are not real, or have fewer than 32 bits: poses would be wrong by
            millimetres, and no tolerance of the package holds.
    """
    if jnp.issubdtype(dtype, jnp.integer):
        return jnp.result_type(float)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise TypeError(f"{name}: expected real numbers, got dtype {dtype}")
    if np.dtype(dtype).itemsize < 4:
        raise TypeError(f"{name}: expected float32 or float64, got {dtype}; convert it first")
    return np.dtype(dtype)


def as_data(name: str, value: Any) -> Array:
    """Numbers that describe an arm: arrays of JAX as they are, all else as float64 of numpy.

    So no precision is lost without x64. What has a shape and a type alone (of `jax.eval_shape`)
    stays as it is.

    Raises:
        TypeError: no array of real numbers, or one of less than 32 bits each.
    """
    if isinstance(value, jax.Array):
        return value.astype(real_dtype(name, value.dtype))
    if isinstance(value, jax.ShapeDtypeStruct):
        return cast(Any, value)
    array = _as_numpy(name, value)
    real_dtype(name, array.dtype)
    array = array.astype(np.float64)
    array.setflags(write=False)
    return array


def _as_numpy(name: str, value: Any) -> np.ndarray:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.asarray(None)
    if array.dtype.kind in "OSU":
        raise TypeError(f"{name}: expected an array of numbers, got {shown(value)}")
    return array


def as_flags(name: str, value: Any, count: int) -> np.ndarray:
    """So many truth values.

    Raises:
        ValueError: another number of them.
        TypeError: no truth values.
    """
    array = _as_numpy(name, value)
    if array.shape != (count,):
        raise ValueError(f"{name}: expected {count} flags, got {shown(value)}")
    if array.dtype != bool and not np.all(np.isin(array, (0, 1))):
        raise TypeError(f"{name}: expected True or False for each joint, got {shown(value)}")
    return array.astype(bool)


def as_labels(name: str, value: Any, count: int) -> tuple[str, ...]:
    """So many texts.

    Raises:
        ValueError: another number of them.
        TypeError: no sequence of texts.
    """
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise TypeError(f"{name}: expected {count} texts, got {shown(value)}")
    for one in value:
        check_text(name, one)
    if len(value) != count:
        raise ValueError(f"{name}: expected {count} names, got {len(value)}")
    return tuple(value)


def check_text(name: str, value: Any) -> None:
    """Raise a TypeError unless it is a text."""
    if not isinstance(value, str):
        raise TypeError(f"{name}: expected a text, got {shown(value)}")


def check_path(name: str, value: Any) -> None:
    """Raise a TypeError unless it is the path of a file, or a text."""
    if not isinstance(value, (str, os.PathLike)):
        raise TypeError(f"{name}: expected a path, got {shown(value)}")


def check_choice(name: str, value: Any, choices: Collection[Any]) -> None:
    """Raise a ValueError unless it is one of these."""
    if not isinstance(value, Hashable) or value not in choices:
        expected = ", ".join(map(repr, choices))
        raise ValueError(f"{name}: expected one of {expected}, got {shown(value)}")


def check_number(name: str, value: Any, what: str, holds: Callable[[float], bool]) -> float:
    """A number.

    Args:
        name: of the argument.
        value: what was given.
        what: what is expected, in words.
        holds: whether a number is that.

    Raises:
        TypeError: no number, or one that is traced.
        ValueError: one that is not what is expected.
    """
    if isinstance(value, (str, bytes)) or np.ndim(value) or not is_concrete(value):
        raise TypeError(f"{name}: expected {what}, got {shown(value)}")
    try:
        given = float(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name}: expected {what}, got {shown(value)}") from None
    if not holds(given):
        raise ValueError(f"{name}: expected {what}, got {value}")
    return given


def check_positive(name: str, value: Any, what: str = "a positive number") -> float:
    """A number above zero that is finite; arguments and errors are those of `check_number`."""
    return check_number(name, value, what, lambda given: 0 < given < math.inf)


def check_count(name: str, value: Any, least: int, most: int) -> int:
    """A whole number between two others.

    Raises:
        TypeError: no whole number.
        ValueError: one that is too small or too large.
    """
    try:
        given = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected an integer, got {shown(value)}") from None
    if given < least:
        raise ValueError(f"{name}: expected {least} or more, got {given}")
    if given > most:
        raise ValueError(f"{name}: expected at most {most}, got {given}")
    return given


def check_fits(name: str, value: Any, least: int, numbers: float) -> int:
    """A whole number of things that take so many numbers each; all must fit into the memory.

    Raises:
        TypeError: no whole number.
        ValueError: one that is too small, or more than there is memory for.
    """
    given, memory = check_count(name, value, least, sys.maxsize), memory_size()
    most = int(memory / (_BYTES * max(numbers, 1)))
    if given > most:
        raise ValueError(
            f"{name}: expected at most {most}, for which the {memory / 2**30:.3g} GiB of memory "
            f"of this machine have room, got {given}"
        )
    return given


@functools.cache
def memory_size() -> int:
    """Bytes of memory of this machine; a terabyte where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 2**40


def check_finite(name: str, array: Any) -> None:
    """Raise a ValueError that names the argument where a number is not finite."""
    if is_known(array) and not np.all(np.isfinite(np.asarray(array))):
        raise ValueError(f"{name}: expected finite numbers, got {array}")


def check_motion(name: str, pose: Any) -> None:
    """Raise a ValueError that names the argument unless `pose` is a rigid motion."""
    if not is_known(pose):
        return
    pose = np.asarray(pose)
    rotation = pose[..., :3, :3]
    with np.errstate(all="ignore"):
        identity = rotation @ np.swapaxes(rotation, -1, -2)
        right = (
            np.all(np.isfinite(pose))
            and np.all(np.abs(identity - np.eye(3)) < MOTION)
            and np.all(np.linalg.det(rotation) > 0)
            and np.all(pose[..., 3, :] == np.array([0.0, 0.0, 0.0, 1.0]))
        )
    if not right:
        raise ValueError(
            f"{name}: expected a rigid motion [[R, p], [0, 0, 0, 1]] with R a rotation, got\n{pose}"
        )


def check_screws(screws: Any) -> None:
    """Raise a ValueError unless all that are known are unit screws."""
    if not is_known(screws):
        return
    check_finite("screws", screws)
    screws = np.asarray(screws)
    omega = np.linalg.norm(screws[..., :3], axis=-1)
    linear = np.linalg.norm(screws[..., 3:], axis=-1)
    unit = np.where(omega == 0, linear, omega)
    if np.any(np.abs(unit - 1) > SCREW_NORM.of(screws.dtype)):
        raise ValueError(
            "screws: expected |omega| = 1, or omega = 0 and |v| = 1 (prismatic); "
            f"got |omega| = {omega}, |v| = {linear}"
        )


def check_limits(lower: Any, upper: Any) -> None:
    """Raise a ValueError unless all that are known are numbers in the right order."""
    for name, limit in (("lower", lower), ("upper", upper)):
        if is_known(limit) and np.any(np.isnan(np.asarray(limit))):
            raise ValueError(f"{name}: expected numbers, got {limit}")
    if is_known(lower) and is_known(upper) and np.any(np.asarray(lower) > np.asarray(upper)):
        raise ValueError(f"lower must not exceed upper, got lower={lower}, upper={upper}")


def shown(value: object) -> str:
    """What was given, in a few words."""
    return reprlib.repr(value)


def is_known(array: object) -> bool:
    """Whether it is an array whose numbers are known now."""
    return isinstance(array, (jax.Array, np.ndarray)) and is_concrete(array)
