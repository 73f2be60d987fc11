"""What stands around a robot: half spaces, boxes, spheres and capsules."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import (
    Array,
    as_data,
    as_labels,
    check_finite,
    check_motion,
    check_number,
    is_known,
    shown,
)
from niryo_jax.collision.model import check_segments
from niryo_jax.collision.tree import STATIC, Record
from niryo_jax.tolerances import SCREW_NORM

_SHAPES = {
    "plane_normals": (3,),
    "plane_offsets": (),
    "box_poses": (4, 4),
    "box_half_sizes": (3,),
    "sphere_centres": (3,),
    "sphere_radii": (),
    "capsule_starts": (3,),
    "capsule_ends": (3,),
    "capsule_radii": (),
}
"""The arrays of a world and the shape of an obstacle's entry in each."""


@jax.tree_util.register_pytree_with_keys_class
@dataclasses.dataclass(frozen=True, eq=False)
class World(Record):
    """Obstacles in the space frame, metres; worlds add up (`+`).

    Attributes:
        plane_normals: (k, 3) unit vectors out of half spaces; plane_offsets: (k,). The points x
            with normal . x < offset are solid.
        box_poses: (b, 4, 4) of centres and edges; box_half_sizes: (b, 3) half the lengths of these.
        sphere_centres: (s, 3); sphere_radii: (s,).
        capsule_starts, capsule_ends: (c, 3); capsule_radii: (c,).
        names: of all obstacles in this order, planes first; static.
        ignored: for each obstacle the links that may touch it, by the number of joints that move
            them; static.

    The arrays are pytree leaves. Worlds are made by `table`, `planes`, `boxes`, `spheres` and
    `capsules`; what is known is checked as these do.
    """

    plane_normals: Array
    plane_offsets: Array
    box_poses: Array
    box_half_sizes: Array
    sphere_centres: Array
    sphere_radii: Array
    capsule_starts: Array
    capsule_ends: Array
    capsule_radii: Array
    names: tuple[str, ...] = dataclasses.field(metadata=STATIC)
    ignored: tuple[tuple[int, ...], ...] = dataclasses.field(metadata=STATIC)

    def __post_init__(self) -> None:
        """Check what is known.

        Raises:
            ValueError, TypeError: as the methods that make worlds.
        """
        for name, last in _SHAPES.items():
            array = as_data(name, getattr(self, name))
            if array.ndim != 1 + len(last) or tuple(array.shape[1:]) != last:
                expected = ", ".join(("k", *map(str, last)))
                raise ValueError(f"{name}: expected shape ({expected}), got {array.shape}")
            check_finite(name, array)
            object.__setattr__(self, name, array)
        _check_alike("plane_offsets", self.plane_offsets, self.plane_normals)
        _check_alike("box_half_sizes", self.box_half_sizes, self.box_poses)
        _check_alike("sphere_radii", self.sphere_radii, self.sphere_centres)
        segments = {name: getattr(self, name) for name in _SHAPES if name.startswith("capsule")}
        check_segments(segments)
        _check_directions(self.plane_normals)
        check_motion("box_poses", self.box_poses)
        for name in ("box_half_sizes", "sphere_radii"):
            value = getattr(self, name)
            if is_known(value) and np.any(np.asarray(value) < 0):
                raise ValueError(f"{name}: expected 0 or more, got {value}")
        count = sum(self.counts)
        object.__setattr__(self, "names", as_labels("names", self.names, count))
        if len(self.ignored) != count:
            raise ValueError(f"ignored: expected {count} sets of links, got {len(self.ignored)}")

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """How many planes, boxes, spheres and capsules there are."""
        return (
            len(self.plane_offsets),
            len(self.box_half_sizes),
            len(self.sphere_radii),
            len(self.capsule_radii),
        )

    @classmethod
    def table(
        cls, height: float = 0.0, *, ignored: Iterable[int] = (0,), name: str = "table"
    ) -> World:
        """A table, or the floor: all that is below a height.

        Args:
            height: z of its top in the space frame, metres.
            ignored: the links that may touch it: the base, unless others are named.
            name: of the obstacle.

        Raises:
            ValueError, TypeError: no finite height, no links, no text.
        """
        check_number("height", height, "a finite number", lambda x: bool(np.isfinite(x)))
        return cls.planes([[0.0, 0.0, 1.0]], [height], ignored=ignored, names=[name])

    @classmethod
    def planes(
        cls,
        normals: ArrayLike,
        offsets: ArrayLike,
        *,
        ignored: Iterable[int] = (),
        names: Sequence[str] | None = None,
    ) -> World:
        """Half spaces, of which the points x with normal . x < offset are solid.

        Args:
            normals: (k, 3) unit vectors, out of what is solid.
            offsets: (k,) metres.
            ignored: the links that may touch them.
            names: of the obstacles; "plane_1"... where not given.

        Raises:
            ValueError: wrong shapes, numbers that are not finite, normals that are no unit vectors.
            TypeError: no arrays of real numbers, no whole numbers, no texts.
        """
        return cls._of("plane", names, ignored, plane_normals=normals, plane_offsets=offsets)

    @classmethod
    def boxes(
        cls,
        poses: ArrayLike,
        half_sizes: ArrayLike,
        *,
        ignored: Iterable[int] = (),
        names: Sequence[str] | None = None,
    ) -> World:
        """Boxes.

        Args:
            poses: (b, 4, 4) of their centres and edges, or (b, 3) centres alone: the edges are then
                those of the space frame.
            half_sizes: (b, 3) half the lengths of the edges, metres.
            ignored, names: as for `planes`.

        Raises:
            ValueError: wrong shapes, poses that are no rigid motions, negative lengths.
            TypeError: as `planes`.
        """
        poses = as_data("box_poses", poses)
        if poses.ndim == 2 and poses.shape[-1] == 3:
            library = np if isinstance(poses, np.ndarray) else jnp
            count, dtype = len(poses), poses.dtype
            turned = library.broadcast_to(library.eye(4, 3, dtype=dtype), (count, 4, 3))
            column = library.concatenate([poses, library.ones((count, 1), dtype)], axis=1)
            poses = library.concatenate([turned, column[..., None]], axis=2)
        return cls._of("box", names, ignored, box_poses=poses, box_half_sizes=half_sizes)

    @classmethod
    def spheres(
        cls,
        centres: ArrayLike,
        radii: ArrayLike,
        *,
        ignored: Iterable[int] = (),
        names: Sequence[str] | None = None,
    ) -> World:
        """Spheres: centres (s, 3) and radii (s,) or one for all, metres; the rest and errors as for
        `planes`."""
        return cls._of("sphere", names, ignored, sphere_centres=centres, sphere_radii=radii)

    @classmethod
    def capsules(
        cls,
        starts: ArrayLike,
        ends: ArrayLike,
        radii: ArrayLike,
        *,
        ignored: Iterable[int] = (),
        names: Sequence[str] | None = None,
    ) -> World:
        """Capsules: ends (c, 3) and radii (c,) or one for all, metres; the rest and errors as for
        `planes`."""
        return cls._of(
            "capsule",
            names,
            ignored,
            capsule_starts=starts,
            capsule_ends=ends,
            capsule_radii=radii,
        )

    @classmethod
    def _of(
        cls, kind: str, names: Sequence[str] | None, ignored: Iterable[int], **arrays: Any
    ) -> World:
        """Obstacles of one kind."""
        empty = {name: np.zeros((0, *last)) for name, last in _SHAPES.items()}
        given = {name: as_data(name, value) for name, value in arrays.items()}
        first = next(iter(given.values()))
        count = first.shape[0] if first.ndim else 0
        for name, value in given.items():
            if name.endswith("_radii") and value.ndim == 0:
                library = np if isinstance(value, np.ndarray) else jnp
                given[name] = library.broadcast_to(value, (count,))
        labels = tuple(f"{kind}_{i + 1}" for i in range(count)) if names is None else names
        links = _as_ignored(ignored)
        return cls(**{**empty, **given}, names=tuple(labels), ignored=(links,) * count)

    def __add__(self, other: object) -> World:
        """All obstacles of both."""
        if not isinstance(other, World):
            return NotImplemented
        arrays = dict[str, Any]()
        for name in _SHAPES:
            both = getattr(self, name), getattr(other, name)
            library = np if is_concrete(*both) else jnp
            arrays[name] = library.concatenate(both)
        labels, links = list[str](), list[tuple[int, ...]]()
        for mine, theirs in zip(self._kinds(), other._kinds()):
            labels += [*self.names[mine], *other.names[theirs]]
            links += [*self.ignored[mine], *other.ignored[theirs]]
        return World(**arrays, names=tuple(labels), ignored=tuple(links))

    def _kinds(self) -> list[slice]:
        """Where the planes, boxes, spheres and capsules are among all obstacles."""
        bounds = np.cumsum([0, *self.counts]).tolist()
        return [slice(low, high) for low, high in itertools.pairwise(bounds)]


def check_is_world(world: object) -> None:
    """Raise a TypeError unless it is a `World` or None."""
    if not isinstance(world, World | None):
        raise TypeError(f"world: expected a World or None, got {shown(world)}")


def _as_ignored(ignored: Any) -> tuple[int, ...]:
    values = () if isinstance(ignored, (str, int)) else tuple(ignored)
    if isinstance(ignored, (str, int)) or not all(isinstance(x, (int, np.integer)) for x in values):
        raise TypeError(f"ignored: expected numbers of links, got {shown(ignored)}")
    return tuple(sorted({int(value) for value in values}))


def _check_alike(name: str, array: Any, other: Any) -> None:
    if len(array) != len(other):
        raise ValueError(f"{name}: expected {len(other)} of them, got {len(array)}")


def _check_directions(normals: Any) -> None:
    if is_known(normals):
        lengths = np.linalg.norm(np.asarray(normals), axis=-1)
        if np.any(np.abs(lengths - 1) > SCREW_NORM.of(normals.dtype)):
            raise ValueError(f"plane_normals: expected unit vectors, got lengths {lengths}")
