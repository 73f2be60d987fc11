"""The arms and poses of the inverse kinematics benchmark, and a judge of answers in plain numpy.

Nothing here uses a solver of the package: an answer is right when a product of exponentials in
numpy takes it to the pose. Angles in radians, lengths in metres.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

import niryo_jax as nj
from benchmarks.reference import forward_kinematics, space_jacobian
from niryo_jax.robots import NIRYO_ONE

CLOSES = 1e-6
"""A claimed solution is verified where it misses the pose by less (metres and radians)."""

CLOSES_FLOAT32 = 1e-4
"""The same for answers in float32, which rounds angles of a few radians to 2e-7."""

SAME = 1e-4
"""Two joint vectors closer than this in every joint are one solution. At a double root an error of
one rounding in the pose moves the joints by its square root, 1e-8, and more the nearer the root is
to a threefold one; other solutions of a random pose lie much farther apart than this."""

SAME_FLOAT32 = 1e-2
"""The same for answers in float32, by the same argument."""

POLISH = 3e-2
"""How far polishing may move a joint to reach the solution that an answer stands for..."""

POLISHED = 1e-9
"""... and within what (metres plus radians) it has then reached one."""

CHUNK = 16_384


@dataclasses.dataclass(frozen=True)
class Arm:
    """A six-axis arm in the two forms in which the libraries take it.

    Attributes:
        name: "niryo_one" or "spherical".
        robot: the arm.
        axes: (6, 3) directions of the axes at home.
        points: (7, 3) a point on each axis, where axes meet the meeting point; the tool at home.
        offset: metres in z from where axes 4 and 5 meet to axis 6; 0 is a spherical wrist.
    """

    name: str
    robot: nj.Robot
    axes: np.ndarray
    points: np.ndarray
    offset: float

    @property
    def steps(self) -> np.ndarray:
        """(7, 3) base to axis 1, axis 1 to axis 2, ..., axis 6 to tool: the P of IK-Geo."""
        return np.diff(self.points, axis=0, prepend=np.zeros((1, 3)))


def niryo_one() -> Arm:
    """The Niryo One."""
    return _arm("niryo_one", nj.robots.niryo_one(), NIRYO_ONE.axis_6_height)


def spherical() -> Arm:
    """The Niryo One with axis 6 and the tool moved by the wrist offset: axes 4, 5 and 6 meet."""
    robot, (_, height) = nj.robots.niryo_one(), NIRYO_ONE.wrist
    screws, home = np.array(robot.screws), np.array(robot.home)
    screws[5, 4], home[2, 3] = height, height
    name = "niryo_one_spherical"
    moved = nj.Robot.from_screws(screws, home, lower=robot.lower, upper=robot.upper, name=name)
    return _arm("spherical", moved, height)


def _arm(name: str, robot: nj.Robot, height: float) -> Arm:
    (sx, sz), (ex, ez), (wx, wz) = NIRYO_ONE.shoulder, NIRYO_ONE.elbow, NIRYO_ONE.wrist
    tool = np.asarray(robot.home)[:3, 3]
    points = [
        *([[sx, 0, sz]] * 2),
        [ex, 0, ez],
        *([[wx, 0, wz]] * 2),
        [wx, 0, height],
        tool.tolist(),
    ]
    return Arm(name, robot, np.array(robot.screws)[:, :3], np.array(points), height - wz)


ARMS: Mapping[str, Callable[[], Arm]] = {"niryo_one": niryo_one, "spherical": spherical}


def random_joints(robot: nj.Robot, count: int, seed: int) -> np.ndarray:
    """(count, n) joint vectors, uniform within the limits; a longer draw begins with the same."""
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, robot.joints))


def poses_of(robot: nj.Robot, q: np.ndarray) -> np.ndarray:
    """(N, n) -> (N, 4, 4), in pieces so that the memory needed is that of the result."""
    pose = np.empty((len(q), 4, 4))
    for i in range(0, len(q), CHUNK):
        pose[i : i + CHUNK] = forward_kinematics(robot, q[i : i + CHUNK])
    return pose


def misses(robot: nj.Robot, q: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much joint vectors miss their poses.

    Args:
        robot: the arm.
        q: (K, n) joint vectors.
        pose: (K, 4, 4) the pose that each should reach.

    Returns:
        (K,) metres and (K,) radians.
    """
    reached = poses_of(robot, q)
    position = np.linalg.norm(reached[:, :3, 3] - pose[:, :3, 3], axis=1)
    turn = np.swapaxes(reached[:, :3, :3], 1, 2) @ pose[:, :3, :3]
    sine = np.linalg.norm(_axial(turn), axis=1)
    return position, np.arctan2(sine, (np.trace(turn, axis1=1, axis2=2) - 1) / 2)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(..., n) joint vectors -> (...,) their largest joint difference, whole turns ignored."""
    turns = a - b
    return np.max(np.abs(turns - 2 * np.pi * np.round(turns / (2 * np.pi))), axis=-1, initial=0)


def polished(robot: nj.Robot, q: np.ndarray, pose: np.ndarray, steps: int = 12) -> np.ndarray:
    """(K, n) joint vectors after Levenberg-Marquardt steps to the nearest solution.

    It makes the answers of solvers of different accuracy comparable with one another. A step that
    does not come nearer, or leads farther than POLISH from the answer, is not taken.
    """
    best, error = q, np.add(*misses(robot, q, pose))
    for _ in range(steps):
        reached = forward_kinematics(robot, best)
        turn = pose[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2)
        w, p = _axial(turn), reached[:, :3, 3]
        twist = np.concatenate([w, pose[:, :3, 3] - p - np.cross(w, p)], axis=1)
        jacobian = space_jacobian(robot, best)
        transposed = np.swapaxes(jacobian, 1, 2)
        damping = (error**2 + 1e-30)[:, None, None] * np.eye(q.shape[1])
        step = np.linalg.solve(transposed @ jacobian + damping, transposed @ twist[..., None])
        now = best + step[..., 0]
        missed = np.add(*misses(robot, now, pose))
        better = (missed < error) & (apart(now, q) < POLISH)
        best, error = np.where(better[:, None], now, best), np.where(better, missed, error)
    return best


def _axial(turn: np.ndarray) -> np.ndarray:
    """(K, 3, 3) -> (K, 3): the axis of a rotation times the sine of its angle."""
    skew = (turn - np.swapaxes(turn, 1, 2)) / 2
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


@dataclasses.dataclass(frozen=True)
class Answers:
    """Claimed solutions of a set of poses.

    Attributes:
        q: (K, n) joint vectors, float64.
        owner: (K,) the index of the pose each is claimed for.
        poses: how many poses were asked for.
    """

    q: np.ndarray
    owner: np.ndarray
    poses: int

    @classmethod
    def of(cls, per_pose: list[np.ndarray]) -> Answers:
        """From one (k_i, n) array a pose."""
        counts = [len(q) for q in per_pose]
        q = [np.asarray(x, dtype=np.float64).reshape(-1, 6) for x in per_pose]
        owner = np.repeat(np.arange(len(per_pose)), counts)
        return cls(np.concatenate([*q, np.zeros((0, 6))]), owner, len(per_pose))

    def first(self, poses: int) -> Answers:
        """Those of the first poses."""
        keep = self.owner < poses
        return Answers(self.q[keep], self.owner[keep], min(poses, self.poses))


def verified(arm: Arm, answers: Answers, pose: np.ndarray, single: bool = False) -> Answers:
    """The answers that close, moved to the solutions that they stand for."""
    closes = CLOSES_FLOAT32 if single else CLOSES
    position, rotation = misses(arm.robot, answers.q, pose[answers.owner])
    good = (position < closes) & (rotation < closes)
    owner = answers.owner[good]
    q = polished(arm.robot, answers.q[good], pose[owner])
    reached = np.add(*misses(arm.robot, q, pose[owner])) < POLISHED
    return Answers(q[reached], owner[reached], answers.poses)


def accuracy(
    arm: Arm, answers: Answers, pose: np.ndarray, made_by: np.ndarray, single: bool = False
) -> dict[str, float]:
    """Residuals of the claimed solutions, how many are wrong, and how often the joint vector that
    made the pose is among them.

    Args:
        arm: the arm.
        answers: the claims, for the first poses of `pose`.
        pose, made_by: (N, 4, 4) and (N, n).
        single: whether they come from float32.
    """
    closes, same = (CLOSES_FLOAT32, SAME_FLOAT32) if single else (CLOSES, SAME)
    position, rotation = misses(arm.robot, answers.q, pose[answers.owner])
    spurious = ~((position < closes) & (rotation < closes))
    hit = apart(answers.q, made_by[answers.owner]) < same
    some = len(answers.q) > 0
    return {
        "poses": answers.poses,
        "claimed": len(answers.q),
        "spurious": int(spurious.sum()),
        "made_by_lost": answers.poses - len(np.unique(answers.owner[hit])),
        "position_max": float(position.max()) if some else 0.0,
        "position_median": float(np.median(position)) if some else 0.0,
        "rotation_max": float(rotation.max()) if some else 0.0,
        "rotation_median": float(np.median(rotation)) if some else 0.0,
    }


def union_and_recall(
    sets: Mapping[str, Answers], poses: int
) -> tuple[list[np.ndarray], dict[str, dict[str, float]]]:
    """All verified solutions of each pose, and what share of them each solver has.

    Args:
        sets: name -> verified answers for at least `poses` poses.
        poses: the number of poses compared.

    Returns:
        One (u_i, n) array a pose, and name -> {"recall": share of all solutions, "complete": share
        of the poses of which no solution is missing, "repeated": claims that repeat another}.
    """
    union: list[np.ndarray] = []
    tally = {name: {"recall": 0.0, "complete": 0.0, "repeated": 0.0} for name in sets}
    for pose in range(poses):
        mine = {name: s.q[s.owner == pose] for name, s in sets.items()}
        all_of_it = distinct(np.concatenate(list(mine.values())))
        union.append(all_of_it)
        for name, q in mine.items():
            near = apart(all_of_it[:, None], q[None]) < SAME
            hits = int(near.any(axis=1).sum())
            tally[name]["recall"] += hits
            tally[name]["complete"] += hits == len(all_of_it)
            tally[name]["repeated"] += len(q) - hits
    total = sum(len(q) for q in union)
    for share in tally.values():
        share["recall"] /= max(1, total)
        share["complete"] /= max(1, poses)
    return union, tally


def distinct(q: np.ndarray) -> np.ndarray:
    """(K, n) -> (k, n): the first of each group of joint vectors closer than SAME."""
    kept = q[:0]
    for row in q:
        if not np.any(apart(kept, row) < SAME):
            kept = np.concatenate([kept, row[None]])
    return kept
