"""The loop of an arm with six revolute joints as equations, and how they are best solved.

A line is the dual quaternion a = (0, w | 0, m), a turn about it g = cos(q/2) + sin(q/2) a. The
loop g_0 g_1 ... g_5 = +-G says that the product of two neighbours j, j+1 is what the other four
leave of the target G; it lies in the span of 1, a_j, a_(j+1) and a_j a_(j+1). Eight numbers of that
product, each linear in (cos, sin) of the half angle of each of the four others and in G: four that
vanish, whatever the two turns are, and four that are its coordinates in the span.

Letters and derivations: docs/theory/general-6r.md.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from niryo_jax.tolerances import POLYNOMIAL_NOISE

JOINTS = 6
NODES = 20
COLUMNS = 9


class Elimination(NamedTuple):
    """How the equations are solved: which joints play which part. Static.

    Attributes:
        pair: the first of the two neighbours that are eliminated linearly.
        kept: the joint whose angle is the unknown of the polynomial.
        x, y, last: the other three.
        columns: the nine columns of the elimination, the six pivots first.
    """

    pair: int
    kept: int
    x: int
    y: int
    last: int
    columns: tuple[int, ...]

    @property
    def joints(self) -> tuple[int, ...]:
        """All six in the order in which they are recovered."""
        return (self.kept, self.x, self.y, self.last, self.pair, self.pair + 1)


@dataclasses.dataclass(frozen=True)
class ByClosure:
    """That an arm has six revolute joints, or seven of which one at an end has a given value.

    Attributes:
        locked: the index of that joint, which is the first or the last; None of six joints. What is
            left is one arm whatever the value is, with another tool or another target.
    """

    locked: int | None = None
    by_arm_angle: ClassVar[bool] = False
    periodic: ClassVar[tuple[bool, ...]] = (True,) * JOINTS
    locked_turns: ClassVar[bool] = True

    def left(self, screws: Any) -> Any:
        """(6, 6) the screws of the joints that are not locked."""
        return screws if self.locked is None else screws[1:] if self.locked == 0 else screws[:-1]


class ClosureNumbers(NamedTuple):
    """An arm as one way of elimination sees it; `xp` arrays.

    Attributes:
        tensor: (8, 2, 2, 2, 2, 8): four equations and four coordinates; half angles of kept, x, y
            and last; the target.
        centre: (3,) where the origin is moved.
        size: () the length that counts as one.
        order: (6,) the place in `Elimination.joints` of each joint.
        columns: (9,) the columns of the elimination; places: (9,) where each of the nine went.
    """

    tensor: Any
    centre: Any
    size: Any
    order: Any
    columns: Any
    places: Any


def quaternion_product(a: Any, b: Any, xp: Any = np) -> Any:
    """Of (..., 4), the real part first."""
    s, t = a[..., :1], b[..., :1]
    u, v = a[..., 1:], b[..., 1:]
    real = s * t - xp.sum(u * v, axis=-1, keepdims=True)
    return xp.concatenate([real, s * v + t * u + xp.cross(u, v)], axis=-1)


def dual_product(a: Any, b: Any, xp: Any = np) -> Any:
    """Of dual quaternions (..., 8), the real parts first."""
    real = quaternion_product(a[..., :4], b[..., :4], xp)
    dual = quaternion_product(a[..., :4], b[..., 4:], xp)
    dual = dual + quaternion_product(a[..., 4:], b[..., :4], xp)
    return xp.concatenate([real, dual], axis=-1)


def centre_and_size(screws: Any, xp: Any = np) -> tuple[Any, Any]:
    """The point nearest to all axes (6, 6), and the distance of the farthest of them."""
    w, m = screws[:, :3], screws[:, 3:]
    points = xp.cross(w, m)
    # |w x (p - c)|^2 summed over the axes is least.
    across = xp.eye(3) - w[:, :, None] * w[:, None, :]
    normal = xp.sum(across, axis=0)
    centre = xp.linalg.pinv(normal) @ xp.sum(points, axis=0)
    away = xp.einsum("nij,nj->ni", across, points - centre)
    size = xp.sqrt(xp.max(xp.sum(away * away, axis=1)))
    return centre, xp.where(size > 0, size, 1.0)


def _lines(screws: Any, centre: Any, size: Any, xp: Any = np) -> Any:
    """(6, 8) the axes as dual quaternions, about a centre and in lengths of a size."""
    w, m = screws[:, :3], screws[:, 3:]
    m = (m - xp.cross(centre, w)) / size
    zero = xp.zeros((JOINTS, 1))
    return xp.concatenate([zero, w, zero, m], axis=1)


def numbers_of_ways(screws: Any, ways: Sequence[Elimination], xp: Any = np) -> Any:
    """(ways, k) the numbers of an arm, from unit screws (6, 6) of revolute joints."""
    return xp.stack([flattened(closure_numbers(screws, way, xp), xp) for way in ways])


def closure_numbers(screws: Any, way: Elimination, xp: Any = np) -> ClosureNumbers:
    """The numbers of an arm, from unit screws (6, 6) of revolute joints."""
    centre, size = centre_and_size(screws, xp)
    lines = _lines(screws, centre, size, xp)
    one = xp.eye(8)
    j = way.pair
    product = dual_product(lines[j], lines[j + 1], xp)
    span = xp.stack([one[0], lines[j], lines[j + 1], product], axis=1)
    basis = xp.linalg.svd(span)[0]
    rows = xp.concatenate([basis[:, 4:].T, xp.linalg.pinv(span)])
    tensor = rows
    # x -> x conj(g) for the joints behind the pair, conj(g) x for those before it; the last first.
    joints = [*range(j - 1, -1, -1), *range(j + 2, JOINTS)]
    for i in joints:
        table = one[:, None], lines[i][None, None]
        left, right = (table[1], table[0]) if i < j else table
        turned = -dual_product(*xp.broadcast_arrays(left, right), xp=xp)[:, 0]
        tensor = xp.stack([tensor, tensor @ turned.T], axis=-2)
    axes = [1 + joints.index(i) for i in (way.kept, way.x, way.y, way.last)]
    tensor = xp.transpose(tensor, (0, *axes, 5))
    order = [way.joints.index(i) for i in range(JOINTS)]
    places = np.argsort(way.columns)
    return ClosureNumbers(tensor, centre, size, np.array(order), np.array(way.columns), places)


def flattened(numbers: ClosureNumbers, xp: Any = np) -> Any:
    """All of them in a row."""
    return xp.concatenate([xp.reshape(xp.asarray(part, float), (-1,)) for part in numbers])


_LENGTHS = 8 * 16 * 8, 3, 1, JOINTS, COLUMNS, COLUMNS


def unflattened(row: Any) -> ClosureNumbers:
    """The numbers of a row (FLAT,)."""
    ends = np.cumsum(_LENGTHS)
    tensor, centre, size, *whole = (row[end - n : end] for n, end in zip(_LENGTHS, ends))
    places = (part.astype(np.int32) for part in whole)
    return ClosureNumbers(tensor.reshape(8, 2, 2, 2, 2, 8), centre, size[0], *places)


def _neighbours(pair: int) -> Iterator[tuple[int, int, int, int]]:
    """(kept, x, y, last): the kept joint is a neighbour of the pair in the loop, for then the
    determinant is a trigonometric polynomial of degree 8; otherwise 12."""
    loop = [(pair + 2 + k) % JOINTS for k in range(4)]
    for kept, rest in ((loop[0], loop[1:]), (loop[-1], loop[-2::-1])):
        for last in rest:
            x, y = (i for i in rest if i != last)
            yield kept, x, y, last


def eliminations(screws: np.ndarray) -> tuple[Elimination, ...]:
    """The ways that suit an arm best, from its screws (6, 6); the best first.

    Judged at poses that the arm takes: by how much of the polynomial is lost in its noise, and by
    how well six columns can be eliminated.
    """
    return _eliminations(np.asarray(screws, float).tobytes())


@functools.lru_cache(maxsize=64)
def _eliminations(numbers: bytes) -> tuple[Elimination, ...]:
    screws = np.frombuffer(numbers).reshape(JOINTS, 6)
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (_SAMPLES, JOINTS))
    goals = _goals(screws, q)
    judged = list[_Judged]()
    for pair in range(JOINTS - 1):
        for kept, x, y, last in _neighbours(pair):
            way = Elimination(pair, kept, x, y, last, tuple(range(COLUMNS)))
            equations = _minors(closure_numbers(screws, way), goals)
            judged.append((_doubt(equations, q[:, kept]), way, equations))
    judged.sort(key=lambda item: item[0])
    # Another kept joint is another polynomial, another order of the rest only another rounding; but
    # one of which nothing is left proves nothing.
    kept = set[tuple[int, int]]()
    first, second = list[_Judged](), list[_Judged]()
    for item in judged:
        way = item[1]
        is_new = (way.pair, way.kept) not in kept and item[0] < _HOPELESS
        (first if is_new else second).append(item)
        kept.add((way.pair, way.kept))
    chosen = [*first, *second][:_WAYS]
    return tuple(way._replace(columns=_columns(equations)) for _, way, equations in chosen)


_Judged = tuple[float, Elimination, np.ndarray]

_HOPELESS = 0.3
_SAMPLES = 24
_WAYS = 3

FOR_ANY = tuple(
    Elimination(pair, *next(_neighbours(pair)), (0, 1, 2, 3, 4, 8, 5, 6, 7))
    for pair in (3, 0, 4, 1)
)
"""Ways for an arm whose numbers are not known while tracing."""


def _goals(screws: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(samples, 8) the motions from home to the poses of joint vectors (samples, 6)."""
    one = np.eye(8)[0]
    goal = np.broadcast_to(one, (len(q), 8))
    for line, angle in zip(_lines(screws, *centre_and_size(screws)), q.T[..., None] / 2):
        goal = dual_product(goal, np.cos(angle) * one + np.sin(angle) * line)
    return goal


def _minors(numbers: ClosureNumbers, goals: np.ndarray) -> np.ndarray:
    """(samples, 6, 3, 3, 3): six equations, linear in (1, cos, sin) of kept, x and y."""
    f = np.einsum("rkxyeg,sg->srkxye", numbers.tensor[:4], goals)
    a, b = f[..., 0], f[..., 1]
    i, j = np.triu_indices(4, 1)
    products = np.einsum("smkxy,smlzw->smklxzyw", a[:, i], b[:, j])
    products -= np.einsum("smkxy,smlzw->smklxzyw", a[:, j], b[:, i])
    out = np.einsum("smklxzyw,klK,xzX,ywY->smKXY", products, *[HALVES] * 3, optimize=True)
    return out / np.sqrt(np.sum(out**2, axis=(1, 2, 3, 4), keepdims=True))


HALVES = np.zeros((2, 2, 3))
"""Products of (cos, sin) of the half angle in terms of (1, cos, sin) of the angle."""
HALVES[0, 0], HALVES[1, 1] = (0.5, 0.5, 0.0), (0.5, -0.5, 0.0)
HALVES[0, 1] = HALVES[1, 0] = (0.0, 0.0, 0.5)


def _at_nodes(equations: np.ndarray, nodes: int) -> np.ndarray:
    """(samples, nodes, 6, 3, 3): the equations at equidistant angles of the kept joint."""
    t = 2 * np.pi * np.arange(nodes) / nodes
    basis = np.stack([np.ones_like(t), np.cos(t), np.sin(t)], axis=-1)
    return np.einsum("nk,smkxy->snmxy", basis, equations)


def _doubt(equations: np.ndarray, angle: np.ndarray) -> float:
    """How much of the circle is lost in the noise of the polynomial, near the known angle or
    anywhere: between 0 and 1, the mean over all poses."""
    at = _at_nodes(equations, NODES)
    constant, cosine, sine = (at[..., i, :] for i in range(3))
    upper = [constant + cosine / 2, sine / 2, cosine / 2, sine / 2]
    lower = [sine / 2, constant - cosine / 2, -sine / 2, cosine / 2]
    matrix = np.concatenate([np.concatenate(part, axis=-1) for part in (upper, lower)], axis=-2)
    values = np.linalg.det(matrix)
    largest = np.max(np.abs(values), axis=1, keepdims=True)
    values = values / np.where(largest > 0, largest, 1.0)
    c = np.fft.fft(values, axis=1)[:, : NODES // 2 + 1] / NODES
    k = np.arange(9)
    wave = c[:, :9] * np.exp(1j * k * angle[:, None]) * np.where(k, 2.0, 1.0)
    slope = np.sum((1j * k * wave).real, axis=1)
    noise = np.maximum(np.max(np.abs(c[:, 9:]), axis=1), 1e-15)
    margin = POLYNOMIAL_NOISE * noise
    lost = np.mean(np.abs(values) < margin[:, None], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.nan_to_num(margin / np.abs(slope), nan=np.inf)
    return float(np.mean(np.minimum(width + lost, 1.0)))


def _columns(equations: np.ndarray) -> tuple[int, ...]:
    """The nine columns, first the six that are best independent of each other everywhere."""
    at = _at_nodes(equations[:12], 5).reshape(-1, 6, COLUMNS)
    choices = list(itertools.combinations(range(COLUMNS), 6))
    values = np.linalg.svd(np.stack([at[..., list(c)] for c in choices]), compute_uv=False)
    worst = np.quantile(values[..., -1] / values[..., 0], 0.05, axis=1)
    pivots = choices[int(np.argmax(worst))]
    return (*pivots, *(i for i in range(COLUMNS) if i not in pivots))
