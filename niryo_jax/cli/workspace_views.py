"""What `niryo-jax workspace` shows: the numbers of a map, costs, differences, placements."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table
from rich.text import Text

from niryo_jax import workspace as ws
from niryo_jax.cli.console import show_table, stderr
from niryo_jax.cli.outcome import json_number, print_json
from niryo_jax.cli.tables import new_table
from niryo_jax.collision import CollisionCheck

if TYPE_CHECKING:
    import xarray as xr

_VOLUMES = ("reachability_index", "dexterous_fraction")
_UNITS = {
    "voxel": "m",
    "volume": "m^3",
    "dexterous_volume": "m^3",
    "length": "m",
    "best_manipulability": "m^3",
}
_DURATIONS = ("compile_seconds", "seconds")


def report(found: xr.Dataset, where: Path, as_json: bool) -> None:
    """The main numbers of a map; of one that is not finished those that are known already."""
    missing = found.attrs.get("chunks_missing", 0)
    if missing:
        said = f"{missing} of {found.sizes['chunk']} chunks are not computed yet; "
        stderr().print(Text(f"{where}: {said}`niryo-jax workspace resume` computes them"))
    volume, dexterous = (ws.reachable_volume(found, of=name) for name in _VOLUMES)
    histogram = found["solution_histogram"].sum("chunk").values
    poses = int(histogram.sum())
    reached = poses - int(histogram[0])
    shares = found["undecided_fraction"].values.astype(np.float64)
    undecided = round(float(np.nansum(shares)) * found.sizes["orientation"])
    if undecided:
        said = f"{where}: of {undecided:,} poses it is not proved that all solutions were found, "
        stderr().print(Text(f"{said}so that volumes and counts may be too small"))
    attributes = found.attrs
    check = ws.collisions_of(found)
    numbers = {
        "store": str(where),
        "robot": attributes["robot_name"],
        "voxel": attributes["voxel"],
        "voxels": found["reachability_index"].size,
        "orientations": found.sizes["orientation"],
        "orientation_kind": attributes["orientation_kind"],
        "exact": bool(attributes["exact"]),
        "collisions": _looked_at(check),
        "chunks_missing": missing,
        "poses": poses,
        "poses_reached": reached,
        "poses_colliding": _colliding(found),
        "poses_undecided": undecided,
        "volume": None if missing else volume.value,
        "volume_lower": None if missing else volume.lower,
        "volume_upper": None if missing or undecided else volume.upper,
        "dexterous_volume": None if missing else dexterous.value,
        "most_solutions": int(np.max(np.flatnonzero(histogram), initial=0)),
        "best_manipulability": _largest(found["manipulability_best"].values),
    }
    show(f"Capability map of {attributes['robot_name']}", numbers, as_json)


def _looked_at(check: CollisionCheck | None) -> str:
    """What the arm had to stay clear of, in words."""
    if check is None:
        return "not looked at"
    around = check.world.names if check.world is not None else ()
    apart = f", {1e3 * check.margin:.4g} mm apart" if check.margin else ""
    return f"none with {', '.join(('itself', *around))}{apart}"


def _colliding(found: xr.Dataset) -> int | None:
    """How many poses are reached by colliding alone; None where collisions were not looked at."""
    if "colliding_fraction" not in found:
        return None
    shares = found["colliding_fraction"].values.astype(np.float64)
    return round(float(np.nansum(shares)) * found.sizes["orientation"])


def _largest(values: np.ndarray) -> float | None:
    there = values[np.isfinite(values)]
    return float(there.max()) if there.size else None


def show(title: str, numbers: dict[str, Any], as_json: bool) -> None:
    """Named numbers as a table or as JSON."""
    if as_json:
        print_json({name: _plain(value) for name, value in numbers.items()})
        return
    # As Text, for names may look like markup.
    table = new_table("")
    table.title = Text(title)
    table.add_column("what")
    table.add_column("value", justify="right", overflow="fold")
    for name, value in numbers.items():
        table.add_row(name.replace("_", " "), Text(_said(name, value)))
    show_table(table)


def _said(name: str, value: Any) -> str:
    """A number with its unit, and a duration in hours and minutes, too."""
    if value is None:
        return "-"
    if name in _DURATIONS:
        return f"{value:,.1f} s ({timedelta(seconds=math.ceil(value))})"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        said = f"{value:.4g}"
    else:
        said = f"{value:,}" if isinstance(value, int) else str(value)
    unit = _UNITS.get(name) or _UNITS.get(name.split("_")[0], "")
    return f"{said} {unit}".strip()


def _plain(value: Any) -> Any:
    """For JSON, which knows neither numpy nor NaN."""
    plain = value.item() if isinstance(value, np.generic) else value
    return json_number(plain) if isinstance(plain, float) else plain


def placements_document(found: ws.BasePlacements) -> dict[str, Any]:
    """Placements, best first, for JSON."""
    placements = [
        {
            "position": position.tolist(),
            "heading": float(heading),
            "reached": reached.tolist(),
            "margin": json_number(margin),
            "manipulability": json_number(manipulability),
        }
        for position, heading, reached, margin, manipulability in _rows(found)
    ]
    return {
        "candidates": found.candidates,
        "evaluated": found.evaluated,
        "placements": placements,
    }


def placements_table(found: ws.BasePlacements) -> Table:
    """Placements, best first, for people."""
    table = new_table(f"{found.candidates:,} candidates, {found.evaluated:,} evaluated exactly")
    for head in ("x (m)", "y (m)", "heading (deg)", "reached", "margin (deg)", "manipulability"):
        table.add_column(head, justify="right")
    for position, heading, reached, margin, manipulability in _rows(found):
        table.add_row(
            f"{position[0]:.4f}",
            f"{position[1]:.4f}",
            f"{np.rad2deg(heading):.1f}",
            f"{reached.sum()} of {len(reached)}",
            f"{np.rad2deg(margin):.2f}",
            f"{manipulability:.3g}",
        )
    return table


def _rows(found: ws.BasePlacements) -> Iterator[Any]:
    return zip(found.position, found.heading, found.reached, found.margin, found.manipulability)
