"""A robot's shape: capsules on its links, and which of them are held against each other."""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import Array, as_data, as_labels, check_finite, is_known, shown
from niryo_jax.collision.tree import STATIC, Record

Link: TypeAlias = str | int
"""A capsule by its name, or all capsules of a link by the number of joints that move it."""


_ARRAYS = "start", "end", "radius"


@jax.tree_util.register_pytree_with_keys_class
@dataclasses.dataclass(frozen=True, eq=False)
class CollisionModel(Record):
    """Capsules that enclose the links of an arm: all points within a radius of a segment.

    Attributes:
        start, end: (m, 3) the ends of the segments in the space frame at q = 0, metres; a sphere is
            a capsule whose ends coincide.
        radius: (m,) metres.
        links: for each capsule the number of joints that move it: 0 is the base, i the link behind
            the i-th joint; static.
        names: of the capsules; static.
        pairs: the pairs of capsules, by their indices, whose distances are looked at; static.

    The arrays are pytree leaves: they can be traced and differentiated
    (`dataclasses.replace(model, radius=...)`). What is known is checked as `from_capsules` does.
    """

    start: Array
    end: Array
    radius: Array
    links: tuple[int, ...] = dataclasses.field(metadata=STATIC)
    names: tuple[str, ...] = dataclasses.field(metadata=STATIC)
    pairs: tuple[tuple[int, int], ...] = dataclasses.field(metadata=STATIC)

    def __post_init__(self) -> None:
        """Check what is known.

        Raises:
            ValueError, TypeError: as `from_capsules`.
        """
        arrays = {name: as_data(name, getattr(self, name)) for name in _ARRAYS}
        for name, array in arrays.items():
            object.__setattr__(self, name, array)
        if self.radius.ndim != 1 or len(self.radius) == 0:
            raise ValueError(f"radius: expected shape (m,) with m >= 1, got {self.radius.shape}")
        check_segments(arrays)
        count = len(self.radius)
        object.__setattr__(self, "links", _as_links(self.links, count))
        object.__setattr__(self, "names", as_labels("names", self.names, count))
        twice = [name for name, found in Counter(self.names).items() if found > 1]
        if twice:
            raise ValueError(f"names: expected distinct names, got {', '.join(twice)} twice")
        object.__setattr__(self, "pairs", _as_pairs(self.pairs, self.links))

    @classmethod
    def from_capsules(
        cls,
        start: ArrayLike,
        end: ArrayLike,
        radius: ArrayLike,
        links: Sequence[int],
        *,
        names: Sequence[str] | None = None,
        pairs: Iterable[tuple[Link, Link]] | None = None,
        allowed: Iterable[tuple[Link, Link]] = (),
    ) -> CollisionModel:
        """A model of capsules.

        Args:
            start, end: (m, 3) the ends of the segments, space frame at q = 0, metres.
            radius: (m,) or one for all, metres, 0 or more.
            links: for each capsule the number of joints that move it.
            names: of the capsules, distinct; "link_0"... where not given.
            pairs: which capsules are held against each other, each by its name, or all those of a
                link by its number; where not given, all of different links that are no neighbours.
            allowed: pairs that are not looked at, as for `allow`.

        Raises:
            ValueError: wrong shapes, numbers that are not finite, a negative radius, names that are
                not distinct, an unknown capsule or link, a pair of capsules of one link.
            TypeError: no arrays of real numbers, no whole numbers, no texts.
        """
        start, end = as_data("start", start), as_data("end", end)
        radius = as_data("radius", radius)
        count = start.shape[0] if start.ndim == 2 else 0
        if radius.ndim == 0:
            library = np if isinstance(radius, np.ndarray) else jnp
            radius = library.broadcast_to(radius, (count,))
        moved_by = _as_links(links, count)
        labels = _numbered(moved_by) if names is None else as_labels("names", names, count)
        model = cls(start, end, radius, moved_by, labels, ())
        every = model._default_pairs() if pairs is None else model._found("pairs", pairs)
        return dataclasses.replace(model, pairs=every).allow(allowed)

    def allow(self, pairs: Iterable[tuple[Link, Link]]) -> CollisionModel:
        """The same model without some pairs, which may touch.

        Args:
            pairs: of capsules by their names, or of links by their numbers: then all capsules of
                them.

        Raises:
            ValueError: an unknown capsule or link. TypeError: no pairs.
        """
        gone = set(self._found("allowed", pairs))
        return dataclasses.replace(self, pairs=tuple(x for x in self.pairs if x not in gone))

    def attach(
        self,
        start: ArrayLike,
        end: ArrayLike,
        radius: ArrayLike,
        links: Sequence[int],
        *,
        names: Sequence[str] | None = None,
    ) -> CollisionModel:
        """The same model with more capsules, of a tool or of what it holds.

        The new ones are held against all capsules of links that are neither their own nor
        neighbours of it. Arguments and errors are those of `from_capsules`.
        """
        more = CollisionModel.from_capsules(start, end, radius, links, names=names)
        taken = set(self.names)
        labels = more.names
        if names is None:
            labels = tuple(_free(name, taken) for name in more.names)
        every = is_concrete(*jax.tree.leaves((self, more)))
        library = np if every else jnp
        start, end, radius = (
            as_data(name, library.concatenate([getattr(self, name), getattr(more, name)]))
            for name in _ARRAYS
        )
        links, names = self.links + more.links, self.names + labels
        whole = CollisionModel(start, end, radius, links, names, self.pairs)
        new = [pair for pair in whole._default_pairs() if pair[1] >= len(self.links)]
        return dataclasses.replace(whole, pairs=self.pairs + tuple(new))

    def pair_names(self) -> tuple[tuple[str, str], ...]:
        """The names of the capsules of each pair."""
        return tuple((self.names[i], self.names[j]) for i, j in self.pairs)

    def _default_pairs(self) -> tuple[tuple[int, int], ...]:
        numbered = enumerate(self.links)
        return tuple(
            (i, j) for (i, a), (j, b) in itertools.combinations(numbered, 2) if abs(a - b) > 1
        )

    def _found(self, argument: str, pairs: Any) -> tuple[tuple[int, int], ...]:
        """The pairs of indices that pairs of names or links mean, each once."""
        found = dict[tuple[int, int], None]()
        for pair in pairs:
            if isinstance(pair, str) or not isinstance(pair, Sequence) or len(pair) != 2:
                raise TypeError(
                    f"{argument}: expected pairs of capsules or links, got {shown(pair)}"
                )
            ends = [self._indices(argument, end) for end in pair]
            for i, j in itertools.product(*ends):
                if self.links[i] == self.links[j]:
                    raise ValueError(
                        f"{argument}: expected capsules of two links, got {self.names[i]!r} and "
                        f"{self.names[j]!r}, both of link {self.links[i]}"
                    )
                found[min(i, j), max(i, j)] = None
        return tuple(found)

    def _indices(self, argument: str, end: Any) -> list[int]:
        chosen = [
            i
            for i, (name, link) in enumerate(zip(self.names, self.links))
            if (name == end if isinstance(end, str) else link == end)
        ]
        if not chosen:
            known = ", ".join(map(repr, (*self.names, *sorted(set(self.links)))))
            raise ValueError(f"{argument}: expected one of {known}, got {shown(end)}")
        return chosen


def check_segments(given: Mapping[str, Any]) -> None:
    """Raise a ValueError unless these are finite ends (m, 3), (m, 3) and radii (m,), none below 0.

    Args:
        given: the three arrays by their names.
    """
    *_, (radii, radius) = given.items()
    for name, array in given.items():
        expected = (*radius.shape[:1], *[3] * (name != radii))
        if tuple(array.shape) != expected:
            raise ValueError(f"{name}: expected shape {expected}, got {tuple(array.shape)}")
        check_finite(name, array)
    if is_known(radius) and np.any(np.asarray(radius) < 0):
        raise ValueError(f"{radii}: expected 0 or more, got {radius}")


def check_is_model(model: object) -> None:
    """Raise a TypeError unless it is a `CollisionModel`."""
    if not isinstance(model, CollisionModel):
        raise TypeError(f"model: expected a CollisionModel, got {shown(model)}")


def _as_links(links: Any, count: int) -> tuple[int, ...]:
    whole = isinstance(links, (Sequence, np.ndarray)) and not isinstance(links, str)
    values = np.asarray(links if whole and len(links) else [0.5])
    if values.ndim != 1 or values.dtype.kind not in "iu":
        raise TypeError(f"links: expected {count} whole numbers, got {shown(links)}")
    if len(values) != count:
        raise ValueError(f"links: expected {count} numbers, got {len(values)}")
    if np.any(values < 0):
        raise ValueError(f"links: expected 0 or more, got {shown(links)}")
    return tuple(int(value) for value in values)


def _as_pairs(pairs: Any, links: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    for pair in pairs:
        i, j = pair
        if not 0 <= i < j < len(links) or links[i] == links[j]:
            raise ValueError(
                f"pairs: expected indices i < j of capsules of two links, of {len(links)}, "
                f"got {shown(pair)}"
            )
    return tuple((int(i), int(j)) for i, j in pairs)


def _numbered(links: tuple[int, ...]) -> tuple[str, ...]:
    taken = set[str]()
    return tuple(_free(f"link_{link}", taken) for link in links)


def _free(name: str, taken: set[str]) -> str:
    """A name that is not taken, which then is."""
    number, candidate = 2, name
    while candidate in taken:
        candidate, number = f"{name}_{number}", number + 1
    taken.add(candidate)
    return candidate
