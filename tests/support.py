"""Independent truths for the tests: plain numpy in extended precision, nothing from the package."""

from __future__ import annotations

import functools
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

import niryo_jax as nj

DATA = Path(__file__).parent / "data"
LD = np.longdouble
PI = LD(np.pi) + LD(1.2246467991473532e-16)
DTYPES = (np.float64, np.float32)
BATCHES = ((), (1,), (3, 2), (0,))


def eps(dtype: Any) -> float:
    """The machine epsilon of a dtype."""
    return float(np.finfo(dtype).eps)


def ulps(value: Any, truth: np.ndarray) -> np.ndarray:
    """The error of `value` in units in the last place of the truth, in the dtype of `value`."""
    value = np.asarray(value)
    info = np.finfo(value.dtype)
    spacing = np.spacing(np.maximum(np.abs(truth).astype(value.dtype), info.tiny))
    return np.abs(value.astype(LD) - truth) / spacing


def hat3(w: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 3, 3): the matrix of w x."""
    x, y, z = np.moveaxis(np.asarray(w), -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(*x.shape, 3, 3)


def hat6(twist: np.ndarray) -> np.ndarray:
    """(..., 6) -> (..., 4, 4): the matrix of a twist (omega, v)."""
    twist = np.asarray(twist)
    out = np.zeros((*twist.shape[:-1], 4, 4), twist.dtype)
    out[..., :3, :3] = hat3(twist[..., :3])
    out[..., :3, 3] = twist[..., 3:]
    return out


def expm(matrix: np.ndarray) -> np.ndarray:
    """The matrix exponential by scaling, a Taylor sum and squaring, in extended precision."""
    matrix = np.asarray(matrix, LD)
    largest = float(np.max(np.abs(matrix), initial=0.0)) * matrix.shape[-1]
    squarings = max(0, int(np.ceil(np.log2(largest))) + 3) if largest > 0 else 0
    scaled = matrix / LD(2) ** squarings
    term = np.broadcast_to(np.eye(matrix.shape[-1], dtype=LD), matrix.shape)
    total = term.copy()
    for k in range(1, 24):
        term = term @ scaled / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def product_of_exponentials(screws: Any, home: Any, q: Any) -> np.ndarray:
    """exp([S1] q1) ... exp([Sn] qn) M for q (..., n), in extended precision."""
    screws, q = np.asarray(screws, LD), np.asarray(q, LD)
    pose = np.eye(4, dtype=LD)
    for i in range(screws.shape[-2]):
        pose = pose @ expm(hat6(screws[..., i, :] * q[..., i, None]))
    return pose @ np.asarray(home, LD)


@functools.partial(jax.jit, static_argnums=0)
def rate(function: Callable[[Any], Any], x: Any, u: Any) -> Any:
    """The derivative of a function at x along u, in forward mode."""
    return jax.jvp(function, (x,), (u,))[1]


@functools.partial(jax.jit, static_argnums=0)
def second_rate(function: Callable[[Any], Any], x: Any, u: Any, s: Any) -> Any:
    """The second derivative of a function at x along u and s."""
    return jax.jvp(lambda x: jax.jvp(function, (x,), (u,))[1], (x,), (s,))[1]


def rate_truth(
    function: Callable[[np.ndarray], np.ndarray], x: Any, u: Any, step: float = 1e-3
) -> np.ndarray:
    """The derivative of an extended-precision function at x along u, by the five-point rule."""
    x, u = np.asarray(x, LD), np.asarray(u, LD)
    h = LD(step)
    near = function(x + h * u) - function(x - h * u)
    far = function(x + 2 * h * u) - function(x - 2 * h * u)
    return (8 * near - far) / (12 * h)


def unit_vectors(rng: np.random.Generator, shape: tuple[int, ...] = ()) -> np.ndarray:
    """Uniform directions (*shape, 3), in extended precision."""
    v = rng.standard_normal((*shape, 3)).astype(LD)
    return v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True))


def random_rotations(rng: np.random.Generator, shape: tuple[int, ...] = ()) -> np.ndarray:
    """Rotations (*shape, 3, 3) of every size of angle, in extended precision."""
    return expm(hat3(unit_vectors(rng, shape) * rng.uniform(0, np.pi, (*shape, 1))))


def random_poses(rng: np.random.Generator, shape: tuple[int, ...] = ()) -> np.ndarray:
    """Rigid motions (*shape, 4, 4) in extended precision."""
    return rigid(random_rotations(rng, shape), rng.uniform(-1, 1, (*shape, 3)))


def rigid(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """The (..., 4, 4) motions of rotations and positions."""
    out = np.zeros((*rotation.shape[:-2], 4, 4), LD)
    out[..., :3, :3] = rotation
    out[..., :3, 3] = position
    out[..., 3, 3] = 1
    return out


def rigid_inverse(pose: np.ndarray) -> np.ndarray:
    """The inverse of rigid motions, (..., 4, 4)."""
    transposed = np.swapaxes(pose[..., :3, :3], -1, -2)
    return rigid(transposed, -(transposed @ pose[..., :3, 3:])[..., 0])


def adjoint_matrix(pose: np.ndarray) -> np.ndarray:
    """Ad_T: column i holds the twist of T [e_i] T^-1."""
    columns = [pose @ hat6(unit) @ rigid_inverse(pose) for unit in np.eye(6, dtype=LD)]
    return np.stack([vee6(column) for column in columns], axis=-1)


def vee6(matrix: np.ndarray) -> np.ndarray:
    """(..., 4, 4) -> (..., 6): the twist of a matrix of se(3)."""
    return np.stack(
        [matrix[..., i, j] for i, j in ((2, 1), (0, 2), (1, 0), (0, 3), (1, 3), (2, 3))], -1
    )


def random_screws(
    rng: np.random.Generator, n: int, *, prismatic: Sequence[int] = (), helical: Sequence[int] = ()
) -> np.ndarray:
    """(n, 6) unit screws; the joints named are prismatic or helical, the others revolute."""
    axis = unit_vectors(rng, (n,))
    pitch = np.zeros((n, 1))
    pitch[list(helical)] = rng.uniform(-0.5, 0.5, (len(helical), 1))
    screws = np.concatenate([axis, np.cross(rng.uniform(-1, 1, (n, 3)), axis) + pitch * axis], 1)
    for i in prismatic:
        screws[i] = [0, 0, 0, *axis[i]]
    return screws.astype(np.float64)


def random_robot(
    rng: np.random.Generator, n: int, *, prismatic: Sequence[int] = (), helical: Sequence[int] = ()
) -> nj.Robot:
    """A robot of n joints in general position."""
    screws = random_screws(rng, n, prismatic=prismatic, helical=helical)
    return nj.Robot.from_screws(screws, random_poses(rng).astype(np.float64))


@functools.cache
def _modern_robotics() -> dict[str, Any]:
    return json.loads((DATA / "modern_robotics.json").read_text())


def modern_robotics(name: str) -> list[tuple[list[Any], Any]]:
    """The (arguments, result) pairs of a function of ModernRobotics, as arrays."""

    def arrays(value: Any) -> Any:
        return np.array(value, np.float64)

    def result(value: Any) -> Any:
        # AxisAng3 and AxisAng6 answer with a pair (vector, number).
        pair = name.startswith("AxisAng")
        return tuple(arrays(part) for part in value) if pair else arrays(value)

    return [
        ([arrays(x) for x in case["in"]], result(case["out"])) for case in _modern_robotics()[name]
    ]


class Urdf:
    """Forward kinematics of a chain in a URDF file."""

    def __init__(self, name: str) -> None:
        self.joints = ElementTree.parse(DATA / f"{name}.urdf").getroot().findall("joint")
        self.moving = [joint for joint in self.joints if joint.get("type") == "revolute"]

    @property
    def limits(self) -> np.ndarray:
        """(2, n) lower and upper limits."""
        found = [joint.find("limit") for joint in self.moving]
        return np.array([[float(limit.get(k)) for limit in found] for k in ("lower", "upper")])

    def pose(self, q: np.ndarray) -> np.ndarray:
        """(..., n) -> (..., 4, 4), the frame of the last link in that of the first."""
        q = np.asarray(q, LD)
        pose = np.broadcast_to(np.eye(4, dtype=LD), (*q.shape[:-1], 4, 4))
        for joint in self.joints:
            origin = joint.find("origin")
            roll, pitch, yaw = np.array(_numbers(origin.get("rpy")), LD)
            x, y, z = np.eye(3, dtype=LD)
            turn = expm(hat3(z * yaw)) @ expm(hat3(y * pitch)) @ expm(hat3(x * roll))
            pose = pose @ rigid(turn, np.array(_numbers(origin.get("xyz")), LD))
            if joint in self.moving:
                axis = np.array(_numbers(joint.find("axis").get("xyz")), LD)
                angle = q[..., self.moving.index(joint), None]
                pose = pose @ rigid(expm(hat3(axis * angle)), np.zeros(3))
        return pose


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]
