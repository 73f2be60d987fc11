"""Adapters to other libraries for forward kinematics, Jacobians and numerical inverse kinematics.

None is a dependency: each is used where it is installed. All get the same arm, as a URDF or as
elementary transforms, and the same joint vectors, put into the library's form outside the measured
time. An answer is brought into ours (poses; the Jacobian of the space twist, rows omega and v)
outside of it as well.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import niryo_jax as nj
from benchmarks.measure import installed


@dataclasses.dataclass(frozen=True)
class Peer:
    """A library in one precision.

    Attributes:
        name: as printed.
        dtype: "float64" or "float32".
        given: joint vectors (N, n) -> what the functions take.
        forward: that -> the library's poses; None where it has no such function.
        poses: these -> (N, 4, 4).
        jacobian: what `given` returns -> the library's Jacobians.
        space_jacobians: these, and the poses (N, 4, 4) -> (N, 6, n).
        batched: whether one call handles the whole batch; otherwise Python loops.
    """

    name: str
    dtype: str
    given: Callable[[np.ndarray], Any]
    forward: Callable[[Any], Any] | None = None
    poses: Callable[[Any], np.ndarray] = np.asarray
    jacobian: Callable[[Any], Any] | None = None
    space_jacobians: Callable[[Any, np.ndarray], np.ndarray] = lambda jacobians, poses: jacobians
    batched: bool = True


def urdf(robot: nj.Robot) -> str:
    """A URDF of an arm of revolute joints whose frames are all parallel to the base at home."""
    screws, home = np.asarray(robot.screws), np.asarray(robot.home)
    points = np.cross(screws[:, :3], screws[:, 3:])
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    mass = f'<inertial><mass value="1"/>{inertia}</inertial>'
    lines, before = ['<robot name="arm">', f'<link name="link_0">{mass}</link>'], np.zeros(3)
    for i, (axis, point) in enumerate(zip(screws[:, :3], points)):
        lower, upper = float(robot.lower[i]), float(robot.upper[i])
        lines.append(
            f'<link name="link_{i + 1}">{mass}</link>'
            f'<joint name="joint_{i + 1}" type="revolute"><parent link="link_{i}"/>'
            f'<child link="link_{i + 1}"/><origin xyz="{_numbers(point - before)}"/>'
            f'<axis xyz="{_numbers(axis)}"/>'
            f'<limit lower="{lower!r}" upper="{upper!r}" effort="1" velocity="1"/></joint>'
        )
        before = point
    r = home[:3, :3]
    turn = np.array(
        [
            np.arctan2(r[2, 1], r[2, 2]),
            -np.arcsin(np.clip(r[2, 0], -1, 1)),
            np.arctan2(r[1, 0], r[0, 0]),
        ]
    )
    lines.append(
        f'<link name="tool"/><joint name="to_tool" type="fixed"><parent link="link_{i + 1}"/>'
        f'<child link="tool"/><origin xyz="{_numbers(home[:3, 3] - before)}" '
        f'rpy="{_numbers(turn)}"/></joint></robot>'
    )
    return "\n".join(lines)


def _numbers(vector: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in vector)


def _as_given(q: np.ndarray) -> np.ndarray:
    return q


def _at_origin(jacobian: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """From rows (v, omega) with v of the tool's origin to the space Jacobian."""
    v, w = jacobian[:, :3], jacobian[:, 3:]
    return np.concatenate([w, v - np.cross(w, poses[:, :3, 3, None], axis=1)], axis=1)


def _numpy(robot: nj.Robot) -> list[Peer]:
    from benchmarks import reference

    return [
        Peer(
            "plain numpy",
            "float64",
            _as_given,
            lambda q: reference.forward_kinematics(robot, q),
            jacobian=lambda q: reference.space_jacobian(robot, q),
        )
    ]


def _pinocchio(robot: nj.Robot) -> list[Peer]:
    """With the tool's pose read into an array, and without reading anything."""
    import pinocchio as pin

    model = pin.buildModelFromXML(urdf(robot))
    data = model.createData()
    tool = model.getFrameId("tool")

    def poses(q: np.ndarray) -> np.ndarray:
        out = np.empty((len(q), 4, 4))
        for i, x in enumerate(q):
            pin.forwardKinematics(model, data, x)
            pin.updateFramePlacement(model, data, tool)
            out[i] = data.oMf[tool].homogeneous
        return out

    def jacobians(q: np.ndarray) -> np.ndarray:
        out = np.empty((len(q), 6, model.nv))
        for i, x in enumerate(q):
            out[i] = pin.computeJointJacobians(model, data, x)
        return out

    def swapped(jacobian: np.ndarray, poses: np.ndarray) -> np.ndarray:
        return np.concatenate([jacobian[:, 3:], jacobian[:, :3]], axis=1)

    def nothing_read(q: np.ndarray) -> None:
        for x in q:
            pin.forwardKinematics(model, data, x)

    def no_jacobian_read(q: np.ndarray) -> None:
        for x in q:
            pin.computeJointJacobians(model, data, x)

    return [
        Peer("pinocchio", "float64", _as_given, poses, np.asarray, jacobians, swapped, False),
        Peer(
            "pinocchio, joints only, not read",
            "float64",
            _as_given,
            nothing_read,
            jacobian=no_jacobian_read,
            batched=False,
        ),
    ]


def elementary_transforms(robot: nj.Robot) -> Any:
    """The arm as roboticstoolbox's elementary transforms; its axes are those of the base."""
    from roboticstoolbox import ET, ETS
    from spatialmath import SE3

    screws, home = np.asarray(robot.screws), np.array(robot.home)
    parts, before = [], np.zeros(3)
    for axis, point in zip(screws[:, :3], np.cross(screws[:, :3], screws[:, 3:])):
        for letter, step in zip("xyz", point - before):
            if step:
                parts.append(getattr(ET, f"t{letter}")(step))
        which = int(np.argmax(np.abs(axis)))
        parts.append(getattr(ET, f"R{'xyz'[which]}")(flip=bool(axis[which] < 0)))
        before = point
    home[:3, 3] -= before
    return ETS([*parts, ET.SE3(SE3(home))])


def _roboticstoolbox(robot: nj.Robot) -> list[Peer]:
    arm = elementary_transforms(robot)

    def jacobians(q: np.ndarray) -> np.ndarray:
        return np.stack([arm.jacob0(x) for x in q])

    return [
        # It answers a batch of one with one matrix.
        Peer("roboticstoolbox", "float64", _as_given, arm.eval, lambda x: x.reshape(-1, 4, 4)),
        Peer(
            "roboticstoolbox",
            "float64",
            _as_given,
            jacobian=jacobians,
            space_jacobians=_at_origin,
            batched=False,
        ),
    ]


def _frax(robot: nj.Robot) -> list[Peer]:
    import jax
    import jax.numpy as jnp
    from frax import Manipulator

    home = np.array(robot.home)
    screws = np.asarray(robot.screws)[-1]
    home[:3, 3] -= np.cross(screws[:3], screws[3:])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf(robot))
        arm = Manipulator(str(path), ee_offset=home)
    forward, jacobian = jax.jit(jax.vmap(arm.ee_transform)), jax.jit(jax.vmap(arm.ee_jacobian))

    def peer(dtype: str) -> Peer:
        return Peer(
            "frax",
            dtype,
            lambda q: jnp.asarray(q, dtype),
            forward,
            np.asarray,
            jacobian,
            lambda j, poses: _at_origin(np.asarray(j), poses),
        )

    return [peer("float64"), peer("float32")]


def _pyroki(robot: nj.Robot) -> list[Peer]:
    import jax
    import jax.numpy as jnp
    import jaxlie
    import pyroki
    import yourdfpy

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf(robot))
        arm = pyroki.Robot.from_urdf(yourdfpy.URDF.load(path, load_meshes=False))
    tool = arm.links.names.index("tool")
    forward = jax.jit(lambda q: arm.forward_kinematics(q)[..., tool, :])

    def poses(quaternions: Any) -> np.ndarray:
        return np.asarray(jaxlie.SE3(quaternions).as_matrix())

    def peer(dtype: str) -> Peer:
        return Peer("PyRoki", dtype, lambda q: jnp.asarray(q, dtype), forward, poses)

    return [peer("float64"), peer("float32")]


def _pytorch_kinematics(robot: nj.Robot) -> list[Peer]:
    import pytorch_kinematics
    import torch

    def peer(dtype: str) -> Peer:
        kind = getattr(torch, dtype)
        chain = pytorch_kinematics.build_serial_chain_from_urdf(urdf(robot), "tool").to(dtype=kind)
        return Peer(
            "pytorch-kinematics",
            dtype,
            lambda q: torch.tensor(q, dtype=kind),
            lambda q: chain.forward_kinematics(q).get_matrix(),
            lambda result: result.numpy(),
            chain.jacobian,
            lambda j, poses: _at_origin(j.numpy(), poses),
        )

    return [peer("float64"), peer("float32")]


def _modern_robotics(robot: nj.Robot) -> list[Peer]:
    import modern_robotics

    screws, home = np.asarray(robot.screws).T, np.asarray(robot.home)
    return [
        Peer(
            "modern_robotics",
            "float64",
            _as_given,
            lambda q: np.stack([modern_robotics.FKinSpace(home, screws, x) for x in q]),
            jacobian=lambda q: np.stack([modern_robotics.JacobianSpace(screws, x) for x in q]),
            batched=False,
        )
    ]


PACKAGES: dict[str, tuple[str, Callable[[nj.Robot], list[Peer]]]] = {
    "numpy": ("numpy", _numpy),
    "pinocchio": ("pin", _pinocchio),
    "roboticstoolbox": ("roboticstoolbox-python", _roboticstoolbox),
    "frax": ("frax", _frax),
    "PyRoki": ("almond-pyroki", _pyroki),
    "pytorch-kinematics": ("pytorch-kinematics", _pytorch_kinematics),
    "modern_robotics": ("modern_robotics", _modern_robotics),
}
"""Library -> the package that pip takes, and its adapters."""


def peers(robot: nj.Robot, skip: list[str]) -> tuple[list[Peer], dict[str, str]]:
    """The peers that are installed, and for the others why they take no part."""
    return installed(PACKAGES, robot, skip)
