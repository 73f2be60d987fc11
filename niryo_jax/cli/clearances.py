"""What collisions leave of the solutions of a pose, for people and for JSON."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np

from niryo_jax.cli.outcome import json_number
from niryo_jax.collision import CollisionCheck, Distances, Free, FreeStatus
from niryo_jax.ik import IKSolutions
from niryo_jax.robot import Robot


class Looked(NamedTuple):
    """What was found of the collisions of the solutions of one pose."""

    check: CollisionCheck
    free: Free
    apart: Distances

    @classmethod
    def at(cls, check: CollisionCheck, arm: Robot, solutions: IKSolutions) -> Looked:
        found = check.free(arm, solutions), check.distances(arm, solutions.q)
        return cls(check, *jax.device_get(found))

    @property
    def status(self) -> FreeStatus:
        """The verdict."""
        return FreeStatus(int(self.free.status))

    def said(self) -> str:
        """Which solutions are free, and which of them has most room."""
        slots = np.flatnonzero(self.free.within)
        best = slots[np.argmax(self.free.clearance[slots])]
        room = 1e3 * float(self.free.clearance[best])
        numbers = ", ".join(str(slot + 1) for slot in slots)
        return (
            f"Free of collisions within the limits: {numbers}; most clearance: {best + 1}, "
            f"{room:.1f} mm."
        )

    def add_to(self, document: dict[str, Any]) -> None:
        """The verdict, and the clearance of each solution, in the document of a pose."""
        document["collisions"] = {
            "status": self.status.name,
            "message": self.free.message(),
            "proved": bool(self.free.proved),
            "margin_m": self.check.margin,
        }
        slots = np.flatnonzero(self.free.solutions.found)
        for slot, solution in zip(slots, document["solutions"]):
            solution["clearance_m"] = json_number(float(self.free.clearance[slot]))
            solution["nearest_pair"] = (
                list(self.apart.nearest_pair(int(slot))) if self.apart.pairs else None
            )
            solution["collides"] = not bool(self.free.clear[slot])
