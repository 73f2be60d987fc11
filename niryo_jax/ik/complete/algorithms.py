"""What complete inverse kinematics does with an arm: a scan with a proof, or a closed form."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

from niryo_jax import lanes
from niryo_jax.chain import joint_motion
from niryo_jax.ik.closed_form import families
from niryo_jax.ik.complete.general_arm import solve_general_arm
from niryo_jax.ik.complete.second_pass import by_polish, by_subdivision
from niryo_jax.ik.offset_wrist.parameters import OffsetWristParameters, parameters_from
from niryo_jax.ik.offset_wrist.scan import scan_candidates
from niryo_jax.ik.offset_wrist.wrist_circle import reason_out_of_reach, wrist_circle
from niryo_jax.ik.results.candidates import Candidates
from niryo_jax.ik.results.limits import Limits
from niryo_jax.ik.results.ranking import Answer
from niryo_jax.ik.results.solutions import SLOTS
from niryo_jax.ik.results.status import UnreachableReason
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.lie import se3
from niryo_jax.specialise import Geometry
from niryo_jax.structure.closure import ByClosure
from niryo_jax.structure.families import ClosedFormPlan
from niryo_jax.structure.offset_wrist import KnownNumbers


class Goal(NamedTuple):
    """What is asked for.

    Attributes:
        pose: (rows, 4, 4) rigid motions.
        held: (rows, 1) the value of the joint that is locked, or the arm angle; or (rows, 0).
    """

    pose: jax.Array
    held: jax.Array


class Algorithm(Protocol):
    """How the complete method solves one kind of arm."""

    def second_pass(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """The answers of poses, whatever it takes."""
        ...


@runtime_checkable
class TwoPasses(Algorithm, Protocol):
    """What solves most poses of a large batch sooner than the others."""

    @property
    def periodic(self) -> tuple[bool, ...]:
        """True for each joint that returns to its place after 2 pi."""
        ...

    @property
    def slots(self) -> int:
        """The most solutions that there can be."""
        ...

    @property
    def sheets(self) -> bool:
        """Whether several solutions of a pose can have the same label."""
        ...

    @property
    def tolerance(self) -> jax.Array | float:
        """Metres and radians by which an arm of fewer than six joints may miss a pose."""
        ...

    def free_arm(self, held: jax.Array) -> Geometry:
        """The arm that is left where a joint is locked; its lanes have the shape (...,) of
        `held` (..., 1), or none."""
        ...

    def first_pass(
        self, geometry: Geometry, target: Lanes, goal: Goal
    ) -> tuple[Candidates, jax.Array]:
        """The candidates, and (rows,) an `UnreachableReason`; `target` is the pose of `goal`."""
        ...


@dataclasses.dataclass(frozen=True)
class OffsetWrist:
    """Axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet, and axis 6 misses that point."""

    whole: Geometry
    arm: OffsetWristParameters
    periodic = (True,) * 6
    slots = SLOTS
    sheets = True
    tolerance = 0.0

    def free_arm(self, held: jax.Array) -> Geometry:
        """The whole arm."""
        del held
        return self.whole

    def first_pass(
        self, geometry: Geometry, target: Lanes, goal: Goal
    ) -> tuple[Candidates, jax.Array]:
        """By a scan of few nodes."""
        del geometry
        rows, dtype = goal.pose.shape[0], goal.pose.dtype
        circle = wrist_circle(self.arm, target)
        candidates = scan_candidates(self.arm, circle, rows, dtype)
        return candidates, reason_out_of_reach(self.arm, circle, rows, dtype)

    def second_pass(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """By subdivision."""
        return by_subdivision(self.whole, self.arm, goal.pose, live, limits, self.slots)


@dataclasses.dataclass(frozen=True)
class ClosedForm:
    """An arm of one of `niryo_jax.structure.families`."""

    whole: Geometry
    plan: ClosedFormPlan
    off: Lane
    tolerance: jax.Array
    sheets = False

    @property
    def periodic(self) -> tuple[bool, ...]:
        """True for each joint that returns to its place after 2 pi."""
        return self.plan.periodic

    @property
    def slots(self) -> int:
        """The most solutions that there can be."""
        return 2**self.plan.family.signs

    def free_arm(self, held: jax.Array) -> Geometry:
        """The arm without the locked joint."""
        joint = self.plan.locked
        return self.whole if joint is None else _without(self.whole, joint, held)

    def first_pass(
        self, geometry: Geometry, target: Lanes, goal: Goal
    ) -> tuple[Candidates, jax.Array]:
        """In closed form; there is no other proof than that it has no root."""
        rows, dtype = goal.pose.shape[0], goal.pose.dtype
        angle = Lane(goal.held[:, 0]) if self.plan.by_arm_angle else None
        candidates = families.candidates(
            self.plan.family, geometry, target, angle, self.off, rows, dtype
        )
        return candidates, jnp.full(rows, UnreachableReason.NONE, jnp.int32)

    def second_pass(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """The same candidates, polished by Newton's method."""
        geometry = self.free_arm(goal.held)
        target = lanes.contiguous_lanes(goal.pose, 2)
        candidates, _ = self.first_pass(geometry, target, goal)
        return by_polish(
            geometry,
            candidates,
            goal.pose,
            live,
            limits,
            self.periodic,
            self.slots,
            self.tolerance,
        )


def _without(whole: Geometry, joint: int, held: jax.Array) -> Geometry:
    """The arm without a joint, whose motion at values (..., 1) is part of what comes behind it."""
    rotation, position = _motion(whole, joint, held)

    def moved(screw: Lanes) -> Lanes:
        return lanes.materialised(se3.adjoint_lanes(rotation, position, screw))

    behind = [moved(screw) for screw in whole.screws[joint + 1 :]]
    home_rotation, home = se3.split(whole.home)
    pose = se3.assemble(rotation @ home_rotation, rotation @ home + position)
    kinds = whole.kinds[:joint] + whole.kinds[joint + 1 :]
    screws = np.stack([*whole.screws[:joint], *behind])
    return Geometry(screws, lanes.materialised(pose), kinds)


def _motion(whole: Geometry, joint: int, held: jax.Array) -> tuple[Lanes, Lanes]:
    rotation, position = joint_motion(whole, joint, Lane(held[..., 0]))
    return lanes.materialised(rotation), lanes.materialised(position)


@dataclasses.dataclass(frozen=True)
class GeneralArm:
    """Six revolute joints of any geometry, or seven of which the first or the last is locked, by
    the roots of one polynomial."""

    whole: Geometry
    structure: ByClosure
    numbers: jax.Array

    def second_pass(self, goal: Goal, live: jax.Array, limits: Limits) -> Answer:
        """By all ways of elimination that it takes."""
        arm, pose, joint = self.whole, goal.pose, self.structure.locked
        if joint == 0:
            # The target moves back, and the other joints stay where they are.
            rotation, position = _motion(arm, 0, goal.held)
            turned, place = se3.split(lanes.unpack(pose, 2))
            back = se3.assemble(rotation.T @ turned, rotation.T @ (place - position))
            pose = lanes.pack(lanes.materialised(back), live.shape, pose.dtype)
            arm = Geometry(arm.screws[1:], arm.home, arm.kinds[1:])
        elif joint is not None:
            arm = _without(arm, joint, goal.held)
        return solve_general_arm(arm, self.numbers, pose, live, limits)


Structure = KnownNumbers | ClosedFormPlan | ByClosure
"""What is known of an arm while tracing, for the algorithm that fits it."""


def algorithm_for(
    structure: Structure, geometry: Geometry, numbers: jax.Array, tolerance: jax.Array
) -> Algorithm:
    """The algorithm of an arm.

    Args:
        structure: what is known of it while tracing.
        geometry: the arm.
        numbers: the other numbers of an offset-wrist arm, those of each way of elimination of a
            general one, and of a closed form by how much an arm is off that is not exact.
        tolerance: metres and radians by which an arm of fewer than six joints may miss a pose.
    """
    if isinstance(structure, ClosedFormPlan):
        off = Lane(0.0) if structure.is_exact else Lane(numbers[0])
        return ClosedForm(geometry, structure, off, tolerance)
    if isinstance(structure, ByClosure):
        return GeneralArm(geometry, structure, numbers)
    return OffsetWrist(geometry, parameters_from(structure, list(numbers)))
