"""Results of a sweep or of a tuning as one page, and which of them a folder holds."""

import json
import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hertzloop.analysis.cases import CaseState
from hertzloop.setup import Setup, parse
from hertzloop.views import provenance
from studies import words
from studies.report import results_charts as charts
from studies.report.charts import svg
from studies.report.templates import template
from studies.sweeps.evaluate import not_run
from studies.sweeps.summary import SHOWN, counted, extremes, short
from studies.sweeps.sweep import read_results
from studies.tuning.pictures import front
from studies.tuning.record import Tuned, read_tuned

_MOST_ROWS = 2000  # of cases
_SPANS = {"impact": "the first impact", "run": "the whole run"}


@dataclass(frozen=True)
class _Chart:
    title: str
    words: str
    svg: str


@dataclass(frozen=True)
class _Table:
    title: str
    words: str
    headings: Sequence[str]
    rows: list[list[str]]
    sorts: bool = False


def results_in(path: Path) -> Path:
    """The results that a path names: itself, or the only ones in a folder. Raises ValueError."""
    if not os.path.isdir(path):
        return path
    found = sorted(
        [*path.glob("tune-*.json"), *path.glob("*.parquet")]
        + [p.with_suffix("") for p in path.glob("*.csv.json")]
    )
    if len(found) != 1:
        names = ", ".join(one.name for one in found[:5])
        raise ValueError(
            f"{path} holds results of no sweep and no tuning"
            if not found
            else f"{path} holds {len(found)} results ({names}); name one of them"
        )
    return found[0]


def page_of_results(path: Path) -> str:
    """The page of a sweep's .parquet or .csv, or of a tuning's .json or .csv.

    Raises ValueError if the file is none of these, SceneError if its scene cannot be read.
    """
    if path.name.startswith("tune-") and path.suffix in (".json", ".csv"):
        return _page_of_tuned(read_tuned(path.with_suffix(".json")))
    return _page_of_sweep(path)


def _page(title: str, lines: list[str], **more: Any) -> str:
    return template("results.html.j2").render(title=title, lines=lines, **more)


def _ran(setup: Setup) -> str:
    return f"{provenance.bodies(setup)}; {provenance.control(setup)}"


def _page_of_sweep(path: Path) -> str:
    rows, header = read_results(path)
    setup = parse(header["scene_toml"], recorded=True)
    design = header["design"]
    keys = [axis["key"] for axis in design["axes"]]
    figures = [f for f in SHOWN if any(row[f] is not None for row in rows)]
    lacking = not_run(rows)
    unstable = sum(row["state"] == CaseState.UNSTABLE for row in rows)
    warnings = [f"{len(lacking)} cases could not be run: {lacking[0]['status']}"] if lacking else []
    if unstable:
        warnings.append(f"{unstable} of {len(rows)} cases are unstable and have no figures")
    beyond = counted(rows, "out_of_range")
    if beyond:
        names = ", ".join(f"{name} in {times}" for name, times in beyond.items())
        warnings.append(f"Out of range, of {len(rows)} cases: {names}")
    drawn: list[_Chart] = []
    if charts.shown_figures(rows):
        dots = "A dot a case, orange their mean where values repeat; dashed: as without control."
        drawn.append(_Chart("Over each key", dots, svg(charts.over_keys(rows, keys))))
        grid = charts.map_keys(rows, keys, design["kind"])
        if grid:
            what = "Blue is less than without control; grey: no figure."
            drawn.append(_Chart("Over both keys", what, svg(charts.maps(rows, *grid))))
    ends = [[words.against_none(figure), *rest] for figure, *rest in extremes(rows, keys)]
    tables = [_Table("Least and largest", "", ("figure", "least", "at", "largest", "at"), ends)]
    listed = [
        [str(row["case"]), *(short(row[key]) for key in keys),
         *("" if row[f] is None else f"{row[f]:.3f}" for f in figures), row["status"] or ""]
        for row in rows[:_MOST_ROWS]
    ]  # fmt: skip
    more = "" if len(rows) <= _MOST_ROWS else f" The first {_MOST_ROWS} of {len(rows)}."
    headings = ("case", *map(charts.key_words, keys), *(words.FIGURES[f] for f in figures), "")
    tables.append(
        _Table("Cases", f"A click on a heading sorts.{more}", headings, listed, sorts=True)
    )
    kinds = {"grid": "a grid", "lhs": "a Latin hypercube", "sobol": "Sobol points"}
    return _page(
        f"Sweep of {setup.name}",
        [
            _ran(setup),
            f"{len(rows):,} cases, {kinds[design['kind']]} over {', '.join(keys)}; figures of "
            f"{_SPANS[header['span']]}, against the same scene without control.",
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
        values = ",".join(_toml(value) for value in axis["values"])
        line += ["--over", f"{axis['key']}={values or '{low:g}:{high:g}'.format(**axis)}"]
    if design["kind"] != "grid":
        line += ["--design", design["kind"], "--cases", str(design["count"])]
    line += ["--span", header["span"], "--out", path.name]
    return [f"{shlex.join(line)}    # the scene below, saved under this name"]


def _toml(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _page_of_tuned(tuned: Tuned) -> str:
    objectives = tuple(tuned.objectives)
    names = [words.against_none(name) for name in objectives]
    keys = sorted({key for found in tuned.front for key in found.values} - {"controller.law"})
    rows = []
    for found in [*tuned.front, tuned.published]:
        law = words.law(str(found.values["controller.law"]))
        cells = [law + (" (published)" if found is tuned.published else "")]
        cells += [f"{found.figures[name]:.3f}" for name in objectives]
        cells += [str(found.spreads[name]) if name in found.spreads else "" for name in objectives]
        rows.append([*cells, *(short(found.values.get(key, "")) for key in keys)])
    headings = (
        "law", *names, *(f"{name}, over touch phases: mean (least to most)" for name in names),
        *map(charts.key_words, keys),
    )  # fmt: skip
    scenes = [(parse(text, recorded=True), text) for text in tuned.scenes]
    title = "Tuning of " + ", ".join(setup.name for setup, _ in scenes)
    limits = "".join(f", {words.against_none(k)} at most {v:g}" for k, v in tuned.at_most.items())
    worst = "; the worst of the scenes counts" if len(scenes) > 1 else ""
    lines = [
        *(_ran(setup) for setup, _ in scenes),
        f"Lowered: {', '.join(names)}{limits}; figures of {_SPANS[tuned.span]}{worst}.",
        *tuned.verdict,
    ]
    picture = front("", tuned.front, tuned.published, objectives)
    return _page(
        title,
        lines,
        warnings=[f"{tuned.failed} cases could not be run"] if tuned.failed else [],
        charts=[_Chart("Settings that no other beats", "", svg(picture))],
        tables=[_Table("Settings", "A click on a heading sorts.", headings, rows, sorts=True)],
        commands=[tuned.command],
        versions=tuned.versions,
        scenes=[(setup.name, text) for setup, text in scenes],
    )
