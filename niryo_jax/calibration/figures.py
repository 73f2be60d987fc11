"""A figure of what a calibration found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jax.typing import ArrayLike

from niryo_jax.calibration.fit import Calibration
from niryo_jax.extras import need
from niryo_jax.figures import BLUE, GREY, INK, RED, STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_THOUSANDTHS = 1e3


def calibration_figure(
    found: Calibration, truth: ArrayLike | None = None, *, title: str | None = None
) -> Figure:
    """The parameters with two standard deviations each, and how much each measurement counted.

    Turns are in mrad, shifts in mm, gears in thousandths.

    Args:
        found: what `fit` returned.
        truth: (m,) what the parameters are, where that is known.
        title: above it; the robot's name unless given.

    Raises:
        ImportError: matplotlib is not installed.
    """
    values, doubt = found.values * _THOUSANDTHS, 2 * found.deviations * _THOUSANDTHS
    rows = np.arange(len(values))
    with need("matplotlib").rc_context(STYLE):
        figure: Figure = need("matplotlib.figure").Figure(figsize=(6.4, 4.4), layout="constrained")
        figure.suptitle(found.robot.name if title is None else title)
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        left.errorbar(
            values, rows, xerr=doubt, fmt="o", markersize=2.5, linewidth=0.9, color=BLUE,
            label="found, two standard deviations",
        )  # fmt: skip
        if truth is not None:
            left.plot(
                np.asarray(truth) * _THOUSANDTHS, rows, "|", color=RED, markersize=7, label="true"
            )
        left.axvline(0.0, color=GREY, linewidth=0.6)
        left.set_yticks(rows, found.names, fontsize=5.5)
        left.invert_yaxis()
        left.set_xlabel("mrad, mm or thousandths", color=INK)
        left.legend(frameon=False, fontsize=6)
        doubted = np.isin(np.arange(len(found.weights)), found.doubted)
        for chosen, colour in ((~doubted, BLUE), (doubted, RED)):
            number = np.flatnonzero(chosen)
            right.vlines(number, 0.0, found.weights[chosen], color=colour, linewidth=0.8)
            right.plot(number, found.weights[chosen], ".", color=colour, markersize=3)
        right.set_xlabel("measurement", color=INK)
        right.set_ylabel("how much it counted", color=INK)
        right.set_title(
            f"{1e3 * found.before.metres:.2f} mm before, {1e3 * found.after.metres:.2f} mm after"
        )
        return figure
