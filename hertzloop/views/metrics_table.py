"""Tables of metrics: of a run, of two runs side by side, and further metrics for --details."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.console import Console

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.facts import Level
from hertzloop.results.metric_rows import MetricRow, Rows
from hertzloop.results.metrics import RunResult
from hertzloop.views.digits import (
    LEGEND,
    RANGE,
    UNKNOWN,
    change_text,
    has_range,
    value_texts,
)
from hertzloop.views.format import Table

NO_RADIATION = "radiated energy: known for simply supported plates with modes that can be summed"


def shown_rows(rows: Rows) -> list[MetricRow]:
    """Return the rows that are printed without --details."""
    return [row for row in rows if row.level is Level.BRIEF]


def further_rows(rows: Rows) -> list[MetricRow]:
    """Return the rows that --details adds."""
    return [row for row in rows if row.level is Level.DETAILS]


def metrics_table(result: RunResult, rows: Rows, details: bool = False) -> Table:
    """Return the table of at most ten metrics that ends a run, or the further metrics.

    Args:
        result: The run.
        rows: Its metrics.
        details: Whether the further metrics are wanted.

    Returns:
        One row for each metric: with control, without control, and the change, in dB for energies,
        speeds and pressures, and in per cent of the value without control otherwise.
    """
    own = "no control" if result.scene_law == NO_CONTROL else "with control"
    title = "Further metrics of the first impact" if details else "Metrics of the first impact"
    shown = further_rows(rows) if details else shown_rows(rows)
    return table_of_rows(shown, (own, "without"), title, complete=result.complete)


def table_of_rows(
    rows: Rows,
    headings: Sequence[str],
    title: str,
    complete: bool = True,
    reference_first: bool = False,
) -> Table:
    """Return a table of metrics.

    Args:
        rows: The metrics.
        headings: Headings of the two columns of values, from the left.
        title: Title of the table.
        complete: Whether all steps of the run are known; else metrics of the whole run are unknown.
        reference_first: Whether the value that a metric is compared with is on the left.
    """
    columns = max((2 if row.reference else 1 for row in rows), default=1)
    compare = any(row.change or row.from_zero for row in rows)
    right = [*headings[:columns], *["change"] * compare]
    table = Table("metric", right=right, title=title)
    for row in rows:
        table.add_row(*cells_of(row, complete, compare, reference_first))
    table.caption = "; ".join(notes_on(rows)) or None
    return table


def cells_of(
    row: MetricRow, complete: bool = True, compare: bool = True, reference_first: bool = False
) -> list[str]:
    """Return label, values and change of a metric, as text."""
    lost = row.span == "whole_run" and not complete
    values = value_texts(row, UNKNOWN if lost else "-")
    if reference_first:
        values.reverse()
    return [row.label, *values, *([change_text(row)] if compare else [])]


def notes_on(rows: Iterable[MetricRow]) -> list[str]:
    """Return what a reader has to know of the numbers in some rows."""
    rows = list(rows)
    notes = []
    if has_range(rows):
        notes.append(RANGE)
    if any(UNKNOWN in cells_of(row) for row in rows):
        notes.append(LEGEND)
    if any(row.metric == "radiated_j" and math.isnan(row.value.value) for row in rows):
        impact = any(not math.isnan(row.value.value) for row in rows)
        notes += [NO_RADIATION] * impact
    return notes


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
