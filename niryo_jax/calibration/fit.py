"""`fit`: an arm from what was measured of it, and how sure that is."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from jax.typing import ArrayLike

from niryo_jax.arguments import check_choice, check_number
from niryo_jax.calibration import motions
from niryo_jax.calibration.identifiability import Identifiability, identifiability
from niryo_jax.calibration.least_squares import Fit, least_squares
from niryo_jax.calibration.loss import Loss
from niryo_jax.calibration.measurements import (
    ROWS,
    Measurements,
    alignment,
    linearised,
    measurements_of,
)
from niryo_jax.calibration.parameters import MINIMAL, Parameters, arm_of, parameters_of
from niryo_jax.robot import Robot, check_is_robot

Redundant = Literal["refuse", "hold"]

_DOUBTED = 0.25


@dataclasses.dataclass(frozen=True)
class Residuals:
    """What is left: root mean squares, metres and radians, of measurements that count.

    Radians are nan where no rotation was measured.
    """

    metres: float
    radians: float

    def __str__(self) -> str:
        turned = "" if np.isnan(self.radians) else f", {self.radians * 1e3:.3g} mrad"
        return f"{self.metres * 1e3:.3g} mm{turned}"


@dataclasses.dataclass(frozen=True)
class Calibration:
    """An arm as measurements say that it is.

    Attributes:
        robot: the fitted arm, for every function of the package. Joint offsets are part of it; it
            takes joint values as the joints turn, see `turned`.
        names: (m,) the parameters that were estimated.
        values: (m,) what they are, radians and metres (gears: shares).
        covariance: (m, m) of these values, for measurements as uncertain as the residuals say.
        identifiable: (m,) whether the measurements tell each of them.
        combinations: in words, what they cannot tell, and so was held.
        rank, condition: of the Jacobian, its columns of unit length.
        offsets, gears: (n,) of the joints, zeros where not estimated.
        before, after: what the nominal and the fitted arm leave.
        held_out: what an arm that was fitted to the others leaves of every k-th measurement; None
            where none was held out.
        weights: (N,) how much each measurement counted, from 0 to 1.
        scale: the standard deviations seen over those given.
        settled: whether the last step changed nothing.
    """

    robot: Robot
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    identifiable: np.ndarray
    combinations: tuple[str, ...]
    rank: int
    condition: float
    offsets: np.ndarray
    gears: np.ndarray
    before: Residuals
    after: Residuals
    held_out: Residuals | None
    weights: np.ndarray
    scale: float
    settled: bool

    @property
    def deviations(self) -> np.ndarray:
        """(m,) the standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def doubted(self) -> np.ndarray:
        """The numbers of the measurements that a robust loss hardly believes."""
        return np.nonzero(self.weights < _DOUBTED)[0]

    def turned(self, q: ArrayLike) -> np.ndarray:
        """(..., n) what `robot` takes when the joints are told to be at q: q times its gears."""
        return np.asarray(q) * (1.0 + self.gears)

    def told(self, q: ArrayLike) -> np.ndarray:
        """(..., n) what to tell the joints so that `robot` is at q; the inverse of `turned`."""
        return np.asarray(q) / (1.0 + self.gears)

    @property
    def message(self) -> str:
        """The fit in a few sentences."""
        lines = [
            f"{len(self.names)} parameters of {self.robot.name} from {len(self.weights)} "
            f"measurements: {self.before} before, {self.after} after (root mean square)."
        ]
        if self.held_out is not None:
            lines.append(f"Measurements that were held out: {self.held_out}.")
        if not self.settled:
            lines.append("The last step still changed something: more measurements may help.")
        if len(self.doubted):
            some = ", ".join(map(str, self.doubted[:12])) + ", ..." * (len(self.doubted) > 12)
            lines.append(f"{len(self.doubted)} measurements are not believed: number {some}.")
        if self.combinations:
            lines.append(
                "Not told by these measurements, and held: " + "; ".join(self.combinations)
            )
        lines.append(f"Rank {self.rank}, condition {self.condition:.3g}.")
        return "\n".join(lines)


def fit(
    robot: Robot,
    q: ArrayLike,
    measured: ArrayLike,
    parameters: Sequence[str] = MINIMAL,
    *,
    loss: Loss = "linear",
    sigma: tuple[float, float] = (1e-3, 1e-3),
    origin: ArrayLike | None = None,
    hold: Sequence[str] = (),
    redundant: Redundant = "refuse",
    held_out: float = 0.2,
) -> Calibration:
    """Estimate what an arm is from joint values and what was measured there.

    Args:
        robot: the nominal arm, concrete.
        q: (N, n) what the joints were told, radians (metres of slides).
        measured: what was measured of the tool, in the space frame: (N, 4, 4) poses, (N, 3)
            positions, or (N,) distances from `origin`; metres.
        parameters: what is estimated: some of "screws" (four of each joint that turns, two of one
            that slides), "home" (or "tool": six), "offsets", "gears", "base" (six). The first two
            say all that poses tell of an arm without gear errors; offsets and base are combinations
            of these. With "base" the fit begins where the nominal tool is nearest to the measured
            places, so that the frame of the instrument need not be known.
        loss: "linear" for least squares; "huber" or "tukey" where some measurements are wrong.
        sigma: standard deviations of what was measured, metres and radians. Their ratio matters to
            the fit of poses; the covariance goes by the residuals.
        origin: (3,) where distances are measured from, space frame; its origin if not given.
        hold: names of single parameters that are not estimated.
        redundant: "refuse" to estimate parameters that these measurements cannot tell apart; or
            "hold" combinations of them, of which the sum of squares, each in units of what it does
            to the measurements, stays least.
        held_out: the share of measurements that a first fit does without, to be tried on; 0 for
            none. The fit that is returned is of all.

    Returns:
        A `Calibration`.

    Raises:
        ValueError: wrong shapes, numbers that are not finite, degrees or millimetres, fewer
            measured numbers than parameters, parameters that cannot be told (by name).
        TypeError: a traced robot, arguments that are none.
    """
    check_is_robot(robot)
    check_choice("loss", loss, get_args(Loss))
    check_choice("redundant", redundant, get_args(Redundant))
    share = check_number("held_out", held_out, "0 to 0.5", lambda x: 0.0 <= x <= 0.5)
    chosen = parameters_of(robot, parameters, hold)
    found = measurements_of(robot, q, measured, origin, sigma)
    count = len(found.q) * ROWS[found.kind]
    if count < len(chosen.free):
        raise ValueError(
            f"q, measured: expected at least {len(chosen.free)} measured numbers for as many "
            f"parameters, got {count} of {len(found.q)} {found.kind}s"
        )
    start = robot
    if "base" in chosen.sets:
        base = alignment(robot, found)
        screws = np.asarray(robot.screws) @ motions.adjoint(base).T
        start = dataclasses.replace(robot, screws=screws, home=base @ np.asarray(robot.home))
    best = least_squares(start, chosen, found, loss)
    told = _told(best, chosen.free_names)
    if redundant == "refuse" and told.combinations:
        raise ValueError(
            "parameters: these measurements cannot tell them apart; hold one of each of these, or "
            f"ask for redundant='hold': {'; '.join(told.combinations)}"
        )
    changes = chosen.changes(start, best.x)
    nothing = linearised(robot, chosen, found, np.zeros(len(chosen.free)))[0]
    return Calibration(
        robot=arm_of(robot, changes),
        names=chosen.free_names,
        values=best.x,
        covariance=_covariance(best),
        identifiable=told.identifiable,
        combinations=told.combinations,
        rank=told.rank,
        condition=told.condition,
        offsets=changes.offsets,
        gears=changes.gears,
        before=_left(nothing, best.weights, found),
        after=_left(best.residuals, best.weights, found),
        held_out=_tried(start, chosen, found, loss, share),
        weights=best.weights,
        scale=best.scale,
        settled=best.settled,
    )


def _weighted(best: Fit) -> np.ndarray:
    """(rows, m) the Jacobian of what counts."""
    count = np.sqrt(best.weights)[:, None, None]
    return (best.jacobian * count).reshape(-1, len(best.x))


def _told(best: Fit, names: tuple[str, ...]) -> Identifiability:
    return identifiability(_weighted(best), names)


def _covariance(best: Fit) -> np.ndarray:
    """sigma^2 (J^T W J)^-1, of what can be told."""
    jacobian = _weighted(best)
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    inverse = np.linalg.pinv(jacobian / size, rcond=1e-8) / size[:, None]
    return best.scale**2 * inverse @ inverse.T


def _left(r: np.ndarray, count: np.ndarray, found: Measurements) -> Residuals:
    """Root mean squares of residuals (N, rows) in standard deviations."""
    metres, radians = found.sigma
    square = np.average(r**2, axis=0, weights=count if count.any() else None)
    if found.kind != "pose":
        return Residuals(metres * float(np.sqrt(square.sum())), float("nan"))
    turn, shift = np.sqrt(square[:3].sum()), np.sqrt(square[3:].sum())
    return Residuals(metres * float(shift), radians * float(turn))


def _tried(
    robot: Robot, chosen: Parameters, found: Measurements, loss: Loss, share: float
) -> Residuals | None:
    """What a fit to the others leaves of every k-th measurement; None where these are too few."""
    every = round(1 / share) if share else 0
    out = np.zeros(len(found.q), bool)
    if every:
        out[every - 1 :: every] = True
    if not out.any() or np.sum(~out) * ROWS[found.kind] < len(chosen.free):
        return None
    others = least_squares(robot, chosen, found.of(np.nonzero(~out)[0]), loss)
    tried = found.of(np.nonzero(out)[0])
    r = linearised(robot, chosen, tried, others.x)[0]
    # Of a robust loss those that are wrong are not what it is judged by.
    norms = np.linalg.norm(r, axis=1) / others.scale
    count = np.ones(len(r)) if loss == "linear" else (norms < 5 * ROWS[found.kind] ** 0.5) * 1.0
    return _left(r, count, tried)
