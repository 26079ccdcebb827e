"""Pictures of the latency study: maps of metrics."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from hertzloop.results.cases import CASE_FACTS
from hertzloop.studies.pages import pictures, words
from hertzloop.studies.pages.words import METRICS

CHANGES = {name: words for name, words in METRICS.items() if CASE_FACTS[name].unit in ("dB", "%")}
_EMPTY = {"rebound_percent": 1.0}  # a row that changes by less is left out; else by 0.05 dB
_LEAST_DB = 0.05
_COLOURS = "RdBu_r"
_UNSTABLE = "#b8b8b8"
_LINE = "as without control"
_LEVELS = 16  # an even number: the band in the middle is around zero, and white
_FLAT = 0.02  # of a scale: less than this has no line


def draw_maps(
    path: Path, title: str, maps: dict[str, list[dict[str, Any]]], metrics: dict[str, str]
) -> None:
    """A row a metric with one scale, zero in its middle; a column a map. Rows that show nothing are
    left out, and named."""
    grids = {metric: [_grid(rows, key, metric) for key, rows in maps.items()] for metric in metrics}
    reaches = {metric: _reach(found) for metric, found in grids.items()}
    kept = [f for f in metrics if reaches[f] >= _EMPTY.get(f, _LEAST_DB)]
    dropped = [metrics[f].partition(" (")[0] for f in metrics if f not in kept]
    sheet, axes = pictures.sheet(max(1, len(kept)), len(maps), width=13.0, height=2.3)
    for line, metric in enumerate(kept):
        reach = pictures.round_above(reaches[metric])
        for column, (key, found) in enumerate(zip(maps, grids[metric], strict=True)):
            ax = axes[line, column]
            shown = _draw_map(ax, *found, reach)
            ax.set_ylabel(words.AXES[key])
            if key == "sensors.bits":
                ax.yaxis.set_major_locator(MaxNLocator(integer=True))
            if line == len(kept) - 1:
                ax.set_xlabel(words.AXES["controller.latency_us"])
        unit = "points" if metric == "rebound_percent" else "dB"
        name = metrics[metric].partition(" (")[0]
        bar = sheet.colorbar(
            shown,
            ax=list(axes[line]),
            label=f"{name}:\nchange ({unit})",
            ticks=np.linspace(-reach, reach, 5),
            aspect=12,
            pad=0.01,
        )
        bar.ax.yaxis.set_major_formatter(lambda value, _: f"{value:+g}" if value else "0")
    left_out = f"\nNot shown, as hardly changed: {', '.join(dropped)}" if dropped else ""
    sheet.suptitle(f"{title}: change against no control. Blue: less{left_out}")
    known: list[Any] = [Line2D([], [], color="black", linestyle="--", label=_LINE)]
    if any(np.isnan(z).any() for found in grids.values() for _, _, z in found):
        known.append(Patch(color=_UNSTABLE, label="unstable"))
    sheet.legend(handles=known, loc="outside upper right", ncols=len(known))
    pictures.save(sheet, path)


def _grid(rows: list[dict[str, Any]], key: str, metric: str) -> tuple[list[Any], list[Any], Any]:
    """Latencies, values of the key, and the metric's change, (values, latencies); nan: unstable."""
    latencies = sorted({row["controller.latency_us"] for row in rows})
    values = sorted({row[key] for row in rows})
    z = np.array([np.nan if row[metric] is None else row[metric] for row in rows], float)
    z = z.reshape(len(latencies), len(values)).T - CASE_FACTS[metric].without
    return latencies, values, z


def _reach(found: list[tuple[list[Any], list[Any], Any]]) -> float:
    """Largest change of a row, without the last 2 % of a map's cases: the map in the middle counts,
    as one gain may drown all else."""
    sizes = [np.abs(z[np.isfinite(z)]) for _, _, z in found]
    reaches = [float(np.percentile(size, 98)) for size in sizes if len(size)]
    return float(np.median(reaches)) if reaches else 0.0


def _draw_map(ax: Any, latencies: list[Any], values: list[Any], z: Any, reach: float) -> Any:
    ax.set_facecolor(_UNSTABLE)
    levels = np.linspace(-reach, reach, _LEVELS)
    shown = ax.contourf(latencies, values, z, levels, cmap=_COLOURS, extend="both")
    ax.grid(False)
    if np.nanmin(z) < -_FLAT * reach and np.nanmax(z) > _FLAT * reach:
        ax.contour(latencies, values, z, [0.0], colors="black", linestyles="--")
    return shown
