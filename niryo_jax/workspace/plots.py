"""Figures of capability maps, made without a display."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ParamSpec

import numpy as np

from niryo_jax.extras import need
from niryo_jax.figures import STYLE, save
from niryo_jax.workspace.drawing import (
    BLUE,
    GREY,
    INK,
    RED,
    colours,
    draw_histogram,
    draw_section,
    draw_sphere,
    label,
    size,
    title,
)
from niryo_jax.workspace.fields import check_map, variable
from niryo_jax.workspace.orientations import rotations_of
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = [
    "PLOTS",
    "dexterity",
    "differences",
    "manipulability",
    "overview",
    "save",
    "sections",
    "solution_counts",
    "volume_by_orientation",
]

_P = ParamSpec("_P")


def _styled(plot: Callable[_P, Figure]) -> Callable[_P, Figure]:
    @functools.wraps(plot)
    def styled(*args: _P.args, **kwargs: _P.kwargs) -> Figure:
        given = inspect.signature(plot).bind(*args, **kwargs).arguments
        check_map(*next(iter(given.items())))
        with need("matplotlib").rc_context(STYLE):
            figure = plot(*args, **kwargs)
        for axes in figure.axes:  # ticks are made when the figure is drawn, after the context
            axes.tick_params(which="both", labelsize=7, width=0.6)
        return figure

    return styled


@_styled
def sections(map: xr.Dataset, of: str = "reachability_index") -> Figure:
    """Three orthogonal sections, laid out as in a drawing: x-z, y-z and x-y.

    The vertical ones go through the voxels at y = 0 and x = 0 (through the middle of a box that
    does not hold 0), the horizontal one through the height where most is reached.

    Args:
        map: a capability map, a comparison or a forward map.
        of: any variable over (x, y, z).

    Raises:
        ValueError: the map has no such variable; the message names those it has.
        ImportError: matplotlib is not installed.
    """
    look = colours(map, of)
    (x, y, z) = (size(map, axis) for axis in VOXELS)
    height = float(np.clip(5.4 * (z + y) / (x + y) + 1.0, 4.0, 11.0))
    figure = _figure(6.8, height)
    panels = figure.subplots(
        2, 2, gridspec_kw={"width_ratios": [x, y], "height_ratios": [z, y]}, squeeze=False
    )
    image = draw_section(panels[0, 0], map, of, "y", look)
    draw_section(panels[0, 1], map, of, "x", look)
    draw_section(panels[1, 0], map, of, "z", look)
    key = panels[1, 1]
    key.set_axis_off()
    bar = figure.colorbar(
        image, cax=key.inset_axes((0.1, 0.7, 0.8, 0.05)), orientation="horizontal"
    )
    bar.set_label(label(map, of))
    key.text(0.1, 0.4, title(map, "\n"), va="top", linespacing=1.6, transform=key.transAxes)
    return figure


@_styled
def dexterity(map: xr.Dataset) -> Figure:
    """Reachability index and dexterous fraction, side by side in the section y = 0, one scale.

    Raises:
        ValueError: the map lacks one of the two; the message names the variables it has.
        ImportError: matplotlib is not installed.
    """
    names = ("reachability_index", "dexterous_fraction")
    look = colours(map, names[0])
    figure, panels = _row([size(map, "x")] * 2, size(map, "z"))
    images = [draw_section(axes, map, of, "y", look) for axes, of in zip(panels, names)]
    for axes, of in zip(panels, names):
        axes.set_title(f"{of.replace('_', ' ')}, {axes.get_title()}")
    _bar(figure, panels, images[0], "share of the orientations")
    figure.suptitle(title(map))
    return figure


@_styled
def solution_counts(map: xr.Dataset) -> Figure:
    """How many solutions within the joint limits the tested poses have.

    Raises:
        ValueError: the map has no `solution_histogram`.
        ImportError: matplotlib is not installed.
    """
    figure = _figure(4.8, 3.0)
    draw_histogram(figure.subplots(), map)
    figure.suptitle(title(map))
    return figure


@_styled
def volume_by_orientation(map: xr.Dataset) -> Figure:
    """The volume reached with each fixed orientation, and where the tool points in it.

    Left: the volumes in falling order. Right: a Mollweide view of all directions as seen from
    the base, ahead (+x) in the middle; each has the colour of the nearest direction that the axis
    of approach takes in a tested orientation (dots), the mean over the orientations that share
    it. The axis of approach is the attribute `orientation_axis`, or the tool's x axis.

    Raises:
        ValueError: the map has no `orientation_reached` or `orientation_quaternion`.
        ImportError: matplotlib is not installed.
    """
    reached = variable(map, "orientation_reached", ("chunk", "orientation"))
    quaternions = variable(map, "orientation_quaternion", ("orientation", "quaternion"))
    volume = reached.sum("chunk").values * float(map.attrs["voxel"]) ** 3
    axis = map.attrs.get("orientation_axis")
    approach = np.array((1.0, 0.0, 0.0) if axis is None else axis)
    directions = rotations_of(quaternions.values) @ approach
    figure = _figure(7.0, 2.9)
    grid = figure.add_gridspec(1, 2, width_ratios=[2, 3])
    curve = figure.add_subplot(grid[0])
    edges = np.arange(volume.size + 1)
    curve.stairs(np.sort(volume)[::-1], edges, fill=True, color=BLUE, alpha=0.85)
    curve.axhline(float(volume.mean()), color=INK, linewidth=0.8, linestyle="--")
    curve.text(volume.size, float(volume.mean()), "mean ", ha="right", va="bottom", fontsize=7)
    curve.set(
        xlim=(0, volume.size), xlabel="orientations, best first", ylabel="volume reached (m³)"
    )
    curve.set_ylim(0, max(1.08 * float(volume.max()), 1e-9))
    curve.spines[["top", "right"]].set_visible(False)
    sphere = figure.add_subplot(grid[1], projection="mollweide")
    mesh = draw_sphere(sphere, directions, volume)
    bar = figure.colorbar(mesh, ax=sphere, location="bottom", shrink=0.5, aspect=24)
    bar.set_label("volume reached (m³)")
    figure.suptitle(title(map))
    return figure


@_styled
def manipulability(map: xr.Dataset) -> Figure:
    """The best manipulability of each voxel, in a vertical and a horizontal section.

    Raises:
        ValueError: the map has no `manipulability_best`.
        ImportError: matplotlib is not installed.
    """
    of = "manipulability_best"
    look = colours(map, of)
    figure, panels = _row([size(map, "x")] * 2, max(size(map, "z"), size(map, "y")))
    images = [draw_section(axes, map, of, normal, look) for axes, normal in zip(panels, "yz")]
    _bar(figure, panels, images[0], label(map, of))
    figure.suptitle(title(map))
    return figure


@_styled
def overview(map: xr.Dataset) -> Figure:
    """One picture of a map: two sections of the reachability index and the numbers of solutions.

    Raises:
        ValueError: the map has no `reachability_index` or `solution_histogram`.
        ImportError: matplotlib is not installed.
    """
    of = "reachability_index"
    look = colours(map, of)
    width = size(map, "x")
    figure, panels = _row([width, width, 0.9 * width], max(size(map, "z"), size(map, "y")), 10.0)
    images = [draw_section(axes, map, of, normal, look) for axes, normal in zip(panels, "yz")]
    _bar(figure, panels[:2], images[0], label(map, of))
    draw_histogram(panels[2], map)
    figure.suptitle(title(map))
    return figure


@_styled
def differences(comparison: xr.Dataset, of: str = "reachability_index") -> Figure:
    """What `compare` found, in the section y = 0: the difference, and what is gained and lost.

    Args:
        comparison: what `compare` returns.
        of: the variable of the maps whose difference is shown.

    Raises:
        ValueError: the comparison has no such difference; the message names those it has.
        ImportError: matplotlib is not installed.
    """
    name = f"{of}_difference"
    look = colours(comparison, name)
    figure, panels = _row([size(comparison, "x")] * 2, size(comparison, "z"))
    image = draw_section(panels[0], comparison, name, "y", look)
    _bar(figure, panels[0], image, label(comparison, name))
    colors = need("matplotlib.colors")
    kinds = {"lost": RED, "common": GREY, "gained": BLUE}
    three = colors.ListedColormap(list(kinds.values())), colors.Normalize(-1, 1)
    draw_section(panels[1], comparison, "change", "y", three)
    patch = need("matplotlib.patches").Patch
    handles = [
        patch(color=colour, label=f"{kind} {comparison.attrs[f'volume_{kind}']:.3g} m³")
        for kind, colour in kinds.items()
    ]
    panels[1].legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.18),
        ncols=3,
        frameon=False,
        handlelength=1.0,
    )
    figure.suptitle(title(comparison))
    return figure


PLOTS: dict[str, Callable[[xr.Dataset], Figure]] = {
    "overview": overview,
    "sections": sections,
    "dexterity": dexterity,
    "solution-counts": solution_counts,
    "volume-by-orientation": volume_by_orientation,
    "manipulability": manipulability,
}
"""The figures of one capability map, by name."""


def _figure(width: float, height: float) -> Figure:
    """A figure of so many inches that fits its axes to what is drawn."""
    return need("matplotlib.figure").Figure(figsize=(width, height), layout="compressed")


def _row(widths: Sequence[float], height: float, inches: float = 7.0) -> tuple[Figure, list[Axes]]:
    """Axes side by side, in proportion to metres of width and height."""
    # What the labels and the colour bars take of the width is found by trial.
    tall = 0.8 * inches * height / sum(widths) + 0.8
    figure = _figure(inches, float(np.clip(tall, 2.4, 11.0)))
    panels = figure.subplots(1, len(widths), gridspec_kw={"width_ratios": list(widths)})
    return figure, list(panels)


def _bar(figure: Figure, axes: Axes | list[Axes], image: AxesImage, text: str) -> None:
    """The colour bar of a section, beside the axes it is for."""
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02, aspect=24)
    bar.set_label(text)
