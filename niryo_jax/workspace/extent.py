"""The box that holds every position of the tool within the joint limits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from niryo_jax.arguments import shown
from niryo_jax.robot import Robot, check_is_robot
from niryo_jax.structure.axes import joint_kinds
from niryo_jax.workspace.grid import Grid, check_box, check_voxel

_STARTS = 512
_SWEEPS = range(30, 1000)
"""So many sweeps at least, in which a start behind may overtake, and at most."""
_GAIN = 1e-15
"""A sweep that gains less than this share of the arm's size has reached a maximum."""


def extent(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """The box that holds every position of the tool's origin within the joint limits.

    Its faces are maxima of the coordinates over the joint vectors, found by coordinate ascent: as a
    function of one joint alone, a coordinate of the tool is a + b sin q + c cos q (+ g q where the
    joint is helical or prismatic), whose greatest value within the limits is known exactly. From
    512 starts at once; that none of them leads to the greatest maximum is possible, but was not
    seen in random arms of up to seven joints. float64 numpy, whatever JAX computes in.

    Args:
        robot: the arm. Revolute limits wider than a turn count as a turn.

    Returns:
        (3,) and (3,) corners in the space frame, metres. They agree along an axis along which the
        arm cannot move.

    Raises:
        ValueError: limits that are NaN, or a prismatic or helical joint without limits, whose
            workspace has no end: give bounds for it.
        TypeError: a traced robot.
    """
    low, high = joint_ranges(robot)
    screws, home = robot.known_screws(), np.asarray(robot.home, np.float64)
    directions = np.concatenate([np.eye(3), -np.eye(3)])[:, None, :]
    directions = np.broadcast_to(directions, (6, _STARTS, 3))
    joints = [_Joint.of(*numbers) for numbers in zip(screws, low, high)]

    share = np.random.default_rng(0).random((robot.joints, 6, _STARTS))
    q = low[:, None, None] + (high - low)[:, None, None] * share
    best = np.full(6, -np.inf)
    for sweep in range(_SWEEPS.stop):
        values = _sweep(joints, home[:3, 3], directions, q).max(axis=1)
        gain = values - best
        best = np.maximum(best, values)
        if sweep >= _SWEEPS.start and np.all(gain <= _GAIN * np.abs(best).max()):
            break
    return -best[3:], best[:3]


def box(robot: Robot, bounds: tuple[ArrayLike, ArrayLike] | None, voxel: float) -> Grid:
    """The grid of a map: of the bounds, or of all that the tool can reach.

    Args:
        robot: the arm.
        bounds: (3,) and (3,) corners, metres, widened outward to whole voxels; None for `extent`.
        voxel: length of an edge, metres.

    Raises:
        ValueError: a voxel that is not positive and finite, or larger than the longest side of the
            box; bounds that are not such corners or that leave nothing between them; without
            bounds, what `extent` refuses.
    """
    check_voxel(voxel)
    if bounds is None:
        low, high = extent(robot)
        name = "what the arm can reach"
        # An arm that moves in a plane gets one layer of voxels.
        widened = np.maximum(high, low + 1e-6 * voxel)
    else:
        corners = tuple(bounds) if np.iterable(bounds) else ()
        if len(corners) != 2:
            raise ValueError(f"bounds: expected two corners, lower and upper; got {shown(bounds)}")
        low, high = check_box(*corners)
        name, widened = "the bounds", high
    longest = float(np.max(high - low))
    if voxel > longest:
        raise ValueError(
            f"voxel: {voxel} m is larger than {name}, whose longest side is {longest:.6g} m"
        )
    return Grid.covering(low, widened, voxel)


def joint_ranges(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """(n,) and (n,) the ends of each joint's range; of a revolute joint a turn at most.

    Raises:
        ValueError: more than one arm; limits that are NaN; a prismatic or helical joint without
            limits.
        TypeError: a traced robot.
    """
    check_is_robot(robot)
    screws = robot.known_screws()
    if screws.ndim != 2:
        raise ValueError(f"robot: expected one arm, got screws of shape {screws.shape}")
    low, high = np.array(robot.lower, np.float64), np.array(robot.upper, np.float64)
    for label, limits in (("lower", low), ("upper", high)):
        if np.any(np.isnan(limits)):
            raise ValueError(f"limits: expected numbers, got {label} = {limits}")
    kinds = np.array(joint_kinds(screws))
    whole = (kinds == "revolute") & (high - low >= 2 * np.pi)
    low, high = np.where(whole, -np.pi, low), np.where(whole, np.pi, high)
    endless = ~np.isfinite(high - low)
    if np.any(endless):
        joint = int(np.argmax(endless))
        raise ValueError(
            f"limits: joint {joint + 1} ({robot.joint_names[joint]}) is {kinds[joint]} and has no "
            "limits, so the workspace has no end: set its limits, or give a capability map bounds"
        )
    return low, high


class _Joint(NamedTuple):
    """A joint's axis (or zero), what is left of its screw, its pitch, and its range."""

    w: np.ndarray
    v: np.ndarray
    pitch: np.ndarray
    low: float
    high: float

    @classmethod
    def of(cls, screw: np.ndarray, low: float, high: float) -> _Joint:
        w, v = screw[:3], screw[3:]
        along = (w @ v) * w if np.any(w) else v
        return cls(w, v - along, along, low, high)

    def rates(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(..., 3) the vectors s, c of exp([S] q) p = p + s sin q + c (1 - cos q) + pitch q."""
        sine = np.cross(self.w, point) + self.v
        return sine, np.cross(self.w, sine)

    def move(self, point: np.ndarray, q: np.ndarray) -> np.ndarray:
        """exp([S] q) p (Lynch & Park, eq. 3.88)."""
        sine, cosine = self.rates(point)
        angle = q[..., None]
        return point + np.sin(angle) * sine + (1 - np.cos(angle)) * cosine + angle * self.pitch

    def turn_back(self, direction: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The rotation of the joint, inverted, of a direction."""
        across = np.cross(self.w, direction)
        angle = q[..., None]
        return direction - np.sin(angle) * across + (1 - np.cos(angle)) * np.cross(self.w, across)

    def best(self, direction: np.ndarray, point: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The joint value that moves the point farthest along the direction; q where none does."""
        sine, cosine = (np.sum(direction * x, axis=-1) for x in self.rates(point))
        slope = direction @ self.pitch
        size = np.hypot(sine, cosine)
        # The value is size cos(q - peak) + slope q. Its maxima lie a turn apart, and rise with the
        # slope: the one to look at is the last one before the limit that the slope leads to.
        peak = np.arctan2(sine, -cosine)
        size = np.where(size > np.abs(slope), size, np.inf)
        peak = peak + np.arcsin(slope / size)
        inner = np.where(
            slope >= 0,
            self.high - (self.high - peak) % (2 * np.pi),
            self.low + (peak - self.low) % (2 * np.pi),
        )
        inner = np.where((inner >= self.low) & (inner <= self.high), inner, q)

        def value(q: np.ndarray) -> np.ndarray:
            return sine * np.sin(q) - cosine * np.cos(q) + slope * q

        for candidate in (inner, np.full_like(q, self.low), np.full_like(q, self.high)):
            q = np.where(value(candidate) > value(q), candidate, q)
        return q


def _sweep(
    joints: list[_Joint], tool: np.ndarray, direction: np.ndarray, q: np.ndarray
) -> np.ndarray:
    """Improve each joint of q (n, ...) in turn, in place; how far the tool is along the direction.

    What follows a joint is a point that it moves; what precedes it turns the direction back.
    """
    points = [np.broadcast_to(tool, direction.shape)]
    for joint, angle in zip(joints[:0:-1], q[:0:-1]):
        points.append(joint.move(points[-1], angle))
    offset = np.zeros(direction.shape[:-1])
    for i, (joint, point) in enumerate(zip(joints, reversed(points))):
        q[i] = joint.best(direction, point, q[i])
        # The motion turns the direction of what follows and adds what it does to the origin.
        offset = offset + np.sum(direction * joint.move(np.zeros(3), q[i]), axis=-1)
        direction = joint.turn_back(direction, q[i])
    return offset + direction @ tool
