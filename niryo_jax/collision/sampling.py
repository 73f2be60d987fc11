"""Which pairs of capsules are worth looking at, found by sampling joint vectors."""

from __future__ import annotations

import dataclasses
import math
import sys

import jax
import numpy as np

from niryo_jax.arguments import check_count, check_number
from niryo_jax.collision.clearance import distances
from niryo_jax.collision.model import CollisionModel, check_is_model
from niryo_jax.robot import Robot, check_is_robot

_AT_ONCE = 4096
"""So many joint vectors are looked at in one call."""


@dataclasses.dataclass(frozen=True)
class Pruned:
    """A model without the pairs of which nothing is to be learned.

    Attributes:
        model: with the pairs that are left.
        always: the names of those that touch in nearly every posture: capsules that overlap by how
            they were chosen.
        never: of those that never came near.
        samples: how many joint vectors were looked at.
    """

    model: CollisionModel
    always: tuple[tuple[str, str], ...]
    never: tuple[tuple[str, str], ...]
    samples: int


def prune(
    robot: Robot,
    model: CollisionModel,
    *,
    samples: int = 16_384,
    seed: int = 0,
    always: float = 0.95,
    near: float = 0.02,
) -> Pruned:
    """Leave out the pairs that touch in nearly every posture, and those that never come near.

    It is what planners' setup assistants do, and no proof: between samples a pair can come nearer
    than in any of them, for which `near` leaves room.

    Args:
        robot: the arm, concrete; joint vectors are drawn evenly between its limits, between -pi and
            pi where it has none.
        model: its shape, concrete.
        samples: how many.
        seed: the same one draws the same.
        always: the share of postures in which a pair touches, from which on it is left out.
        near: metres that a pair which never comes near keeps in all postures.

    Raises:
        ValueError: counts, shares or lengths out of range, and as `clearance`.
        TypeError: no numbers, a traced robot, and as `clearance`.
    """
    check_is_robot(robot)
    check_is_model(model)
    robot.known_screws()
    count = check_count("samples", samples, 1, 10_000_000)
    check_count("seed", seed, 0, sys.maxsize)
    share = check_number("always", always, "a share above 0", lambda x: 0 < x <= 1)
    apart = check_number("near", near, "0 or more", lambda x: 0 <= x < math.inf)
    lower, upper = (
        np.nan_to_num(np.asarray(x, float), neginf=-np.pi, posinf=np.pi)
        for x in (robot.lower, robot.upper)
    )
    rng = np.random.default_rng(seed)
    pairs = len(model.pairs)
    touching, least, done = np.zeros(pairs), np.full(pairs, np.inf), 0
    while done < count and pairs:
        q = rng.uniform(lower, upper, (min(_AT_ONCE, count), robot.joints))
        found = np.asarray(jax.device_get(distances(robot, model, q).distance))[: count - done]
        touching += np.sum(found <= 0, axis=0)
        least = np.minimum(least, np.min(found, axis=0))
        done += len(found)
    names = model.pair_names()
    often = touching >= share * count
    far = least > apart
    gone = [tuple(name for name, is_so in zip(names, flags) if is_so) for flags in (often, far)]
    return Pruned(model.allow([*gone[0], *gone[1]]), gone[0], gone[1], count)
