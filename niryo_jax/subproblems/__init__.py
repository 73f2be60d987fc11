"""The canonical geometric subproblems that inverse kinematics is put together from.

Screws are (..., 6) rows (omega, v), points (..., 3), and a later factor acts first:
exp([S1] t1) exp([S2] t2) p = k. Every function solves a whole batch and returns all solutions in
fixed slots with a mask, a residual and a kind; where there is none, the angles are those of the
closest approach and the residual says how close.

| subproblem | finds |
| --- | --- |
| `paden_kahan_1` | a rotation from a point to another |
| `paden_kahan_2` | two rotations, about axes that meet or are parallel |
| `paden_kahan_3` | a rotation to a distance |
| `pardos_gotor_1`, `_2`, `_3` | one translation, two translations, a translation to a distance |
| `pardos_gotor_4` | two rotations about parallel axes |
| `pardos_gotor_5` | a rotation into the plane through the axis and another point |
| `pardos_gotor_6` | two rotations about any axes |
| `pardos_gotor_7` | three rotations of a point, the last two to act first about parallel axes |
| `pardos_gotor_8` | three rotations of a pose about parallel axes |
"""

from niryo_jax.subproblems.paden_kahan import (
    paden_kahan_1,
    paden_kahan_1_lanes,
    paden_kahan_2,
    paden_kahan_2_lanes,
    paden_kahan_3,
    paden_kahan_3_lanes,
)
from niryo_jax.subproblems.pardos_gotor import (
    pardos_gotor_1,
    pardos_gotor_1_lanes,
    pardos_gotor_2,
    pardos_gotor_2_lanes,
    pardos_gotor_3,
    pardos_gotor_3_lanes,
    pardos_gotor_4,
    pardos_gotor_4_lanes,
    pardos_gotor_5,
    pardos_gotor_5_lanes,
)
from niryo_jax.subproblems.pardos_gotor_chains import (
    pardos_gotor_6,
    pardos_gotor_6_lanes,
    pardos_gotor_7,
    pardos_gotor_7_lanes,
    pardos_gotor_8,
    pardos_gotor_8_lanes,
)
from niryo_jax.subproblems.result import Solved, SubproblemKind, SubproblemSolutions

__all__ = [
    "Solved",
    "SubproblemKind",
    "SubproblemSolutions",
    "paden_kahan_1",
    "paden_kahan_1_lanes",
    "paden_kahan_2",
    "paden_kahan_2_lanes",
    "paden_kahan_3",
    "paden_kahan_3_lanes",
    "pardos_gotor_1",
    "pardos_gotor_1_lanes",
    "pardos_gotor_2",
    "pardos_gotor_2_lanes",
    "pardos_gotor_3",
    "pardos_gotor_3_lanes",
    "pardos_gotor_4",
    "pardos_gotor_4_lanes",
    "pardos_gotor_5",
    "pardos_gotor_5_lanes",
    "pardos_gotor_6",
    "pardos_gotor_6_lanes",
    "pardos_gotor_7",
    "pardos_gotor_7_lanes",
    "pardos_gotor_8",
    "pardos_gotor_8_lanes",
]
