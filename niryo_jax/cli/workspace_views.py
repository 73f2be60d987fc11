"""What `niryo-jax workspace` shows: the numbers of a map, costs, differences, placements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from niryo_jax import workspace as ws
from niryo_jax.cli.console import stdout
from niryo_jax.cli.outcome import print_json
from niryo_jax.cli.tables import new_table

if TYPE_CHECKING:
    import xarray as xr

_VOLUMES = ("reachability_index", "dexterous_fraction")
_UNITS = {
    "voxel": "m",
    "volume": "m^3",
    "dexterous": "m^3",
    "compile": "s",
    "seconds": "s",
    "stored": "bytes",
    "best_manipulability": "m^3",
}


def report(found: xr.Dataset, where: Path, as_json: bool) -> None:
    """The main numbers of a map."""
    volume, dexterous = (ws.reachable_volume(found, of=name) for name in _VOLUMES)
    histogram = found["solution_histogram"].sum("chunk").values
    poses = int(histogram.sum())
    reached = poses - int(histogram[0])
    attributes = found.attrs
    numbers = {
        "store": str(where),
        "robot": attributes["robot_name"],
        "voxel": attributes["voxel"],
        "voxels": int(np.prod(attributes["shape"])),
        "orientations": attributes["orientations"],
        "orientation_kind": attributes["orientation_kind"],
        "exact": bool(attributes["exact"]),
        "chunks_missing": attributes.get("chunks_missing", 0),
        "poses": poses,
        "poses_reached": reached,
        "volume": volume.value,
        "volume_lower": volume.lower,
        "volume_upper": volume.upper,
        "dexterous_volume": dexterous.value,
        "most_solutions": int(np.max(np.flatnonzero(histogram), initial=0)),
        "best_manipulability": _largest(found["manipulability_best"].values),
    }
    show(attributes["title"], numbers, as_json)


def _largest(values: np.ndarray) -> float | None:
    there = values[np.isfinite(values)]
    return float(there.max()) if there.size else None


def show(title: str, numbers: dict[str, Any], as_json: bool) -> None:
    """Named numbers as a table or as JSON."""
    if as_json:
        print_json({name: _plain(value) for name, value in numbers.items()})
        return
    table = new_table(title)
    table.add_column("what")
    table.add_column("value", justify="right")
    for name, value in numbers.items():
        unit = _UNITS.get(name) or _UNITS.get(name.split("_")[0], "")
        said = (
            f"{value:.4g}"
            if isinstance(value, float)
            else f"{value:,}"
            if _counts(value)
            else value
        )
        table.add_row(name.replace("_", " "), f"{said} {unit}".strip())
    stdout().print(table)


def _counts(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _number(value: float) -> float | None:
    """For JSON, which knows no NaN."""
    return float(value) if np.isfinite(value) else None


def show_placements(found: ws.BasePlacements, as_json: bool) -> None:
    """Placements, best first."""
    rows = zip(found.position, found.heading, found.reached, found.margin, found.manipulability)
    if as_json:
        placements = [
            {
                "position": position.tolist(),
                "heading": float(heading),
                "reached": [bool(x) for x in reached],
                "margin": _number(margin),
                "manipulability": _number(manipulability),
            }
            for position, heading, reached, margin, manipulability in rows
        ]
        print_json(
            {
                "candidates": found.candidates,
                "evaluated": found.evaluated,
                "placements": placements,
            }
        )
    else:
        title = f"{found.candidates:,} candidates, {found.evaluated:,} evaluated exactly"
        table = new_table(title)
        for head in (
            "x (m)",
            "y (m)",
            "heading (deg)",
            "reached",
            "margin (deg)",
            "manipulability",
        ):
            table.add_column(head, justify="right")
        for position, heading, reached, margin, manipulability in rows:
            table.add_row(
                f"{position[0]:.4f}",
                f"{position[1]:.4f}",
                f"{np.rad2deg(heading):.1f}",
                f"{reached.sum()} of {len(reached)}",
                f"{np.rad2deg(margin):.2f}",
                f"{manipulability:.3g}",
            )
        stdout().print(table)
