"""The programs of clearance: one fused loop over the batch for all pairs.

What is known of a concrete model's capsules (zeros, ones, and all numbers where the caller
transforms the joints alone) is part of the program, as that of a robot is (`specialise`).
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from niryo_jax import lanes
from niryo_jax._jax import is_concrete
from niryo_jax.chain import link_motions
from niryo_jax.collision.model import CollisionModel
from niryo_jax.collision.segments import (
    Box,
    HalfSpace,
    Segment,
    between_segments,
    moved,
    segment,
    to_box,
    to_half_space,
)
from niryo_jax.collision.tree import Record
from niryo_jax.collision.world import World
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lanes.batching import on_joints
from niryo_jax.specialise import Geometry, specialised

_FEW = 4
"""So many half spaces, spheres and capsules are looked at side by side; more of them, and boxes,
one after the other in a loop, which costs more where they are few."""

_CAPSULE = 7
"""Numbers of a capsule: start, vector and radius."""


class Shapes(NamedTuple):
    """A model and a world as arrays, in the precision of the computation.

    Attributes:
        capsules: of the (m, 7) start, vector and radius those that the program does not know.
        planes: (k, 4) normal and offset.
        boxes: (b, 15) rotation by rows, centre and half size.
        segments: (c, 7) the spheres and the capsules of the world.
    """

    capsules: jax.Array
    planes: jax.Array
    boxes: jax.Array
    segments: jax.Array


_Known = tuple[float | None, ...]


class Layout(NamedTuple):
    """What of a model and a world a program is made for.

    Attributes:
        known: the (m 7) numbers of the capsules that the program knows (None: arguments).
        links, pairs: as those of the model.
        ignored: of the planes, of the boxes, and of the spheres and capsules of the world.
    """

    known: _Known
    links: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    ignored: tuple[tuple[tuple[int, ...], ...], ...]


def shapes_of(model: CollisionModel, world: World | None, q: jax.Array) -> tuple[Shapes, Layout]:
    """The arrays and the layout of a model and a world for joint vectors q."""
    numbers, known = _numbers_of(model, q.dtype, is_concrete(q))
    arrays: list[Any] = [np.zeros((0, 4)), np.zeros((0, 15)), np.zeros((0, _CAPSULE))]
    ignored: tuple[tuple[tuple[int, ...], ...], ...] = ((), (), ())
    if world is not None:
        arrays = _world_arrays(world)
        ends = np.cumsum([0, *(len(array) for array in arrays)]).tolist()
        ignored = tuple(world.ignored[low:high] for low, high in itertools.pairwise(ends))
    parts: list[Any] = [numbers, *arrays]
    shapes = Shapes(*(x.astype(q.dtype) if x.dtype != q.dtype else x for x in parts))
    return shapes, Layout(known, model.links, model.pairs, ignored)


def _numbers_of(model: CollisionModel, dtype: np.dtype, of_call: bool) -> tuple[Any, _Known]:
    """The numbers of the capsules that a program does not know, and those that it does.

    Args:
        model: whose capsules they are.
        dtype: of the computation.
        of_call: whether other numbers than zeros and ones are arguments of the program.
    """
    arrays = _known_or_traced(model)
    if not is_concrete(*arrays):
        numbers = _capsule_rows(*arrays).reshape(-1)
        return numbers, (None,) * numbers.shape[0]
    # Found once for all calls.
    cache: dict[tuple[np.dtype, bool], tuple[np.ndarray, _Known]]
    cache = model.__dict__.setdefault("_numbers", {})
    if (dtype, of_call) not in cache:
        numbers = _capsule_rows(*arrays).reshape(-1).astype(dtype)
        free = ~np.isin(numbers, (0.0, 1.0, -1.0)) & of_call
        # A negative zero plus 0.0 is a positive one, so that both give one program.
        known = tuple(None if x_free else float(x) + 0.0 for x, x_free in zip(numbers, free))
        cache[dtype, of_call] = numbers[free], known
    return cache[dtype, of_call]


def _world_arrays(world: World) -> list[Any]:
    normals, offsets, poses, half_sizes, centres, radii, *capsules = _known_or_traced(world)
    segments = [_capsule_rows(centres, centres, radii), _capsule_rows(*capsules)]
    library = np if is_concrete(*segments) else jnp
    return [
        _joined(normals, offsets[:, None]),
        _joined(poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3], half_sizes),
        library.concatenate(segments),
    ]


def _known_or_traced(record: Record) -> list[Any]:
    """The arrays of a record, of numpy where they are known, so that nothing of them is traced."""
    return [np.asarray(x) if is_concrete(x) else x for x in jax.tree.leaves(record)]


def _capsule_rows(start: Any, end: Any, radius: Any) -> Any:
    """(m, 7) start, vector and radius."""
    return _joined(start, end - start, radius[:, None])


def _joined(*parts: Any) -> Any:
    """Columns side by side."""
    return (np if is_concrete(*parts) else jnp).concatenate(parts, axis=1)


@specialised
def least_distance(
    geometry: Geometry, q: jax.Array, shapes: Shapes, *, layout: Layout
) -> jax.Array:
    """(...,) the least signed distance; infinite where there are no pairs."""
    return _least_distance(layout, geometry, q, shapes)


# The derivative is that of the nearest pair alone: that of all pairs would be thrown away, and
# takes XLA longer to compile than anything else here.
@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _least_distance(layout: Layout, geometry: Geometry, q: jax.Array, shapes: Shapes) -> jax.Array:
    def least(q: Lanes) -> Lane:
        capsules = _capsules(geometry, q, shapes, layout)
        found = Lane(np.inf)
        for distance in _own_distances(capsules, layout):
            found = lanes.minimum(found, distance)
        for group in _groups(shapes, layout):
            if group.is_small:
                for distance in group.unrolled(capsules):
                    found = lanes.minimum(found, distance)
            else:
                nearest = group.map(capsules, q, lambda distances: jnp.min(distances, axis=0))
                found = lanes.minimum(found, Lane(jnp.min(nearest, axis=0)))
        return found + _nothing(q)

    return on_joints(least, q, geometry.joints)


@_least_distance.defjvp
def _least_distance_jvp(
    layout: Layout, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[jax.Array, jax.Array]:
    nearest = _nearest(layout, *primals)
    value = _least_distance(layout, *primals)
    return value, jax.jvp(functools.partial(_of_nearest, layout, nearest), primals, tangents)[1]


_Nearest = list[tuple[jax.Array, jax.Array]]
"""Of the arm with itself, if it has pairs, the indices of the two capsules that are nearest; of
each group of obstacles those of the capsule and of the obstacle."""


def _nearest(layout: Layout, geometry: Geometry, q: jax.Array, shapes: Shapes) -> _Nearest:
    found: _Nearest = []

    def look(q: Lanes) -> tuple[()]:
        capsules = _capsules(geometry, q, shapes, layout)
        if layout.pairs:
            pair, least = jnp.zeros(_batch(q), int), Lane(np.inf)
            for number, distance in enumerate(_own_distances(capsules, layout)):
                pair = jnp.where(distance < least, number, pair)
                least = lanes.minimum(least, distance)
            first, second = (jnp.array(part)[pair] for part in zip(*layout.pairs))
            found.append((first, second))
        for group in _groups(shapes, layout):
            least = group.map(capsules, q, lambda distances: jnp.min(distances, axis=0))
            which = group.map(capsules, q, lambda distances: jnp.argmin(distances, axis=0))
            obstacle = jnp.argmin(least, axis=0)
            capsule = jnp.take_along_axis(which, obstacle[None], axis=0)[0]
            found.append((jnp.array(group.chosen)[capsule], obstacle))
        return ()

    on_joints(look, q, geometry.joints)
    return found


def _of_nearest(
    layout: Layout, nearest: _Nearest, geometry: Geometry, q: jax.Array, shapes: Shapes
) -> jax.Array:
    """(...,) the least of the distances of these."""

    def least(q: Lanes) -> Lane:
        capsules = _capsules(geometry, q, shapes, layout)
        rest, found = iter(nearest), Lane(np.inf)
        if layout.pairs:
            found = _between(*(_pick(capsules, index) for index in next(rest)))
        for group, (capsule, obstacle) in zip(_groups(shapes, layout), rest):
            row = lanes.unpack(group.rows[obstacle])
            distance = group.measure(_pick(capsules, capsule), row)
            found = lanes.select(distance < found, distance, found)
        return found + _nothing(q)

    return on_joints(least, q, geometry.joints)


@specialised
def all_distances(geometry: Geometry, q: jax.Array, shapes: Shapes, *, layout: Layout) -> jax.Array:
    """(..., p) the signed distances of the pairs of the arm, then of those with each obstacle."""

    def every(q: Lanes) -> tuple[Lane, ...]:
        capsules = _capsules(geometry, q, shapes, layout)
        found = _own_distances(capsules, layout)
        of_obstacle: dict[tuple[int, int], jax.Array] = {}
        for group in _groups(shapes, layout):
            distances = group.map(capsules, q, lambda distances: distances)
            of_obstacle.update(zip(group.places, distances))
        found += [Lane(x) for _, rows in sorted(of_obstacle.items()) for x in rows]
        return tuple(distance + _nothing(q) for distance in found)

    columns = on_joints(every, q, geometry.joints)
    return jnp.stack(columns, axis=-1) if columns else jnp.zeros((*q.shape[:-1], 0), q.dtype)


def _batch(q: Lanes) -> tuple[int, ...]:
    return q[0].array.shape


def _nothing(q: Lanes) -> Lane:
    """0; NaN where a joint is, though it may move no capsule of a pair."""
    return 0.0 * Lane(sum((lane.array for lane in q[1:]), q[0].array))


class _Capsule(NamedTuple):
    segment: Segment
    radius: Lane


def _capsules(geometry: Geometry, q: Lanes, shapes: Shapes, layout: Layout) -> list[_Capsule]:
    """The capsules of the arm in the space frame."""
    motions = link_motions(geometry, q)
    rest = iter(list(shapes.capsules))
    numbers = [Lane(next(rest)) if number is None else Lane(number) for number in layout.known]
    capsules = list[_Capsule]()
    for i, link in enumerate(layout.links):
        capsule = _capsule(lanes.lanes_of(numbers[_CAPSULE * i : _CAPSULE * (i + 1)]))
        if link:
            capsule = capsule._replace(segment=moved(capsule.segment, *motions[link - 1]))
        capsules.append(capsule)
    return capsules


def _capsule(numbers: Lanes) -> _Capsule:
    return _Capsule(segment(numbers[:3], numbers[3:6]), numbers[6])


def _pick(capsules: Sequence[_Capsule], index: jax.Array) -> _Capsule:
    """For each element of the batch the capsule of an index."""
    out = _numbers(capsules[0])
    for i, capsule in enumerate(capsules[1:], 1):
        out = lanes.choose(index == i, _numbers(capsule), out)
    return _from_numbers(lanes.materialised(out))


def _numbers(capsule: _Capsule) -> Lanes:
    start, vector, inverse_square = capsule.segment
    return lanes.lanes_of([*start, *vector, inverse_square, capsule.radius])


def _from_numbers(numbers: Lanes) -> _Capsule:
    return _Capsule(Segment(numbers[:3], numbers[3:6], numbers[6]), numbers[7])


def _between(first: _Capsule, second: _Capsule) -> Lane:
    apart = between_segments(first.segment, second.segment)
    return apart - (first.radius + second.radius)


def _own_distances(capsules: Sequence[_Capsule], layout: Layout) -> list[Lane]:
    return [_between(capsules[i], capsules[j]) for i, j in layout.pairs]


def _to_plane(capsule: _Capsule, row: Lanes) -> Lane:
    return to_half_space(capsule.segment, HalfSpace(row[:3], row[3])) - capsule.radius


def _to_box(capsule: _Capsule, row: Lanes) -> Lane:
    box = Box(row[:9].reshape(3, 3), row[9:12], row[12:])
    return to_box(capsule.segment, box) - capsule.radius


def _to_segment(capsule: _Capsule, row: Lanes) -> Lane:
    return _between(capsule, _capsule(row))


class _Group(NamedTuple):
    """Obstacles of one kind that the same links may touch.

    Attributes:
        measure: the distance of a capsule to an obstacle.
        rows: (k, ...) numbers of the obstacles.
        places: the kind and the number within it of each, by which they are in order.
        chosen: the indices of the capsules that they are held against.
    """

    measure: Callable[[_Capsule, Lanes], Lane]
    rows: jax.Array
    places: list[tuple[int, int]]
    chosen: list[int]

    @property
    def is_small(self) -> bool:
        """Whether all of them fit into the loop over the pairs of the arm."""
        return self.measure is not _to_box and len(self.places) <= _FEW

    def unrolled(self, capsules: Sequence[_Capsule]) -> list[Lane]:
        """The distances of each obstacle to the capsules, obstacle by obstacle."""
        rows = [lanes.unpack(self.rows[i]) for i in range(len(self.places))]
        return [self.measure(capsules[i], row) for row in rows for i in self.chosen]

    def map(
        self,
        capsules: Sequence[_Capsule],
        q: Lanes,
        function: Callable[[jax.Array], jax.Array],
    ) -> jax.Array:
        """(k, ...) a function of the (m, ...) distances of the capsules to each obstacle.

        The capsules are one array, which one small loop runs over: XLA makes slow programs of loops
        with thousands of operations, and takes long for them.
        """
        batch = _batch(q)
        chosen = np.stack([_numbers(capsules[i]) for i in self.chosen])
        stacked = _from_numbers(lanes.lanes_of([_stacked(column, batch) for column in chosen.T]))
        shape = (len(self.chosen), *batch)

        def of_one(row: jax.Array) -> jax.Array:
            distances = self.measure(stacked, lanes.unpack(row)).array
            return function(jnp.broadcast_to(distances, shape))

        return lax.map(of_one, self.rows)


def _stacked(column: Lanes, batch: tuple[int, ...]) -> Lane:
    """Lanes as one, with an axis in front of the batch's."""
    if all(np.ndim(lane.value) == 0 for lane in column):
        numbers = jnp.stack([lane.array for lane in column])
        return Lane(numbers.reshape(len(column), *[1] * len(batch)))
    return Lane(jnp.stack([jnp.broadcast_to(lane.array, batch) for lane in column]))


def _groups(shapes: Shapes, layout: Layout) -> list[_Group]:
    groups = list[_Group]()
    measures = (_to_plane, _to_box, _to_segment)
    for kind, (rows, ignored, measure) in enumerate(zip(shapes[1:], layout.ignored, measures)):
        for touching in dict.fromkeys(ignored):
            chosen = [i for i, link in enumerate(layout.links) if link not in touching]
            members = [i for i, other in enumerate(ignored) if other == touching]
            if chosen:
                places = [(kind, i) for i in members]
                groups.append(_Group(measure, rows[np.array(members)], places, chosen))
    return groups
