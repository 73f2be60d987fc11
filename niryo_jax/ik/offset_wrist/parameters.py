"""The numbers of an offset-wrist arm as lanes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import jax
import numpy as np
from jax.typing import DTypeLike

from niryo_jax import lanes
from niryo_jax.lanes import Lane, Lanes
from niryo_jax.structure.offset_wrist import FIELDS, KnownNumbers
from niryo_jax.tolerances import AXES_OFF


@dataclasses.dataclass(frozen=True)
class OffsetWristParameters:
    """Geometry of an arm whose axes 1 and 2 meet, 2 and 3 are parallel, 4 and 5 meet, as lanes.

    Attributes:
        base: (3, 3) rows e, e1 x e, e1 of the base frame, in the space frame.
        shoulder: (3,) where axes 1 and 2 meet, space frame.
        centre: (3,) tool frame: the point of axis 6 nearest to the wrist point.
        spoke: (3,) tool frame: unit vector from there to the wrist point.
        axis_6: (3,) tool frame: direction of axis 6.
        radius: distance of the wrist point from axis 6 (the wrist offset).
        upper_arm, forearm: lengths a, b of the links, seen along axis 2.
        sideways: how far the wrist lies from the shoulder along axis 2.
        shoulder_angle: cosine and sine of the angle between axes 1 and 2.
        axis_4: (3,) e4 on (e2, direction of the forearm, third) at home.
        axis_5: (3,) the part of e5 at right angles to e4, unit, on the same.
        hand: (3,) e5 on (e6, spoke, e6 x spoke).
        wrist_angle: cosine of the angle between axes 4 and 5.
        twist: (2, 3) the part of e6 at right angles to e5, unit, and e5 x that, on
            (e4, e5, e4 x e5).
        upper_arm_angle: cosine and sine of the angle of the upper arm from P1 at home.
        elbow_angle: cosine and sine of the angle from upper arm to forearm at home.
        turn_3: 1 where axis 3 points as axis 2 does, -1 where it points back.
        off: how far the axes are from lying so, in radians and shares of the shorter link
            (`structure.rounding`).
        is_far: whether axis 6 passes the wrist point far off (`KnownNumbers`).
    """

    base: Lanes
    shoulder: Lanes
    centre: Lanes
    spoke: Lanes
    axis_6: Lanes
    radius: Lane
    upper_arm: Lane
    forearm: Lane
    sideways: Lane
    shoulder_angle: Lanes
    axis_4: Lanes
    axis_5: Lanes
    hand: Lanes
    wrist_angle: Lane
    twist: Lanes
    upper_arm_angle: Lanes
    elbow_angle: Lanes
    turn_3: Lane
    off: Lane
    is_far: bool

    @property
    def is_planar(self) -> bool:
        """Whether upper arm and forearm move in a plane that contains axis 1."""
        return self.sideways.is_known(0.0) and self.shoulder_angle[0].is_known(0.0)

    @property
    def moved(self) -> Lane:
        """How far the condition can be from that of the arm as it is, where its joints are regular;
        known to be 0 for an arm that is exact."""
        return AXES_OFF * self.off

    def astype(self, dtype: DTypeLike) -> OffsetWristParameters:
        """The same numbers in a dtype."""
        cast = {name: lanes.astype(getattr(self, name), dtype) for name in FIELDS}
        return dataclasses.replace(self, **cast)


def parameters_from(known: KnownNumbers, arguments: Iterable[jax.Array]) -> OffsetWristParameters:
    """The lanes of an arm: the known numbers, and the arguments in the places between."""
    rest = iter(arguments)
    entries = np.empty(len(known.entries), dtype=object)
    for i, number in enumerate(known.entries):
        entries[i] = Lane(next(rest)) if number is None else Lane(number)
    fields, at = dict[str, Any](), 0
    for name, shape in FIELDS.items():
        size = int(np.prod(shape))
        part = entries[at : at + size]
        fields[name] = part.reshape(shape) if shape else lanes.as_lane(part[0])
        at += size
    return OffsetWristParameters(**fields, is_far=known.is_far)
