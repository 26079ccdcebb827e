"""The metrics of two runs, side by side."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from hertzloop.results.metric_rows import MetricRow, SpanName, UncertainValues, compared, uncertain
from hertzloop.results.span_metrics import SPAN_METRICS, RunMetrics


@dataclass(frozen=True)
class Difference:
    """One metric of two runs.

    Attributes:
        span: "first_impact" or "whole_run".
        metric: name of the metric in `SpanMetrics`.
        a: value of the first run, SI units.
        b: value of the second run, SI units.
        b_to_a: change from a to b in `unit`; nan where it is not defined.
        unit: "dB" for energies, speeds and pressures, "%" for other quantities; the SI unit of what
            is compared by its difference.
        a_error: largest absolute error of `a`, infinite if no digit is predictable; 0 if nothing is
            known of it.
        b_error: the same of `b`.
        a_range: least and largest value of `a` over the touch phases.
        b_range: the same of `b`.
    """

    span: str
    metric: str
    a: float
    b: float
    b_to_a: float
    unit: str
    a_error: float
    b_error: float
    a_range: tuple[float, float]
    b_range: tuple[float, float]


@dataclass(frozen=True)
class Comparison:
    """All metrics of two runs.

    Attributes:
        metrics: the metrics as rows; `value` is that of the second run, `reference` that of the
            first.
    """

    metrics: tuple[MetricRow, ...]

    @property
    def rows(self) -> tuple[Difference, ...]:
        """The metrics of the first impact, then those of the whole run."""
        return tuple(map(_difference, self.metrics))


def values_in(rows: Iterable[MetricRow]) -> UncertainValues:
    """Return the values of a run by span and name of the metric."""
    return {(row.span, row.metric): row.value for row in rows}


def without_errors(metrics: RunMetrics) -> UncertainValues:
    """Return metrics of which no error is known."""
    spans: tuple[tuple[SpanName, object], ...] = (
        ("first_impact", metrics.first_impact),
        ("whole_run", metrics.whole_run),
    )
    return {
        (span, name): uncertain(float(value))
        for span, found in spans
        if found is not None
        for name, value in vars(found).items()
    }


def comparison(a: UncertainValues, b: UncertainValues) -> tuple[MetricRow, ...]:
    """Compare the spans that both runs have.

    Args:
        a: Metrics of the first run.
        b: Metrics of the second run.
    """
    lacking = {
        span
        for found in (a, b)
        for span in ("first_impact", "whole_run")
        if (span, "contacts") not in found or math.isnan(found[span, "contacts"].value)
    }
    found = (row for row in compared(b, a) if row.metric in SPAN_METRICS)
    return tuple(row for row in found if row.span not in lacking)


def _difference(row: MetricRow) -> Difference:
    assert row.reference is not None
    return Difference(
        span=row.span,
        metric=row.metric,
        a=row.reference.value,
        b=row.value.value,
        b_to_a=row.change.value if row.change else math.nan,
        unit=row.unit,
        a_error=row.reference.error,
        b_error=row.value.error,
        a_range=(row.reference.least, row.reference.most),
        b_range=(row.value.least, row.value.most),
    )
