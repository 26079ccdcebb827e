"""The metrics of two runs side by side."""

from dataclasses import dataclass

from rich.console import Console

from hertzloop.results.metric_rows import MetricRow
from hertzloop.views.format import Table
from hertzloop.views.metrics_table import shown_rows, table_of_rows


@dataclass(frozen=True)
class Comparison:
    """All metrics of two runs, A and B. It prints as the table of `compare --metrics`.

    Attributes:
        rows: the metrics of the first impact, then those of the whole run; `reference` is the value
            of A, `value` that of B, `change` the change from A to B.
    """

    rows: tuple[MetricRow, ...]

    def table(self, details: bool = False) -> Table:
        """Return the metrics that a run prints, or all of them for `details`."""
        rows = self.rows if details else shown_rows(self.rows)
        title = "Metrics of A and B in the first impact, and the change from A to B"
        return table_of_rows(rows, ("A", "B"), title, reference_first=True)

    def __str__(self) -> str:
        console = Console(width=100, highlight=False, emoji=False, markup=False)
        with console.capture() as caught:
            console.print(self.table())
        return caught.get()
