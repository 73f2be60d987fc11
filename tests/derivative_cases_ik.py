"""How inverse kinematics is differentiated, by poses and by the geometry."""

from __future__ import annotations

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from derivative_cases_arms import (
    FAR,
    GEOMETRY,
    IIWA,
    LEAST,
    NIRYO,
    NO_MOTION,
    OF_SMALL,
    ON_AXIS_1,
    Q7,
    SMALL,
    SPHERICAL,
    UR,
    Q,
    built,
    pose_of,
)
from derivatives import Answer, Case, NoDerivative, Tier

import niryo_jax as nj


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
