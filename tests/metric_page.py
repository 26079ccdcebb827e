"""The reference page of all metrics, made of their rows."""

from hertzloop.results.cases import CASE_FACTS
from hertzloop.results.span_metrics import SPAN_FACTS

_TABLES = {
    "Metrics of a run": ("`run`, `inspect` and `compare` print them.", SPAN_FACTS),
    "Metrics of a case": ("Columns of `sweep`, goals of `tune` and `budget`.", CASE_FACTS),
}


def page() -> str:
    """The metrics as a page in Markdown."""
    names = (
        "The names are those of `--json`, of files and of Python. They end in units: `_n_s` is N s "
        "here, and N/s in the scene key `controller.slew_n_s`."
    )
    lines = ["# Metrics", "", names, ""]
    for heading, (where, rows) in _TABLES.items():
        lines += [f"## {heading}", "", where, "", "| metric | means |", "|---|---|"]
        lines += [f"| `{name}` | {row.meaning} |" for name, row in rows.items()] + [""]
    return "\n".join(lines[:-1]) + "\n"
