"""How trajectories and collisions are differentiated."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from derivative_cases_arms import FAR, GEOMETRY, NIRYO, OF_SMALL, Q2, Q, built, pose_of
from derivatives import Case, Kind, NoDerivative, motion

import niryo_jax as nj
from niryo_jax import collision as co

START, END = motion(0.2, -0.3, 0.1, 0.3, 0.1, 0.2), motion(-0.4, 0.5, 0.9, 0.1, 0.3, 0.4)
HALF = START @ motion(0, 0, np.pi, 0.1, 0.2, 0.3)
BOTH: dict[str, Kind] = {"start": "motion", "end": "motion", "duration": "free"}
TIMES: dict[str, Kind] = {"t": "free", "duration": "free"}


def _poses(function: Any, start: Any, end: Any, duration: Any) -> Any:
    path = function(start, end, duration, 5)
    return path.time, path.pose, path.twist, path.twist_rate


def _trajectory(name: str) -> Case:
    return Case(
        f"motion.{name}",
        functools.partial(_poses, getattr(nj.motion, name)),
        BOTH,
        {"two poses": (START, END, 2.0), "the same pose": (START, START, 2.0)},
        {"half a turn apart": NoDerivative((START, HALF, 2.0), "that of the way taken")},
        tier="heavy",
    )


def _scaling(name: str) -> Case:
    outside = {"before": (-0.5, 2.0), "after": (3.0, 2.0)}
    edges = {
        "the start": NoDerivative((0.0, 2.0), "that of the inside"),
        "the end": NoDerivative((2.0, 2.0), "that of the inside"),
    }
    return Case(
        f"motion.{name}",
        getattr(nj.motion, name),
        TIMES,
        {"on the way": (0.7, 2.0)} | outside,
        edges,
    )


MOVE: dict[str, Kind] = {
    "velocity": "free", "acceleration": "free", "jerk": "free", "q_start": "free", "q_end": "free",
}  # fmt: skip
MOST = np.linspace(1.0, 2.0, 6), np.linspace(2.0, 3.0, 6), np.linspace(20.0, 30.0, 6)


def _moves(velocity: Any, acceleration: Any, jerk: Any, start: Any, end: Any) -> Any:
    limits = nj.motion.MotionLimits(velocity, acceleration, jerk)
    return nj.motion.point_to_point(start, end, limits, "scurve")


MOTION = [
    _scaling("cubic_time_scaling"),
    _scaling("quintic_time_scaling"),
    Case(
        "motion.joint_trajectory",
        lambda a, b, t: tuple(nj.motion.joint_trajectory(a, b, t, 5)),
        {"q_start": "free", "q_end": "free", "duration": "free"},
        {"two postures": (Q, -Q, 2.0), "the same posture": (Q, Q, 2.0)},
    ),
    _trajectory("screw_trajectory"),
    _trajectory("cartesian_trajectory"),
    Case(
        "motion.point_to_point",
        lambda *x: _moves(*x).duration,
        MOVE,
        {"two postures": (Q, -Q)},
        {"the same posture": NoDerivative((Q, Q), "0")},
        shared=MOST,
    ),
    Case(
        "motion.PointToPoint.at",
        lambda t, *x: _moves(*x).at(t).q,
        {"t": "free"} | MOVE,
        {"two postures": (Q, -Q)},
        {"the same posture": NoDerivative((Q, Q), "those of both ends")},
        shared=(np.array([0.31, 0.67]), *MOST),
    ),
    Case(
        "motion.arc",
        lambda start, via, end: nj.motion.arc(start, via, end, 5),
        {"start": "motion", "via": "free", "end": "motion"},
        {"three points": (START, [0.2, 0.3, 0.2], END)},
        tier="heavy",
    ),
    Case(
        "motion.blend",
        lambda poses: nj.motion.blend(poses, 0.05, 9),
        {"poses": "motion"},
        {"a corner": (np.stack([START, START @ motion(0.3, 0.1, 0, 0.2, 0, 0.1), END]),)},
        tier="slow",
    ),
    Case(
        "motion.velocity_ik",
        lambda q, twist: nj.motion.velocity_ik(NIRYO, q, twist).rate,
        {"q": "free", "twist": "free"},
        {"a posture": (Q, np.arange(1.0, 7.0) / 20)},
        {"a straight wrist": NoDerivative((Q * [1, 1, 1, 1, 0, 1], np.ones(6)), "of damped rates")},
        tier="slow",
    ),
]

SEGMENTS = {
    "crossing": ([-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]),
    "the same": ([-1, 0, 0], [1, 0, 0], [-1, 0, 0], [1, 0, 0]),
    "parallel": ([-1, 0, 0], [1, 0, 0], [-0.5, 1, 0], [0.7, 1, 0]),
    "one point": ([0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]),
}
FOUR: dict[str, Kind] = dict.fromkeys(("start", "end", "other_start", "other_end"), "free")
EYE = np.eye(4)
POINT = np.zeros(3)
SHAPE = co.niryo_one()
BALL = co.World.spheres([[0.3, 0.1, 0.3]], [0.05])
# One capsule of the base against one of the second's tool.
PAIR: dict[str, Any] = {
    "start": np.array([[0, 0, 0.0], [0.4, 0, 0.2]]),
    "end": np.array([[0, 0, 0.3], [0.7, 0.1, 0.3]]),
    "radius": np.array([0.05, 0.04]),
}


def _by_shape(s: Any, m: Any, start: Any, end: Any, radius: Any, centre: Any, q: Any) -> Any:
    model = co.CollisionModel.from_capsules(start, end, radius, [0, 2], pairs=[(0, 2)])
    world = co.World.spheres(centre, 0.1) + co.World.boxes(centre + 0.5, [[0.1, 0.2, 0.1]])
    return co.distances(built(s, m), model, q, world).distance


def _attached(start: Any, end: Any, radius: Any) -> Any:
    base = (jnp.asarray(part, start.dtype) for part in ([[0, 0, 0]], [[1, 1, 1]], [0.1]))
    model = co.CollisionModel.from_capsules(*base, [0])
    more = model.attach(start[0], end[0], radius[0], [2, 2])
    return more.start[None], more.end[None], more.radius[None]


def _obstacles(kind: str, *given: Any) -> Any:
    """The arrays of a world that are not empty."""
    world = getattr(co.World, kind)(*(part[0] for part in given))
    return [part[None] for part in jax.tree.leaves(world) if len(part)]


def _world(kind: str, by: dict[str, Kind], at: tuple[Any, ...]) -> Case:
    return Case(f"collision.World.{kind}", functools.partial(_obstacles, kind), by, {"one": at})


COLLISION = [
    Case(
        "collision.segment_distance",
        co.segment_distance,
        FOUR,
        {
            "skew": ([-1, 0, 0], [1, 0, 0.2], [0.1, -1, 1], [0.3, 1, 1.2]),
            "end to end": ([0, 0, 0], [1, 0, 0], [2, 0.1, 0], [3, 0.5, 1]),
        },
        {
            name: NoDerivative(at, "that of one nearest pair; 0 at 0")
            for name, at in SEGMENTS.items()
        },
    ),
    Case(
        "collision.box_distance",
        co.box_distance,
        {"start": "free", "end": "free", "pose": "motion", "half_size": "free"},
        {
            "outside": ([2, 0.3, 0.2], [3, 1.1, 2], motion(0.1, 0.2, -0.1, 0, 0, 0), [1, 1.1, 0.9]),
            "inside": ([0.1, 0, 0.2], [0.3, 0.1, 0.2], motion(0.1, 0.2, -0.1, 0, 0, 0), [1, 2, 3]),
        },
        {
            "through its centre": NoDerivative(
                ([-2, 0, 0], [2, 0, 0], EYE, np.ones(3)), "that of one way out"
            ),
            "on an edge": NoDerivative(([-2, 1, 1], [2, 1, 1], EYE, np.ones(3)), "one of both"),
            "a point in the centre": NoDerivative(
                (POINT, POINT, EYE, np.ones(3)), "of one way out"
            ),
        },
        tier="heavy",
    ),
    Case(
        "collision.clearance",
        lambda q: co.clearance(NIRYO, SHAPE, q, BALL),
        {"q": "free"},
        {"a posture": (Q,), "at home": (0 * Q + 0.01,)},
        tier="heavy",
    ),
    Case(
        "collision.distances",
        lambda q: co.distances(NIRYO, SHAPE, q, BALL).distance,
        {"q": "free"},
        {"a posture": (Q,)},
        tier="slow",
    ),
    Case(
        "collision.distances",
        _by_shape,
        GEOMETRY
        | {"start": "free", "end": "free", "radius": "free", "centres": "free", "q": "free"},
        {"a posture": (Q2,)},
        shared=(*OF_SMALL, *PAIR.values(), np.array([[0.6, 0.5, 0.6]])),
        note="by arm, model and world",
        tier="slow",
    ),
    Case(
        "collision.free",
        lambda pose: jnp.where(
            (answer := nj.inverse_kinematics(NIRYO, pose)).found,
            co.free(NIRYO, SHAPE, answer, BALL).clearance,
            0.0,
        ),
        {"pose": "motion"},
        {"a posture": (pose_of(NIRYO, Q),)},
        {"out of reach": NoDerivative((FAR,), "0")},
        jitted=False,
        single=2e-2,
        tier="slow",
    ),
    Case(
        "collision.CollisionModel.from_capsules",
        lambda *x: jax.tree.map(
            lambda part: part[None],
            jax.tree.leaves(co.CollisionModel.from_capsules(*(part[0] for part in x), [0, 2])),
        ),
        {"start": "free", "end": "free", "radius": "free"},
        {"two": tuple(PAIR.values())},
    ),
    Case(
        "collision.CollisionModel.attach",
        _attached,
        {"start": "free", "end": "free", "radius": "free"},
        {"two": tuple(PAIR.values())},
    ),
    _world("planes", {"normals": "free", "offsets": "free"}, ([[0, 0, 1.0]], [0.1])),
    _world("boxes", {"poses": "motion", "half_sizes": "free"}, (START[None], [[0.1, 0.2, 0.3]])),
    _world("spheres", {"centres": "free", "radii": "free"}, ([[0.1, 0.2, 0.3]], [0.1])),
    _world(
        "capsules",
        {"starts": "free", "ends": "free", "radii": "free"},
        ([[0.1, 0.2, 0.3]], [[0.4, 0.2, 0.3]], [0.1]),
    ),
]
