"""The reference page of the Python interface, made of the docstrings of its names.

It shows signatures, first sentences, units and shapes; `help` shows the whole docstrings.
`python -m tests.python_page` writes it.
"""

import inspect
import pkgutil
import re
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from hertzloop.loop.run_options import USES

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "python.md"
# Names by heading; a function, a class, or an exception.
NAMES = {
    "Scenes": """api.scenes.scene_names api.scenes.load api.scenes.vary scene.scene.Scene""",
    "Runs and recordings": """api.runs.simulate api.runs.run api.runs.read api.runs.Run
        plant.metrics.impacts.Impact plant.metrics.noise.ImpactNoise
        results.span_metrics.RunMetrics results.span_metrics.SpanMetrics api.runs.compare
        results.metric_rows.MetricRow results.metric_rows.UncertainValue
        views.metrics_table.Comparison api.studies.modes""",
    "Studies": """api.studies.sweep studies.sweep.request.SweepRequest results.cases.CaseMetrics
        api.studies.tune studies.tune.request.TuneRequest studies.tune.result.TuneResult
        studies.tune.result.Candidate api.studies.budget studies.budget.request.BudgetRequest
        studies.budget.result.BudgetResult studies.budget.result.InPlant
        studies.budget.limits.BudgetLimit studies.budget.limits.Boundary api.studies.margin
        studies.margin.margin.MarginResult studies.margin.flight.Margin""",
    "Fits": """api.studies.read_record api.studies.read_records
        fitting.records.record.Record api.studies.fit fitting.fit.results.FitResult
        fitting.fit.results.Estimate""",
    "Linear response": """api.studies.linear studies.margin.system.LinearSystem""",
    "Step by step": """api.stepper.Stepper""",
    "Exceptions": """scene.errors.SceneError loop.run_options.OptionError
        studies.cases.axis.DesignError fitting.errors.RecordError
        fitting.errors.FitError processes.launcher.RunFailed bus.port.BusError
        bus.streams.StreamFault recordings.writer.RecordingError studies.cases.workers.WorkersLost
        results.cases.UnstableLoop results.cases.CaseFailed""",
    "Laws": """controller.law.Keys controller.law.LawContext controller.law.ForceBound
        controller.law.Response controller.law.kernel""",
    "pytest": """pytest_plugin.hertzloop_run pytest_plugin.RequirementFailed""",
}
# Classes whose attributes another page explains, and where.
ELSEWHERE = {
    "SpanMetrics": "[Metrics of a run](metrics.md#metrics-of-a-run)",
    "CaseMetrics": "[Metrics of a case](metrics.md#metrics-of-a-case)",
    "BudgetResult": "[Fields of the budget](../how-to/budget.md#fields-of-json)",
    "InPlant": "[Fields of the budget](../how-to/budget.md#fields-of-json)",
    "BudgetLimit": "[Fields of the budget](../how-to/budget.md#fields-of-json)",
    "SweepRequest": "`hertzloop sweep --help`",
    "TuneRequest": "`hertzloop tune --help`",
    "BudgetRequest": "`hertzloop budget --help`",
    "Boundary": "[Fields of the budget](../how-to/budget.md#fields-of-json)",
    "Margin": "[Results of a margin](../how-to/margin.md#results)",
    "FitResult": "[JSON of a fit](fit-json.md)",
    "Estimate": "[JSON of a fit](fit-json.md)",
}
# Attributes that serve the code alone, and parameters that a command explains.
INNER = {
    "run": USES,
    "Record": (
        "measurement",
        "sha256",
        "notes",
        "source",
        "interval_s",
        "uniform",
        "repeats(other)",
    ),
    "Scene": ("plant_tables",),
    "LinearSystem": ("of", "resonance_grid_hz()"),
}
# Results whose attributes say what they are by their names; `help` explains them.
RESULTS = (
    "Impact", "ImpactNoise", "RunMetrics", "MetricRow", "UncertainValue", "Comparison",
    "TuneResult", "Candidate", "MarginResult", "SweepRequest", "TuneRequest", "BudgetRequest",
)  # fmt: skip
_SCENE = ("the scene, or its name or TOML file", "the scene with its law, or its name or TOML file")
_PART = re.compile(r"^(Args|Attributes|Returns|Raises):$")
_ITEM = re.compile(r"^(\w+): (.*)$")


def page() -> str:
    """The page in Markdown."""
    lines = [
        "# Python interface",
        "",
        "[Use Python and notebooks](../how-to/python.md) has examples. `help(hertzloop.run)`",
        "prints the whole text on a name, with its errors. The names of numbers",
        "end in their units, `_n_s` is N s. The names of a law are in `hertzloop.law`.",
        "",
        "A parameter `scene` is a scene, the name of a shipped one, or a TOML file. `options` are",
        "fields of the request by name, for example `workers=1`. A list below the functions has",
        "the attributes of their results and requests.",
        "",
    ]
    for heading, names in NAMES.items():
        lines += [f"## {heading}", ""]
        named = [pkgutil.resolve_name(f"hertzloop.{name}") for name in names.split()]
        if heading == "Exceptions":
            lines += [f"- `{one.__name__}`: {_cell(_summary(one))}" for one in named] + [""]
        else:
            results = [one for one in named if is_result(one)]
            lines += [line for one in named if one not in results for line in entry(one)]
            lines += [result(one) for one in results] + [""] * bool(results)
    return "\n".join(lines).rstrip("\n") + "\n"


def entry(named: Any) -> list[str]:
    """The entry of a function or a class: a summary, and a line for each parameter or attribute."""
    _, parts = parts_of(inspect.getdoc(named) or "")
    is_function = inspect.isfunction(named)
    heading = named.__name__ + (f"({_parameters(named)})" if is_function else "")
    lines = [f"### `{heading}`", "", _summary(named), ""]
    inner = INNER.get(named.__name__, ())
    rows = {name: row for name, row in _rows(named, parts).items() if name not in inner}
    if rows:
        lines += [f"- `{name}`: {_cell(_first(meaning))}" for name, meaning in rows.items()] + [""]
    if named.__name__ == "run":
        lines += ["Other parameters are options of `hertzloop run`.", ""]
    text = _sentence(parts.get("Returns", ""))
    if len(text.split()) > 3:  # a shorter one says what the first sentence says
        lines += [f"Returns: {text}", ""]
    return lines


def is_result(named: Any) -> bool:
    """Whether a class is listed with the names of its attributes alone."""
    return named.__name__ in (*RESULTS, *ELSEWHERE)


def result(named: Any) -> str:
    """The line of a result or a request: its attributes, or where they are explained."""
    where = ELSEWHERE.get(named.__name__, "")
    if named.__name__ not in RESULTS:
        return f"- `{named.__name__}`: {where}"
    _, parts = parts_of(inspect.getdoc(named) or "")
    names = dict.fromkeys([*getattr(named, "__annotations__", ()), *_rows(named, parts)])
    shown = ", ".join(f"`{name}`" for name in names if not name.startswith("_"))
    return f"- `{named.__name__}`: {shown}{where and f'; {where}'}"


def _summary(named: Any) -> str:
    """The first sentence of a docstring."""
    return _first(parts_of(inspect.getdoc(named) or "")[0])


def _first(text: str) -> str:
    return re.split(r"(?<=[.:]) (?=[A-Z])|(?<=\.) (?=`)|; `", text)[0]


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
        is_common = {
            name: name == "options" or text.strip(" .\n") in _SCENE for name, text in rows.items()
        }
        return {name: meaning for name, meaning in rows.items() if not is_common[name]}
    if issubclass(named, Enum):
        return {member.name: f'"{member.value}"' for member in named}
    if is_dataclass(named):
        for one in fields(named):
            if not one.name.startswith("_"):
                rows.setdefault(one.name, one.metadata.get("meaning", ""))
    for name, member in vars(named).items():
        is_public = not name.startswith("_") and callable(getattr(member, "__get__", None))
        if is_public and (text := inspect.getdoc(member)):
            shown = f"{name}({_parameters(member)})" if inspect.isfunction(member) else name
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
    signature = inspect.signature(function)
    shown = [
        one.replace(
            annotation=one.empty, default=one.empty if callable(one.default) else one.default
        )
        for name, one in signature.parameters.items()
        if name != "self"
    ]
    return str(signature.replace(parameters=shown, return_annotation=signature.empty))[1:-1]


def _sentence(text: str) -> str:
    return " ".join(text.split())


def _cell(text: str) -> str:
    return _sentence(text).removesuffix(".")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
