"""A figure of blocks in their cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from niryo_jax.extras import need
from niryo_jax.figures import BLUE, GREY, INK, PALE, RED, STYLE
from niryo_jax.hardware.simulated.things import footprint
from niryo_jax.hardware.stacking import Layout
from niryo_jax.lie.rpy import pose_from_rpy
from niryo_jax.studies.block_stacking import StackingStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MM = 1e3


def stacking_figure(study: StackingStudy, layout: Layout | None = None) -> Figure:
    """Where the blocks came to lie, seen from above, before and after the calibration.

    Axes are those of the layout, millimetres; cells are grey, blocks outside of theirs red.

    Args:
        study: what is shown.
        layout: of the study.

    Raises:
        ImportError: matplotlib is not installed.
    """
    chosen = Layout() if layout is None else layout
    size = np.array(chosen.size)
    with need("matplotlib").rc_context(STYLE):
        figure: Figure = need("matplotlib.figure").Figure(figsize=(5.6, 3.0), layout="constrained")
        both = zip(
            figure.subplots(1, 2, sharex=True, sharey=True),
            (study.before, study.after),
            ("before", "after"),
        )
        for axes, blocks, title in both:
            inside = sum(block.inside for block in blocks)
            axes.set_title(f"{title} the calibration: {inside} of 4 in their cells")
            for place, block in zip(chosen.places, blocks):
                cell = footprint(size + 2 * chosen.margin, pose_from_rpy((*place, 0, 0, 0, 0)))
                x, y = place + block.position[:2]
                lying = footprint(size, pose_from_rpy((x, y, 0, 0, 0, block.turn)))
                axes.fill(*(cell * _MM).T, facecolor=PALE, edgecolor=GREY, linewidth=0.6)
                colour = BLUE if block.inside else RED
                axes.fill(*(lying * _MM).T, facecolor="none", edgecolor=colour, linewidth=1.0)
            axes.set_aspect("equal")
            axes.set_xlabel("away from the base (mm)", color=INK)
            axes.set_ylabel("across (mm)", color=INK)
        return figure
