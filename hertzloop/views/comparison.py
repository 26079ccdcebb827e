"""The metrics of two runs side by side, as a table."""

import math

from rich.console import Console
from rich.text import Text

from hertzloop.results.comparison import Comparison
from hertzloop.results.span_metrics import SPAN_METRICS
from hertzloop.views.format import Table

_SPANS = {"first_impact": "first impact", "whole_run": "whole run"}


def comparison_table(found: Comparison) -> Table:
    """Return the metrics of both runs with their units, and the change from A to B."""
    title = "Metrics of A and B, and the change from A to B"
    table = Table("metric", right=("A", "B", "change"), title=title)
    span = ""
    for row in found.rows:
        if row.span != span:
            span = row.span
            table.add_section()
            table.add_row(Text(_SPANS[span], style="bold"), "", "", "")
        of = SPAN_METRICS[row.metric]
        values = [
            "not defined" if math.isnan(value) else f"{value * of.factor:.4g} {of.unit}".strip()
            for value in (row.a, row.b)
        ]
        change = f"{row.b_to_a:+z.2f} {row.unit}" if row.unit else f"{row.b_to_a:+z.0f}"
        table.add_row(of.words, *values, "" if math.isnan(row.b_to_a) else change)
    return table


class PrintedComparison(Comparison):
    """A comparison that prints as its table."""

    def __str__(self) -> str:
        console = Console(width=100, highlight=False, emoji=False, markup=False)
        with console.capture() as caught:
            console.print(comparison_table(self))
        return caught.get()
