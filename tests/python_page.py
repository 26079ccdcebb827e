"""The reference page of the Python interface, made of the docstrings of its names.

`python -m tests.python_page` writes it.
"""

import inspect
import pkgutil
import re
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "python.md"
# Names by heading; a function, a class, or an exception.
NAMES = {
    "Scenes": """api.scenes.scene_names api.scenes.load api.scenes.vary scene.scene.Scene""",
    "Runs and recordings": """api.runs.simulate api.runs.run api.runs.read api.runs.Run
        plant.metrics.impacts.Impact plant.metrics.noise.ImpactNoise
        results.span_metrics.RunMetrics results.span_metrics.SpanMetrics api.runs.compare
        results.metric_rows.MetricRow results.metric_rows.UncertainValue
        views.comparison.Comparison api.studies.modes""",
    "Studies": """api.studies.sweep studies.sweep.request.SweepRequest results.cases.CaseMetrics
        api.studies.tune studies.tune.request.TuneRequest studies.tune.result.TuneResult
        studies.tune.result.Candidate api.studies.budget studies.budget.request.BudgetRequest
        studies.budget.result.BudgetResult studies.budget.result.InPlant
        studies.budget.limits.BudgetLimit studies.budget.limits.Boundary api.studies.margin
        studies.margin.margin.MarginResult studies.margin.flight.Margin""",
    "Fits": """api.measurements.read_record api.measurements.read_records
        fitting.records.record.Record api.measurements.fit fitting.fit.results.FitResult
        fitting.fit.results.Estimate""",
    "Linear response": """api.studies.linear studies.margin.linear.TransferFunction""",
    "Step by step": """api.stepper.Stepper""",
    "Exceptions": """scene.errors.SceneError loop.run_options.OptionError
        studies.cases.axis.DesignError fitting.records.errors.RecordError
        fitting.fit.errors.FitError processes.launcher.RunFailed bus.port.BusError
        bus.streams.StreamFault recordings.writer.RecordingError studies.cases.workers.WorkersLost
        results.cases.UnstableLoop results.cases.CaseFailed""",
    "Laws": """controller.law.Keys controller.law.LawContext controller.law.ForceBound
        controller.law.Response controller.law.kernel""",
    "pytest": """pytest_plugin.hertzloop_run pytest_plugin.RequirementFailed""",
}
_PART = re.compile(r"^(Args|Attributes|Returns|Raises):$")
_ITEM = re.compile(r"^(\w+): (.*)$")


def page() -> str:
    """The page in Markdown."""
    lines = [
        "# Python interface",
        "",
        "[Use Python and notebooks](../how-to/python.md) has examples. The names of numbers end in "
        "their units: `_m`, `_us`, `_n`, `_n_s` (N s), `_db`. `import hertzloop` offers functions "
        "and classes, `hertzloop.law` the names of a law.",
        "",
    ]
    for heading, names in NAMES.items():
        lines += [f"## {heading}", ""]
        for name in names.split():
            lines += entry(pkgutil.resolve_name(f"hertzloop.{name}"))
    return "\n".join(lines).rstrip("\n") + "\n"


def entry(named: Any) -> list[str]:
    """The entry of a function or a class: a summary, and a row for each parameter or attribute."""
    summary, parts = parts_of(inspect.getdoc(named) or "")
    heading = f"`{named.__name__}`"
    if inspect.isfunction(named):
        heading = f"`{named.__name__}({_parameters(named)})`"
    lines = [f"### {heading}", "", summary, ""]
    rows = _rows(named, parts)
    if rows:
        what = "parameter" if inspect.isfunction(named) else "attribute"
        lines += [f"| {what} | meaning |", "|---|---|"]
        lines += [f"| `{name}` | {_cell(meaning)} |" for name, meaning in rows.items()]
        lines.append("")
    for part in ("Returns", "Raises"):
        if text := parts.get(part):
            lines += [f"{part}: {_sentence(text)}", ""]
    return lines


def parts_of(text: str) -> tuple[str, dict[str, str]]:
    """The summary of a docstring in Google's style, and its parts by name."""
    summary: list[str] = []
    parts: dict[str, str] = {}
    part = ""
    for line in text.splitlines():
        if found := _PART.match(line):
            part = found[1]
            parts[part] = ""
        elif part and (line.startswith("    ") or not line):
            parts[part] += f"{line}\n"
        else:
            part = ""
            summary.append(line)
    words = " ".join(" ".join(summary).split())
    return words, parts


def _rows(named: Any, parts: dict[str, str]) -> dict[str, str]:
    """Names and meanings: of the docstring, else of the fields, members or properties."""
    rows = _items(parts.get("Args") or parts.get("Attributes") or "")
    if not isinstance(named, type):
        return rows
    if issubclass(named, Enum):
        return {member.name: f"`{member.value}`" for member in named}
    if is_dataclass(named):
        for one in fields(named):
            if not one.name.startswith("_"):
                rows.setdefault(one.name, one.metadata.get("meaning", ""))
    for name, member in vars(named).items():
        is_public = not name.startswith("_") and callable(getattr(member, "__get__", None))
        if is_public and (text := inspect.getdoc(member)):
            shown = f"{name}()" if inspect.isfunction(member) else name
            rows[shown] = parts_of(text)[0]
    return {name: meaning for name, meaning in rows.items() if meaning}


def _items(text: str) -> dict[str, str]:
    """Names and meanings of a part of a docstring."""
    rows: dict[str, str] = {}
    last = ""
    for line in inspect.cleandoc(text).splitlines():
        if found := _ITEM.match(line):
            last = found[1]
            rows[last] = found[2]
        elif last:
            rows[last] += f" {line.strip()}"
    return rows


def _parameters(function: Any) -> str:
    """Parameters as they are called: names, a star, defaults."""
    shown = []
    for name, one in inspect.signature(function).parameters.items():
        if one.kind is one.KEYWORD_ONLY and not any("*" in other for other in shown):
            shown.append("*")
        default = "" if one.default is one.empty or callable(one.default) else f"={one.default!r}"
        stars = "**" if one.kind is one.VAR_KEYWORD else ""
        shown.append(f"{stars}{name}{default}")
    return ", ".join(shown)


def _sentence(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _cell(text: str) -> str:
    return _sentence(text).removesuffix(".")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
