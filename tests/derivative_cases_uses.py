"""How trajectories, collisions and uncertainty are differentiated."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from derivative_cases_arms import FAR, GEOMETRY, OF_SMALL, Q2, SPHERICAL, Q, built, pose_of
from derivatives import Case, Kind, NoDerivative, motion

import niryo_jax as nj
from niryo_jax import collision as co
from niryo_jax import uncertainty as un

NIRYO = nj.robots.niryo_one()
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

SPREAD2 = np.array([[2.0, 0.5], [0.5, 1.0]])
SPREAD6 = np.diag(np.arange(1.0, 7.0)) + 0.3
SPREAD3 = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
ROUND = NoDerivative((np.eye(3),), "0 of the directions")
FLAT = NoDerivative((np.diag([1.0, 0.0, 0.0]),), "0 of the axis that is 0")
KEY = jax.random.key(3)
OTHER_DRAWS = np.inf
"""A key draws other numbers in float32."""
SIZES = np.array([0.01, 0.02, 0.03, 0.01, 0.02, 0.03])


def _propagated(q: Any, covariance: Any) -> un.Propagated:
    return un.propagate(NIRYO, q, covariance)


def _propagate(s: Any, m: Any, q: Any, covariance: Any, mean: Any) -> Any:
    found = un.propagate(built(s, m), q, covariance, mean)
    return found.covariance, found.position_covariance, found.mean_shift


def _noise(matrix: Any, width: Any, offset: Any, share: Any, play: Any) -> un.Noise:
    """Of everything at once, for one set of parameters."""
    parts = un.Gaussian(matrix), un.Uniform(width), un.Bias(offset), un.GearRatio(share, share)
    return sum((un.Backlash(play), un.EncoderSteps(0.3)), un.Combined(parts))


def _of_noise(what: str, *x: Any) -> Any:
    *parameters, q = x
    function = getattr(_noise(*parameters), what)
    return function(KEY, q, 4) if what == "sample" else function(q)


def _trials(matrix: Any, q: Any) -> un.MonteCarlo:
    return un.monte_carlo(NIRYO, q, un.Gaussian(1e-4 * matrix), KEY, 16)


def _compared(matrix: Any, q: Any) -> Any:
    found = un.compare(un.propagate(NIRYO, q, 1e-4 * matrix), _trials(matrix, q))
    return found.rms_ratio, found.half_axes_ratio, found.covariance_difference


def _ellipsoid(found: Any) -> Any:
    return found.half_axes, found.directions


ONE_MATRIX: dict[str, Kind] = {"matrix": "symmetric", "q": "free"}
PARAMETERS: dict[str, Kind] = {
    "matrix": "symmetric", "half_width": "free", "offset": "free", "share": "free", "play": "free",
    "q": "free",
}  # fmt: skip
NO_ERROR = NoDerivative((Q, np.zeros((6, 6))), "0")
BY_SPREAD: dict[str, Kind] = {"q": "free", "covariance": "symmetric"}
POSTURE = {"a posture": (Q, SPREAD6)}

UNCERTAINTY = [
    Case(
        "uncertainty.propagate",
        _propagate,
        GEOMETRY | {"q": "free", "covariance": "symmetric", "mean": "free"},
        {"a posture": (Q2, SPREAD2, Q2), "no error": (Q2, np.zeros((2, 2)), np.zeros(2))},
        shared=OF_SMALL,
        tier="heavy",
    ),
    Case(
        "uncertainty.Propagated.rms",
        lambda *x: _propagated(*x).rms,
        BY_SPREAD,
        POSTURE,
        {"no error": NO_ERROR},
        tier="slow",
    ),
    Case(
        "uncertainty.Propagated.ellipsoid",
        lambda *x: _ellipsoid(_propagated(*x).ellipsoid(0.9)),
        BY_SPREAD,
        POSTURE,
        {"no error": NO_ERROR},
        single=2e-2,
        tier="slow",
    ),
    Case(
        "uncertainty.sensitivity",
        lambda q, s: (lambda found: (found.position, found.rotation))(un.sensitivity(NIRYO, q, s)),
        {"q": "free", "sigma": "free"},
        {"a posture": (Q, SIZES)},
        {"an axis through the tool": NoDerivative((np.zeros(6), SIZES), "0 of that joint")},
        tier="heavy",
    ),
    *(
        Case(
            f"uncertainty.Sensitivity.{name}",
            lambda q, name=name: getattr(un.sensitivity(NIRYO, q), name),
            {"q": "free"},
            {"a posture": (Q,)},
            single=2e-3,
            tier="slow",
        )
        for name in ("millimetres", "milliradians")
    ),
    Case(
        "uncertainty.least_sensitive",
        lambda pose: un.least_sensitive(
            SPHERICAL, nj.inverse_kinematics(SPHERICAL, pose), SPREAD6.astype(pose.dtype)
        )[0],
        {"pose": "motion"},
        {"a posture": (pose_of(SPHERICAL, Q),)},
        {"out of reach": NoDerivative((FAR,), "0")},
        jitted=False,
        turns=True,
        single=2e-2,
        tier="heavy",
    ),
    Case(
        "uncertainty.position_ellipsoid",
        lambda c: _ellipsoid(un.position_ellipsoid(c, 0.9)),
        {"covariance": "symmetric"},
        {"three axes": (SPREAD3,)},
        {"a sphere": ROUND, "a line": FLAT, "a point": NoDerivative((np.zeros((3, 3)),), "0")},
    ),
    Case(
        "uncertainty.Gaussian.independent",
        lambda sigma: un.Gaussian.independent(sigma[0]).matrix[None],
        {"sigma": "free"},
        {"some": (SIZES,), "none": (np.zeros(6),)},
    ),
    *(
        Case(
            f"uncertainty.Noise.{what}",
            functools.partial(_of_noise, what),
            PARAMETERS,
            {"a posture": (Q,)},
            shared=(SPREAD6, *(SIZES for _ in range(4))),
        )
        for what in ("mean", "covariance")
    ),
    Case(
        "uncertainty.Noise.sample",
        functools.partial(_of_noise, "sample"),
        PARAMETERS,
        {"a posture": (Q,)},
        shared=(SPREAD6, *(SIZES for _ in range(4))),
        single=OTHER_DRAWS,
    ),
    Case(
        "uncertainty.monte_carlo",
        lambda *x: (lambda y: (y.mean, y.covariance, y.rms, y.mean_norm, y.percentiles))(
            _trials(*x)
        ),
        ONE_MATRIX,
        {"a posture": (Q,)},
        shared=(SPREAD6,),
        single=OTHER_DRAWS,
        tier="slow",
    ),
    *(
        Case(
            f"uncertainty.MonteCarlo.{name}",
            lambda *x, name=name: getattr(_trials(*x), name),
            ONE_MATRIX,
            {"a posture": (Q,)},
            shared=(SPREAD6,),
            single=OTHER_DRAWS,
            tier="slow",
        )
        for name in ("position_covariance", "mean_shift")
    ),
    Case(
        "uncertainty.MonteCarlo.ellipsoid",
        lambda *x: _ellipsoid(_trials(*x).ellipsoid()),
        ONE_MATRIX,
        {"a posture": (Q,)},
        shared=(SPREAD6,),
        single=OTHER_DRAWS,
        tier="slow",
    ),
    Case(
        "uncertainty.compare",
        _compared,
        ONE_MATRIX,
        {"a posture": (Q,)},
        shared=(SPREAD6,),
        single=OTHER_DRAWS,
        tier="slow",
    ),
]
