"""Errors of joints: what each kind of cause does to a joint vector, and what is known of it.

An error d is what must be added to a joint vector q for what the joints really do. Every model
says its mean and covariance at q, and draws from it; models add up (`+`) as independent causes do.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Iterable
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax.arguments import Array, as_data, check_finite, check_fits, is_known, shown
from niryo_jax.lanes.batching import as_floating, check_shape
from niryo_jax.lanes.matrices import product
from niryo_jax.uncertainty.checks import check_covariance, check_key
from niryo_jax.uncertainty.normal import factor, standard_normal


@dataclasses.dataclass(frozen=True, eq=False)
class Noise(abc.ABC):
    """A model of the errors of joints; its parameters are leaves of a pytree.

    A subclass says `_mean`, `_covariance` and `_draw` for a joint vector (..., n) that is checked.
    """

    def sample(self, key: ArrayLike, q: ArrayLike, count: int) -> jax.Array:
        """Draw errors.

        Args:
            key: of `jax.random`; the same one draws the same errors.
            q: (..., n) joint vectors, radians (metres for prismatic joints).
            count: how many for each joint vector.

        Returns:
            (..., count, n) errors in the dtype of q, independent of each other.

        Raises:
            ValueError: a q or parameters of another number of joints, a count below 1 or for which
                there is no memory.
            TypeError: no key, no array, no whole number.
        """
        q = self._checked(q)
        check_key("key", key)
        count = check_fits("count", count, 1, q.size)
        return self._draw(key, q, count)

    def mean(self, q: ArrayLike) -> jax.Array:
        """(..., n) the mean of the errors at joint vectors q (..., n); errors as `sample`."""
        q = self._checked(q)
        return jnp.broadcast_to(self._mean(q), q.shape)

    def covariance(self, q: ArrayLike) -> jax.Array:
        """(..., n, n) their covariance at joint vectors q (..., n); errors as `sample`."""
        q = self._checked(q)
        return jnp.broadcast_to(self._covariance(q), (*q.shape, q.shape[-1]))

    def __add__(self, other: object) -> Combined:
        """Both causes at once, independent of each other."""
        if not isinstance(other, Noise):
            return NotImplemented
        return Combined((*_parts(self), *_parts(other)))

    def tree_flatten(self) -> tuple[list[Any], None]:
        """The parameters."""
        return [getattr(self, field.name) for field in dataclasses.fields(self)], None

    @classmethod
    def tree_unflatten(cls, _: None, children: Iterable[Any]) -> Self:
        """A model of these parameters, which JAX may have put anything in the place of."""
        noise = object.__new__(cls)
        for field, value in zip(dataclasses.fields(cls), children):
            object.__setattr__(noise, field.name, value)
        return noise

    def _checked(self, q: ArrayLike) -> jax.Array:
        """The joint vectors, once it is seen that the parameters are of as many joints."""
        q = as_floating("q", q)
        check_shape("q", q, (-1,))
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, tuple) and np.shape(value) not in ((), q.shape[-1:]):
                raise ValueError(
                    f"{field.name}: expected one number or {q.shape[-1]}, one for each joint, "
                    f"got shape {np.shape(value)}"
                )
        return q

    def _store(self, name: str, *, least: float = -math.inf) -> None:
        """Keep a parameter as an array of finite numbers, none below the least."""
        value = as_data(name, getattr(self, name))
        check_finite(name, value)
        if value.ndim > 1:
            raise ValueError(
                f"{name}: expected one number or one for each joint, got shape {value.shape}"
            )
        if is_known(value) and np.any(np.asarray(value) < least):
            raise ValueError(f"{name}: expected {least:g} or more, got {value}")
        object.__setattr__(self, name, value)

    @abc.abstractmethod
    def _mean(self, q: jax.Array) -> jax.Array: ...

    @abc.abstractmethod
    def _covariance(self, q: jax.Array) -> jax.Array: ...

    @abc.abstractmethod
    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array: ...


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class Gaussian(Noise):
    """Normal errors of mean zero.

    Attributes:
        matrix: (n, n) the covariance, rad^2 (m^2 for prismatic joints): symmetric, and positive
            semidefinite; rows of zeros are joints without error.

    Raises:
        ValueError: a matrix that is none of that. TypeError: no array of real numbers.
    """

    matrix: Array

    def __post_init__(self) -> None:
        """Check what is known."""
        matrix = as_data("matrix", self.matrix)
        check_covariance("matrix", matrix)
        object.__setattr__(self, "matrix", matrix)

    @classmethod
    def independent(cls, sigma: ArrayLike) -> Gaussian:
        """Joints whose errors are independent of each other.

        Args:
            sigma: (n,) standard deviations, radians (metres for prismatic joints), 0 or more.

        Raises:
            ValueError: negative ones or ones that are not finite; no vector of them.
            TypeError: no array of real numbers.
        """
        sigma = as_data("sigma", sigma)
        check_shape("sigma", sigma, (-1,))
        check_finite("sigma", sigma)
        if is_known(sigma) and np.any(np.asarray(sigma) < 0):
            raise ValueError(f"sigma: expected 0 or more, got {sigma}")
        # Of numpy where it can be, so that nothing of float64 is lost without x64.
        library = np if isinstance(sigma, np.ndarray) else jnp
        return cls(library.eye(sigma.shape[-1], dtype=sigma.dtype) * (sigma * sigma)[..., None])

    def _checked(self, q: ArrayLike) -> jax.Array:
        q = as_floating("q", q)
        check_shape("q", q, (-1,))
        if np.shape(self.matrix)[-1] != q.shape[-1]:
            raise ValueError(
                f"matrix: expected shape ({q.shape[-1]}, {q.shape[-1]}) for a q of shape "
                f"{q.shape}, got {np.shape(self.matrix)}"
            )
        return q

    def _mean(self, q: jax.Array) -> jax.Array:
        return jnp.zeros_like(q)

    def _covariance(self, q: jax.Array) -> jax.Array:
        return jnp.asarray(self.matrix, q.dtype)

    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array:
        unit = standard_normal(key, (*q.shape[:-1], count, q.shape[-1]), q.dtype)
        lower = factor(self._covariance(q))
        return product(unit, jnp.swapaxes(lower, -1, -2))


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class Uniform(Noise):
    """Errors spread evenly between -half_width and half_width, of each joint on its own.

    Attributes:
        half_width: () or (n,) radians (metres for prismatic joints), 0 or more.

    Raises:
        ValueError: negative numbers or ones that are not finite. TypeError: no real numbers.
    """

    half_width: Array

    def __post_init__(self) -> None:
        """Check what is known."""
        self._store("half_width", least=0.0)

    def _mean(self, q: jax.Array) -> jax.Array:
        return jnp.zeros_like(q)

    def _covariance(self, q: jax.Array) -> jax.Array:
        return _diagonal(self.half_width**2 / 3.0, q)

    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array:
        shape = (*q.shape[:-1], count, q.shape[-1])
        unit = jax.random.uniform(key, shape, q.dtype, minval=-1.0, maxval=1.0)
        return unit * jnp.asarray(self.half_width, q.dtype)


class _Certain(Noise):
    """Errors that are the same at each draw."""

    def _covariance(self, q: jax.Array) -> jax.Array:
        return jnp.zeros((q.shape[-1], q.shape[-1]), q.dtype)

    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array:
        del key
        error = jnp.broadcast_to(self._mean(q), q.shape)[..., None, :]
        return jnp.broadcast_to(error, (*q.shape[:-1], count, q.shape[-1]))


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class Bias(_Certain):
    """A joint that is off by the same everywhere: a zero that was found wrongly.

    Attributes:
        offset: () or (n,) radians (metres for prismatic joints).

    Raises:
        ValueError: numbers that are not finite. TypeError: no real numbers.
    """

    offset: Array

    def __post_init__(self) -> None:
        """Check what is known."""
        self._store("offset")

    def _mean(self, q: jax.Array) -> jax.Array:
        return jnp.asarray(self.offset, q.dtype)


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class GearRatio(Noise):
    """A gear whose ratio is not the one that is reckoned with: an error in proportion to q.

    Attributes:
        share: () or (n,) how much farther the joint turns than it should, as a share of q.
        sigma: () or (n,) the standard deviation of that share among arms, 0 or more.

    Raises:
        ValueError: numbers that are not finite, a negative sigma. TypeError: no real numbers.
    """

    share: Array
    sigma: Array = dataclasses.field(default_factory=lambda: np.zeros(()))

    def __post_init__(self) -> None:
        """Check what is known."""
        self._store("share")
        self._store("sigma", least=0.0)

    def _mean(self, q: jax.Array) -> jax.Array:
        return jnp.asarray(self.share, q.dtype) * q

    def _covariance(self, q: jax.Array) -> jax.Array:
        return _diagonal((jnp.asarray(self.sigma, q.dtype) * q) ** 2, q)

    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array:
        share, sigma = (jnp.asarray(x, q.dtype) for x in (self.share, self.sigma))
        unit = standard_normal(key, (*q.shape[:-1], count, q.shape[-1]), q.dtype)
        return (share + sigma * unit) * q[..., None, :]


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class Backlash(Noise):
    """Play between motor and joint: the joint lags behind by half of it, on the side it came from.

    Attributes:
        play: () or (n,) the whole play, radians (metres for prismatic joints), 0 or more.
        direction: () or (n,) the way in which each joint moved last: 1 towards larger q, -1 towards
            smaller q, and the error is -direction play / 2; 0 where it is not known, and either
            side is as likely as the other.

    Raises:
        ValueError: a negative play, numbers that are not finite, a direction of another value.
        TypeError: no real numbers.
    """

    play: Array
    direction: Array = dataclasses.field(default_factory=lambda: np.zeros(()))

    def __post_init__(self) -> None:
        """Check what is known."""
        self._store("play", least=0.0)
        self._store("direction")
        if is_known(self.direction) and not np.all(np.isin(self.direction, (-1, 0, 1))):
            raise ValueError(f"direction: expected -1, 0 or 1, got {self.direction}")

    def _mean(self, q: jax.Array) -> jax.Array:
        return -0.5 * jnp.asarray(self.direction, q.dtype) * jnp.asarray(self.play, q.dtype)

    def _covariance(self, q: jax.Array) -> jax.Array:
        open_side = jnp.asarray(self.direction) == 0
        return _diagonal(jnp.where(open_side, 0.25 * jnp.asarray(self.play) ** 2, 0.0), q)

    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array:
        shape = (*q.shape[:-1], count, q.shape[-1])
        side = jnp.where(jax.random.bernoulli(key, shape=shape), 0.5, -0.5).astype(q.dtype)
        known = self._mean(q)
        either = side * jnp.asarray(self.play, q.dtype)
        return jnp.where(jnp.asarray(self.direction) == 0, either, known)


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class EncoderSteps(_Certain):
    """An encoder of whole steps: the joint stands at the multiple of the step nearest to q.

    The error is the same each time at one q; over all q it is spread as `Uniform(step / 2)`. Its
    derivative by q is -1, and by the step the number of steps, wherever it does not jump.

    Attributes:
        step: () or (n,) radians (metres for prismatic joints), 0 or more; 0 for none.

    Raises:
        ValueError: negative numbers or ones that are not finite. TypeError: no real numbers.
    """

    step: Array

    def __post_init__(self) -> None:
        """Check what is known."""
        self._store("step", least=0.0)

    def _mean(self, q: jax.Array) -> jax.Array:
        step = jnp.asarray(self.step, q.dtype)
        some = step > 0
        return jnp.where(some, jnp.round(q / jnp.where(some, step, 1.0)) * step - q, 0.0)


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class Combined(Noise):
    """Several causes at once, independent of each other; what `+` makes.

    Attributes:
        parts: the models. Each looks at the joint vector as it is given, not as others move it.

    Raises:
        TypeError: anything but a sequence of models. ValueError: an empty one.
    """

    parts: tuple[Noise, ...]

    def __post_init__(self) -> None:
        """Check that they are models."""
        given: Any = self.parts
        if not isinstance(given, (tuple, list)) or not all(isinstance(x, Noise) for x in given):
            raise TypeError(f"parts: expected models of noise, got {shown(given)}")
        if not given:
            raise ValueError("parts: expected one model of noise or more, got none")
        object.__setattr__(self, "parts", tuple(given))

    def _checked(self, q: ArrayLike) -> jax.Array:
        checked = as_floating("q", q)
        for part in self.parts:
            checked = part._checked(q)
        return checked

    def _mean(self, q: jax.Array) -> jax.Array:
        return sum((part._mean(q) for part in self.parts), jnp.zeros_like(q))

    def _covariance(self, q: jax.Array) -> jax.Array:
        n = q.shape[-1]
        return sum((part._covariance(q) for part in self.parts), jnp.zeros((n, n), q.dtype))

    def _draw(self, key: ArrayLike, q: jax.Array, count: int) -> jax.Array:
        none = jnp.zeros((*q.shape[:-1], count, q.shape[-1]), q.dtype)
        keys = jax.random.split(jnp.asarray(key), len(self.parts))
        return sum((part._draw(one, q, count) for one, part in zip(keys, self.parts)), none)


def check_noise(name: str, value: Any) -> None:
    """Raise a TypeError unless it is a model of noise."""
    if not isinstance(value, Noise):
        raise TypeError(f"{name}: expected a model of noise, got {shown(value)}")


def _parts(noise: Noise) -> tuple[Noise, ...]:
    return noise.parts if isinstance(noise, Combined) else (noise,)


def _diagonal(variances: ArrayLike, q: jax.Array) -> jax.Array:
    """Variances () or (..., n) as a diagonal covariance."""
    n = q.shape[-1]
    spread = jnp.asarray(variances, q.dtype)
    return jnp.eye(n, dtype=q.dtype) * jnp.broadcast_to(spread, (*spread.shape[:-1], n))[..., None]
