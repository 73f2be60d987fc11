"""Families of arms that closed forms solve: what `niryo_jax.structure.classify` looks for.

All of it is static: it says which formulas of `niryo_jax.ik.closed_form` apply, not the numbers in
them. A solver may take a chain from its other end, since exp(S1 q1) ... exp(Sn qn) = T is solved
where exp(Sn (-qn)) ... exp(S1 (-q1)) = T^-1 is.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

Surface = Literal["plane", "sphere", "general"]


@dataclasses.dataclass(frozen=True)
class Shoulder:
    """Three joints that bring a point p to a point k: exp(S1 q1) exp(S2 q2) exp(S3 q3) p = k.

    Joints 2 and 3 keep p on a plane or on a sphere, which joint 1 must bring k to; or the axes are
    in general position, which takes the roots of a quartic.

    Attributes:
        kinds: the kinds of the joints, in the order in which they are solved.
        surface: on what the last two keep the point.
        reverse: whether they are solved from the other end, for exp(-S3 q3) ... k = p.
    """

    kinds: tuple[str, str, str]
    surface: Surface
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        first = self.kinds[0] == "revolute" or self.surface == "sphere"
        return first + ("revolute" in self.kinds[1:])


@dataclasses.dataclass(frozen=True)
class SphericalWrist:
    """Three axes at one end meet in a point, which the other three joints place.

    Attributes:
        shoulder: how they place it.
        reverse: whether the axes that meet are the first three.
    """

    shoulder: Shoulder
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return self.shoulder.signs + 1

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        where, others = ("1, 2, 3", "4, 5, 6") if self.reverse else ("4, 5, 6", "1, 2, 3")
        how = "axes in general position"
        if self.shoulder.surface != "general":
            how = f"two of them keep it on a {self.shoulder.surface}"
        return (
            f"axes {where} meet in one point, which joints {others} place ({how})",
            f"axes {where} in a plane, that point on another axis, joints {others} at the edge of "
            "what they reach",
        )


@dataclasses.dataclass(frozen=True)
class ThreeParallel:
    """Axes 2, 3 and 4 are parallel, 5 and 6 meet; or from the other end 3, 4, 5, and 1 and 2.

    Attributes:
        kind: the kind of the joint that is solved first.
        turns: 1 or -1 for each of the three: whether it points as the first of them does.
        reverse: whether they are counted from the other end.
    """

    kind: str
    turns: tuple[int, ...]
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 2 + (self.kind == "revolute")

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        parallel, meeting = ("3, 4 and 5", "1 and 2") if self.reverse else ("2, 3 and 4", "5 and 6")
        last = "2" if self.reverse else "5"
        return (
            f"axes {parallel} are parallel, {meeting} meet",
            f"the axes {parallel} in a plane, axis {last} turned so that the one behind it is "
            "parallel to them, the far end on axis 1",
        )


@dataclasses.dataclass(frozen=True)
class Schoenflies:
    """Four joints: three parallel axes, and a slide along them (SCARA).

    Attributes:
        slide: the index of the slide.
        turns: 1 or -1 for each of the others: whether it points as the first of them does.
    """

    slide: int
    turns: tuple[int, ...]

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 1

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        return (
            "three parallel axes and a slide along them; poses are turned about these axes only",
            "the three axes in a plane",
        )


@dataclasses.dataclass(frozen=True)
class TwoTurnsTwoSlides:
    """Four joints: two axes that are not parallel, and two slides, in any order.

    Attributes:
        turns: the indices of the axes.
        slides: the indices of the slides.
    """

    turns: tuple[int, int]
    slides: tuple[int, int]

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 0

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        return (
            "two axes that are not parallel, and two slides; four of the six coordinates of a pose",
            "the slides parallel to each other, the second axis parallel to the first",
        )


@dataclasses.dataclass(frozen=True)
class SphericalShoulderAndWrist:
    """Seven joints: axes 1, 2 and 3 meet in a point, 5, 6 and 7 in another, as in a human arm.

    What is left to choose is the arm angle (`niryo_jax.arm_angle`).
    """

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return 3

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        return (
            "axes 1, 2, 3 meet in one point and 5, 6, 7 in another",
            "either three axes in a plane, the arm stretched, the wrist on axis 1",
        )


@dataclasses.dataclass(frozen=True)
class PlanarArm:
    """Three to five joints: an axis, two or three that are parallel to each other and not to it,
    and perhaps one more that is not parallel to them: a planar arm on a turning base.

    Attributes:
        turns: 1 or -1 for each of the parallel axes: whether it points as the first of them does.
        roll: whether an axis follows them.
        reverse: whether the axes are counted from the other end.
    """

    turns: tuple[int, ...]
    roll: bool
    reverse: bool

    @property
    def signs(self) -> int:
        """How many signs tell the solutions apart."""
        return self.roll + (len(self.turns) == 3)

    def describe(self) -> tuple[str, str]:
        """The family, and its singularities."""
        joints = 1 + len(self.turns) + self.roll
        first = 1 if self.reverse else 2
        *axes, last = range(first, first + len(self.turns))
        parallel = f"axes {', '.join(map(str, axes))} and {last}"
        singular = [f"{parallel} in a plane"] * (len(self.turns) == 3)
        singular += [f"axis {joints} in line with axis 1"] * self.roll
        return (
            f"{parallel} are parallel, the others are not; {joints} of the six coordinates of a "
            "pose",
            ", ".join(singular) or "none",
        )


Family = (
    SphericalWrist
    | ThreeParallel
    | Schoenflies
    | TwoTurnsTwoSlides
    | SphericalShoulderAndWrist
    | PlanarArm
)


@dataclasses.dataclass(frozen=True)
class ClosedFormPlan:
    """How an arm is solved in closed form.

    Attributes:
        family: the family of the arm, or of what is left of it.
        locked: the index of the joint that is to be locked; None where none is.
        periodic: True for each joint of what is left that returns to its place after 2 pi.
        locked_turns: the same of the joint that is locked.
        is_exact: whether the arm is of the family to rounding (`structure.rounding`).
    """

    family: Family
    locked: int | None
    periodic: tuple[bool, ...]
    locked_turns: bool = False
    is_exact: bool = True

    @property
    def by_arm_angle(self) -> bool:
        """Whether an arm angle is to be given."""
        return isinstance(self.family, SphericalShoulderAndWrist)
