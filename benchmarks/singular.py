"""Joint vectors next to singular postures, of any arm, found in plain numpy.

How near a posture is to a singular one is measured by the smallest singular value of its space
Jacobian (metres and radians mixed): 0 where the tool loses a direction of motion. Wrists that are
straight, elbows that are stretched and postures that have no name are all of them.
"""

from __future__ import annotations

import numpy as np

import niryo_jax as nj
from benchmarks.reference import space_jacobian

STEPS = 60
SINGULAR = 1e-11
"""Smallest singular value at which a posture counts as singular."""

FARTHEST = 0.1
"""Radians (metres) by which a posture is moved away from the singular one at most."""


def limits(robot: nj.Robot) -> tuple[np.ndarray, np.ndarray]:
    """(n,) and (n,): a joint without limits has a whole turn."""
    low, high = np.asarray(robot.lower), np.asarray(robot.upper)
    return np.nan_to_num(low, neginf=-np.pi), np.nan_to_num(high, posinf=np.pi)


def smallest(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N,): the smallest singular value of the Jacobian."""
    return np.linalg.svd(space_jacobian(robot, q), compute_uv=False)[:, -1]


def near(robot: nj.Robot, size: float, count: int, seed: int) -> np.ndarray:
    """Joint vectors within the limits whose smallest singular value is `size`, to a tenth of it.

    Args:
        robot: the arm.
        size: the singular value wanted.
        count: how many joint vectors at most.
        seed: of the random postures from which singular ones are looked for.

    Returns:
        (k, n) with k <= count: fewer where the arm has few singular postures within its limits.
    """
    rng = np.random.default_rng(seed)
    low, high = limits(robot)
    singular = _singular(robot, rng.uniform(low, high, (8 * count, robot.joints)))
    inside = np.all((singular >= low) & (singular <= high), axis=1)
    singular = singular[inside & (smallest(robot, singular) < SINGULAR)]
    direction = rng.standard_normal(singular.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    away = np.full((len(singular), 1), size)
    for _ in range(STEPS):
        now = smallest(robot, singular + away * direction)
        away = np.minimum(away * np.clip(size / np.maximum(now, 1e-300), 0.5, 2)[:, None], FARTHEST)
    q = singular + away * direction
    kept = np.all((q >= low) & (q <= high), axis=1)
    kept &= np.abs(smallest(robot, q) - size) < 0.1 * size
    return q[kept][:count]


def _singular(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N, n): Newton's steps on the smallest singular value; some fail.

    With u and v the singular vectors, its rate with joint k is u' (dJ / dq_k) v, and column j > k
    of the space Jacobian has the rate [J_k, J_j].
    """
    for _ in range(STEPS):
        jacobian = space_jacobian(robot, q)
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        u, v = left[:, :, -1], right[:, -1]
        w, p = jacobian[:, :3], jacobian[:, 3:]
        gradient = np.zeros_like(q)
        for k in range(robot.joints - 1):
            # Columns j > k, weighted by v and summed: the bracket is linear.
            rest_w = np.einsum("bij,bj->bi", w[:, :, k + 1 :], v[:, k + 1 :])
            rest_p = np.einsum("bij,bj->bi", p[:, :, k + 1 :], v[:, k + 1 :])
            turned = np.cross(w[:, :, k], rest_w)
            moved = np.cross(w[:, :, k], rest_p) + np.cross(p[:, :, k], rest_w)
            gradient[:, k] = np.sum(u * np.concatenate([turned, moved], axis=1), axis=1)
        square = np.sum(gradient**2, axis=1, keepdims=True)
        step = values[:, -1:] * gradient / np.maximum(square, 1e-30)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        q = q - step * np.minimum(1, 0.5 / np.maximum(length, 1e-30))
    return q
