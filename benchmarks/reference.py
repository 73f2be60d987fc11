"""The product of exponentials in plain numpy, vectorised over the batch: a rival and a judge."""

from __future__ import annotations

import numpy as np

import niryo_jax as nj


def hat(w: np.ndarray) -> np.ndarray:
    """The matrix of w x."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def chain(robot: nj.Robot, q: np.ndarray) -> list[np.ndarray]:
    """exp([S1] q1) ... exp([Si] qi) for i = 0..n, vectorised over the batch, in plain numpy."""
    motions = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for screw, angle in zip(robot.screws, q.T):
        w = hat(screw[:3])
        sin, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
        motion = np.zeros((len(q), 4, 4))
        motion[:, :3, :3] = np.eye(3) + sin * w + versine * (w @ w)
        along = sin[:, 0] if np.any(w) else angle[:, None]
        motion[:, :3, 3] = along * screw[3:] + versine[:, 0] * (w @ screw[3:])
        motion[:, 3, 3] = 1
        motions.append(motions[-1] @ motion)
    return motions


def forward_kinematics(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N, 4, 4)."""
    return chain(robot, q)[-1] @ robot.home


def space_jacobian(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N, 6, n)."""
    columns = []
    for screw, motion in zip(robot.screws, chain(robot, q)):
        w = motion[:, :3, :3] @ screw[:3]
        v = motion[:, :3, :3] @ screw[3:] + np.cross(motion[:, :3, 3], w)
        columns.append(np.concatenate([w, v], axis=1))
    return np.stack(columns, axis=-1)
