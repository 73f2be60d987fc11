"""Robots from tables of Denavit-Hartenberg parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from niryo_jax._jax import is_concrete
from niryo_jax.arguments import as_data, check_choice, check_motion
from niryo_jax.lanes.batching import as_floating
from niryo_jax.robot import Robot
from niryo_jax.robots.frames import robot_from_frames


def from_dh(
    table: ArrayLike,
    *,
    convention: str = "standard",
    base: ArrayLike | None = None,
    tool: ArrayLike | None = None,
    prismatic: Sequence[bool] | None = None,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    joint_names: Sequence[str] | None = None,
    name: str = "robot",
) -> Robot:
    """Build a robot from a table of Denavit-Hartenberg parameters.

    THE COLUMNS ARE (a, alpha, d, theta), in this order; a row per joint; metres and radians. The
    joint variable is added to theta of a revolute joint and to d of a prismatic one, so the table
    holds the home position: T(0) = base A_1 ... A_n tool, where the row (a, alpha, d, theta) means

        standard (distal):           A = Rz(theta) Tz(d) Tx(a) Rx(alpha)
        modified (proximal, Craig):  A = Rx(alpha) Tx(a) Rz(theta) Tz(d)

    (Siciliano et al., *Robotics*, 2.8.2; Craig, *Introduction to Robotics*, 3.4, and Lynch & Park,
    *Modern Robotics*, appendix C, whose row i holds a and alpha of link i - 1.)

    Other books order the columns in other ways. The classic tables of Pardos-Gotor, *Screw Theory
    in Robotics*, are (d, theta, a, alpha) of the standard convention:

        from_dh(np.asarray(classic)[:, [2, 3, 0, 1]])

    Args:
        table: (n, 4) rows (a, alpha, d, theta); may be traced, for calibration.
        convention: "standard" or "modified".
        base: (4, 4) pose in the space frame of the frame that the first row starts from; the
            identity where not given.
        tool: (4, 4) pose of the tool frame in the frame of the last row; the identity where not
            given.
        prismatic: n flags, True for a prismatic joint; all revolute where not given.
        lower, upper, joint_names, name: as in `Robot.from_screws`; limits are those of the joint
            variable, not of theta.

    Raises:
        ValueError: wrong shapes, numbers that are not finite, an unknown convention, a base or
            tool that is not a rigid motion, and all that `Robot.from_screws` refuses.
    """
    check_choice("convention", convention, ("standard", "modified"))
    xp = np if is_concrete(table, base, tool) else jnp
    rows = _numbers("table", table, xp)
    if rows.ndim != 2 or rows.shape[1] != 4 or not len(rows):
        raise ValueError(f"table: expected shape (n, 4) with n >= 1, got {rows.shape}")
    if xp is np and not np.all(np.isfinite(rows)):
        raise ValueError(f"table: expected finite numbers, got {table}")
    along_x = _screw_motions(rows[:, 0], rows[:, 1], (0, 1, 2), xp)
    along_z = _screw_motions(rows[:, 2], rows[:, 3], (2, 0, 1), xp)
    pose = _motion("base", base, rows.dtype, xp)
    frames: list[Any] = []
    for in_x, in_z in zip(along_x, along_z):
        # A motion along the joint axis leaves the axis where it is, so either end of it will do.
        pose = pose if convention == "standard" else pose @ in_x
        frames.append(pose)
        pose = pose @ in_z @ in_x if convention == "standard" else pose @ in_z
    return robot_from_frames(
        xp.stack(frames),
        xp.broadcast_to(xp.asarray([0, 0, 1], dtype=rows.dtype), (len(rows), 3)),
        pose @ _motion("tool", tool, rows.dtype, xp),
        prismatic=prismatic,
        lower=lower,
        upper=upper,
        joint_names=joint_names,
        name=name,
    )


def _numbers(name: str, values: Any, xp: Any) -> Any:
    """Concrete numbers in float64; with traced ones among them, in the dtype they have."""
    return as_data(name, values) if xp is np else as_floating(name, values)


def _motion(name: str, given: ArrayLike | None, dtype: Any, xp: Any) -> Any:
    if given is None:
        return xp.eye(4, dtype=dtype)
    pose = _numbers(name, given, xp)
    if pose.shape != (4, 4):
        raise ValueError(f"{name}: expected shape (4, 4), got {pose.shape}")
    check_motion(name, pose)
    return pose


def _screw_motions(lengths: Any, angles: Any, cycle: tuple[int, int, int], xp: Any) -> Any:
    """(n, 4, 4) translations and rotations along and about one coordinate axis.

    `cycle` numbers that axis and the two that follow it: rotations turn the second to the third.
    """
    cos, sin = xp.cos(angles), xp.sin(angles)
    zero, one = xp.zeros_like(cos), xp.ones_like(cos)
    i, j, k = cycle
    entries = {(i, i): one, (j, j): cos, (j, k): -sin, (k, j): sin, (k, k): cos}
    entries |= {(i, 3): lengths, (3, 3): one}
    return xp.stack(
        [xp.stack([entries.get((r, c), zero) for c in range(4)], -1) for r in range(4)], -2
    )
