"""An independent judge of inverse kinematics: every solution, by brute force, in plain numpy.

For six revolute axes of which 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet; with any wrist
offset, also none. Two ways are taken, and the union of what they find is the answer:

- a dense scan of theta6, on the 2 x 2 branches of shoulder and elbow, with nodes graded towards
  every place where a branch begins, ends or bends sharply;
- Newton-Raphson on the whole pose, from random joint vectors and from mirrored solutions.

Every solution is verified by the product of exponentials. The answer is complete where solutions
are isolated; of a continuum (an exactly singular pose) it holds a few members. Metres, radians.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from theta6_scan import Elbow as Elbow
from theta6_scan import Geometry, rodrigues, scan
from theta6_scan import turn_between as turn_between

CLOSES = 1e-13
"""A joint vector is a solution where it misses the pose by less than this, metres and radians.

Rounding leaves 3e-15. Near a singularity much that is not a solution misses by little.
"""

MERGE = 1e-5
"""Solutions closer than this in every joint, modulo 2 pi, count as one (near-double roots)."""

SCAN_CHUNK = 64
NEWTON_CHUNK = 1 << 15
EPS = float(np.finfo(np.float64).eps)


class Solutions(NamedTuple):
    """All solutions of P poses, in K slots.

    Attributes:
        q: (P, K, 6) joint vectors in (-pi, pi]; zeros in the empty slots, which come last.
        found: (P, K) whether the slot holds a solution.
        singular: (P, K) the least singular value of the geometric Jacobian at the tool point.
    """

    q: np.ndarray
    found: np.ndarray
    singular: np.ndarray

    @property
    def count(self) -> np.ndarray:
        """(P,) the number of solutions."""
        return self.found.sum(axis=1)


def exhaustive(
    screws: np.ndarray,
    home: np.ndarray,
    poses: np.ndarray,
    *,
    nodes: int = 2048,
    starts: int = 12,
    seed: int = 0,
) -> Solutions:
    """All joint vectors that bring the tool to each pose (P, 4, 4); joint limits are ignored.

    Args:
        screws: (6, 6) screw axes (omega, v), space frame.
        home: (4, 4) tool pose at q = 0.
        poses: (P, 4, 4) rigid motions.
        nodes: evenly spaced values of theta6; about 1,200 graded ones are added.
        starts: random starts of Newton-Raphson a pose; 0 leaves the second way out altogether.
        seed: of the random starts.
    """
    arm = Geometry.of(screws)
    home, poses = np.asarray(home, float), np.asarray(poses, float)
    rng = np.random.default_rng(seed)
    owner, q = [np.zeros(0, int)], [np.zeros((0, 6))]
    for first in range(0, len(poses), SCAN_CHUNK):
        who, guess = scan(arm, home, poses[first : first + SCAN_CHUNK], nodes)
        owner.append(who + first)
        q.append(guess)
    owner, q = np.concatenate(owner), np.concatenate(q)
    q = polish(arm, home, poses, owner, q)
    known = distinct(arm, home, poses, owner, q)
    if not starts or not len(poses):
        return known
    owner, q = np.nonzero(known.found)[0], known.q[known.found]
    for who, start in _starts(rng, owner, q, len(poses), starts):
        reached = newton(arm, home, poses, who, start, 24)
        keep = residual(arm, home, poses, who, reached) < 1e-6
        owner = np.concatenate([owner, who[keep]])
        q = np.concatenate([q, polish(arm, home, poses, who[keep], reached[keep])])
    return distinct(arm, home, poses, owner, q)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(..., 6) -> (...,): the largest joint difference modulo 2 pi, radians."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


# The whole pose: product of exponentials, Jacobian, Newton-Raphson.


def forward(arm: Geometry, home: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
    """(n, 6) -> rotations (n, 3, 3), positions (n, 3), geometric Jacobians (n, 6, 6)."""
    rotation = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    shift = np.zeros((len(q), 3))
    axes, points = [], []
    for i in range(6):
        turn = rodrigues(arm.axis[i], q[:, i])
        axes.append(rotation @ arm.axis[i])
        points.append(rotation @ arm.point[i] + shift)
        rotation = rotation @ turn
        shift = points[-1] - rotation @ arm.point[i]
    position = rotation @ home[:3, 3] + shift
    columns = [np.concatenate([w, np.cross(w, position - r)], axis=1) for w, r in zip(axes, points)]
    return rotation @ home[:3, :3], position, np.stack(columns, axis=2)


def misses(arm, home, poses, owner, q) -> tuple[np.ndarray, np.ndarray]:
    """How q (n, 6) misses poses[owner]: rotation vector and translation (n, 6); Jacobians."""
    rotation, position, jacobian = forward(arm, home, q)
    error = poses[owner, :3, :3] @ np.swapaxes(rotation, 1, 2)
    skew = np.stack([error[:, i, j] - error[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1) / 2
    sine = np.linalg.norm(skew, axis=1)
    cosine = (np.trace(error, axis1=1, axis2=2) - 1) / 2
    scale = np.where(sine > 1e-8, np.arctan2(sine, cosine) / np.maximum(sine, 1e-8), 1.0)
    # A half turn has no skew part; half a turn about anything is then as good a guess as any.
    skew = np.where((sine < 1e-8) & (cosine < 0), np.pi / np.sqrt(3), skew.T * scale).T
    return np.concatenate([skew, poses[owner, :3, 3] - position], axis=1), jacobian


def residual(arm, home, poses, owner, q) -> np.ndarray:
    """(n,) the larger of the rotation (radians) and the position (metres) by which q misses."""
    error = misses(arm, home, poses, owner, q)[0]
    return np.maximum(np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1))


def _step(jacobian: np.ndarray, error: np.ndarray, longest: float) -> np.ndarray:
    try:
        step = np.linalg.solve(jacobian, error[..., None])[..., 0]
    except np.linalg.LinAlgError:  # numpy refuses a whole batch for one singular matrix
        step = (np.linalg.pinv(jacobian, rcond=EPS) @ error[..., None])[..., 0]
    return step * np.minimum(1.0, longest / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]


def newton(arm, home, poses, owner, q, iterations: int) -> np.ndarray:
    """Plain Newton-Raphson with a bounded step, for global search; (n, 6) -> (n, 6)."""
    q = q.copy()
    active = np.arange(len(q))
    for _ in range(iterations):
        error, jacobian = misses(arm, home, poses, owner[active], q[active])
        going = np.abs(error).max(axis=1) > 1e-9
        active, error, jacobian = active[going], error[going], jacobian[going]
        if not len(active):
            break
        q[active] += _step(jacobian, error, 0.8)
    return q


def polish(arm, home, poses, owner, q, iterations: int = 24) -> np.ndarray:
    """Newton-Raphson that never gets worse, down to rounding; (n, 6) -> (n, 6).

    At a nearly double root the full step can leap away; it is then cut until the pose is missed
    by less than before.
    """
    best = q.copy()
    for part in np.split(np.arange(len(q)), range(NEWTON_CHUNK, len(q), NEWTON_CHUNK)):
        error, jacobian = misses(arm, home, poses, owner[part], best[part])
        cut = np.ones(len(part))
        for _ in range(iterations):
            trial = best[part] + cut[:, None] * _step(jacobian, error, 0.5)
            new_error, new_jacobian = misses(arm, home, poses, owner[part], trial)
            better = np.linalg.norm(new_error, axis=1) < np.linalg.norm(error, axis=1)
            best[part[better]] = trial[better]
            error[better], jacobian[better] = new_error[better], new_jacobian[better]
            cut = np.where(better, 1.0, cut / 4)
            going = (np.linalg.norm(error, axis=1) > EPS) & (cut > 1e-4)
            part, error, jacobian, cut = part[going], error[going], jacobian[going], cut[going]
            if not len(part):
                break
    return best


def spread(singular: np.ndarray) -> np.ndarray:
    """How far rounding of the pose alone can move a solution, radians.

    A pose is known to a few units of rounding, and a joint vector to that over the least singular
    value of the Jacobian: at most 1e-3, but where the rounding of the nine entries of a rotation
    (1.5 units of their size in all) alone explains more.
    """
    units = EPS / np.maximum(singular, 1e-300)
    return np.maximum(np.minimum(200 * units, 1e-3), np.minimum(2 * units, 0.1))


def distinct(arm, home, poses, owner, q) -> Solutions:
    """The verified ones among q (n, 6) for poses[owner], the same ones told once, best first."""
    error = residual(arm, home, poses, owner, q)
    good = error < CLOSES
    order = np.lexsort((error[good], owner[good]))
    owner, q = owner[good][order], q[good][order]
    q = np.pi - (np.pi - q) % (2 * np.pi)
    kept, who, singular = [], [], []
    while len(owner):
        # One round takes the best of each pose and drops all that are the same as it.
        first = np.unique(owner, return_index=True)[1]
        least = np.linalg.svd(forward(arm, home, q[first])[2], compute_uv=False)[:, -1]
        kept.append(q[first])
        who.append(owner[first])
        singular.append(least)
        mine = np.repeat(np.arange(len(first)), np.diff([*first, len(owner)]))
        # Rounding spreads one solution along a line of near-solutions; between two there is none.
        between = (q[first][mine] - q + np.pi) % (2 * np.pi) - np.pi
        distance = np.abs(between).max(axis=1)
        alike = distance < MERGE
        maybe = np.nonzero(~alike & (distance < spread(least)[mine]))[0]
        halfway = q[maybe] + between[maybe] / 2
        alike[maybe] = residual(arm, home, poses, owner[maybe], halfway) < 10 * CLOSES
        owner, q = owner[~alike], q[~alike]
    out = Solutions(
        np.zeros((len(poses), max(len(kept), 1), 6)),
        np.zeros((len(poses), max(len(kept), 1)), bool),
        np.zeros((len(poses), max(len(kept), 1))),
    )
    for slot, (row, solution, least) in enumerate(zip(who, kept, singular)):
        out.q[row, slot], out.found[row, slot], out.singular[row, slot] = solution, True, least
    return out


def _starts(rng, owner, q, poses: int, starts: int):
    """Parts (owner, start) of the starts: random ones, and known solutions q (n, 6) mirrored."""
    half = np.pi
    flips = np.array([[0, 0, 0, half, 0, half], [half, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0.0]])
    signs = np.array([[1, 1, 1, 1, -1, 1], [1, -1, 1, 1, 1, 1], [1, 1, -1, 1, 1, 1.0]])
    who = np.concatenate([np.repeat(np.arange(poses), starts), np.repeat(owner, 3)])
    mirrored = (q[:, None] * signs + flips + rng.normal(0, 0.1, (len(q), 3, 6))).reshape(-1, 6)
    start = np.concatenate([rng.uniform(-np.pi, np.pi, (poses * starts, 6)), mirrored])
    for first in range(0, len(who), NEWTON_CHUNK):
        yield who[first : first + NEWTON_CHUNK], start[first : first + NEWTON_CHUNK]
