"""What the panel says, as HTML."""

from __future__ import annotations

import html

import numpy as np

from niryo_jax.viewer import colours
from niryo_jax.viewer.colours import as_css, of_branch
from niryo_jax.viewer.session import View

_STYLE = "font-size:0.8em;line-height:1.45;padding:0.2em 0.9em;overflow-wrap:anywhere"


def panel(*parts: str) -> str:
    """Parts, which are HTML already, in the look of the panel."""
    return f'<div style="{_STYLE}">{"".join(parts)}</div>'


def line(text: str, strong: bool = False) -> str:
    """A line of plain text."""
    weight = "font-weight:600" if strong else ""
    return f'<div style="{weight}">{html.escape(text)}</div>'


def status(view: View) -> str:
    """What became of the target, and how the arm stands, as HTML."""
    found, within = int(np.sum(view.found)), int(np.sum(view.within))
    known = "yes" if view.complete else "no: there may be more"
    manipulability = float(view.measures.manipulability[0])
    said = [
        line(view.message, strong=True),
        line(f"Solutions: {found}, {within} within the limits"),
        line(f"Complete: {known}"),
        line(f"Manipulability: {manipulability:.4g}"),
    ]
    apart, pair = view.clearance(), view.nearest_pair()
    if apart is not None and pair is not None:
        said.append(line(f"Clearance: {1e3 * apart:.1f} mm ({pair[0]} to {pair[1]})"))
    else:
        said.append(line("Clearance: not known, no collision model"))
    if not view.reached:
        said.append(line("The arm is not at the target: it stays where it was."))
    return panel(*said)


def solutions(view: View) -> str:
    """The solutions as a table, in HTML."""
    rows: list[str] = []
    with_clearance = view.clearance() is not None
    for slot in np.flatnonzero(view.found):
        within = bool(view.within[slot])
        colour = of_branch(int(view.branches[slot])) if within else colours.OUTSIDE
        dot = f'<span style="color:{as_css(colour)};font-size:1.3em">&#9679;</span>'
        apart = view.clearance(int(slot) + 1)
        cells = [
            f"{dot} {slot + 1}",
            "" if within else "outside",
            "" if apart is None else f"{1e3 * apart:.0f}",
            f"{view.measures.manipulability[slot + 1]:.3g}",
        ]
        weight = "font-weight:700" if slot == view.chosen else ""
        shown = "".join(f'<td style="padding:0 0.5em 0 0">{cell}</td>' for cell in cells)
        rows.append(f'<tr style="{weight}">{shown}</tr>')
    if not rows:
        return panel(line("No solution."))
    heads = "no.", "limits", "clear, mm" if with_clearance else "", "manip."
    head = "".join(
        f'<th style="text-align:left;font-weight:400;opacity:0.7;padding:0 0.5em 0 0">{name}</th>'
        for name in heads
    )
    table = f'<table style="border-collapse:collapse;width:100%"><tr>{head}</tr>'
    return panel(f"{table}{''.join(rows)}</table>")
