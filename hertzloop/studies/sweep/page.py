"""The page of a sweep: charts and maps of its metrics, extremes, all cases."""

import shlex
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hertzloop.results.cases import CASE_METRICS, SHOWN, CaseState
from hertzloop.scene.setup import Setup, parse
from hertzloop.scene.toml import toml_text
from hertzloop.studies.cases.design import keys_of
from hertzloop.studies.cases.rows import Rows, with_metric, without_result
from hertzloop.studies.pages import pictures, words
from hertzloop.studies.pages.html import ResultChart, ResultPage, ResultTable, svg
from hertzloop.studies.sweep.result import counted, extremes
from hertzloop.studies.sweep.results_file import read_results

_MOST_KEYS = 6
_MOST_METRICS = 3
_MOST_DOTS = 4000  # a panel


def telling_metrics(rows: Rows) -> tuple[list[str], list[str]]:
    """Return the metrics that differ between cases, or all with a value if none differs, and
    sentences on the other metrics."""
    shown = {
        metric: {_digits(row[metric]) for row in having}
        for metric in SHOWN
        if (having := with_metric(rows, metric))
    }
    differing = [metric for metric, values in shown.items() if len(values) > 1] or list(shown)
    sentences = [
        f"{words.against_none(metric)}: no value in any case"
        if metric not in shown
        else f"{words.against_none(metric)}: {min(shown[metric])} in every case"
        for metric in SHOWN
        if metric not in differing
    ]
    return differing, sentences


def _digits(value: float) -> str:
    return f"{value:z.3f}"


def shown_metrics(rows: Rows) -> list[str]:
    """Return the first few metrics that differ between cases."""
    return telling_metrics(rows)[0][:_MOST_METRICS]


def over_keys(rows: Rows, keys: list[str]) -> Figure:
    """Draw each metric (rows) over each key (columns). Every case is a dot. A line is the mean over
    the other keys, if values repeat."""
    metrics, keys = shown_metrics(rows), keys[:_MOST_KEYS]
    sheet, axes = pictures.sheet(len(metrics), len(keys), width=10.0, height=2.5)
    for line, metric in enumerate(metrics):
        for column, key in enumerate(keys):
            ax = axes[line, column]
            _draw(ax, rows, key, metric)
            ax.axhline(CASE_METRICS[metric].without, color="#7F7F7F", linewidth=1.0, linestyle="--")
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


def maps(rows: Rows, x: str, y: str) -> Figure:
    """Draw a map of each metric over two keys. Grey: no metric."""
    metrics = shown_metrics(rows)
    sheet, axes = pictures.sheet(1, len(metrics), width=10.0, height=3.2)
    across, up = (sorted({row[key] for row in rows}) for key in (x, y))
    for ax, metric in zip(axes[0], metrics, strict=True):
        z = np.full((len(up), len(across)), np.nan)
        for row in with_metric(rows, metric):
            z[up.index(row[y]), across.index(row[x])] = row[metric]
        z -= CASE_METRICS[metric].without
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
        unit = "points" if CASE_METRICS[metric].without else unit.strip("()")
        sheet.colorbar(shown, ax=ax, label=f"change ({unit})", ticks=np.linspace(-reach, reach, 5))
        ax.set(title=name, xlabel=words.key_words(x), ylabel=words.key_words(y))
    return sheet


_MOST_ROWS = 2000  # of cases


def sweep_page(path: Path) -> ResultPage:
    """Return the page of a file of results.

    Raises:
        ValueError: the file holds no results of a sweep.
        SceneError: its scene cannot be read.
    """
    rows, header = read_results(path)
    setup = parse(header["scene_toml"], recorded=True)
    design = header["design"]
    keys = keys_of(design)
    metrics, constant = telling_metrics(rows)
    lacking = without_result(rows)
    unstable = sum(row["state"] == CaseState.UNSTABLE for row in rows)
    warnings = [f"{len(lacking)} cases could not be run: {lacking[0]['status']}"] if lacking else []
    if unstable:
        warnings.append(f"{unstable} of {len(rows)} cases are unstable and have no metrics")
    beyond = counted(rows, "out_of_range")
    if beyond:
        names = ", ".join(
            f"{name} in {times} of {len(rows)} cases" for name, times in beyond.items()
        )
        warnings.append(f"Out of range: {names}")
    drawn: list[ResultChart] = []
    if shown_metrics(rows):
        dots = "One dot per case; orange: mean where values repeat; dashed: without control."
        drawn.append(ResultChart("Over each key", svg(over_keys(rows, keys)), dots))
        grid = map_keys(rows, keys, design["kind"])
        if grid:
            what = "Blue: less than without control. Grey: no metric."
            drawn.append(ResultChart("Over both keys", svg(maps(rows, *grid)), what))
    ends = [[words.against_none(metric), *rest] for metric, *rest in extremes(rows, keys, metrics)]
    tables = [ResultTable("Least and largest", ("metric", "least", "at", "largest", "at"), ends)]
    listed = [
        [
            str(row["case"]),
            *(words.short(row[key]) for key in keys),
            *(_digits(row[f]) if with_metric([row], f) else "" for f in metrics),
            row["status"] or "",
        ]
        for row in rows[:_MOST_ROWS]
    ]
    more = "" if len(rows) <= _MOST_ROWS else f" The first {_MOST_ROWS} of {len(rows)}."
    headings = ("case", *map(words.key_words, keys), *(words.METRICS[f] for f in metrics), "")
    sort = f"Click on a heading to sort.{more}"
    tables.append(ResultTable("Cases", headings, listed, sort, sorts=True))
    kinds = {"grid": "a grid", "lhs": "a Latin hypercube", "sobol": "Sobol points"}
    return ResultPage(
        title=f"Sweep of {setup.name}",
        lines=[
            words.scene_words(setup),
            f"{len(rows):,} cases, {kinds[design['kind']]} over {', '.join(keys)}; metrics of "
            f"{words.SPANS[header['span']]}, against the same scene without control.",
            *([f"Left out: {'; '.join(constant)}."] if constant and metrics else []),
        ],
        warnings=warnings,
        charts=drawn,
        tables=tables,
        commands=_sweep_command(setup, header, path),
        versions=header["versions"],
        scenes=[(setup.name, header["scene_toml"])],
    )


def _sweep_command(setup: Setup, header: dict[str, Any], path: Path) -> list[str]:
    line = ["hertzloop", "sweep", f"{setup.name}.toml"]
    design = header["design"]
    for axis in design["axes"]:
        values = ",".join(toml_text(value) for value in axis["values"])
        line += ["--over", f"{axis['key']}={values or '{low:g}:{high:g}'.format(**axis)}"]
    if design["kind"] != "grid":
        line += ["--design", design["kind"], "--cases", str(design["count"])]
    about = "the scene below, saved under this name"
    if design["drawn"]:
        line += ["--uncertain", "DISTRIBUTIONS.toml", "--cases", str(len(design["drawn"]))]
        about += ", and the file of the distributions"
    line += ["--span", header["span"], "--out", path.name]
    return [f"{shlex.join(line)}    # {about}"]
