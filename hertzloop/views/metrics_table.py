"""Tables of metrics: of a run, of two runs side by side, and further metrics for --details."""

import math
from collections.abc import Iterable, Sequence

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.metric_rows import MetricRow, Rows, SpanName, row_of
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

# Metrics that run, inspect and compare print without --details.
_SHOWN: tuple[tuple[SpanName, str], ...] = (
    ("first_impact", "contact_time_s"),
    ("first_impact", "peak_force_n"),
    ("first_impact", "rebound_speed_m_s"),
    ("first_impact", "rebound_height_m"),
    ("first_impact", "plate_energy_j"),
    ("first_impact", "radiated_j"),
    ("first_impact", "plate_speed_max_m_s"),
    ("first_impact", "peak_pressure_pa"),
    ("whole_run", "plate_energy_j"),
    ("whole_run", "contacts"),
)
NO_RADIATION = "radiated energy: known for simply supported plates with modes that can be summed"


def shown_rows(rows: Rows) -> list[MetricRow]:
    """Return the rows that are printed without --details, in their order."""
    found = (row_of(rows, span, name) for span, name in _SHOWN)
    return [row for row in found if row is not None]


def label_of(row: MetricRow) -> str:
    """Return the label of a metric, with its span if that is not the first impact."""
    return row.field.words + (", whole run" if row.span == "whole_run" else "")


def further_rows(rows: Rows) -> list[MetricRow]:
    """Return the other rows of the first impact, which --details adds."""
    shown = {name for span, name in _SHOWN if span == "first_impact"} | {"contacts"}
    return [row for row in rows if row.span == "first_impact" and row.metric not in shown]


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
    return [label_of(row), *values, *([change_text(row)] if compare else [])]


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
