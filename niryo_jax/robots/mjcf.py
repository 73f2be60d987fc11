"""Robots from MJCF models, read by MuJoCo itself."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

import numpy as np

from niryo_jax.arguments import check_path
from niryo_jax.robot import Robot
from niryo_jax.robots.frames import robot_from_frames

_NO_KINEMATICS = (
    "keys",
    "sensors",
    "actuators",
    "tendons",
    "equalities",
    "pairs",
    "skins",
    "flexes",
    "geoms",
    "meshes",
    "hfields",
    "materials",
    "textures",
    "tuples",
)
"""What a model holds besides bodies, joints and sites; things that refer to others come first."""


def from_mjcf(
    path: str | os.PathLike[str],
    base: str | None = None,
    tip: str | None = None,
    *,
    name: str | None = None,
) -> Robot:
    """Read the chain between two bodies of an MJCF model.

    The space frame is the frame of the base, the tool frame that of the tip. Hinge and slide joints
    of the bodies below the base, down to the tip, become joints of the robot; q is MuJoCo's qpos,
    so a joint's `ref` counts. Shapes, meshes and inertias are not read: mesh files need not exist.

    Args:
        path: an MJCF file, or its text, which starts with "<".
        base: the body that the chain starts at; the world where not given.
        tip: the site or body that the chain ends at; where not given, the one body below the base
            that carries no other.
        name: the robot's name; that of the model where not given.

    Raises:
        ImportError: MuJoCo is not installed.
        FileNotFoundError: there is no such file.
        ValueError: what MuJoCo refuses; no body or site of the name; tip is not below base; several
            bodies to choose from; a free or ball joint on the chain, or one that an equality
            constraint couples; no joint on the chain.
    """
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError as error:
        raise ImportError(
            'from_mjcf needs mujoco; install it with: pip install "niryo_jax[mjcf]"'
        ) from error
    try:
        spec = _read(mujoco, path)
        coupled = _coupled(mujoco, spec)
        model = _kinematic_model(spec)
    except ValueError as error:
        raise ValueError(f"path: {error}") from error
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    mujoco.mj_kinematics(model, data)
    first = _body(model, "base", "world" if base is None else base)
    last, home = _tip(model, data, first, tip)
    ids = _chain(model, first, last)
    names = [model.joint(i).name or f"joint_{place + 1}" for place, i in enumerate(ids)]
    kinds = [mujoco.mjtJoint(model.jnt_type[i]) for i in ids]
    for joint, kind in zip(names, kinds):
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            raise ValueError(
                f"path: joint {joint!r} on the chain is of type {kind.name}; "
                "expected a hinge or a slide"
            )
        if joint in coupled:
            raise ValueError(
                f"path: an equality constraint couples joint {joint!r} on the chain; "
                "a Robot has no coupled joints"
            )
    to_base = np.linalg.inv(_pose(data.xmat[first], data.xpos[first]))
    limited, ranges = model.jnt_limited[ids].astype(bool), model.jnt_range[ids]
    return robot_from_frames(
        np.stack([to_base @ _pose(np.eye(3), data.xanchor[i]) for i in ids]),
        data.xaxis[ids],
        to_base @ home,
        prismatic=[kind == mujoco.mjtJoint.mjJNT_SLIDE for kind in kinds],
        lower=np.where(limited, ranges[:, 0], -np.inf),
        upper=np.where(limited, ranges[:, 1], np.inf),
        joint_names=names,
        name=spec.modelname if name is None else name,
    )


def _read(mujoco: Any, path: str | os.PathLike[str]) -> Any:
    check_path("path", path)
    if isinstance(path, str) and path.lstrip().startswith("<"):
        return mujoco.MjSpec.from_string(path)
    if not Path(path).is_file():
        raise FileNotFoundError(
            f"path: {os.fspath(path)!r} is no file; expected an MJCF file, or text that starts "
            'with "<"'
        )
    return mujoco.MjSpec.from_file(os.fspath(path))


def _coupled(mujoco: Any, spec: Any) -> set[str]:
    """The joints that equality constraints couple."""
    return {
        joint
        for equality in spec.equalities
        if equality.active and equality.type == mujoco.mjtEq.mjEQ_JOINT
        for joint in (equality.name1, equality.name2)
    }


def _kinematic_model(spec: Any) -> Any:
    """The compiled model of bodies, joints and sites alone, whose inertias mean nothing."""
    for group in _NO_KINEMATICS:
        for element in list(getattr(spec, group)):
            spec.delete(element)
    for site in spec.sites:
        site.material = ""
    compiler = spec.compiler
    compiler.boundmass = compiler.boundinertia = 1.0
    compiler.balanceinertia = True
    compiler.fusestatic = compiler.alignfree = False
    return spec.compile()


def _pose(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), position
    return pose


def _body(model: Any, argument: str, name: str) -> int:
    bodies = [model.body(i).name for i in range(model.nbody)]
    if name not in bodies:
        known = ", ".join(map(repr, bodies))
        raise ValueError(f"{argument}: no body is named {name!r}; the bodies: {known}")
    return bodies.index(name)


def _tip(model: Any, data: Any, base: int, tip: str | None) -> tuple[int, np.ndarray]:
    """The last body of the chain, and the pose of the tip in the world."""
    sites = [model.site(i).name for i in range(model.nsite)]
    if tip in sites:
        i = sites.index(tip)
        return model.site_bodyid[i], _pose(data.site_xmat[i], data.site_xpos[i])
    body = _only_leaf(model, base) if tip is None else _body(model, "tip", tip)
    return body, _pose(data.xmat[body], data.xpos[body])


def _bodies(model: Any, base: int, last: int) -> list[int] | None:
    """The bodies after the base down to the last one; None where it is not below the base."""
    path: list[int] = []
    while last not in (base, 0):
        path.insert(0, last)
        last = int(model.body_parentid[last])
    return path if last == base else None


def _only_leaf(model: Any, base: int) -> int:
    parents = set(model.body_parentid[1:])
    leaves = [
        body
        for body in range(1, model.nbody)
        if body not in parents and _bodies(model, base, body) is not None
    ]
    if len(leaves) != 1:
        known = ", ".join(repr(model.body(body).name) for body in leaves)
        raise ValueError(
            f"tip: expected one chain from body {model.body(base).name!r}; choose one of: {known}"
        )
    return leaves[0]


def _chain(model: Any, base: int, last: int) -> list[int]:
    """The joints that move the last body against the base, in order."""
    bodies = _bodies(model, base, last)
    names = [repr(model.body(body).name) for body in (base, last)]
    if bodies is None:
        raise ValueError(f"tip: body {names[1]} is not below the base body {names[0]}")
    joints = [
        int(model.body_jntadr[body]) + i for body in bodies for i in range(model.body_jntnum[body])
    ]
    if not joints:
        raise ValueError(f"base, tip: no joint moves between bodies {' and '.join(names)}")
    return joints
