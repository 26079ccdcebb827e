"""The reference page of all metrics, made of their rows."""

from hertzloop.results.cases import CASE_FACTS
from hertzloop.results.facts import Fact
from hertzloop.results.span_metrics import SPAN_FACTS

_TABLES = {
    "Metrics of a run": ("`run`, `inspect` and `compare` print them.", SPAN_FACTS),
    "Metrics of a case": ("Columns of `sweep`, goals of `tune` and `budget`.", CASE_FACTS),
}


def _lines(rows: dict[str, Fact]) -> dict[str, str]:
    """Names and meanings; what a case has of a run, and its changes in dB, have one line each."""
    of_run = [_without_unit(row) for row in SPAN_FACTS.values()]
    same = [n for n, row in rows.items() if rows is CASE_FACTS and _without_unit(row) in of_run]
    changes = [name for name in rows if name.endswith("_db")]
    found: dict[str, str] = {}
    if changes:
        found[_quoted(changes)] = "change of this metric against no control, dB"
        found[_quoted(same)] = "as of a run, in the unit of the name"
    return found | {_quoted([n]): r.meaning for n, r in rows.items() if n not in same + changes}


def _without_unit(row: Fact) -> str:
    return row.meaning.rpartition(", ")[0] or row.meaning


def _quoted(names: list[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def page() -> str:
    """The metrics as a page in Markdown."""
    names = (
        "The names are those of `--json`, of files and of Python. They end in units: `_n_s` is N s "
        "here, and N/s in the scene key `controller.slew_n_s`."
    )
    lines = ["# Metrics", "", names, ""]
    for heading, (where, rows) in _TABLES.items():
        lines += [f"## {heading}", "", where, ""]
        lines += [f"- {names}: {meaning}" for names, meaning in _lines(rows).items()] + [""]
    return "\n".join(lines[:-1]) + "\n"
