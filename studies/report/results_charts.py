"""Charts of a sweep: every figure over every key, and maps where two keys make a grid."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hertzloop.scenes.keys import unit_of
from studies import pictures, words
from studies.latency.pictures import round_above
from studies.sweeps.evaluate import Rows
from studies.sweeps.summary import SHOWN, known

_MOST_KEYS = 6
_MOST_FIGURES = 3
_MOST_DOTS = 4000  # a panel
_WITHOUT = {"rebound_percent": 100.0}  # what a figure is without control; else 0 dB


def key_words(key: str) -> str:
    """A scene key as an axis: words with a unit."""
    if key in words.AXES:
        return words.AXES[key]
    name, unit = unit_of(key)
    name = name.partition(".")[2].replace("_", " ") or name
    return f"{name} ({unit})" if unit else name


def shown_figures(rows: Rows) -> list[str]:
    """Those that differ between cases, the first few; the first one if none does."""
    there = [f for f in SHOWN if known(rows, f)]
    differing = [f for f in there if len({row[f] for row in known(rows, f)}) > 1]
    return (differing or there)[:_MOST_FIGURES]


def over_keys(rows: Rows, keys: list[str]) -> Figure:
    """A row a figure, a column a key: every case a dot, the mean over the other keys a line where
    values repeat."""
    figures, keys = shown_figures(rows), keys[:_MOST_KEYS]
    sheet, axes = pictures.sheet(len(figures), len(keys), width=10.0, height=2.5)
    for line, figure in enumerate(figures):
        for column, key in enumerate(keys):
            ax = axes[line, column]
            _draw(ax, rows, key, figure)
            ax.axhline(_WITHOUT.get(figure, 0.0), color="#7F7F7F", linewidth=1.0, linestyle="--")
            if not column:
                name, _, unit = words.against_none(figure).partition(" against no control ")
                ax.set_ylabel(f"{name} {unit}")
            if line == len(figures) - 1:
                ax.set_xlabel(key_words(key))
    return sheet


def _draw(ax: Any, rows: Rows, key: str, figure: str) -> None:
    having = known(rows, figure)
    numbers = all(isinstance(row[key], int | float) for row in rows)
    numbers = numbers and not any(isinstance(row[key], bool) for row in rows)
    kinds = list(dict.fromkeys(row[key] if numbers else str(row[key]) for row in rows))
    places = np.array(
        [row[key] if numbers else kinds.index(str(row[key])) for row in having], float
    )
    y = np.array([row[figure] for row in having], float)
    some = slice(None, None, -(-len(y) // _MOST_DOTS))
    ax.plot(places[some], y[some], ".", color=pictures.COLOURS[0], markersize=3, alpha=0.5)
    if len(kinds) < len(rows):
        at = np.unique(places)
        means = [y[places == place].mean() for place in at]
        line = "-" if numbers else ""
        ax.plot(at, means, color=pictures.COLOURS[1], marker="o", markersize=3, linestyle=line)
    if not numbers:
        names = [words.law(str(kind)) for kind in kinds]
        ax.set_xticks(range(len(kinds)), names, rotation=25, ha="right", fontsize=7)
        ax.set_xlim(-0.5, len(kinds) - 0.5)


def map_keys(rows: Rows, keys: list[str], kind: str) -> tuple[str, str] | None:
    """The two keys of a grid of numbers, if that is what a sweep is."""
    if kind != "grid" or len(keys) != 2:
        return None
    x, y = keys
    for key in keys:
        values = {row[key] for row in rows}
        if len(values) < 3 or any(isinstance(v, bool | str | list) for v in values):
            return None
    if len(rows) != len({row[x] for row in rows}) * len({row[y] for row in rows}):
        return None
    return x, y


def maps(rows: Rows, x: str, y: str) -> Figure:
    """A map a figure over two keys, no change in the middle of its colours; grey: no figure."""
    figures = shown_figures(rows)
    sheet, axes = pictures.sheet(1, len(figures), width=10.0, height=3.2)
    across, up = (sorted({row[key] for row in rows}) for key in (x, y))
    for ax, figure in zip(axes[0], figures, strict=True):
        z = np.full((len(up), len(across)), np.nan)
        for row in known(rows, figure):
            z[up.index(row[y]), across.index(row[x])] = row[figure]
        z -= _WITHOUT.get(figure, 0.0)
        largest = float(np.nanmax(np.abs(z)))
        reach = round_above(largest) if largest > 0.0 else 1.0
        ax.set_facecolor("#b8b8b8")
        shown = ax.pcolormesh(
            across, up, z, cmap="RdBu_r", vmin=-reach, vmax=reach, shading="nearest",
            rasterized=True,
        )  # fmt: skip
        ax.grid(False)
        name, _, unit = words.against_none(figure).partition(" against no control ")
        unit = "points" if figure == "rebound_percent" else unit.strip("()")
        sheet.colorbar(shown, ax=ax, label=f"change ({unit})", ticks=np.linspace(-reach, reach, 5))
        ax.set(title=name, xlabel=key_words(x), ylabel=key_words(y))
    return sheet
