"""Random arms of every family with a closed form, and a search for all solutions in plain numpy."""

from __future__ import annotations

import numpy as np
from support import product_of_exponentials

import niryo_jax as nj
from benchmarks.random_arms import FAMILIES as FAMILIES
from benchmarks.random_arms import arm as arm


def joint_vectors(robot: nj.Robot, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, n) joint values, slides within a metre."""
    q = rng.uniform(-np.pi, np.pi, (count, robot.joints))
    return np.where(turns(robot), q, q / np.pi)


def turns(robot: nj.Robot) -> np.ndarray:
    """(n,) whether a joint is revolute."""
    return np.any(np.asarray(robot.screws)[:, :3] != 0, axis=1)


def apart(robot: nj.Robot, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The largest difference of a joint, whole turns left out."""
    difference = a - b
    wrapped = (difference + np.pi) % (2 * np.pi) - np.pi
    return np.abs(np.where(turns(robot), wrapped, difference)).max(axis=-1)


def off_by(
    robot: nj.Robot, rng: np.random.Generator, size: float, *, limited: bool = False
) -> nj.Robot:
    """The arm with each axis moved (metres) and tilted (radians) by about `size`, without limits
    unless it is to be `limited` as before."""
    w, v = np.asarray(robot.screws)[:, :3], np.asarray(robot.screws)[:, 3:]
    points = np.cross(w, v) + size * rng.standard_normal(w.shape)
    axes = w + size * rng.standard_normal(w.shape)
    limits = {"lower": robot.lower, "upper": robot.upper} if limited else {}
    return nj.Robot.from_axes(axes, points, robot.home, **limits)


def posed(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """Poses (..., 4, 4) of joint vectors, rounded from extended precision."""
    return product_of_exponentials(robot.screws, robot.home, q).astype(float)


def check_closes(
    robot: nj.Robot, answer: nj.IKSolutions, pose: np.ndarray, within: float = 1e-10
) -> None:
    """All that is found takes its pose (..., 4, 4), to `within`, and is counted."""
    found = np.asarray(answer.found)
    wanted = np.broadcast_to(np.asarray(pose)[..., None, :, :], (*found.shape, 4, 4))[found]
    np.testing.assert_allclose(posed(robot, np.asarray(answer.q)[found]), wanted, atol=within)
    np.testing.assert_array_equal(found.sum(axis=-1), answer.count)


def forward(robot: nj.Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (..., 4, 4) and space Jacobians (..., 6, n), screw by screw, in numpy."""
    screws = np.asarray(robot.screws)
    pose = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    columns = []
    for screw, angle in zip(screws, np.moveaxis(q, -1, 0)):
        w, v = screw[:3], screw[3:]
        rotation, position = pose[..., :3, :3], pose[..., :3, 3]
        turned = rotation @ w
        columns.append(np.concatenate([turned, rotation @ v + np.cross(position, turned)], axis=-1))
        step = np.zeros((*q.shape[:-1], 4, 4))
        step[..., 3, 3] = 1
        hat = np.cross(np.eye(3), w)
        sin, cos = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
        step[..., :3, :3] = np.eye(3) + sin * hat + (1 - cos) * hat @ hat
        centre = np.cross(w, v)
        moved = angle[..., None] * v if not np.any(w) else centre - step[..., :3, :3] @ centre
        step[..., :3, 3] = moved
        pose = pose @ step
    return pose @ np.asarray(robot.home), np.stack(columns, axis=-1)


def search(
    robot: nj.Robot, pose: np.ndarray, starts: int, rng: np.random.Generator, steps: int = 60
) -> list[np.ndarray]:
    """The different solutions of one pose (4, 4) that damped Newton steps from random joint vectors
    end at."""
    q = joint_vectors(robot, starts, rng)
    for _ in range(steps):
        reached, jacobian = forward(robot, q)
        turn = pose[:3, :3] @ np.swapaxes(reached[..., :3, :3], -1, -2)
        w = 0.5 * np.stack(
            [
                turn[..., 2, 1] - turn[..., 1, 2],
                turn[..., 0, 2] - turn[..., 2, 0],
                turn[..., 1, 0] - turn[..., 0, 1],
            ],
            axis=-1,
        )
        # The twist in the space frame that carries the tool's origin to its goal.
        away = pose[:3, 3] - reached[..., :3, 3]
        twist = np.concatenate([w, away - np.cross(w, reached[..., :3, 3])], axis=-1)
        damping = 1e-3 * np.minimum(np.sum(twist**2, axis=-1), 1.0)[..., None, None]
        normal = np.swapaxes(jacobian, -1, -2) @ jacobian + damping * np.eye(robot.joints)
        normal = normal + 1e-14 * np.eye(robot.joints)
        step = np.linalg.solve(normal, np.swapaxes(jacobian, -1, -2) @ twist[..., None])[..., 0]
        q = q + np.clip(step, -0.5, 0.5)
    reached, _ = forward(robot, q)
    good = q[np.abs(reached - pose).max(axis=(1, 2)) < 1e-10]
    found: list[np.ndarray] = []
    for candidate in good:
        if all(apart(robot, candidate, other) > 1e-5 for other in found):
            found.append(candidate)
    return found


def turned_apart(a: object, b: np.ndarray) -> np.ndarray:
    """(...,) the farthest of the joints of (..., n), up to whole turns."""
    return np.abs((np.asarray(a) - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


def has(answer: nj.IKSolutions, q: np.ndarray, within: float = 1e-5) -> np.ndarray:
    """(...,) whether joint vectors (..., n) are among the solutions."""
    return np.any(
        (turned_apart(answer.q, q[..., None, :]) < within) & np.asarray(answer.found), axis=-1
    )
