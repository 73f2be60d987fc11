"""How chains, Jacobians and inverse kinematics are differentiated, by the geometry too."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import pose_sets
from derivatives import Answer, Case, NoDerivative, Tier, motion
from support import product_of_exponentials

import niryo_jax as nj

NIRYO = nj.robots.niryo_one()
SPHERICAL = pose_sets.robot("irb120")
IIWA = nj.robots.kuka_iiwa14()
UR = nj.robots.ur16e()

Q = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8])
Q7 = np.array([0.3, -0.4, 0.5, 0.6, -0.7, 0.8, 0.2])
# The tool axis of the Niryo One lies on axis 1: joints 1 and 6 turn against each other.
ON_AXIS_1 = np.array([[0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0.5], [0, 0, 0, 1.0]])
FAR = np.array([[1, 0, 0, 5.0], [0, 1, 0, 0], [0, 0, 1, 0.2], [0, 0, 0, 1]])
NO_MOTION = np.diag([2.0, 1.0, 1.0, 1.0])
RATES = np.array([0.2, -0.5, 0.3, 0.7, -0.1, 0.4])
VELOCITY = np.array([0.3, -0.2, 0.1, 0.05, 0.02, -0.04])
GEOMETRY = {"screws": "screw", "home": "motion"}
LEAST = "the least that follow"

# Programs of traced screws take long to compile: two joints, one of them helical.
SMALL = nj.Robot.from_screws(
    [[0, 0, 1, 0, 0, 0], [0, 1, 0, -0.2, 0.05, 0.3]],
    motion(0.3, 0.2, -0.4, 0.5, 0.1, 0.2).astype(float),
)
OF_SMALL = SMALL.screws, SMALL.home
Q2 = np.array([0.3, 1.1])
SMOOTH = {"a posture": (Q2,), "home": (np.zeros(2),), "whole turns": (Q2 + 2 * np.pi,)}
WRIST = np.array([0.3, -0.4, 0.5, 0.6, 0.0, 0.8])


def built(screws: Any, home: Any, like: nj.Robot = SMALL) -> nj.Robot:
    """An arm of this geometry."""
    return dataclasses.replace(like, screws=screws, home=home)


def of_geometry(function: Callable[..., Any], like: nj.Robot = SMALL) -> Callable[..., Any]:
    """A function of a robot as one of its screws and its home pose."""
    return lambda screws, home, *rest: function(built(screws, home, like), *rest)


def pose_of(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(4, 4) of joints (n,), in extended precision."""
    return product_of_exponentials(robot.screws, robot.home, q)


def _by_all(name: str, tier: Tier = "heavy") -> Case:
    """A smooth function of an arm and joints, by both."""
    function = of_geometry(getattr(nj, name))
    return Case(name, function, GEOMETRY | {"q": "free"}, SMOOTH, shared=OF_SMALL, tier=tier)


def _by_joints(name: str, given: str) -> list[Case]:
    """A measure of the Jacobian, which has no derivative where the arm is singular."""
    function = getattr(nj, name)
    measure = (lambda *x: 1.0 / function(*x)) if name == "condition_number" else function
    edges = {
        "home, singular": NoDerivative((np.zeros(6),), given),
        "wrist singular": NoDerivative((WRIST,), given),
    }
    return [
        Case(
            name,
            functools.partial(measure, SPHERICAL),
            {"q": "free"},
            {"a posture": (Q,)},
            edges,
            tier="heavy",
        ),
        Case(
            name,
            of_geometry(measure),
            GEOMETRY | {"q": "free"},
            {"a posture": (Q2,)},
            shared=OF_SMALL,
            note="by the geometry",
            tier="slow",
        ),
        Case(
            name,
            functools.partial(measure, IIWA),
            {"q": "free"},
            {"a posture": (Q7,)},
            {"stretched": NoDerivative((np.zeros(7),), given)},
            note="seven joints",
            tier="slow",
        ),
    ]


CHAINS = [
    _by_all("forward_kinematics"),
    _by_all("link_poses"),
    _by_all("space_jacobian"),
    _by_all("body_jacobian", "slow"),
    _by_all("autodiff_space_jacobian", "slow"),
    Case(
        "tool_velocity",
        of_geometry(nj.tool_velocity),
        GEOMETRY | {"q": "free", "rates": "free"},
        {name: (*at, Q2) for name, at in SMOOTH.items()},
        shared=OF_SMALL,
        tier="slow",
    ),
    Case(
        "joint_rates",
        functools.partial(nj.joint_rates, NIRYO),
        {"q": "free", "velocity": "free"},
        {"a posture": (Q, VELOCITY)},
        {"home, singular": NoDerivative((np.zeros(6), VELOCITY), LEAST)},
        tier="heavy",
    ),
    Case(
        "joint_rates",
        lambda s, m, q, v, d: nj.joint_rates(built(s, m), q, v, damping=d),
        GEOMETRY | {"q": "free", "velocity": "free", "damping": "free"},
        {"a posture": (Q2, VELOCITY, 0.1), "home": (np.zeros(2), VELOCITY, 0.1)},
        shared=OF_SMALL,
        note="damped, by the geometry",
        tier="slow",
    ),
    Case(
        "joint_rates",
        functools.partial(nj.joint_rates, IIWA),
        {"q": "free", "velocity": "free"},
        {"a posture": (Q7, VELOCITY)},
        {"stretched": NoDerivative((np.zeros(7), VELOCITY), LEAST)},
        note="seven joints",
        tier="slow",
    ),
    *_by_joints("manipulability", "that of one side"),
    *_by_joints("singular_values", "that of the order they are in"),
    *_by_joints("condition_number", "that of one side, 0 where it is infinite"),
    *_by_joints("free_direction", "that with equals held fixed"),
    Case(
        "arm_angle",
        functools.partial(nj.arm_angle, IIWA),
        {"q": "free"},
        {"a posture": (Q7,)},
        {"stretched": NoDerivative((np.zeros(7),), "0")},
        turns=True,
        tier="heavy",
    ),
]


def solutions(robot: nj.Robot, pose: Any, *, singularity: bool = False, **options: Any) -> Answer:
    """Joint vectors; as the flag the status, or whichever singularity is the gravest."""
    answer = nj.inverse_kinematics(robot, pose, **options)
    found = jnp.broadcast_to(answer.found[..., None], answer.q.shape)
    gravest = jnp.max(jnp.where(answer.found, answer.singularity, 0), axis=-1)
    flag = gravest if singularity else answer.status
    return Answer(answer.q, flag.astype(jnp.int32), found)


def _by_pose(
    robot: nj.Robot, note: str, q: np.ndarray, *, tier: Tier = "slow", **options: Any
) -> Case:
    """Inverse kinematics by the pose; of joints to spare no difference finds the least rates."""
    posture, home = pose_of(robot, q), pose_of(robot, 0 * q)
    spare = options.get("task") == "position"
    singular = {
        "out of reach": NoDerivative((FAR,), "0", int(nj.IKStatus.UNREACHABLE)),
        "no rigid motion": NoDerivative((NO_MOTION,), "0", int(nj.IKStatus.INVALID_POSE)),
        "home, singular": NoDerivative((home,), LEAST),
    }
    if spare:
        singular = {"joints to spare": NoDerivative((posture,), LEAST)} | singular
        del singular["no rigid motion"]
    return Case(
        "inverse_kinematics",
        functools.partial(solutions, robot, **options),
        {"pose": "motion"},
        {} if spare else {"a posture": (posture,)},
        singular,
        note=note,
        jitted=False,
        turns=True,
        joints=len(q),
        single=2e-2,
        tier=tier,
    )


def _newton(robot: nj.Robot, pose: Any, q0: Any, **options: Any) -> Answer:
    answer = nj.newton_raphson(robot, pose, q0, **options)
    return Answer(answer.q, answer.converged.astype(jnp.int32))


def _chosen(name: str, pose: Any) -> Any:
    answer = nj.inverse_kinematics(SPHERICAL, pose)
    given = (SPHERICAL,) if name == "most_manipulable" else ()
    return getattr(answer, name)(*given)[0]


def _parts(robot: nj.Robot) -> tuple[Any, Any]:
    return robot.screws[None], robot.home[None]


SOLVERS = [
    _by_pose(NIRYO, "an offset wrist", Q, tier="heavy"),
    _by_pose(SPHERICAL, "a spherical wrist", Q, tier="heavy"),
    _by_pose(UR, "three parallel axes", Q),
    _by_pose(IIWA, "seven joints", Q7),
    _by_pose(NIRYO, "the position alone", Q, task="position"),
    _by_pose(NIRYO, "one axis of the tool", Q, task="direction", tool_axis=(1, 0, 0)),
    _by_pose(NIRYO, "from many guesses", Q, method="multistart"),
    _by_pose(NIRYO, "from seeds", Q, method="seeded"),
    Case(
        "inverse_kinematics",
        lambda s, m, pose: solutions(built(s, m, NIRYO), pose, singularity=True),
        GEOMETRY | {"pose": "motion"},
        {"a posture": (pose_of(NIRYO, Q),)},
        {
            "a self-motion": NoDerivative((ON_AXIS_1,), LEAST, int(nj.Singularity.SELF_MOTION)),
            "out of reach": NoDerivative((FAR,), "0"),
        },
        shared=(NIRYO.screws, NIRYO.home),
        note="by the geometry",
        jitted=False,
        turns=True,
        joints=6,
        single=2e-2,
        tier="slow",
    ),
    Case(
        "newton_raphson",
        functools.partial(_newton, NIRYO),
        {"pose": "motion", "q0": "free"},
        {"a posture": (pose_of(NIRYO, Q), Q + 0.05)},
        {
            "out of reach": NoDerivative((FAR, Q), "0", 0),
            "no rigid motion": NoDerivative((NO_MOTION, Q), "0", 0),
            "a self-motion": NoDerivative((ON_AXIS_1, np.zeros(6)), "finite"),
        },
        jitted=False,
        single=2e-2,
        tier="heavy",
    ),
    Case(
        "newton_raphson",
        lambda s, m, pose, q0: _newton(built(s, m, NIRYO), pose, q0),
        GEOMETRY | {"pose": "motion", "q0": "free"},
        {"a posture": (pose_of(NIRYO, Q), Q + 0.05)},
        shared=(NIRYO.screws, NIRYO.home),
        note="by the geometry",
        jitted=False,
        single=2e-2,
        tier="slow",
    ),
    Case(
        "IKSolutions.nearest",
        lambda pose, q: nj.inverse_kinematics(SPHERICAL, pose).nearest(q)[0],
        {"pose": "motion", "q_ref": "free"},
        {
            "a posture": (pose_of(SPHERICAL, Q), Q + 0.1),
            "out of reach, where it is the reference": (FAR, Q),
        },
        {"home, singular": NoDerivative((pose_of(SPHERICAL, 0 * Q), 0 * Q), LEAST)},
        jitted=False,
        turns=True,
        single=2e-2,
        tier="heavy",
    ),
    *(
        Case(
            f"IKSolutions.{name}",
            functools.partial(_chosen, name),
            {"pose": "motion"},
            {"a posture": (pose_of(SPHERICAL, Q),)},
            {
                "out of reach": NoDerivative((FAR,), "0"),
                "home, singular": NoDerivative((pose_of(SPHERICAL, 0 * Q),), LEAST),
            },
            jitted=False,
            turns=True,
            single=2e-2,
            tier="heavy",
        )
        for name in ("farthest_from_limits", "most_manipulable")
    ),
    Case(
        "ik.seeded_branches",
        lambda pose: nj.ik.seeded_branches(NIRYO, pose).newton.q,
        {"pose": "motion"},
        {"a posture": (pose_of(NIRYO, Q),)},
        {"out of reach": NoDerivative((FAR,), "0")},
        note="where it converges",
        jitted=False,
        turns=True,
        single=2e-2,
        tier="slow",
    ),
    Case(
        "ik.wrap_into_limits",
        lambda q: nj.ik.wrap_into_limits(
            q, *(jnp.full(6, x, q.dtype) for x in (-4, 4)), (True,) * 6
        ),
        {"q": "free"},
        {"turned": (Q + 6 * np.pi,)},
        {"where the turn changes": NoDerivative((np.pi * np.ones(6),), "1")},
    ),
    Case(
        "Robot.from_screws",
        lambda s, m: _parts(nj.Robot.from_screws(s[0], m[0])),
        GEOMETRY,
        {"an arm": OF_SMALL},
    ),
    Case(
        "Robot.from_body_screws",
        lambda s, m: _parts(nj.Robot.from_body_screws(s[0], m[0])),
        GEOMETRY,
        {"an arm": OF_SMALL},
    ),
    Case(
        "Robot.from_axes",
        lambda *x: _parts(nj.Robot.from_axes(*(part[0] for part in x))),
        {"axes": "free", "points": "free", "home": "motion"},
        {"an arm": (SMALL.screws[:, :3], [[0, 0, 0.1], [0.3, 0, 0.2]], SMALL.home)},
    ),
    Case(
        "Robot.with_tool",
        lambda s, m, tool: _parts(built(s[0], m[0]).with_tool(tool[0])),
        GEOMETRY | {"tool": "motion"},
        {"an arm": (*OF_SMALL, SMALL.home)},
    ),
    Case(
        "Robot.body_screws",
        lambda s, m: built(s[0], m[0]).body_screws[None],
        GEOMETRY,
        {"an arm": OF_SMALL},
    ),
    Case(
        "robots.from_dh",
        lambda table: _parts(nj.robots.from_dh(table[0])),
        {"table": "free"},
        {"an arm": ([[0.1, 0.2, 0.3, 0.4], [0.3, -0.2, 0.1, 0.0]],)},
    ),
]
