"""How the functions of SO(3), SE(3) and the subproblems are differentiated."""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from derivatives import Answer, Case, Kind, NoDerivative, motion, rotation
from support import DATA, PI

import niryo_jax as nj
from niryo_jax.subproblems import SubproblemKind

PI_ = float(PI)
W = (0.4, -0.7, 0.5)
AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
TWIST = (*W, 0.3, -0.2, 0.6)
MATRIX = np.array([[0.9, 0.2, -0.1], [-0.3, 1.1, 0.2], [0.1, -0.2, 0.8]])
POSE = np.array(motion(*TWIST), float)
NEAR_POSE = POSE + 0.01 * np.arange(16.0).reshape(4, 4)

VECTORS: dict[str, tuple[Any, ...]] = {
    "a turn": (W,),
    "identity": ((0.0, 0.0, 0.0),),
    "near the identity": ((1e-9, -2e-9, 1e-9),),
    "near a half turn": (tuple((PI_ - 1e-7) * AXIS),),
    "half turn": (tuple(PI_ * AXIS),),
    "whole turn": (tuple(2 * PI_ * AXIS),),
}
TWISTS = {name: ((*w, 0.3, -0.2, 0.6),) for name, (w,) in VECTORS.items()} | {
    "zero": (np.zeros(6),)
}
# The logarithm has a cut at the half turn, which no difference may cross.
ROTATIONS = {
    "a turn": (rotation(*W),),
    "identity": (np.eye(3),),
    "near the identity": (rotation(1e-9, -2e-9, 1e-9),),
    "near a half turn": (rotation(*(3.14 * AXIS)),),
}
POSES = {
    name: (motion(*w, 0.3, -0.2, 0.6),)
    for name, w in (
        ("a turn", W),
        ("identity", (0, 0, 0)),
        ("near the identity", (1e-9, -2e-9, 1e-9)),
        ("near a half turn", tuple(3.14 * AXIS)),
    )
}
BRANCH = "that of the vector returned"
NOTHING, OF_ROTATION = "0", "0 of the rotation"

GROUPS = [
    Case("so3.hat", nj.so3.hat, {"w": "free"}, VECTORS),
    Case("so3.vee", nj.so3.vee, {"matrix": "free"}, {"any": (MATRIX,)}),
    Case("so3.inverse", nj.so3.inverse, {"rotation": "rotation"}, ROTATIONS),
    Case("so3.exp", nj.so3.exp, {"w": "free"}, VECTORS),
    Case(
        "so3.log",
        nj.so3.log,
        {"rotation": "rotation"},
        ROTATIONS,
        {
            "half turn": NoDerivative((rotation(*(PI * AXIS)),), BRANCH),
            "half turn about z": NoDerivative((np.diag([-1.0, -1.0, 1.0]),), BRANCH),
        },
        single=5e-3,
    ),
    Case(
        "so3.axis_angle",
        nj.so3.axis_angle,
        {"w": "free"},
        {"a turn": (W,), "half turn": (tuple(PI_ * AXIS),)},
        {"zero": NoDerivative((np.zeros(3),), NOTHING)},
    ),
    Case(
        "so3.project",
        nj.so3.project,
        {"matrix": "free"},
        {"near a rotation": (MATRIX,), "left-handed": (MATRIX @ np.diag([1, 1, -1]),)},
        {
            "zero": NoDerivative((np.zeros((3, 3)),), OF_ROTATION),
            "a rotation": NoDerivative((np.eye(3),), "0 of the distance"),
            "no unique rotation": NoDerivative((np.diag([1.0, 0.0, 0.0]),), OF_ROTATION),
            "a reflection": NoDerivative((np.diag([1.0, 1.0, -1.0]),), OF_ROTATION),
        },
    ),
    Case("se3.hat", nj.se3.hat, {"twist": "free"}, TWISTS),
    Case("se3.vee", nj.se3.vee, {"matrix": "free"}, {"any": (NEAR_POSE,)}),
    Case(
        "se3.from_rotation_and_position",
        nj.se3.from_rotation_and_position,
        {"rotation": "rotation", "position": "free"},
        {"any": (rotation(*W), (0.1, 0.2, 0.3))},
    ),
    Case("se3.rotation_and_position", nj.se3.rotation_and_position, {"pose": "motion"}, POSES),
    Case("se3.inverse", nj.se3.inverse, {"pose": "motion"}, POSES),
    Case("se3.exp", nj.se3.exp, {"twist": "free"}, TWISTS),
    Case(
        "se3.log",
        nj.se3.log,
        {"pose": "motion"},
        POSES,
        {"half turn": NoDerivative((motion(*(PI * AXIS), 0.3, -0.2, 0.6),), BRANCH)},
        single=5e-3,
    ),
    Case("se3.adjoint", nj.se3.adjoint, {"pose": "motion"}, POSES),
    Case("se3.ad", nj.se3.ad, {"twist": "free"}, TWISTS),
    Case(
        "se3.project",
        nj.se3.project,
        {"matrix": "free"},
        {"near a motion": (NEAR_POSE,)},
        {
            "zero": NoDerivative((np.zeros((4, 4)),), OF_ROTATION),
            "a motion": NoDerivative((np.eye(4),), "0 of the distance"),
        },
    ),
    Case(
        "se3.screw_from_axis",
        nj.se3.screw_from_axis,
        {"point": "free", "direction": "free", "pitch": "free"},
        {
            "a line": ((0.1, 0.2, 0.3), (0.3, -0.4, 1.0), 0.2),
            "without pitch": ((0.1, 0.2, 0.3), (0.3, -0.4, 1.0), 0.0),
        },
        {
            "translation": NoDerivative(
                ((0.1, 0.2, 0.3), (0.3, -0.4, 1.0), np.inf), "0 by the pitch"
            )
        },
    ),
    Case(
        "se3.axis_of_screw",
        nj.se3.axis_of_screw,
        {"screw": "free"},
        {"a screw": (TWIST,)},
        {
            "zero": NoDerivative((np.zeros(6),), NOTHING),
            "translation": NoDerivative(((0, 0, 0, 0.1, 0.2, 0.3),), "that of a translation"),
        },
    ),
    Case(
        "se3.unit_screw",
        nj.se3.unit_screw,
        {"twist": "free"},
        {"a screw": (TWIST,)},
        {
            "zero": NoDerivative((np.zeros(6),), NOTHING),
            "translation": NoDerivative(((0, 0, 0, 0.1, 0.2, 0.3),), "that of a translation"),
        },
    ),
]


_GIVEN = {
    SubproblemKind.NONE: "that of the closest approach",
    SubproblemKind.TANGENT: "that of where both solutions meet",
    SubproblemKind.INFINITE: "that of the solution that is listed",
}
_SOLVERS = {f"PK{i}": f"paden_kahan_{i}" for i in (1, 2, 3)} | {
    f"PG{i}": f"pardos_gotor_{i}" for i in range(1, 9)
}
_KINDS: dict[int, Kind] = {6: "axis", 3: "free", 4: "motion", 0: "free"}


def _kind(case: dict[str, Any]) -> SubproblemKind:
    if case["count"] == "infinite":
        return SubproblemKind.INFINITE
    if "tangent" in case["tag"] or "delta=0" in case["tag"]:
        return SubproblemKind.TANGENT
    return SubproblemKind.FINITE if case["count"] else SubproblemKind.NONE


def _angles(function: Callable[..., Any], *x: Any) -> Answer:
    answer = function(*x)
    valid = jnp.broadcast_to(answer.valid[..., None], answer.angles.shape)
    return Answer(answer.angles, answer.kind, valid)


def _subproblem(code: str, name: str) -> Case:
    """The first of each sort of the recorded problems."""
    first: dict[str, dict[str, Any]] = {}
    for case in json.loads((DATA / "subproblems.json").read_text())["subproblems"][code]:
        first.setdefault(case["tag"], case)
    # A pair of skew axes that meets after all has a second solution, which any step but one that
    # keeps them meeting leaves.
    first.pop("axes meet (PK2 as special case)", None)
    points = {tag: (tuple(case["in"].values()), _kind(case)) for tag, case in first.items()}
    function = getattr(nj.subproblems, name)
    arguments = next(iter(points.values()))[0]
    kinds = [_KINDS[len(x) if isinstance(x, list) else 0] for x in arguments]
    return Case(
        f"subproblems.{name}",
        functools.partial(_angles, function),
        dict(zip(inspect.signature(function).parameters, kinds)),
        {tag: at for tag, (at, kind) in points.items() if kind is SubproblemKind.FINITE},
        {
            tag: NoDerivative(at, _GIVEN[kind], int(kind))
            for tag, (at, kind) in points.items()
            if kind is not SubproblemKind.FINITE
        },
        turns=True,
        single=5e-3,
        tier="slow" if code in ("PG6", "PG7", "PG8") else "heavy",
    )


SUBPROBLEMS = [_subproblem(code, name) for code, name in _SOLVERS.items()]
