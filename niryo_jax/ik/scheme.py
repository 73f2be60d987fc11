"""What complete inverse kinematics does with an arm: by a scan with proof, or in closed form."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import joint_motion
from niryo_jax.family import Plan
from niryo_jax.geometry import Geometry
from niryo_jax.ik import closed_form
from niryo_jax.ik.arm import Arm, arm_from
from niryo_jax.ik.arrange import Answer, Limits
from niryo_jax.ik.candidates import Candidates
from niryo_jax.ik.circle import obstacle, wrist_circle
from niryo_jax.ik.second_pass import by_polish, by_subdivision
from niryo_jax.ik.solutions import SLOTS, Obstacle
from niryo_jax.ik.sweep import spherical, sweep
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3
from niryo_jax.offset_wrist import Known


class Goal(NamedTuple):
    """What is asked for.

    Attributes:
        pose: (rows, 4, 4) rigid motions.
        locked: (rows, 1) the value of the joint that is locked, or the arm angle; or (rows, 0).
    """

    pose: jax.Array
    locked: jax.Array


class Scheme(Protocol):
    """How the complete method solves one kind of arm."""

    @property
    def periodic(self) -> tuple[bool, ...]:
        """True for each joint that returns to its place after 2 pi."""
        ...

    @property
    def slots(self) -> int:
        """The most solutions that there can be."""
        ...

    def geometry(self, locked: jax.Array) -> Geometry:
        """The arm that is left where a joint is locked; its lanes have the shape (...,) of
        `locked` (..., 1), or none."""
        ...

    def candidates(self, geometry: Geometry, goal: Goal) -> tuple[Candidates, jax.Array]:
        """The candidates, and (rows,) an `Obstacle` that proves a pose to be out of reach."""
        ...

    def again(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """The answers of poses that the candidates leave open."""
        ...


@dataclasses.dataclass(frozen=True)
class OffsetWrist:
    """Axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet."""

    whole: Geometry
    arm: Arm
    periodic = (True,) * 6

    @property
    def slots(self) -> int:
        """The most solutions that there can be."""
        return 8 if self.arm.is_spherical else SLOTS

    def geometry(self, locked: jax.Array) -> Geometry:
        """The whole arm."""
        del locked
        return self.whole

    def candidates(self, geometry: Geometry, goal: Goal) -> tuple[Candidates, jax.Array]:
        """By the scan, or in closed form where the wrist is spherical."""
        del geometry
        batch, dtype = goal.pose.shape[0], goal.pose.dtype
        circle = wrist_circle(self.arm, lanes.columns(goal.pose, 2))
        find = spherical if self.arm.is_spherical else sweep
        return find(self.arm, circle, batch, dtype), obstacle(circle, batch, dtype)

    def again(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """By subdivision, or by Newton's method where the wrist is spherical."""
        if not self.arm.is_spherical:
            return by_subdivision(self.whole, self.arm, goal.pose, live, limits, self.slots)
        found, reach = self.candidates(self.whole, goal)
        return by_polish(
            self.whole, found, reach, goal.pose, live, limits, self.periodic, self.slots
        )


@dataclasses.dataclass(frozen=True)
class ClosedForm:
    """An arm of one of `niryo_jax.families`."""

    whole: Geometry
    plan: Plan

    @property
    def periodic(self) -> tuple[bool, ...]:
        """True for each joint that returns to its place after 2 pi."""
        return self.plan.periodic

    @property
    def slots(self) -> int:
        """The most solutions that there can be."""
        return 2**self.plan.family.signs

    def geometry(self, locked: jax.Array) -> Geometry:
        """The arm without the locked joint, whose motion is part of what comes behind it."""
        joint, whole = self.plan.locked, self.whole
        if joint is None:
            return whole
        rotation, position = joint_motion(whole, joint, Lane(locked[..., 0]))
        rotation, position = lanes.stored(rotation), lanes.stored(position)

        def moved(screw: Lanes) -> Lanes:
            w = rotation @ screw[:3]
            return np.concatenate([w, rotation @ screw[3:] + lanes.cross(position, w)])

        behind = [lanes.stored(moved(screw)) for screw in whole.screws[joint + 1 :]]
        home_rotation, home = se3.split(whole.home)
        pose = se3.assemble(rotation @ home_rotation, rotation @ home + position)
        kinds = whole.kinds[:joint] + whole.kinds[joint + 1 :]
        return Geometry(np.stack([*whole.screws[:joint], *behind]), lanes.stored(pose), kinds)

    def candidates(self, geometry: Geometry, goal: Goal) -> tuple[Candidates, jax.Array]:
        """In closed form; there is no other proof than that it has no root."""
        rows, dtype = goal.pose.shape[0], goal.pose.dtype
        target = lanes.columns(goal.pose, 2)
        angle = Lane(goal.locked[:, 0]) if self.plan.by_arm_angle else None
        found = closed_form.candidates(self.plan.family, geometry, target, angle, rows, dtype)
        return found, jnp.full(rows, Obstacle.NONE, jnp.int32)

    def again(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """By Newton's method."""
        geometry = self.geometry(goal.locked)
        found, reach = self.candidates(geometry, goal)
        return by_polish(geometry, found, reach, goal.pose, live, limits, self.periodic, self.slots)


def scheme_of(key: Known | Plan, geometry: Geometry, numbers: jax.Array) -> Scheme:
    """The scheme of an arm.

    Args:
        key: what is known of it while tracing.
        geometry: the arm.
        numbers: the other numbers of an offset-wrist arm, and none of others.
    """
    if isinstance(key, Plan):
        return ClosedForm(geometry, key)
    return OffsetWrist(geometry, arm_from(key, list(numbers)))
