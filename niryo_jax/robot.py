"""The `Robot`: an open chain as screw axes, home pose and limits."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import (
    Array,
    as_data,
    as_flags,
    as_labels,
    check_finite,
    check_limits,
    check_motion,
    check_screws,
    check_text,
    is_known,
    shown,
)
from niryo_jax.structure import axes, classify
from niryo_jax.structure.classify import Structure, structure_of
from niryo_jax.structure.closure import ByClosure
from niryo_jax.structure.families import ClosedFormPlan
from niryo_jax.structure.offset_wrist import KnownNumbers

_ARRAYS = "screws", "home", "lower", "upper"
_STATIC = "joint_names", "name", "assumed"


@jax.tree_util.register_pytree_with_keys_class
@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
    """An open chain of revolute, prismatic or helical joints.

    Attributes:
        screws: (n, 6) screw axes (omega, v) in the space frame at the home configuration;
            |omega| = 1, or omega = 0 and |v| = 1 for a prismatic joint. Metres, radians.
        home: (4, 4) pose of the tool frame in the space frame at q = 0.
        lower, upper: (n,) joint limits, radians (metres for prismatic joints).
        joint_names, name: labels; static. "joint_1"... where no names are given.
        assumed: the structure of the concrete arm that a traced one was made from; static. It
            says which solver a program takes; the program looks whether the arm still has it.

    The four arrays are pytree leaves, so they can be traced, batched and differentiated:
    `dataclasses.replace(robot, screws=...)` accepts traced arrays. What is known is checked as
    `from_screws` checks it; float16 and bfloat16 are refused, integers and lists taken as float64.
    JAX builds robots of anything that it puts in place of arrays, and those are not looked at.
    """

    screws: Array
    home: Array
    lower: Array
    upper: Array
    joint_names: tuple[str, ...] = ()
    name: str = "robot"
    assumed: Structure | None = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Check what is known, and find the structure, which a robot that is traced brings along.

        Raises:
            ValueError, TypeError: as `from_screws`.
        """
        for name in _ARRAYS:
            object.__setattr__(self, name, _as_leaf(name, getattr(self, name)))
        _check_shapes(self)
        names = self.joint_names or tuple(f"joint_{i + 1}" for i in range(self.joints))
        object.__setattr__(self, "joint_names", as_labels("joint_names", names, self.joints))
        check_text("name", self.name)
        if not isinstance(self.assumed, Structure | None):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TypeError(f"assumed: expected a structure or None, got {shown(self.assumed)}")
        check_screws(self.screws)
        check_motion("home", self.home)
        check_limits(self.lower, self.upper)
        object.__setattr__(self, "assumed", self._structure)

    def tree_flatten(self) -> tuple[list[Any], tuple[Any, ...]]:
        """The four arrays, and the rest."""
        arrays, static = ([getattr(self, name) for name in names] for names in (_ARRAYS, _STATIC))
        return arrays, tuple(static)

    def tree_flatten_with_keys(self) -> tuple[list[tuple[Any, Any]], tuple[Any, ...]]:
        """The four arrays by their names, and the rest."""
        arrays, static = self.tree_flatten()
        return list(zip(map(jax.tree_util.GetAttrKey, _ARRAYS), arrays)), static

    @classmethod
    def tree_unflatten(cls, static: tuple[Any, ...], arrays: Sequence[Any]) -> Robot:
        """A robot of these arrays, which may be anything.

        What is assumed stays, so that a robot and its rates are trees of one kind.
        """
        robot = object.__new__(cls)
        for name, value in zip(_ARRAYS + _STATIC, (*arrays, *static)):
            object.__setattr__(robot, name, value)
        return robot

    @functools.cached_property
    def _structure(self) -> Structure:
        """That of the numbers where they are known, else what is assumed."""
        if is_known(self.screws) and self.screws.ndim == 2:
            return structure_of(self.screws)
        return self.assumed or Structure(None, ())

    @property
    def offset_wrist(self) -> KnownNumbers | None:
        """Which numbers of an offset-wrist arm are 0, 1 or -1; None for an arm of another kind."""
        return self._structure.offset_wrist

    @property
    def plans(self) -> tuple[ClosedFormPlan, ...]:
        """How the arm can be solved in closed form."""
        return self._structure.plans

    @property
    def ends(self) -> tuple[ByClosure, ...]:
        """How an arm of seven joints is solved where the first or the last has a given value."""
        return tuple(way for way in self._structure.general if way.locked is not None)

    @property
    def spare(self) -> ClosedFormPlan | ByClosure | None:
        """How an arm with a joint to spare is solved for one way to spend it; None of others.

        By the arm angle if it has one: whatever the arm can reach it reaches with any, but not with
        any value of a joint.
        """
        plans = [plan for plan in self.plans if plan.locked is not None or plan.by_arm_angle]
        if plans:
            return max(plans, key=lambda plan: plan.by_arm_angle)
        return next(iter(self.ends), None)

    @property
    def is_general(self) -> bool:
        """Whether the arm has six revolute joints and is of no kind that is solved otherwise."""
        return ByClosure() in self._structure.general

    @property
    def joints(self) -> int:
        """The number of joints n."""
        return self.screws.shape[-2]

    @property
    def body_screws(self) -> Array:
        """(n, 6) the screws in the tool frame at home, Ad_{M^-1} S (Lynch & Park, 4.1.3)."""
        xp = np if is_concrete(self.screws, self.home) else jnp
        rotation, position = self.home[:3, :3], self.home[:3, 3]
        w, v = self.screws[:, :3], self.screws[:, 3:]
        return xp.concatenate([w @ rotation, (v - xp.cross(position, w)) @ rotation], axis=1)

    @classmethod
    def from_body_screws(
        cls,
        screws: ArrayLike,
        home: ArrayLike,
        *,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        joint_names: Sequence[str] | None = None,
        name: str = "robot",
    ) -> Robot:
        """Build a robot from screws in the tool frame: T = M exp([B1] q1) ... exp([Bn] qn).

        Args:
            screws: (n, 6) rows (omega, v), tool frame at home (Lynch & Park, eq. 4.16).
            home, lower, upper, joint_names, name: as in `from_screws`.

        Raises:
            ValueError: as `from_screws`.
        """
        screws, home = as_data("screws", screws), as_data("home", home)
        if screws.ndim != 2 or screws.shape[1] != 6:
            raise ValueError(f"screws: expected shape (n, 6), got {screws.shape}")
        if home.shape != (4, 4):
            raise ValueError(f"home: expected shape (4, 4), got {home.shape}")
        check_motion("home", home)
        check_finite("screws", screws)
        xp = np if is_concrete(screws, home) else jnp
        w, v = screws[:, :3] @ home[:3, :3].T, screws[:, 3:] @ home[:3, :3].T
        space = xp.concatenate([w, v + xp.cross(home[:3, 3], w)], axis=1)
        return cls.from_screws(
            space, home, lower=lower, upper=upper, joint_names=joint_names, name=name
        )

    @classmethod
    def from_screws(
        cls,
        screws: ArrayLike,
        home: ArrayLike,
        *,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        joint_names: Sequence[str] | None = None,
        name: str = "robot",
    ) -> Robot:
        """Build a robot from space-frame screws and its home pose.

        Args:
            screws: (n, 6) rows (omega, v), space frame.
            home: (4, 4) tool pose at q = 0.
            lower, upper: (n,) limits; unlimited where not given.
            joint_names: n labels; "joint_1"... where not given.
            name: label of the robot.

        Raises:
            ValueError: wrong shapes, numbers that are not finite, screws that are not unit screws,
                a home pose that is not a rigid motion, limits that are NaN or in the wrong order, a
                wrong number of names. Of traced arrays the shapes alone are checked.
            TypeError: what is no array of real numbers of 32 or 64 bits, or no text.
        """
        screws, home = as_data("screws", screws), as_data("home", home)
        joints = screws.shape[-2] if screws.ndim > 1 else 0
        low = as_data("lower", np.full(joints, -np.inf) if lower is None else lower)
        high = as_data("upper", np.full(joints, np.inf) if upper is None else upper)
        names = () if joint_names is None else as_labels("joint_names", joint_names, joints)
        return cls(screws, home, low, high, names, name)

    @classmethod
    def from_axes(
        cls,
        axes: ArrayLike,
        points: ArrayLike,
        home: ArrayLike,
        *,
        prismatic: Sequence[bool] | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        joint_names: Sequence[str] | None = None,
        name: str = "robot",
    ) -> Robot:
        """Build a robot from the direction of each joint axis and a point on it.

        Args:
            axes: (n, 3) directions, of any length but zero, space frame.
            points: (n, 3) a point on each axis, metres; ignored for prismatic joints.
            home: (4, 4) tool pose at q = 0.
            prismatic: n flags, True for a prismatic joint; all revolute where not given.
            lower, upper, joint_names, name: as in `from_screws`.

        Raises:
            ValueError: wrong shapes, a zero axis, and all that `from_screws` refuses.
        """
        axes, points = as_data("axes", axes), as_data("points", points)
        if axes.ndim != 2 or axes.shape[1] != 3:
            raise ValueError(f"axes: expected shape (n, 3), got {axes.shape}")
        if points.shape != axes.shape:
            raise ValueError(f"points: expected shape {axes.shape}, got {points.shape}")
        slides = np.zeros(len(axes), bool)
        if prismatic is not None:
            slides = as_flags("prismatic", prismatic, len(axes))
        if is_known(axes):
            lengths = np.linalg.norm(np.asarray(axes), axis=1)
            if not np.all((lengths > 0) & np.isfinite(lengths)):
                raise ValueError(f"axes: expected non-zero finite directions, got {axes}")
        check_finite("points", points)
        xp = np if is_concrete(axes, points) else jnp
        unit = axes / xp.linalg.norm(axes, axis=1, keepdims=True)
        screws = xp.where(
            slides[:, None],
            xp.concatenate([0 * unit, unit], axis=1),
            xp.concatenate([unit, xp.cross(points, unit)], axis=1),
        )
        return cls.from_screws(
            screws, home, lower=lower, upper=upper, joint_names=joint_names, name=name
        )

    def with_tool(self, tool: ArrayLike) -> Robot:
        """The same arm with its tool frame moved by a pose in the present one: home @ tool.

        Args:
            tool: (4, 4) pose of the new tool frame in the present tool frame, metres.

        Raises:
            ValueError: wrong shape, or not a rigid motion.
        """
        tool = as_data("tool", tool)
        if tool.shape[-2:] != (4, 4):
            raise ValueError(f"tool: expected shape (4, 4), got {tool.shape}")
        check_motion("tool", tool)
        return dataclasses.replace(self, home=self.home @ tool)

    def known_screws(self) -> np.ndarray:
        """(n, 6) the screws as numbers, from which the kinematic structure can be found.

        Raises:
            TypeError: the robot is traced.
        """
        if not is_concrete(self.screws, self.home):
            raise TypeError(
                "robot: its structure can only be found on concrete arrays; got a traced robot. "
                "Close over the robot instead of passing it through jax.jit or jax.grad."
            )
        return np.asarray(self.screws)

    def describe(self) -> str:
        """The arm in words: joints, limits, home pose, how the axes lie, and what solves it.

        Axes are counted from 1; the index of a joint that can be `locked` from 0, and says so.

        Raises:
            TypeError: the robot is traced.
        """
        screws = self.known_screws()
        lines = [f"{self.name}: {self.joints} joints"]
        for name, kind, screw, low, high in zip(
            self.joint_names,
            axes.joint_kinds(screws),
            screws,
            np.asarray(self.lower),
            np.asarray(self.upper),
        ):
            slides = kind == "prismatic"
            unit, scale = ("m", 1.0) if slides else ("deg", 180.0 / np.pi)
            place = "" if slides else f" through {_vector(axes.axis_point(screw))} m"
            lines.append(
                f"{name}: {kind}, along {_vector(screw[3:] if slides else screw[:3])}{place}, "
                f"{low * scale:.2f} to {high * scale:.2f} {unit}"
            )
        lines += axes.relations(screws) + classify.describe(screws)
        lines.append(f"tool at home: {_vector(np.asarray(self.home)[:3, 3])} m")
        return "\n  ".join(lines)


def _vector(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:.5g}" for value in values) + ")"


def _as_leaf(name: str, value: Any) -> Array:
    """An array of a robot: what is in float32 stays so, and its structure is found as such."""
    if isinstance(value, np.ndarray) and value.dtype == np.float32:
        return value
    return as_data(name, value)


def _check_shapes(robot: Robot) -> None:
    """Raise a ValueError unless the last axes of all arrays fit each other."""
    shape = tuple(robot.screws.shape)
    if len(shape) < 2 or shape[-1] != 6 or shape[-2] == 0:
        raise ValueError(f"screws: expected shape (n, 6) with n >= 1, got {shape}")
    for name, last in (("home", (4, 4)), ("lower", shape[-2:-1]), ("upper", shape[-2:-1])):
        given = tuple(getattr(robot, name).shape)
        if given[-len(last) :] != last:
            raise ValueError(f"{name}: expected shape {last}, got {given}")


def check_is_robot(robot: object) -> None:
    """Raise a TypeError unless it is a `Robot`."""
    if not isinstance(robot, Robot):
        raise TypeError(f"robot: expected a niryo_jax.Robot, got {shown(robot)}")
