"""Every tolerance of the package, in one place, named by its reason."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt


class ByDtype(NamedTuple):
    """A tolerance in each floating-point type."""

    float64: float
    float32: float

    def of(self, dtype: npt.DTypeLike) -> float:
        """The value for a dtype (that of float32 for anything narrower)."""
        return self.float64 if np.dtype(dtype) == np.float64 else self.float32


SCREW_NORM = ByDtype(1e-9, 2e-6)
"""How far a screw axis given as data may be from unit length."""

TINY = 1e-30
"""Smaller squares of sines than this are taken for it, where they divide."""

PITCH = ByDtype(1e-12, 1e-6)
"""A screw axis whose |omega . v| (metres per radian) is below this is a pure rotation."""

MOTION = 1e-6
"""How far R R^T of a home or tool pose given as data may be from the identity, per entry."""

AXES_PARALLEL = ByDtype(1e-9, 2e-6)
"""Two axes are parallel where the sine of their angle is below this."""

AXES_MEET = ByDtype(1e-9, 2e-6)
"""Two axes meet where their distance (metres) is below this."""

AXES_EXACT = 2e-14
"""Axes that miss what they are taken for by less than this (metres, radians) are so to rounding."""

AXES_OFF = 100.0
"""An arm that is off what it is taken for moves the equations of its solutions by less than so many
times as much (measured: 10 times, next to singular postures)."""

AXES_NEARLY_MEET = 2e-3
"""Axes that should meet nearly do within this (metres): a millimetre is a badly made arm."""

AXES_NEARLY_PARALLEL = 2e-2
"""Axes that should be parallel nearly are where the sine of their angle is below this; where nearly
parallel axes meet is not determined."""

SUBPROBLEM_RESIDUAL = ByDtype(1e-9, 1e-4)
"""A subproblem's answer is a solution where it misses by less than this share of its lengths."""

SUBPROBLEM_COINCIDENCE = ByDtype(2e-14, 1e-5)
"""Lengths below this share of a subproblem's lengths are rounding: points on an axis, circles that
touch, axes that coincide."""

POSE_ROTATION = 1e-2
"""A target whose rotation block is farther than this (Frobenius norm) from SO(3) is refused.
Matrices printed with three decimals are within 1.5e-3; a scale error of 1 % is beyond."""

NEWTON_POSITION = ByDtype(1e-11, 2e-6)
"""Newton-Raphson has converged where the position misses by less than this (metres)..."""

NEWTON_ROTATION = ByDtype(1e-11, 5e-6)
"""... and the rotation by less than this (radians)."""

DEPENDENT_ROW = ByDtype(1e-14, 1e-6)
"""A Jacobian row that is independent of the others by less than this share is rounding."""

SELF_MOTION = ByDtype(1e-3, 1e-2)
"""On a self-motion a Jacobian row that is independent of the others by less than this share is what
the distance from it makes."""

SAME_SOLUTION = ByDtype(1e-6, 1e-3)
"""Two joint vectors closer than this in every joint (radians) are one solution."""

LIMIT_ROUNDING = ByDtype(1e-9, 1e-5)
"""A joint beyond its limit by less than this (radians) is at its limit."""

MERGED_ROOT = ByDtype(2e-7, 5e-3)
"""Where two solutions merge, rounding moves a joint by its square root (radians)."""

LOOSE_ROOT = 1e-4
"""An equation p cos x + q sin x + c = 0 fixes its root loosely where p^2 + q^2 - c^2 is below this
share of the square of its size: rounding is then magnified a hundred times and more..."""

DEGENERATE_ROOT = ByDtype(1e-6, 1e-2)
"""... and an equation behind it may miss its root by less than this share of its size: the square
root of rounding, a few times over."""

SUBPROBLEM_PARALLEL = ByDtype(1e-9, 1e-5)
"""The two axes of a subproblem are parallel where the sine of their angle is below this."""

SUBPROBLEM_STEEP = 1e-3
"""Two circles pass each other steeply, and tell where accurately, where the square of the sine of
the angle between them is above this."""

ARM_NUMBER = 1e-14
"""A number of an arm (a sine, a cosine, a length in metres) this near to 0, 1 or -1 is that."""

CONDITION_ROUNDING = ByDtype(4e-15, 2e-6)
"""The condition of an offset-wrist arm (a cosine) is computed to within this, for a
pose within rounding of the one that is given."""

ELBOW_ROUNDING = ByDtype(2e-15, 1e-6)
"""The rounding of a pose moves the condition by less than this over the sine of the elbow angle:
ten units in the last place of a metre."""

AXIS_1_ROUNDING = ByDtype(1e-15, 6e-7)
"""The rounding of a pose moves the wrist by less than this share of the arm's links: five units in
the last place. Over its distance from axis 1, that is how it moves the condition."""

SECANT = ByDtype(1e-9, 1e-3)
"""Two points nearer to each other than this (radians) tell the rounding of the condition of an
offset-wrist arm, not its slope."""

NARROWEST = ByDtype(1e-14, 1e-6)
"""An interval of the curve narrower than this (radians) is not halved again."""

ON_AXIS_1 = ByDtype(1e-7, 1e-4)
"""The wrist point is on axis 1 where it is nearer than this share of its circle's radius."""

AT_SHOULDER = ByDtype(1e-3, 3e-2)
"""A wrist point on axis 1 is at the shoulder where it is nearer than this share of its circle's
radius: what is on axis 1 to `ON_AXIS_1` is then too far aside for a direction to it."""

SQUARE_ROOT_END = 1e-4
"""Where the condition is farther than this from zero, an interval too narrow to halve holds no
root: even at a square-root end of the curve it varies by less."""

IK_POSITION = ByDtype(1e-12, 1e-6)
"""The complete method calls a joint vector a solution where it misses by less (metres; times the
distance of the pose where that is more than a metre)..."""

IK_ROTATION = ByDtype(1e-12, 1e-6)
"""... and by less than this (radians)."""

IK_POLISH = ByDtype(1e-13, 5e-7)
"""A candidate that misses by more than this (metres, radians) is polished on the full pose."""

ANSWERED = 1e-5
"""A pose that an arm of fewer freedoms can take to within this (metres, radians) is answered by the
nearest that it can."""

OFF_TASK = ByDtype(1e-6, 1e-3)
"""A joint vector that misses a pose by more than this (metres, radians) does not for rounding."""

REACH_ROUNDING = ByDtype(1e-13, 1e-6)
"""The wrist is out of reach where 4 a b times this is missing from the square of its distance."""

CLOSED_FORM = ByDtype(1e-9, 1e-4)
"""The condition of a spherical wrist has a root where its extremum is nearer to zero than this."""

VANISHING = ByDtype(2e-13, 1e-5)
"""The condition vanishes all along a branch where it is nowhere farther from zero than this."""

SINGULAR_ANGLE = ByDtype(1e-7, 1e-4)
"""An arm is at a singularity of a spherical-wrist arm where it is nearer than this (radians)."""

VANISHING_LENGTH = ByDtype(1e-15, 1e-8)
"""What is shorter than this (metres, or a sine) has no direction."""

REACH_EDGE = ByDtype(1e-9, 1e-5)
"""The edge of what is reachable is found to within this (metres)."""

PATH_SHARE = 1e-5
"""No smaller share of the way between two samples of a path is looked at: where branches merge they
would be one solution."""

BRANCHES_MEET = 0.1
"""Branches that are nearer than this (radians) where both end have merged there."""

AT_REST = ByDtype(2e-14, 1e-6)
"""The tool rests on a self-motion to within this (metres and radians; times the distance of the
pose where that is more than a metre)."""

POLYNOMIAL_NOISE = 500.0
"""The polynomial of a general arm is known to within this many times its estimated noise."""

COVARIANCE = ByDtype(1e-10, 1e-5)
"""A covariance that misses being symmetric, or positive semidefinite, by less than this share of
its largest entry does for rounding."""

SAME_WAYPOINT = ByDtype(1e-9, 1e-5)
"""Waypoints that are nearer than this share of the path's length to the one before are that one."""

PATH_LIMITS = ByDtype(1e-6, 1e-4)
"""A path may pass a joint limit by less than this between its samples (radians, metres): a spline
through samples at the limit does."""

ACCELERATION = ByDtype(1e-9, 1e-5)
"""The passes along a path take accelerations beyond their limits by up to this share for rounding,
which a joint that turns round divides by a slope near zero. Time is stretched by as much later."""

ARC_SINE = ByDtype(1e-6, 1e-3)
"""Three points are on a line where the sine of the angle at the first is below this: farther off,
the radius of the circle through them is lost in rounding."""

PROXIMAL = ByDtype(1e-13, 3e-6)
"""Joint rates are drawn to those before by this share of the largest square of a column of the
Jacobian: a few times rounding, so that what is singular still has a factor."""

PROXIMAL_REDUNDANT = ByDtype(1e-9, 1e-5)
"""The same for arms with joints to spare: half-way, on a scale of ratios, between 1 and rounding,
which both the least part of a slope and what it is drawn from must be told from."""

ROUNDING_OF_SLOPE = ByDtype(1e-13, 2e-6)
"""A bound is pressed against from the wrong side where the slope is more than this share of its
size."""

APART_FROM_EIGENVALUE = ByDtype(1e-12, 1e-6)
"""A matrix that its least eigenvalue is taken from, less this share of its trace, has a factor."""

TWIST_REACHED = ByDtype(1e-9, 1e-4)
"""A twist is reached where what is missing is below this share of it (or rad/s and m/s)."""

OPTIMAL_RATES = ByDtype(1e-9, 1e-4)
"""Joint rates are the optimum where the conditions for one are missed by less than this share of
the largest (or rad/s)."""
