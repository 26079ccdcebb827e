"""The metrics of two runs side by side, as a table."""

import math

from rich.console import Console
from rich.text import Text

from hertzloop.results.comparison import Comparison, Difference
from hertzloop.results.span_metrics import DECIBELS, SPAN_METRICS
from hertzloop.views.digits import change_cell, known_digits, with_unit
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
            "not defined"
            if math.isnan(value)
            else with_unit(known_digits(value * of.factor, ".4g", error * of.factor), of.unit)
            for value, error in ((row.a, row.a_error), (row.b, row.b_error))
        ]
        table.add_row(of.words, *map(str.strip, values), _change(row))
    return table


def _change(row: Difference) -> str:
    """Return the change with its unit and its predictable digits; empty if it is not defined."""
    if row.a_error or row.b_error:
        factor = DECIBELS.get(row.metric, 0.0)
        return change_cell(factor, (row.b, row.a), (row.b_error, row.a_error), 2)
    if math.isnan(row.b_to_a):
        return ""
    return f"{row.b_to_a:+z.2f} {row.unit}" if row.unit else f"{row.b_to_a:+z.0f}"


class PrintedComparison(Comparison):
    """A comparison that prints as its table."""

    def __str__(self) -> str:
        console = Console(width=100, highlight=False, emoji=False, markup=False)
        with console.capture() as caught:
            console.print(comparison_table(self))
        return caught.get()
