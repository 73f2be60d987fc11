"""What is shown, worked out from joint angles or a target: no browser, and nothing of viser."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from niryo_jax.arguments import as_data, check_finite
from niryo_jax.ik import IKSolutions, IKStatus, inverse_kinematics
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.structure.axes import joint_kinds
from niryo_jax.viewer.measures import Measures, measures_of
from niryo_jax.viewer.shape import Shape, shape_of

Vector = NDArray[np.float64]

_SAME = 1e-4
"""Radians by which a solution may differ from the joints that are shown and be the same one."""

_REACHED = 1e-5
"""Metres, and entries of a rotation, by which the tool may miss a target that it is at."""

_TRIED, _HIGH = 48, 0.25
"""Joint vectors that are looked at for the first one shown, and how high the tool is there, as a
share of the reach."""

_SIGMA = 1e-3
"""Standard deviation of each joint's error where none is given, radians (metres)."""


@dataclasses.dataclass(frozen=True)
class View:
    """What is shown of an arm and of all solutions of a target.

    Attributes:
        q: (n,) the joints of the arm as it is drawn.
        target: (4, 4) the pose that the solutions are of.
        solutions: of one pose, as numpy.
        chosen: the slot of the solution that the arm is drawn in; None where it is in none.
        measures: of n + 1 joint vectors: that of the arm, and then of each slot.
        pairs: the names of what `measures.distances` are between.
        message: what became of the target, in words.
    """

    q: Vector
    target: Vector
    solutions: IKSolutions
    chosen: int | None
    measures: Measures
    pairs: tuple[tuple[str, str], ...]
    message: str

    @property
    def found(self) -> NDArray[np.bool_]:
        """(slots,) which slots hold a solution."""
        return np.asarray(self.solutions.found)

    @property
    def within(self) -> NDArray[np.bool_]:
        """(slots,) which of them are within the joint limits."""
        return np.asarray(self.solutions.within_limits)

    @property
    def branches(self) -> NDArray[np.int64]:
        """(slots,) which branch each solution is of: its label, or its slot where it has none."""
        label = np.asarray(self.solutions.label, np.int64)
        return np.where(label >= 0, label, np.arange(len(label)))

    @property
    def complete(self) -> bool:
        """Whether it is proved that there are no other solutions."""
        return bool(self.solutions.complete)

    @property
    def reached(self) -> bool:
        """Whether the arm is drawn where it reaches the target."""
        return bool(np.allclose(self.measures.tool[0], self.target, rtol=0.0, atol=_REACHED))

    def clearance(self, row: int = 0) -> float | None:
        """The least distance of a row of `measures`, metres; None without a collision model."""
        apart = self.measures.distances[row]
        return float(np.min(apart)) if len(apart) else None

    def nearest_pair(self) -> tuple[str, str] | None:
        """What the clearance of the arm is between; None without a collision model."""
        return self.pairs[int(np.argmin(self.measures.distances[0]))] if self.pairs else None


class Session:
    """An arm, and what it was last asked for.

    Every call returns a `View`, which nothing changes later. Not for several threads at once.

    Args:
        robot: the arm, concrete.
        shape: what it looks like; `shape_of(robot)` where not given.
        covariance: (n, n) of the errors of its joints, rad^2 (m^2 for prismatic joints); errors of
            1 mrad (1 mm), independent of each other, where not given.

    Attributes:
        robot, shape: as given.
        lower, upper: (n,) the joint limits; half a turn each way, or the arm's reach, where there
            is none.
        slides: (n,) which joints are prismatic.
        start: (n,) the joints at which the arm is first shown.
        slots: how many solutions there can be.
        view: what was last shown.

    Raises:
        ValueError, TypeError: a covariance that is none; a robot that is none, or traced.
    """

    def __init__(
        self, robot: Robot, shape: Shape | None = None, covariance: ArrayLike | None = None
    ) -> None:
        check_is_robot(robot)
        self.robot = robot
        self.slides = np.array([kind == "prismatic" for kind in joint_kinds(robot.known_screws())])
        self.shape = shape_of(robot) if shape is None else shape
        bound = np.where(self.slides, self.shape.reach, math.pi)
        lower, upper = (np.asarray(x, np.float64) for x in (robot.lower, robot.upper))
        self.lower: Vector = np.where(np.isfinite(lower), lower, np.minimum(-bound, upper))
        self.upper: Vector = np.where(np.isfinite(upper), upper, np.maximum(bound, lower))
        if covariance is None:
            covariance = _SIGMA**2 * np.eye(robot.joints)
        spread = np.asarray(as_data("covariance", covariance))
        self._measure, self._pairs = measures_of(robot, self.shape, spread)
        self._size = 0
        self.start = self._start()
        self.view = self.set_joints(self.start)
        self.slots = len(self.view.found)

    def _start(self) -> Vector:
        """(n,) joints of which there is something to see: of a few that the arm can take, with the
        tool above the table, the most manipulable ones that are not the only solution."""
        rng, best = np.random.default_rng(0), (-1, 0.0)
        chosen = np.clip(np.zeros(self.robot.joints), self.lower, self.upper)
        for share in rng.uniform(0.2, 0.8, (_TRIED, self.robot.joints)):
            q = self.lower + share * (self.upper - self.lower)
            one = self._of(q[None])
            high = one.tool[0, 2, 3] > _HIGH * self.shape.reach
            solutions = self._solve(np.asarray(one.tool[0], np.float64))
            merit = int(np.sum(solutions.within_limits) > 1), float(one.manipulability[0])
            if high and np.all(one.distances[0] > 0) and merit > best:
                best, chosen = merit, q
        return chosen

    def set_joints(self, q: ArrayLike) -> View:
        """The arm at joint angles, and all solutions of the pose that it has there.

        Args:
            q: (n,) radians (metres for prismatic joints).

        Raises:
            ValueError: another shape, or numbers that are not finite.
        """
        q = self._joints(q)
        target = np.asarray(self._of(q[None]).tool[0], np.float64)
        return self._show(q, target, self._solve(target))

    def set_target(self, target: ArrayLike) -> View:
        """All solutions of a target, and the arm in the one that is nearest to where it is.

        The arm stays where it is if no solution is within its limits.

        Args:
            target: (4, 4) metres; what is no rigid motion has no solution, and the message says so.
        """
        target = np.asarray(target, np.float64)
        solutions = self._solve(target)
        q, ok = solutions.nearest(self.view.q)
        return self._show(np.asarray(q, np.float64) if ok else self.view.q, target, solutions)

    def choose(self, slot: int) -> View:
        """The arm in a solution of the target; nothing changes where the slot holds none.

        Whether the solution is within the joint limits does not matter.
        """
        view = self.view
        if not 0 <= slot < len(view.found) or not view.found[slot]:
            return view
        q = np.asarray(view.solutions.q[slot], np.float64)
        return self._show(q, view.target, view.solutions)

    def joints_of(self, q: ArrayLike) -> Measures:
        """What is known of joint vectors (n,) or (k, n), k of which is no more than the slots."""
        return self._of(np.atleast_2d(np.asarray(q, np.float64)))

    def _joints(self, q: ArrayLike) -> Vector:
        given = np.asarray(as_data("q", q), np.float64)
        if given.shape != (self.robot.joints,):
            raise ValueError(f"q: expected shape ({self.robot.joints},), got {given.shape}")
        check_finite("q", given)
        return given

    def _solve(self, target: Vector) -> IKSolutions:
        found: IKSolutions = jax.device_get(inverse_kinematics(self.robot, target))
        self._size = len(found.found) + 1
        return found

    def _of(self, q: Vector) -> Measures:
        """The measures of a few joint vectors, by the program that measures all."""
        if not self._size:
            self._solve(np.asarray(self.robot.home, np.float64))
        padded = np.concatenate([q, np.broadcast_to(q[-1:], (self._size - len(q), q.shape[1]))])
        found = self._measure(padded)
        return found._replace(
            links=found.links[: len(q)],
            tool=found.tool[: len(q)],
            distances=found.distances[: len(q)],
            manipulability=found.manipulability[: len(q)],
        )

    def _show(self, q: Vector, target: Vector, solutions: IKSolutions) -> View:
        every = np.concatenate([q[None], np.asarray(solutions.q, np.float64)])
        self.view = View(
            q,
            target,
            solutions,
            self._slot_of(q, solutions),
            self._measure(every),
            self._pairs,
            _said(solutions),
        )
        return self.view

    def _slot_of(self, q: Vector, solutions: IKSolutions) -> int | None:
        apart = np.abs(np.asarray(solutions.q) - q)
        turns = np.array(solutions.periodic) * 2 * math.pi * np.round(apart / (2 * math.pi))
        apart = np.max(np.abs(apart - turns), axis=-1)
        apart = np.where(solutions.found, apart, math.inf)
        nearest = int(np.argmin(apart))
        return nearest if apart[nearest] < _SAME else None


def _said(solutions: IKSolutions) -> str:
    """What became of a target in a line; the whole of it where nothing was found."""
    status = IKStatus(int(solutions.status))
    return status.message if solutions.count else solutions.message()
