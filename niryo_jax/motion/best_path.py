"""The best continuous path of joint vectors through poses, of all that there are."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import check_choice, check_fits, check_number, shown
from niryo_jax.chain import forward_kinematics
from niryo_jax.collision import CollisionModel, World
from niryo_jax.collision.world import check_is_world
from niryo_jax.execution.padding import program_size
from niryo_jax.ik.paths.words import beyond_limits, too_far
from niryo_jax.ik.results.limits import without_whole_turns
from niryo_jax.ik.task import task_of
from niryo_jax.lanes.batching import as_floating
from niryo_jax.motion.ladder import (
    Prices,
    Rungs,
    Turns,
    Way,
    cheapest,
    lowest_copies,
    turns_of,
)
from niryo_jax.motion.rungs import Candidates, Obstacles, PathCost, candidates
from niryo_jax.robot import Robot, check_is_robot

_ROUNDS = 16
_STRAY = 0.5
_LENGTH = 0.1
_PLENTY = 1e6
_SAME = 1e-6
_REST = 1e-5
_PREFERENCE = 1e-9


@dataclasses.dataclass(frozen=True)
class BestPath:
    """Joint vectors along paths of poses.

    Attributes:
        q: (..., k, n) radians (metres); where there is no path, the one that gets farthest, and its
            last joint vector from there on.
        ok: (...,) whether it does all samples without a jump.
        reached: (...,) how many samples it does.
        cost: (...,) what `PathCost` makes of it; infinite where not `ok`.
        returns: (...,) whether the joint vector at the end is the one at the start, whole turns
            included. Where a closed path of the tool does not return, it changes the branch or
            winds a joint.
        proved: (...,) whether the solutions of every sample are known to be all, so that where not
            `ok` there is no such path at these samples.
        message: of one path, whether it goes all the way, or where the best of all branches ends
            and why; of many, how many go.
    """

    q: np.ndarray
    ok: np.ndarray
    reached: np.ndarray
    cost: np.ndarray
    returns: np.ndarray
    proved: np.ndarray
    message: str


def best_path(
    robot: Robot,
    poses: ArrayLike,
    *,
    q_start: ArrayLike | None = None,
    closed: bool = False,
    largest_step: float = 0.5,
    cost: PathCost | None = None,
    collision: CollisionModel | None = None,
    world: World | None = None,
    margin: float = 0.0,
    task: str = "pose",
    tool_axis: ArrayLike | Sequence[float] = (0.0, 0.0, 1.0),
    values: int = 32,
) -> BestPath:
    """The best path of joint vectors that takes poses one after the other, without a jump.

    All solutions of all samples are found; of all ways through them, whole turns included, the
    cheapest is taken (dynamic programming). Unlike `follow`, which goes along the branch that
    begins near a joint vector, it looks at every branch, and at the end of a path before it begins:
    a line that one branch cannot finish is done on another. Of arms of up to six joints the
    solutions are complete, and so is what is said where there is no path (`BestPath.proved`); the
    ways to spend a seventh joint, and turns of the tool, are sampled.

    A step is none where a joint would move by more than `largest_step`, or where the tool, joints
    half-way between, strays from the middle between the two samples by more than half of what is
    between them: so two branches that are near each other are not taken for one.

    Args:
        robot: an arm of up to six joints, or of seven of which one can be locked.
        poses: (..., k, 4, 4) targets in the space frame, metres, in the order of the path.
        q_start: (..., n) where the arm is before the first sample: the way from there, as one step
            of any size, is part of the cost.
        closed: whether the last joint vector must be the first, whole turns included.
        largest_step: no joint moves by more than this from sample to sample, radians (metres).
        cost: what makes a path dear; the squares of joint steps where not given.
        collision: the shape of the arm; with it, joint vectors that collide are not taken. Between
            samples nothing is looked at.
        world: what stands around it.
        margin: metres that are kept to all that is not to be touched.
        task: "pose", or "direction": the position and `tool_axis`, about which the tool may turn.
        tool_axis: (3,) tool frame.
        values: how many turns about the axis, or ways to spend a seventh joint, are looked at.

    Returns:
        A `BestPath`. Nothing is raised where there is no path: `ok` and `message` tell.

    Raises:
        ValueError: a wrong shape, fewer samples than two, numbers that are not finite in q_start, a
            step not in (0, pi], a negative cost, an unknown task, an arm that the method does not
            fit, a world or a margin without a model.
        TypeError: traced arrays: what is found depends on their values; arguments of other kinds.
    """
    check_is_robot(robot)
    poses = as_floating("poses", poses)
    if poses.ndim < 3 or poses.shape[-2:] != (4, 4) or poses.shape[-3] < 2:
        raise ValueError(f"poses: expected shape (..., k, 4, 4) with k >= 2, got {poses.shape}")
    check_choice("task", task, ("pose", "direction"))
    axis = _axis(task, tool_axis)
    check_number("largest_step", largest_step, "radians in (0, pi]", lambda x: 0 < x <= math.pi)
    cost = _checked_cost(PathCost() if cost is None else cost, robot)
    obstacles = _obstacles(collision, world, margin, cost)
    values = check_fits("values", values, 2, 4096)
    if robot.joints != 6 and robot.spare is None and not robot.plans:
        raise ValueError(
            "best_path needs an arm whose solutions are known to be all: one that a closed form "
            "solves, six revolute joints, or seven of which one can be locked; "
            f"{robot.name} is none"
        )
    if not is_concrete(poses, *jax.tree.leaves(robot)):
        raise TypeError(
            "best_path: expected concrete arrays, got traced ones; call it outside jax.jit"
        )
    batch, (count, n) = poses.shape[:-3], (poses.shape[-3], robot.joints)
    start = _start(q_start, batch, n)
    flat = poses.reshape(-1, count, 4, 4)
    given = candidates(robot, flat, cost, obstacles, axis, values)
    turns = turns_of(robot, given.solutions.periodic)
    ladder = _Ladder(robot, turns, flat, given, _prices(robot, cost, largest_step, flat.dtype))
    rungs = ladder.rungs(start)
    way = ladder.closed(rungs) if closed else ladder.cheapest(rungs)
    q = _unwound(np.asarray(way.q), turns)
    ok = np.isfinite(np.asarray(way.cost))
    proved = np.all(np.asarray(given.solutions.complete.reshape(len(flat), -1)), axis=1)
    proved = proved & (robot.spare is None) & (axis is None)
    returns = ok & np.all(np.abs(q[:, 0] - q[:, -1]) < _SAME, axis=-1)
    return BestPath(
        q=q.reshape(*batch, count, n),
        ok=ok.reshape(batch),
        reached=np.asarray(way.reached).reshape(batch),
        cost=np.asarray(way.cost).reshape(batch),
        returns=returns.reshape(batch),
        proved=proved.reshape(batch),
        message=_of_many(ok) if batch else ladder.message(way, q[0], largest_step),
    )


class _Ladder(NamedTuple):
    """The candidates of paths, and what is asked of a way through them."""

    robot: Robot
    turns: Turns
    poses: jax.Array
    given: Candidates
    prices: Prices

    def rungs(self, start: np.ndarray | None) -> Rungs:
        """The rungs of all paths, from joint vectors (paths, n)."""
        q, dtype, prices = self.given.q, self.given.q.dtype, self.prices
        paths, count, m, _ = q.shape
        low = lowest_copies(q, prices.lower, self.turns)
        offsets = 2 * np.pi * self.turns.digits * np.array(self.turns.periodic)
        copies = low[:, 0, :, None] + jnp.asarray(offsets, dtype)
        # Where nothing else tells whole turns apart, those near the middle of the range.
        middle = 0.5 * (prices.lower + prices.upper)
        off = copies - jnp.where(jnp.isfinite(middle), middle, 0.0)
        first = _PREFERENCE * jnp.sum(off * off, axis=-1)
        if start is not None:
            away = copies - jnp.asarray(start, dtype)[:, None, None]
            free = np.array([count == 0 for count in self.turns.copies])
            away = jnp.where(free, without_whole_turns(away, self.turns.periodic), away)
            first = first + jnp.sum(prices.travel * away * away, axis=-1)
        barred = jnp.zeros((paths, count - 1, m, m), bool)
        usable = self.given.possible & self.given.clear
        return Rungs(low, usable, self.given.price, barred, first, jnp.zeros_like(first))

    def cheapest(self, rungs: Rungs) -> Way:
        """The cheapest way that takes no step on which the tool strays."""
        way = cheapest(rungs, self.prices, self.turns)
        for _ in range(_ROUNDS):
            strays = self._strays(way)
            rows = np.nonzero(strays.any(axis=1))[0]
            if not len(rows):
                return way
            path, step = np.nonzero(strays)
            place = np.asarray(way.place)
            barred = rungs.barred.at[path, step, place[path, step + 1], place[path, step]].set(True)
            rungs = rungs._replace(barred=barred)
            few = np.resize(rows, program_size(len(rows)))
            again = cheapest(Rungs(*(x[few] for x in rungs)), self.prices, self.turns)
            way = Way(*(x.at[rows].set(y[: len(rows)]) for x, y in zip(way, again)))
        # What strays after so many rounds is cut where it does.
        strays = self._strays(way)
        lost = jnp.asarray(strays.any(axis=1))
        cut = jnp.where(lost, jnp.asarray(strays.argmax(axis=1)) + 1, way.reached)
        rung = jnp.minimum(jnp.arange(way.q.shape[1]), jnp.maximum(cut, 1)[:, None] - 1)
        q = jnp.take_along_axis(way.q, rung[..., None], axis=1)
        return Way(q, way.place, cut, jnp.where(lost, jnp.inf, way.cost))

    def closed(self, rungs: Rungs) -> Way:
        """The cheapest of the ways that end where they begin, of each place to begin."""
        best: Way | None = None
        m, copies = rungs.first.shape[1:]
        usable = np.asarray(jnp.any(rungs.usable[:, 0], axis=0))
        for number in np.nonzero(np.repeat(usable, copies))[0].tolist():
            only = jnp.full(m * copies, jnp.inf).at[number].set(0.0).reshape(m, copies)
            way = self.cheapest(self._ending_alike(rungs, only))
            if best is None:
                best = way
                continue
            better = (way.cost < best.cost) | (
                jnp.isinf(best.cost) & jnp.isinf(way.cost) & (way.reached > best.reached)
            )
            best = Way(
                *(
                    jnp.where(better.reshape(-1, *[1] * (x.ndim - 1)), x, y)
                    for x, y in zip(way, best)
                )
            )
        return self.cheapest(rungs) if best is None else best

    def _ending_alike(self, rungs: Rungs, only: jax.Array) -> Rungs:
        """Ways that begin at one place of the first rung, and end at the joint vector it is."""
        number = int(jnp.argmin(only.reshape(-1)))
        copies = only.shape[1]
        place, copy = number // copies, number % copies
        away = rungs.q[:, -1] - rungs.q[:, 0, place, None]
        same = jnp.all(jnp.abs(without_whole_turns(away, self.turns.periodic)) < _SAME, axis=-1)
        whole = jnp.round((rungs.q[:, 0, place, None] - rungs.q[:, -1]) / (2 * np.pi))
        digit = self.turns.digits[copy] + whole.astype(jnp.int32)
        its = jnp.all(
            (digit[:, :, None] == self.turns.digits) | (np.array(self.turns.copies) == 0), axis=-1
        )
        last = jnp.where(same[..., None] & its, 0.0, jnp.inf)
        return rungs._replace(first=rungs.first + only, last=last)

    def _strays(self, way: Way) -> np.ndarray:
        """(paths, k - 1) on which steps the tool strays, of those that are taken."""
        at = forward_kinematics(self.robot, _with_middles(way.q, self.turns.periodic))
        return np.asarray(_are_astray(at, way.reached))

    def message(self, way: Way, q: np.ndarray, largest_step: float) -> str:
        """What became of a single path."""
        count = self.poses.shape[1]
        if np.isfinite(way.cost[0]):
            travel = np.max(np.sum(np.abs(np.diff(q, axis=0)), axis=0))
            return (
                f"The whole path is done, all {count} samples; no joint moves by more than "
                f"{np.max(np.abs(np.diff(q, axis=0))):.3f} rad a step and {travel:.3f} rad in all."
            )
        end = int(way.reached[0])
        if end == count:
            return "No branch that goes all the way ends at the joint vector it began with."
        begin = "" if end else "no branch begins: "
        words = f"{begin}{self._reason(end, q[max(end - 1, 0)], largest_step)}"
        if end:
            words = (
                f"of all branches the longest ends before sample {end} of 0 to {count - 1}: {words}"
            )
        return f"{words[0].upper()}{words[1:]}"

    def _reason(self, at: int, before: np.ndarray, largest_step: float) -> str:
        """Why no joint vector of a sample goes on from one before it."""
        answer = self.given.solutions.map(lambda x: x[0, at])
        found = np.asarray(answer.found).reshape(-1)
        if not found.any():
            return answer.message((0,) * answer.status.ndim)
        possible, clear = (np.asarray(x)[0, at] for x in (self.given.possible, self.given.clear))
        if possible.any() and not (possible & clear).any():
            return "every solution within the joint limits collides."
        if at == 0:
            return "no solution is within the joint limits."
        change = jnp.asarray(answer.q).reshape(len(found), -1) - before
        change = np.asarray(without_whole_turns(change, self.turns.periodic))
        away = np.where(found, np.abs(change).max(axis=-1), np.inf)
        nearest = int(np.argmin(away))
        if away[nearest] > largest_step:
            return too_far(self.robot, change[nearest], at, largest_step)
        beyond = beyond_limits(self.robot, before + change[nearest])
        return beyond or "the arm would collide, or take another branch between the samples."


@functools.partial(jax.jit, static_argnums=1)
def _with_middles(q: jax.Array, periodic: tuple[bool, ...]) -> jax.Array:
    """(paths, 2 k - 1, n) the joint vectors of paths, and behind them those half-way between."""
    change = without_whole_turns(q[:, 1:] - q[:, :-1], periodic)
    return jnp.concatenate([q, q[:, :-1] + 0.5 * change], axis=1)


@jax.jit
def _are_astray(at: jax.Array, reached: jax.Array) -> jax.Array:
    """(paths, k - 1) of steps, from the poses of `_with_middles` and how many samples are done."""
    count = (at.shape[1] + 1) // 2
    before, after, middle = at[:, : count - 1], at[:, 1:count], at[:, count:]
    between = _apart(before, after)
    # Twice the distance from either end to the middle is the whole way, unless it is no way.
    off = jnp.maximum(_apart(before, middle), _apart(middle, after)) - 0.5 * between
    taken = jnp.arange(1, count) < reached[:, None]
    return taken & (off > _STRAY * between + _REST)


def _apart(a: jax.Array, b: jax.Array) -> jax.Array:
    """Metres between poses (..., 4, 4), a radian counting as a tenth."""
    moved = jnp.linalg.norm(a[..., :3, 3] - b[..., :3, 3], axis=-1)
    # The chord is no longer than the turn, and within a tenth of it up to a right angle.
    turned = jnp.linalg.norm(a[..., :3, :3] - b[..., :3, :3], axis=(-2, -1)) / math.sqrt(2)
    return moved + _LENGTH * turned


def _unwound(q: np.ndarray, turns: Turns) -> np.ndarray:
    """Paths (paths, k, n) whose joints without limits go on beyond a turn."""
    free = [i for i, copies in enumerate(turns.copies) if copies == 0]
    out = q.copy()
    out[..., free] = np.unwrap(q[..., free], axis=1)
    return out


def _of_many(ok: np.ndarray) -> str:
    return f"{int(ok.sum())} of {ok.size} paths are done, all samples without a jump."


def _axis(task: str, tool_axis: Any) -> np.ndarray | None:
    axis = np.asarray(task_of("direction", tool_axis).axis, float)
    return None if task == "pose" else axis


def _start(q_start: ArrayLike | None, batch: tuple[int, ...], n: int) -> np.ndarray | None:
    if q_start is None:
        return None
    start = np.asarray(as_floating("q_start", q_start))
    if start.shape[-1:] != (n,) or np.broadcast_shapes(start.shape[:-1], batch) != batch:
        raise ValueError(f"q_start: expected shape {(*batch, n)} or {(n,)}, got {start.shape}")
    if not np.all(np.isfinite(start)):
        raise ValueError(f"q_start: expected finite numbers, got {start}")
    return np.broadcast_to(start, (*batch, n)).reshape(-1, n)


def _checked_cost(cost: Any, robot: Robot) -> PathCost:
    if not isinstance(cost, PathCost):
        raise TypeError(f"cost: expected a PathCost, got {shown(cost)}")
    travel = np.asarray(cost.travel, float)
    if (
        travel.shape not in ((), (robot.joints,))
        or not np.all(travel >= 0)
        or np.any(travel > _PLENTY)
    ):
        raise ValueError(
            f"cost.travel: expected a number of 0 to {_PLENTY:g}, or {robot.joints} of them, "
            f"got {shown(cost.travel)}"
        )
    for name in ("limits", "sensitivity", "clearance"):
        check_number(f"cost.{name}", getattr(cost, name), "0 or more", lambda x: 0 <= x < math.inf)
    check_number(
        "cost.comfort", cost.comfort, "a positive number of metres", lambda x: 0 < x < math.inf
    )
    return cost


def _obstacles(
    model: CollisionModel | None, world: World | None, margin: float, cost: PathCost
) -> Obstacles | None:
    check_is_world(world)
    check_number("margin", margin, "a finite number of metres", math.isfinite)
    if model is None:
        asked = world is not None or margin != 0 or cost.clearance != 0
        if asked:
            raise ValueError(
                "collision: expected the shape of the arm where a world, a margin or a price of "
                "clearance is given, got None"
            )
        return None
    if not isinstance(model, CollisionModel):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(f"collision: expected a CollisionModel, got {shown(model)}")
    return Obstacles(model, world, margin)


def _prices(robot: Robot, cost: PathCost, largest_step: float, dtype: Any) -> Prices:
    travel = np.broadcast_to(np.asarray(cost.travel, float), (robot.joints,))
    numbers = travel, cost.limits, largest_step, robot.lower, robot.upper
    return Prices(*(np.asarray(x, dtype) for x in numbers))
