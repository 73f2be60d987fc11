"""What was measured of an arm: poses, positions or distances of its tool; and its residuals."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np

from niryo_jax.arguments import check_finite, check_motion, check_positive, shown
from niryo_jax.calibration import motions
from niryo_jax.calibration.parameters import Parameters
from niryo_jax.lanes.batching import as_floating
from niryo_jax.robot import Robot

Kind = Literal["pose", "position", "distance"]

ROWS: dict[Kind, int] = {"pose": 6, "position": 3, "distance": 1}
"""How many numbers a measurement says."""

_MOST_TURNS = 4 * np.pi
_UNITS = 50.0


class Measurements(NamedTuple):
    """Joint values and what was measured there.

    Attributes:
        kind: what was measured; static.
        q: (N, n) what the joints were told, radians and metres.
        values: (N, 4, 4) poses, (N, 3) positions or (N,) distances of the tool, space frame.
        origin: (3,) where distances are measured from.
        sigma: (2,) standard deviations, metres and radians.
    """

    kind: Kind
    q: np.ndarray
    values: np.ndarray
    origin: np.ndarray
    sigma: np.ndarray

    def of(self, rows: np.ndarray) -> Measurements:
        """Those of some rows."""
        return self._replace(q=self.q[rows], values=self.values[rows])


def measurements_of(
    robot: Robot, q: Any, measured: Any, origin: Any, sigma: tuple[float, float]
) -> Measurements:
    """Measurements that are looked at.

    Raises:
        ValueError: wrong shapes or numbers, degrees or millimetres, a sigma that is not positive.
        TypeError: no numbers.
    """
    q = np.asarray(as_floating("q", q), float)
    values = np.asarray(as_floating("measured", measured), float)
    if q.ndim != 2 or q.shape[1] != robot.joints:
        raise ValueError(f"q: expected (N, {robot.joints}) joint values, got shape {q.shape}")
    kinds: dict[tuple[int, ...], Kind] = {(4, 4): "pose", (3,): "position", (): "distance"}
    kind = kinds.get(values.shape[1:]) if values.ndim else None
    if kind is None or len(values) != len(q):
        raise ValueError(
            f"measured: expected ({len(q)}, 4, 4) poses, ({len(q)}, 3) positions or ({len(q)},) "
            f"distances, got shape {values.shape}"
        )
    check_finite("q", q)
    check_finite("measured", values)
    if kind == "pose":
        for pose in values:
            check_motion("measured", pose)
    point = np.zeros(3) if origin is None else np.asarray(as_floating("origin", origin), float)
    if point.shape != (3,) or (origin is not None and kind != "distance"):
        raise ValueError(
            f"origin: expected (3,), where distances are measured from; got {shown(origin)} for "
            f"measured {kind}s"
        )
    check_finite("origin", point)
    if not isinstance(sigma, tuple | list) or len(sigma) != 2:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"sigma: expected (metres, radians), got {shown(sigma)}")
    deviations = np.array([check_positive("sigma", x) for x in sigma])
    found = Measurements(kind, q, values, point, deviations)
    _check_units(robot, found)
    return found


def _check_units(robot: Robot, found: Measurements) -> None:
    turns = np.any(np.asarray(robot.screws)[:, :3], axis=1)
    most = np.abs(found.q[:, turns]).max(initial=0.0)
    if most > _MOST_TURNS:
        raise ValueError(
            f"q: expected radians, got values up to {most:.4g}, more than two turns: are they "
            "degrees?"
        )
    if not len(found.q):
        return
    nominal = places_of(robot, found.q)
    if found.kind == "distance":
        reach, seen = np.linalg.norm(nominal - found.origin, axis=1), np.abs(found.values)
    else:
        places = found.values[:, :3, 3] if found.kind == "pose" else found.values
        # Where a base frame is to be found the tool may be anywhere; how far it moves is the same.
        reach, seen = (np.linalg.norm(x - x.mean(axis=0), axis=1) for x in (nominal, places))
    ratio = np.median(seen) / max(float(np.median(reach)), 1e-9)
    if ratio > _UNITS:
        raise ValueError(
            f"measured: expected metres, got lengths {ratio:.3g} times those of the arm: are they "
            "millimetres?"
        )


def linearised(
    robot: Robot, parameters: Parameters, found: Measurements, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What was measured less what parameters x (m,) predict, (N, rows), the turn of a pose before
    its place; and how the parameters move what is predicted, (N, rows, m). In standard deviations.

    The turn is that from the predicted tool to the measured one, in its frame; near zero it moves
    as the tool turns.
    """
    pose, twists = parameters.linearised(robot, x, found.q)
    rotation, place = pose[:, :3, :3], pose[:, :3, 3]
    # The tool's origin moves by omega x p + v.
    moves = twists[:, 3:] - motions.hat(place) @ twists[:, :3]
    if found.kind == "distance":
        away = place - found.origin
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        r = (found.values - length)[:, None]
        jacobian = (away / length[:, None])[:, None] @ moves
    elif found.kind == "position":
        r, jacobian = found.values - place, moves
    else:
        back = np.swapaxes(rotation, 1, 2)
        turn = motions.rotation_vector(back @ found.values[:, :3, :3])
        r = np.concatenate([turn, found.values[:, :3, 3] - place], axis=1)
        jacobian = np.concatenate([back @ twists[:, :3], moves], axis=1)
    metres, radians = found.sigma
    rows = [radians] * 3 + [metres] * 3 if found.kind == "pose" else [metres] * r.shape[1]
    return r / rows, jacobian / np.array(rows)[:, None]


def alignment(robot: Robot, found: Measurements) -> np.ndarray:
    """(4, 4) the base frame that brings the nominal tool nearest to where it was measured, to begin
    with: the rotation by the singular vectors of the cross-covariance (Kabsch, 1976)."""
    nominal = places_of(robot, found.q)
    places = found.values[:, :3, 3] if found.kind == "pose" else found.values
    base = np.eye(4)
    if found.kind == "distance" or len(places) < 3:
        return base
    centres = nominal.mean(axis=0), places.mean(axis=0)
    left, size, right = np.linalg.svd((places - centres[1]).T @ (nominal - centres[0]))
    if size[1] < 1e-6 * size[0]:
        return base
    handed = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    base[:3, :3] = left @ handed @ right
    base[:3, 3] = centres[1] - base[:3, :3] @ centres[0]
    return base


def places_of(robot: Robot, q: np.ndarray) -> np.ndarray:
    """(N, 3) where the tool's origin is at joint vectors (N, n)."""
    at = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for screw, value in zip(np.asarray(robot.screws, float), q.T):
        at = at @ motions.exp(screw * value[:, None])
    return (at @ np.asarray(robot.home, float))[:, :3, 3]
