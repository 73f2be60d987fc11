"""How all figures look, and how they are written; made without a display."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from niryo_jax import arguments
from niryo_jax.extras import need
from niryo_jax.files import whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FORMATS: dict[str, dict[str, Any]] = {
    ".png": {},
    ".svg": {"metadata": {"Date": None}},
    ".pdf": {"metadata": {"CreationDate": None}},
}
INK, BLUE, RED, GREY, PALE = "#333333", "#2166ac", "#b2182b", "#9aa0a6", "#eeeeee"
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "figure.titlesize": 9,
    "savefig.dpi": 200,
    "savefig.bbox": "tight",
    "savefig.pad_inches": 0.05,
    "svg.fonttype": "none",
    "svg.hashsalt": "niryo_jax",
    "pdf.fonttype": 42,
}


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG (200 dots per inch), SVG or PDF, whichever the suffix names.

    The text of an SVG or PDF stays text, and the same figure gives the same bytes.

    Raises:
        ValueError: another suffix.
        OSError: the file cannot be written.
    """
    arguments.check_path("path", path)
    if not hasattr(figure, "savefig"):
        raise TypeError(f"figure: expected a matplotlib Figure, got {arguments.shown(figure)}")
    suffix = Path(path).suffix.lower()
    if suffix not in _FORMATS:
        raise ValueError(f"path: expected a suffix of {', '.join(_FORMATS)}, got {str(path)!r}")
    with need("matplotlib").rc_context(STYLE), whole(path) as file:
        figure.savefig(file, format=suffix[1:], **_FORMATS[suffix])
