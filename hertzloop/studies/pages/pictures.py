"""One look for all charts: readable on light and dark pages, and without colour."""

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from hertzloop.common.atomic_files import whole_file

# Okabe and Ito's colours, each with a line style and a marker of its own.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#7F7F7F")
LINES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (7, 3)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

mpl.rcParams.update(
    {
        "figure.facecolor": "white",
        "axes.facecolor": "white",
        "axes.grid": True,
        "grid.alpha": 0.3,
        "font.size": 9,
        "legend.fontsize": 8,
        "legend.framealpha": 0.9,
        "lines.linewidth": 1.4,
    }
)


def look(index: int, marked: bool = False) -> dict[str, Any]:
    """Colour and line style, with marker if asked, of series `index`."""
    style: dict[str, Any] = {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": LINES[index % len(LINES)],
    }
    if marked:
        style |= {"marker": MARKERS[index % len(MARKERS)], "markersize": 5}
    return style


def sheet(rows: int, columns: int, width: float = 9.0, height: float = 2.8) -> tuple[Figure, Any]:
    """A figure of rows x columns axes, `height` inches a row."""
    figure = Figure(figsize=(width, height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def round_above(value: float) -> float:
    """The smallest of 1, 2, 4 times a power of ten that is not below: its half is round, too."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(f * power for f in (1, 2, 4, 10) if f * power >= value * (1 - 1e-9))


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG, or what the ending says. Raises NotWritten."""
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, dpi=130)
    return path
