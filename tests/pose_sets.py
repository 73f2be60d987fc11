"""Robots and sets of poses on which inverse kinematics is judged, made by seed.

Joint vectors are radians, lengths metres. Hard sets lie within `delta` of a singularity, joint
limits aside.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import exhaustive as judge
import numpy as np
from support import product_of_exponentials, random_rotations

import niryo_jax as nj

DELTAS = (1e-3, 1e-6, 1e-9)

# ABB IRB120, tool down, Y up: screws (omega, v), home and limits as computed in the exercises of
# Pardos-Gotor, "Screw Theory for Robotics" (2018, 2022), for its data sheet.
IRB120 = nj.Robot.from_screws(
    [
        [0, 1, 0, 0, 0, 0],
        [0, 0, 1, 0.29, 0, 0],
        [0, 0, 1, 0.56, 0, 0],
        [1, 0, 0, 0, 0, -0.63],
        [0, 0, 1, 0.63, -0.302, 0],
        [0, -1, 0, 0, 0, -0.302],
    ],
    [[0, -1, 0, 0.302], [0, 0, -1, 0.47], [1, 0, 0, 0], [0, 0, 0, 1]],
    lower=np.deg2rad([-165, -110, -110, -160, -120, -400]),
    upper=np.deg2rad([165, 110, 70, 160, 120, 400]),
    name="irb120",
)


def spherical(robot: nj.Robot) -> nj.Robot:
    """The arm with axis 6 and the tool moved sideways so that axis 6 meets the wrist point."""
    screws, home = np.array(robot.screws), np.array(robot.home)
    arm = judge.Geometry.of(screws)
    away = arm.wrist - arm.point[5]
    away -= (away @ arm.axis[5]) * arm.axis[5]
    screws[5, 3:] = np.cross(arm.point[5] + away, arm.axis[5])
    home[:3, 3] += away
    return nj.Robot.from_screws(
        screws, home, lower=robot.lower, upper=robot.upper, name=f"{robot.name}_spherical"
    )


def relative(
    seed: int,
    *,
    offset: float,
    sideways: float = 0.0,
    tilt: float = 0.0,
    skew_12: float = 0.0,
    skew_45: float = 0.0,
    skew_56: float = 0.0,
) -> nj.Robot:
    """A random arm of the family, without limits.

    Args:
        seed: of the link lengths and directions.
        offset: between axis 6 and the wrist point, metres.
        sideways: of the wrist point along axis 2, metres.
        tilt: of axis 4 out of the arm plane, radians.
        skew_12, skew_45, skew_56: what is lacking to a right angle between two axes, radians.
    """
    rng = np.random.default_rng(seed)
    x, z = np.eye(3)[0], np.eye(3)[2]
    shoulder = 0.18 * z
    second = np.array([0.0, -np.cos(skew_12), np.sin(skew_12)])
    third = np.cross(x, second)

    def planar(angle: float) -> np.ndarray:
        return np.cos(angle) * x + np.sin(angle) * third

    elbow = shoulder + rng.uniform(0.18, 0.25) * planar(rng.uniform(0.8, 2.2))
    wrist = elbow + rng.uniform(0.18, 0.25) * planar(rng.uniform(-1, 1)) + sideways * second
    fourth = np.cos(tilt) * planar(rng.uniform(-1, 1)) + np.sin(tilt) * second
    fifth = np.cos(skew_45) * _normal(rng, fourth) + np.sin(skew_45) * fourth
    sixth = np.cos(skew_56) * _normal(rng, fifth) + np.sin(skew_56) * fifth
    sixth_point = wrist + offset * _normal(rng, sixth)
    home = np.eye(4)
    home[:3, :3] = random_rotations(rng).astype(float)
    home[:3, 3] = sixth_point + 0.08 * sixth + 0.02 * _normal(rng, sixth)
    home[:3, :3] = np.linalg.qr(home[:3, :3])[0]
    home[:3, :3] *= np.linalg.det(home[:3, :3])
    return nj.Robot.from_axes(
        [z, second, second, fourth, fifth, sixth],
        [0 * z, shoulder, elbow, wrist, wrist, sixth_point],
        home,
        name=f"relative_{seed}",
    )


def _normal(rng: np.random.Generator, axis: np.ndarray) -> np.ndarray:
    """A random unit vector at right angles to an axis."""
    v = np.cross(axis, rng.standard_normal(3))
    return v / np.linalg.norm(v)


@functools.cache
def robot(name: str) -> nj.Robot:
    """A robot by its name in `NAMED` or `RELATIVES`."""
    return {**NAMED, **RELATIVES}[name]()


NAMED: dict[str, Callable[[], nj.Robot]] = {
    "niryo_one": nj.robots.niryo_one,
    "niryo_ned": nj.robots.niryo_ned,
    "niryo_ned2": nj.robots.niryo_ned2,
    "spherical": lambda: spherical(nj.robots.niryo_one()),
    "irb120": lambda: IRB120,
}

RELATIVES: dict[str, Callable[[], nj.Robot]] = {
    "offset_20mm": lambda: relative(1, offset=0.02),
    "offset_150mm": lambda: relative(2, offset=0.15),
    "sideways": lambda: relative(3, offset=0.03, sideways=0.06),
    "tilted_forearm": lambda: relative(4, offset=0.03, tilt=0.4),
    "skew_12": lambda: relative(5, offset=0.03, skew_12=0.3),
    "skew_45": lambda: relative(6, offset=0.03, skew_45=0.3),
    "skew_56": lambda: relative(7, offset=0.03, skew_56=0.3),
    "all_at_once": lambda: relative(
        8, offset=0.05, sideways=-0.04, tilt=-0.3, skew_12=-0.2, skew_45=0.2, skew_56=-0.3
    ),
    "all_spherical": lambda: relative(
        9, offset=0.0, sideways=0.05, tilt=0.3, skew_12=0.2, skew_45=-0.2, skew_56=0.2
    ),
}


def poses_of(arm: nj.Robot, q: np.ndarray) -> np.ndarray:
    """Tool poses (n, 4, 4) of joint vectors (n, 6): exact, then rounded to float64."""
    parts = np.array_split(q, max(1, len(q) // 5000))
    return np.concatenate([product_of_exponentials(arm.screws, arm.home, p) for p in parts]).astype(
        float
    )


def solve(arm: nj.Robot, poses: np.ndarray, **options: int) -> judge.Solutions:
    """The judge's solutions for a robot."""
    return judge.exhaustive(np.asarray(arm.screws), np.asarray(arm.home), poses, **options)


# Reachable sets: (robot, n, delta, rng) -> joint vectors (n, 6).


def in_limits(arm: nj.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    """Uniform within the joint limits, or within a turn where there are none."""
    lower = np.where(np.isfinite(arm.lower), arm.lower, -np.pi)
    upper = np.where(np.isfinite(arm.upper), arm.upper, np.pi)
    return rng.uniform(lower, upper, (n, 6))


def _about(delta: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """Of either sign, and no less than a third of delta: where a singularity is exact, solutions
    are no longer isolated, and much nearer to one than 1e-9 rounding smears them."""
    return delta * rng.uniform(0.33, 1, n) * rng.choice([-1.0, 1.0], n)


def elbow(arm: nj.Robot, n: int, delta: float, rng: np.random.Generator, *, end: int) -> np.ndarray:
    """The elbow within delta radians of stretched (end = 0) or folded (end = 1)."""
    q = in_limits(arm, n, rng)
    straight = judge.Elbow.of(judge.Geometry.of(arm.screws)).straight
    q[:, 2] = np.angle(straight) + end * np.pi + _about(delta, n, rng)
    return q


def wrist(arm: nj.Robot, n: int, delta: float, rng: np.random.Generator, *, end: int) -> np.ndarray:
    """Axes 4 and 6 within delta radians of their smallest (end = 0) or greatest angle.

    In an arm without skew axes they are then parallel or opposed.
    """
    q = in_limits(arm, n, rng)
    e4, e5, e6 = np.asarray(arm.screws)[3:, :3]
    q[:, 4] = np.arctan2(e4 @ np.cross(e5, e6), e4 @ e6 - (e4 @ e5) * (e6 @ e5))
    q[:, 4] += end * np.pi + _about(delta, n, rng)
    return q


def shoulder(arm: nj.Robot, n: int, delta: float, rng: np.random.Generator) -> np.ndarray:
    """The wrist point within delta metres of axis 1, above or below the shoulder."""
    q = in_limits(arm, n, rng)
    geometry = judge.Geometry.of(arm.screws)
    e1, e2 = geometry.axis[:2]
    assert abs(e1 @ e2) < 1e-12, "only where axes 1 and 2 are at right angles"
    forearm = judge.rodrigues(e2, q[:, 2]) @ (geometry.wrist - geometry.point[2])
    reach = forearm + geometry.point[2] - geometry.shoulder
    assert np.abs(reach @ e2).max() < 1e-12, "only where the arm plane holds axis 1"
    up = np.broadcast_to(e1, reach.shape) * rng.choice([-1.0, 1.0], n)[:, None]
    lean = _about(delta, n, rng) / np.linalg.norm(reach, axis=1)
    q[:, 1] = judge.turn_between(e2, reach, up) + lean
    return q


def corners(arm: nj.Robot, n: int, delta: float, rng: np.random.Generator) -> np.ndarray:
    """Every joint within delta radians of one of its limits, inside."""
    inside = delta * rng.uniform(0, 1, (n, 6))
    return np.where(rng.random((n, 6)) < 0.5, arm.lower + inside, arm.upper - inside)


HARD: dict[str, Callable[..., np.ndarray]] = {
    "elbow_stretched": functools.partial(elbow, end=0),
    "elbow_folded": functools.partial(elbow, end=1),
    "wrist_aligned": functools.partial(wrist, end=0),
    "wrist_opposed": functools.partial(wrist, end=1),
    "shoulder": shoulder,
    "corners": corners,
}


def with_count(arm: nj.Robot, count: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Joint vectors whose pose has exactly `count` solutions, limits aside.

    Such poses are rare but lie together, with axes 4 and 6 nearly parallel or the wrist point near
    axis 1: a few are found there at random, the others by small steps from those.
    """
    kept = np.zeros((0, 6))
    for _ in range(60):
        q = np.concatenate([rng.uniform(-np.pi, np.pi, (250, 6)), shoulder(arm, 250, 0.01, rng)])
        q[:375, 4] = rng.normal(0, 0.15, 375)
        if len(kept):
            near = kept[rng.integers(len(kept), size=400)]
            q[:400] = near + rng.normal(0, 1, (400, 6)) * 10 ** rng.uniform(-3, -1, (400, 1))
        right = solve(arm, poses_of(arm, q), nodes=512, starts=0).count == count
        kept = np.concatenate([kept, q[right]])
        if len(kept) >= n:
            return kept[:n]
    raise AssertionError(f"{arm.name}: only {len(kept)} poses with {count} solutions found")


# Poses that may be out of reach: (robot, n, rng) -> poses (n, 4, 4).


def placed(
    arm: nj.Robot, distance: Callable[[np.ndarray], np.ndarray], n: int, rng: np.random.Generator
) -> np.ndarray:
    """Random rotations, and positions such that theta6 leaves the wrist point at a distance.

    `distance` is told the radii (n,) of the wrist point's circle about axis 6 and answers with
    the distance of the shoulder from the circle's centre (n,).
    """
    geometry = judge.Geometry.of(arm.screws)
    away = geometry.wrist - geometry.point[5]
    foot = geometry.wrist - away + (away @ geometry.axis[5]) * geometry.axis[5]
    radius = np.full(n, np.linalg.norm(geometry.wrist - foot))
    motion = np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
    motion[:, :3, :3] = random_rotations(rng, (n,)).astype(float)
    direction = rng.standard_normal((n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    centre = geometry.shoulder + distance(radius)[:, None] * direction
    motion[:, :3, 3] = centre - motion[:, :3, :3] @ foot
    return motion @ arm.home


def reach(arm: nj.Robot) -> tuple[float, float]:
    """The least and the greatest distance of the wrist point from the shoulder."""
    links = judge.Elbow.of(judge.Geometry.of(arm.screws))
    a, b, d = abs(links.upper), abs(links.lower), links.sideways
    return float(np.hypot(d, a - b)), float(np.hypot(d, a + b))


def beyond(arm: nj.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    """No theta6 brings the wrist point within 1.001 to 1.02 of the outer reach."""
    factor = rng.uniform(1.001, 1.02, n)
    return placed(arm, lambda radius: reach(arm)[1] * factor + radius, n, rng)


def far(arm: nj.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    """Two to a hundred times the outer reach away."""
    factor = 10 ** rng.uniform(0.3, 2, n)
    return placed(arm, lambda radius: reach(arm)[1] * factor + radius, n, rng)


def hole(arm: nj.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    """The whole circle of the wrist point lies within 0.98 of the inner reach."""
    room = reach(arm)[0] * 0.98
    return placed(arm, lambda radius: rng.uniform(0, 1, n) * (room - radius), n, rng)


def anywhere(arm: nj.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    """Uniform in the ball of the outer reach, turned anyhow: some can be reached, some not."""
    most = reach(arm)[1]
    return placed(arm, lambda radius: (most + radius) * rng.random(n) ** (1 / 3), n, rng)


UNREACHABLE: dict[str, Callable[..., np.ndarray]] = {"beyond": beyond, "far": far, "hole": hole}
