"""The metrics of two runs side by side, as a table."""

from rich.console import Console

from hertzloop.results.comparison import Comparison
from hertzloop.views.format import Table
from hertzloop.views.metrics_table import shown_rows, table_of_rows


def comparison_table(found: Comparison, details: bool = False) -> Table:
    """Return the metrics of both runs with their units, and the change from A to B.

    Args:
        found: The metrics.
        details: Whether all metrics are wanted, not those that a run prints.
    """
    rows = found.metrics if details else shown_rows(found.metrics)
    title = "Metrics of A and B in the first impact, and the change from A to B"
    return table_of_rows(rows, ("A", "B"), title, reference_first=True)


class PrintedComparison(Comparison):
    """A comparison that prints as its table."""

    def __str__(self) -> str:
        console = Console(width=100, highlight=False, emoji=False, markup=False)
        with console.capture() as caught:
            console.print(comparison_table(self))
        return caught.get()
