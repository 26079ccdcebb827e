"""The picture of a sweep: a map of its metrics over two keys, or the metrics over each key."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hertzloop.results.cases import CASE_FACTS, SHOWN
from hertzloop.studies.cases.rows import Rows, with_metric
from hertzloop.studies.pages import pictures, words

_MOST_KEYS = 6
_MOST_METRICS = 3
_MOST_DOTS = 4000  # a panel


def draw(rows: Rows, keys: list[str], kind: str) -> Figure:
    """Draw the first few metrics that differ between cases.

    Args:
        rows: Rows of the cases, at least one with a metric.
        keys: Keys that differ from case to case.
        kind: Kind of the design. A grid over two keys of numbers is drawn as a map of each metric.
    """
    shown = {
        metric: {f"{row[metric]:z.3f}" for row in having}
        for metric in SHOWN
        if (having := with_metric(rows, metric))
    }
    differing = [metric for metric, values in shown.items() if len(values) > 1] or list(shown)
    metrics, grid = differing[:_MOST_METRICS], map_keys(rows, keys, kind)
    return _maps(rows, metrics, *grid) if grid else _over_keys(rows, metrics, keys[:_MOST_KEYS])


def _over_keys(rows: Rows, metrics: list[str], keys: list[str]) -> Figure:
    """Draw each metric (rows) over each key (columns). Every case is a dot. A line is the mean over
    the other keys, if values repeat. Dashed: without control."""
    sheet, axes = pictures.sheet(len(metrics), len(keys), width=10.0, height=2.5)
    for line, metric in enumerate(metrics):
        for column, key in enumerate(keys):
            ax = axes[line, column]
            _draw(ax, rows, key, metric)
            ax.axhline(CASE_FACTS[metric].without, color="#7F7F7F", linewidth=1.0, linestyle="--")
            if not column:
                name, _, unit = words.against_none(metric).partition(" against no control ")
                ax.set_ylabel(f"{name} {unit}")
            if line == len(metrics) - 1:
                ax.set_xlabel(words.key_words(key))
    return sheet


def _draw(ax: Any, rows: Rows, key: str, metric: str) -> None:
    having = with_metric(rows, metric)
    numbers = all(isinstance(row[key], int | float) for row in rows)
    numbers = numbers and not any(isinstance(row[key], bool) for row in rows)
    kinds = list(dict.fromkeys(row[key] if numbers else str(row[key]) for row in rows))
    places = np.array(
        [row[key] if numbers else kinds.index(str(row[key])) for row in having], float
    )
    y = np.array([row[metric] for row in having], float)
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
    """Return the two keys of a sweep over a grid of numbers; None for another sweep."""
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


def _maps(rows: Rows, metrics: list[str], x: str, y: str) -> Figure:
    """Draw a map of each metric over two keys. Blue: less than without control. Grey: no metric."""
    sheet, axes = pictures.sheet(1, len(metrics), width=10.0, height=3.2)
    across, up = (sorted({row[key] for row in rows}) for key in (x, y))
    for ax, metric in zip(axes[0], metrics, strict=True):
        z = np.full((len(up), len(across)), np.nan)
        for row in with_metric(rows, metric):
            z[up.index(row[y]), across.index(row[x])] = row[metric]
        z -= CASE_FACTS[metric].without
        largest = float(np.nanmax(np.abs(z)))
        reach = pictures.round_above(largest) if largest > 0.0 else 1.0
        ax.set_facecolor("#b8b8b8")
        shown = ax.pcolormesh(
            across,
            up,
            z,
            cmap="RdBu_r",
            vmin=-reach,
            vmax=reach,
            shading="nearest",
            rasterized=True,
        )
        ax.grid(False)
        name, _, unit = words.against_none(metric).partition(" against no control ")
        unit = "points" if CASE_FACTS[metric].without else unit.strip("()")
        sheet.colorbar(shown, ax=ax, label=f"change ({unit})", ticks=np.linspace(-reach, reach, 5))
        ax.set(title=name, xlabel=words.key_words(x), ylabel=words.key_words(y))
    return sheet
