"""All solutions that many guesses lead to, in plain numpy: a judge that knows no solver of ours."""

from __future__ import annotations

import numpy as np

import niryo_jax as nj
from benchmarks.poses import distinct
from benchmarks.reference import forward_kinematics, space_jacobian

CLOSES = 1e-10
"""Metres and radians by which a solution may miss."""

STEPS = 60
LONGEST = 1.0
"""Radians (metres) of a step at most, joints together."""


def search(robot: nj.Robot, pose: np.ndarray, starts: int, seed: int) -> list[np.ndarray]:
    """Levenberg-Marquardt from random joint vectors.

    Args:
        robot: the arm; joints that turn start anywhere, whatever their limits.
        pose: (N, 4, 4).
        starts: guesses for each pose.
        seed: of the guesses.

    Returns:
        One (k, n) array for each pose, of joint vectors that differ.
    """
    rng = np.random.default_rng(seed)
    owner = np.repeat(np.arange(len(pose)), starts)
    q = rng.uniform(-np.pi, np.pi, (len(owner), robot.joints))
    missed = np.full(len(owner), np.inf)
    open_ = np.arange(len(owner))
    for _ in range(STEPS):
        twist, jacobian = _twist(robot, q[open_], pose[owner[open_]])
        missed[open_] = np.linalg.norm(twist, axis=1)
        going = missed[open_] > CLOSES
        open_, twist, jacobian = open_[going], twist[going], jacobian[going]
        if not len(open_):
            break
        transposed = np.swapaxes(jacobian, 1, 2)
        damping = np.minimum(1e-3, missed[open_] ** 2)[:, None, None] * np.eye(robot.joints)
        step = np.linalg.solve(
            transposed @ jacobian + damping + 1e-18 * np.eye(robot.joints),
            transposed @ twist[..., None],
        )[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        q[open_] += step * np.minimum(1, LONGEST / np.maximum(length, 1e-30))
    closed = missed <= CLOSES
    return [distinct(q[closed & (owner == i)]) for i in range(len(pose))]


def _twist(robot: nj.Robot, q: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 6) the motion in the space frame that is left to make, to first order; the Jacobian."""
    reached = forward_kinematics(robot, q)
    turn = pose[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2)
    skew = (turn - np.swapaxes(turn, 1, 2)) / 2
    w = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine, cosine = np.linalg.norm(w, axis=1), (np.trace(turn, axis1=1, axis2=2) - 1) / 2
    # Beyond a right angle the sine falls again: the angle itself, about the same axis.
    w = w * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-12))[:, None]
    p = reached[:, :3, 3]
    return (
        np.concatenate([w, pose[:, :3, 3] - p - np.cross(w, p)], axis=1),
        space_jacobian(robot, q),
    )
