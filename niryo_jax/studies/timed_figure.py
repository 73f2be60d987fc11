"""A figure of a timed plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax
import numpy as np

from niryo_jax.chain import forward_kinematics
from niryo_jax.collision import CollisionCheck
from niryo_jax.extras import need
from niryo_jax.figures import BLUE, GREY, INK, RED, STYLE
from niryo_jax.studies.timed_plan import TimedPlan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = (BLUE, RED, "#1b7837", "#e08214", "#762a83", GREY)
_MM = 1e3


def timed_figure(timed: TimedPlan, check: CollisionCheck | None = None) -> Figure:
    """Joint angles, the height of the tool and the clearance over time.

    Where the gripper acts is grey; ends of steps are dotted, with their numbers above.

    Args:
        timed: the plan.
        check: what the arm has to stay clear of; no clearance is drawn where not given.

    Raises:
        ImportError: matplotlib is not installed.
        ValueError: the model has links that the arm does not.
    """
    robot, rows = timed.plan.robot, 2 if check is None else 3
    time, q = (np.asarray(x) for x in timed.trajectory[:2])
    height = np.asarray(forward_kinematics(robot, q))[:, 2, 3]
    with need("matplotlib").rc_context(STYLE):
        figure: Figure = need("matplotlib.figure").Figure(
            figsize=(6.4, 1.7 * rows), layout="constrained"
        )
        axes: list[Axes] = list(figure.subplots(rows, 1, sharex=True))
        for joint, colour in zip(range(q.shape[1]), _COLOURS * q.shape[1]):
            # Joints that move alike are both seen.
            style, label = "-" if joint < 3 else "--", robot.joint_names[joint]
            turned = np.rad2deg(q[:, joint])
            axes[0].plot(time, turned, color=colour, lw=0.9, linestyle=style, label=label)
        axes[0].set_ylabel("joint angle (deg)", color=INK)
        axes[0].legend(fontsize=6, ncols=6, frameon=False, loc="lower center")
        axes[1].plot(time, _MM * height, color=BLUE, lw=0.9)
        axes[1].set_ylabel("height of the tool (mm)", color=INK)
        if check is not None:
            found = jax.device_get(check.distances(robot, q)).distance
            axes[2].plot(time, _MM * np.min(found, axis=-1), color=BLUE, lw=0.9)
            axes[2].axhline(_MM * check.margin, color=RED, linestyle="--", linewidth=0.6)
            axes[2].set_ylabel("clearance (mm)", color=INK)
        axes[-1].set_xlabel("seconds", color=INK)
        for panel in axes:
            _mark(panel, timed)
        for number, step in enumerate(timed.steps, start=1):
            middle = (step.begin + step.end) / 2
            axes[0].text(
                middle,
                1.02,
                str(number),
                ha="center",
                va="bottom",
                fontsize=6,
                color=INK,
                transform=axes[0].get_xaxis_transform(),
            )
        return figure


def _mark(axes: Axes, timed: TimedPlan) -> None:
    """Where steps end, and where the gripper acts."""
    for planned, step in zip(timed.plan.steps, timed.steps):
        axes.axvline(step.end, color=GREY, linestyle=":", linewidth=0.5)
        if planned.step.action != "move":
            axes.axvspan(step.begin, step.end, color=GREY, alpha=0.25, linewidth=0)
