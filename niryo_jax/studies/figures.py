"""A figure of blocks in their cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from niryo_jax.extras import need
from niryo_jax.figures import STYLE
from niryo_jax.hardware.stacking import Layout
from niryo_jax.studies.block_stacking import StackingStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_INK, _GOOD, _BAD = "#333333", "#2166ac", "#b2182b"
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
    matplotlib = need("matplotlib")
    need("matplotlib.figure")
    chosen = Layout() if layout is None else layout
    half = np.array(chosen.size[:2]) / 2
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    with matplotlib.rc_context(STYLE):
        figure = matplotlib.figure.Figure(figsize=(5.6, 3.0), layout="constrained")
        both = zip(
            figure.subplots(1, 2, sharex=True, sharey=True),
            (study.before, study.after),
            ("before", "after"),
        )
        for axes, blocks, title in both:
            inside = sum(block.inside for block in blocks)
            axes.set_title(f"{title} the calibration: {inside} of 4 in their cells")
            for place, block in zip(chosen.places, blocks):
                cell = place + corners * (half + chosen.margin)
                axes.fill(*(cell * _MM).T, facecolor="#eeeeee", edgecolor="#9aa0a6", linewidth=0.6)
                cos, sin = np.cos(block.turn), np.sin(block.turn)
                turned = corners * half @ np.array([(cos, sin), (-sin, cos)])
                outline = place + block.position[:2] + turned
                axes.plot(*(outline * _MM).T, color=_GOOD if block.inside else _BAD, linewidth=1.0)
            axes.set_aspect("equal")
            axes.set_xlabel("away from the base (mm)", color=_INK)
            axes.set_ylabel("across (mm)", color=_INK)
        return figure
