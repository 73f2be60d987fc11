"""What the figures of maps are drawn with: sections, colours and labels."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from niryo_jax.extras import need
from niryo_jax.workspace.fields import SHARES, shown, variable
from niryo_jax.workspace.variables import VOXELS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.image import AxesImage

INK, BLUE, RED, GREY = "#333333", "#2166ac", "#b2182b", "#c4c8cc"
_PLATE = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
_ACROSS = {"x": ("y", "z"), "y": ("x", "z"), "z": ("x", "y")}
"""The horizontal and the vertical axis of a section across an axis."""


def colours(map: xr.Dataset, of: str) -> tuple[Colormap, Normalize]:
    """The colour map of a variable, and its range over the whole map.

    Shares and counts start at 0; what can have both signs in a comparison is symmetric about it.

    Raises:
        ValueError: the map has no such variable.
        ImportError: matplotlib is not installed.
    """
    matplotlib, normalize = need("matplotlib"), need("matplotlib.colors").Normalize
    values = variable(map, of, VOXELS).values
    drawn = values[shown(map, of).values].astype(np.float64)
    least, most = (drawn.min(), drawn.max()) if drawn.size else (0.0, 0.0)
    if "reached" in map:
        bound = max(-least, most) or 1.0
        return matplotlib.colormaps["RdBu"], normalize(-bound, bound)
    if of in SHARES or values.dtype.kind in "iu":
        least = 0.0
    return matplotlib.colormaps["viridis"], normalize(least, most if most > least else least + 1.0)


def draw_section(
    axes: Axes, map: xr.Dataset, of: str, normal: str, look: tuple[Colormap, Normalize]
) -> AxesImage:
    """Draw the plane of voxels across an axis: coloured where there is something, and outlined.

    It lies at 0 along x or y (in the middle of a box that does not hold 0), and along z where
    most is reached. A cross marks the axis of the base.
    """
    across, up = _ACROSS[normal]
    where = shown(map, of)
    here = {normal: _place(map, where, normal)}
    mask = where.isel(here).transpose(up, across).values
    values = map[of].isel(here).transpose(up, across).values
    right, top = _edges(map, across), _edges(map, up)
    image = axes.imshow(
        np.ma.masked_where(~mask, values),
        cmap=look[0],
        norm=look[1],
        origin="lower",
        extent=(right[0], right[-1], top[0], top[-1]),
        interpolation="nearest",
    )
    if mask.any():
        _outline(axes, mask, right, top)
    else:
        axes.text(0.5, 0.5, "nothing is reached", ha="center", transform=axes.transAxes)
    if right[0] <= 0 <= right[-1] and top[0] <= 0 <= top[-1]:
        for width, colour in ((2.4, "white"), (0.9, INK)):  # seen on dark and light alike
            axes.plot(0, 0, marker="+", markersize=6, markeredgewidth=width, color=colour)
    at = 1e3 * float(map[normal].values[here[normal]])
    axes.set(
        xlabel=f"{across} (m)",
        ylabel=f"{up} (m)",
        title=f"section at {normal} = {at:.4g} mm",
    )
    return image


def draw_histogram(axes: Axes, map: xr.Dataset) -> None:
    """Draw the shares of the poses by their number of solutions.

    The scale is logarithmic where the shares span more than a factor of 300.

    Raises:
        ValueError: the map has no `solution_histogram`.
    """
    poses = variable(map, "solution_histogram", ("chunk", "solutions")).sum("chunk").values
    poses = poses[: int(np.max(np.flatnonzero(poses), initial=0)) + 1]
    share = 100.0 * poses / max(int(poses.sum()), 1)
    numbers = np.arange(poses.size)
    bars = axes.bar(numbers, share, 0.8, color=[GREY, *[BLUE] * (poses.size - 1)])
    axes.bar_label(bars, [f"{x:.2g}" if x else "" for x in share], padding=1.5, fontsize=6.5)
    there = share[share > 0]
    if there.size and there.max() > 300 * there.min():
        axes.set_yscale("log")
        axes.set_ylim(there.min() / 3, 300)
    axes.set(
        xlabel="solutions within the joint limits",
        ylabel="share of the poses (%)",
        xticks=numbers,
    )
    axes.spines[["top", "right"]].set_visible(False)


def draw_sphere(axes: Axes, directions: np.ndarray, values: np.ndarray) -> QuadMesh:
    """Draw all directions in Mollweide's projection, each as the nearest of `directions` (M, 3)."""
    same, group = np.unique(np.round(directions, 6), axis=0, return_inverse=True)
    group = group.reshape(-1)
    mean = np.bincount(group, values) / np.bincount(group)
    longitude, latitude = np.linspace(-np.pi, np.pi, 361), np.linspace(-np.pi / 2, np.pi / 2, 181)
    turn, rise = (longitude[1:] + longitude[:-1]) / 2, (latitude[1:] + latitude[:-1]) / 2
    nearest = np.empty((rise.size, turn.size))
    for row, up in enumerate(rise):
        # Seen from the base: what is to its left (+y) is drawn on the left.
        level = np.stack([np.cos(turn), -np.sin(turn)]) * np.cos(up)
        nearest[row] = mean[np.argmax(same[:, :2] @ level + same[:, 2:] * np.sin(up), axis=0)]
    mesh = axes.pcolormesh(longitude, latitude, nearest, cmap="viridis", rasterized=True)
    axes.plot(
        np.arctan2(-same[:, 1], same[:, 0]),
        np.arcsin(np.clip(same[:, 2], -1, 1)),
        linestyle="none",
        marker="o",
        markersize=1.5,
        color="white",
        markeredgewidth=0,
    )
    axes.set(xticks=[], yticks=[])
    for turned, risen, text in (
        (0.0, 0.0, "+x"),
        (-np.pi / 2, 0.0, "+y"),
        (np.pi / 2, 0.0, "−y"),
        (0.0, 0.44 * np.pi, "up"),
        (0.0, -0.44 * np.pi, "down"),
    ):
        axes.text(turned, risen, text, ha="center", va="center", color=INK, bbox=_PLATE)
    return mesh


def size(map: xr.Dataset, axis: str) -> float:
    """The length of the box along an axis, metres."""
    return map.sizes[axis] * float(map.attrs["voxel"])


def label(map: xr.Dataset, of: str) -> str:
    """What a variable means, with its unit."""
    described = map[of].attrs
    units = str(described.get("units", "1")).replace("^3", "³")
    text = described.get("long_name", of.replace("_", " "))
    return textwrap.fill(text if units == "1" else f"{text} ({units})", 38)


def title(map: xr.Dataset, between: str = "  ·  ") -> str:
    """What a map is of: the robot, the voxel, the orientations and the poses, as far as known."""
    known = map.attrs
    names = [str(known[key]) for key in ("robot_name", "robot_a", "robot_b") if key in known]
    parts = [" → ".join(names), f"voxel {1e3 * float(known['voxel']):.4g} mm"]
    if known.get("collisions") is not None:
        parts.append("free of collisions")
    if "orientations" in known:
        parts.append(f"{known['orientations']} orientations")
    if "solution_histogram" in map:
        parts.append(f"{_words(int(map['solution_histogram'].sum()))} poses")
    return between.join(part for part in parts if part)


def _words(number: int) -> str:
    """A large number to three digits, in words."""
    for power, word in ((10**9, "billion"), (10**6, "million")):
        if number >= power:
            return f"{number / power:.3g} {word}"
    return f"{number:,}"


def _place(map: xr.Dataset, where: xr.DataArray, normal: str) -> int:
    """The index of the section across an axis."""
    if normal == "z":
        reached = map.get("reachability_index", where)
        return int(reached.sum(("x", "y")).values.argmax())
    edges = _edges(map, normal)
    at = 0.0 if edges[0] <= 0 < edges[-1] else (edges[0] + edges[-1]) / 2
    return int(np.clip(np.searchsorted(edges, at, "right") - 1, 0, map.sizes[normal] - 1))


def _edges(map: xr.Dataset, axis: str) -> np.ndarray:
    """The faces of the voxels along an axis, metres: one more than there are voxels."""
    centres, half = map[axis].values, float(map.attrs["voxel"]) / 2
    return np.append(centres - half, centres[-1] + half)


def _outline(axes: Axes, mask: np.ndarray, right: np.ndarray, top: np.ndarray) -> None:
    """The line between the voxels that are shown and those that are not, mask (up, across)."""
    padded = np.pad(mask, 1)
    i, j = np.nonzero(padded[1:-1, 1:] != padded[1:-1, :-1])
    upright = np.stack([right[j], top[i], right[j], top[i + 1]], -1)
    i, j = np.nonzero(padded[1:, 1:-1] != padded[:-1, 1:-1])
    level = np.stack([right[j], top[i], right[j + 1], top[i]], -1)
    segments = np.concatenate([upright, level]).reshape(-1, 2, 2)
    lines = need("matplotlib.collections").LineCollection(
        segments, colors=INK, linewidths=0.6, capstyle="projecting"
    )
    axes.add_collection(lines, autolim=False)
