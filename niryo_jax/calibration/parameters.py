"""What of an arm can be estimated: joint offsets, gear errors, screws, home pose and base frame.

A screw is moved by a twist, S' = Ad(exp([B] x)) S, which leaves it a unit screw of the same pitch.
Of the six twists two do not move the screw of a turning joint, the turn about and the slide along
its axis, and four do not move that of a slide; so that a joint has four parameters, or two, and an
arm of r turning joints and p slides with its tool 4 r + 2 p + 6, which is all that poses can tell
(Everett, Driels & Mooring, 1987). Joint offsets and the base frame are combinations of these.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from niryo_jax.arguments import shown
from niryo_jax.calibration import motions
from niryo_jax.robot import Robot
from niryo_jax.structure.axes import axis_point, joint_kinds

SETS = "offsets", "gears", "screws", "home", "base"
"""The kinds of parameters, in their order."""

MINIMAL = "screws", "home"
"""All that poses tell of an arm without gear errors, and nothing twice."""

_LETTERS = "xyz"


class Changes(NamedTuple):
    """An arm and its joints as parameters make them.

    Attributes:
        screws: (n, 6) of which no base is part; home: (4, 4) behind them.
        base: (4, 4) in front of both.
        offsets: (n,) what is added to the joint values.
        gears: (n,) the share by which joints turn farther than they are told.
    """

    screws: np.ndarray
    home: np.ndarray
    base: np.ndarray
    offsets: np.ndarray
    gears: np.ndarray


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The parameters of an arm that are estimated.

    Attributes:
        sets: which kinds, in the order of `SETS`.
        names: of each parameter.
        twists: (k, 6) in the space frame, by which the parameters of the screws move them.
        joints: (k,) the joint that each of these belongs to.
        free: (m,) the indices of the parameters that are not held at 0.
    """

    sets: tuple[str, ...]
    names: tuple[str, ...]
    twists: np.ndarray
    joints: np.ndarray
    free: np.ndarray

    @property
    def free_names(self) -> tuple[str, ...]:
        """The names of those that are estimated."""
        return tuple(self.names[i] for i in self.free)

    def changes(self, robot: Robot, x: np.ndarray) -> Changes:
        """What values (m,) of the free parameters make of an arm."""
        parts = self._parts(robot, x)
        none = np.zeros(robot.joints)
        moves = motions.adjoint(motions.exp(self._moves(robot, parts)))
        screws = (moves @ np.asarray(robot.screws, float)[..., None])[..., 0]
        home = np.asarray(robot.home, float) @ motions.exp(parts.get("home", np.zeros(6)))
        base = motions.exp(parts.get("base", np.zeros(6)))
        return Changes(screws, home, base, parts.get("offsets", none), parts.get("gears", none))

    def linearised(
        self, robot: Robot, x: np.ndarray, q: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where the tool is when the joints are told to be at q, and how the parameters move it.

        With A_i = exp(S_1 q_1) ... exp(S_i q_i), a twist that moves S_i moves the tool by its
        Ad(A_(i-1)) less its Ad(A_i), since the joint's motion is conjugated by it.

        Args:
            robot: the nominal arm.
            x: (m,) values of the free parameters.
            q: (N, n) joint vectors.

        Returns:
            (N, 4, 4) poses and (N, 6, m) spatial twists.
        """
        parts, changes = self._parts(robot, x), self.changes(robot, x)
        moves = self._moves(robot, parts)
        turned = q * (1.0 + changes.gears) + changes.offsets
        at = np.broadcast_to(changes.base, (len(q), 4, 4))
        before = [motions.adjoint(at)]
        for screw, value in zip(changes.screws, turned.T):
            at = at @ motions.exp(screw * value[:, None])
            before.append(motions.adjoint(at))
        pose = at @ changes.home
        columns = dict[str, list[np.ndarray]]()
        joint_twists = [ad @ screw for ad, screw in zip(before, changes.screws)]
        columns["offsets"] = joint_twists
        columns["gears"] = [twist * value[:, None] for twist, value in zip(joint_twists, q.T)]
        columns["screws"] = [
            (before[i] - before[i + 1]) @ (motions.left_derivative(moves[i]) @ twist)
            for i, twist in zip(self.joints, self.twists)
        ]
        if "home" in parts:
            body = motions.left_derivative(-parts["home"])
            columns["home"] = list(np.moveaxis(motions.adjoint(pose) @ body, -1, 0))
        if "base" in parts:
            space = motions.left_derivative(parts["base"])
            columns["base"] = [np.broadcast_to(c, (len(q), 6)) for c in space.T]
        every = [column for name in self.sets for column in columns[name]]
        return pose, np.stack([every[i] for i in self.free], axis=-1)

    def _parts(self, robot: Robot, x: np.ndarray) -> dict[str, np.ndarray]:
        """The values of each set."""
        whole = np.zeros(len(self.names))
        whole[self.free] = x
        sizes = {"offsets": robot.joints, "gears": robot.joints, "screws": len(self.joints)}
        ends = np.cumsum([sizes.get(name, 6) for name in self.sets])[:-1]
        return dict(zip(self.sets, np.split(whole, ends)))

    def _moves(self, robot: Robot, parts: dict[str, np.ndarray]) -> np.ndarray:
        """(n, 6) the twists that move the screws."""
        moves = np.zeros((robot.joints, 6))
        if "screws" in parts:
            np.add.at(moves, self.joints, parts["screws"][:, None] * self.twists)
        return moves


def parameters_of(robot: Robot, sets: Sequence[str], hold: Sequence[str]) -> Parameters:
    """The parameters of a concrete arm.

    Args:
        robot: the arm.
        sets: which of `SETS`; "tool" is another name of "home".
        hold: names of parameters that stay at 0.

    Raises:
        ValueError: a set or a name that there is not, no set, every parameter held.
        TypeError: a traced robot, or texts that are none.
    """
    if isinstance(sets, str) or isinstance(hold, str):
        raise TypeError("parameters, hold: expected sequences of texts, got one text")
    wanted = {"home" if name == "tool" else name for name in sets}
    if not wanted or wanted - set(SETS):
        raise ValueError(f"parameters: expected some of {', '.join(SETS)}, got {shown(sets)}")
    chosen = tuple(name for name in SETS if name in wanted)
    screws = robot.known_screws()
    names = list[str]()
    twists, joints = [np.zeros((0, 6))], list[int]()
    for name in chosen:
        if name == "screws":
            for i, (screw, kind) in enumerate(zip(screws, joint_kinds(screws))):
                labels, moves = _moves(screw, kind)
                names += [f"{robot.joint_names[i]} {label}" for label in labels]
                twists.append(moves)
                joints += [i] * len(moves)
        elif name in ("home", "base"):
            frame = "tool" if name == "home" else name
            names += [f"{frame} {what} {axis}" for what in ("turn", "shift") for axis in _LETTERS]
        else:
            names += [f"{joint} {name[:-1]}" for joint in robot.joint_names]
    unknown = [name for name in hold if name not in names]
    if unknown:
        raise ValueError(f"hold: expected some of {', '.join(names)}; got {shown(unknown)}")
    free = np.array([i for i, name in enumerate(names) if name not in hold], int)
    if not len(free):
        raise ValueError("hold: expected a parameter that is left to estimate, got all of them")
    return Parameters(chosen, tuple(names), np.concatenate(twists), np.array(joints, int), free)


def _moves(screw: np.ndarray, kind: str) -> tuple[list[str], np.ndarray]:
    """Names and twists (k, 6) that move a screw: tilts about a point of its axis, and shifts."""
    axis = screw[3:] if kind == "prismatic" else screw[:3]
    # The two axes of the space frame that are least along it, made perpendicular.
    order = np.argsort(np.abs(axis), kind="stable")[:2]
    first, second = (np.eye(3)[i] for i in sorted(order))
    first = first - (first @ axis) * axis
    first = first / np.linalg.norm(first)
    second = np.cross(axis, first) * np.sign(np.cross(axis, first) @ second)
    labels = [_LETTERS[i] for i in sorted(order)]
    point = np.zeros(3) if kind == "prismatic" else axis_point(screw)
    tilts = [np.concatenate([w, np.cross(point, w)]) for w in (first, second)]
    names = [f"tilt {label}" for label in labels]
    if kind == "prismatic":
        return names, np.stack(tilts)
    shifts = [np.concatenate([np.zeros(3), v]) for v in (first, second)]
    return names + [f"shift {label}" for label in labels], np.stack(tilts + shifts)


def arm_of(robot: Robot, changes: Changes) -> Robot:
    """The arm whose zero is where the joints were told to be at 0: each screw behind the base and
    the offsets of the joints before it, and the home pose behind all of them."""
    screws, at = list[np.ndarray](), changes.base
    for screw, offset in zip(changes.screws, changes.offsets):
        screws.append(motions.adjoint(at) @ screw)
        at = at @ motions.exp(screw * offset)
    unit = np.array(screws)
    for screw, kind in zip(unit, joint_kinds(np.asarray(robot.screws, float))):
        # What rounding has left of a unit screw, and of a pitch of zero.
        w, v = screw[:3], screw[3:]
        if kind == "prismatic":
            w[:] = 0.0
            v /= np.linalg.norm(v)
            continue
        v /= np.linalg.norm(w)
        w /= np.linalg.norm(w)
        if kind == "revolute":
            v -= (v @ w) * w
    return dataclasses.replace(robot, screws=unit, home=at @ changes.home)
