"""Figures of paths in time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from niryo_jax.arguments import check_positive, shown
from niryo_jax.extras import need
from niryo_jax.figures import BLUE, GREY, INK, RED, STYLE
from niryo_jax.motion.limits import MotionLimits
from niryo_jax.motion.point_to_point import PointToPoint
from niryo_jax.motion.timed_path import TimedPath

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, RED, "#1b7837", "#e08214", "#762a83", GREY)


def motion_figure(
    timed: Mapping[str, TimedPath | PointToPoint], limits: MotionLimits, step: float = 1e-3
) -> Figure:
    """Velocities and accelerations of all joints over time, as shares of their limits.

    Args:
        timed: single paths or moves by their titles, one column each.
        limits: of the joints; dashed.
        step: seconds between what is drawn.

    Raises:
        ValueError: nothing to draw, a step that is not positive.
        ImportError: matplotlib is not installed.
    """
    if not timed:
        raise ValueError(f"timed: expected one path or more, got {shown(timed)}")
    check_positive("step", step, "a positive number of seconds")
    with need("matplotlib").rc_context(STYLE):
        figure: Figure = need("matplotlib.figure").Figure(
            figsize=(2.8 * len(timed), 3.4), layout="constrained"
        )
        rows = figure.subplots(2, len(timed), sharex=True, sharey=True, squeeze=False)
        for (title, path), (above, below) in zip(timed.items(), rows.T):
            found = path.every(step)
            above.set_title(f"{title}: {float(path.duration):.2f} s")
            below.set_xlabel("seconds", color=INK)
            for axes, rate, most in (
                (above, found.velocity, limits.velocity),
                (below, found.acceleration, limits.acceleration),
            ):
                shares = np.asarray(rate) / np.asarray(most)
                for joint, colour in zip(range(shares.shape[-1]), _COLOURS * shares.shape[-1]):
                    label = f"joint {joint + 1}"
                    axes.plot(found.time, shares[:, joint], color=colour, lw=0.9, label=label)
                for bound in (-1, 1):
                    axes.axhline(bound, color=GREY, linestyle="--", linewidth=0.6)
        rows[0, 0].set_ylabel("velocity / limit", color=INK)
        rows[1, 0].set_ylabel("acceleration / limit", color=INK)
        rows[0, -1].legend(fontsize=6, ncols=2, frameon=False)
        return figure
