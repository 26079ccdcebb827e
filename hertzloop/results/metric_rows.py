"""The metrics of a run as rows, each with its error, its range and its change by control.

The verdict, tables, JSON, comparisons and the Python interface are made of these rows.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from hertzloop.results.facts import Fact, Level
from hertzloop.results.metrics import Metrics, RunResult
from hertzloop.results.predictability import (
    ImpactErrors,
    Predictability,
    errors_of,
    later_impacts_known,
)
from hertzloop.results.span_metrics import (
    FACTS,
    SPAN_FACTS,
    RunMetrics,
    SpanName,
    ValuesBySpan,
    decibels,
)


@dataclass(frozen=True)
class UncertainValue:
    """A number with its error and its range.

    Attributes:
        value: the number.
        error: largest absolute error by the truncated modes and by what earlier impacts magnify;
            infinite if no digit is predictable.
        least: least value over the touch phases.
        most: largest value over the touch phases.
    """

    value: float
    error: float
    least: float
    most: float

    @property
    def known(self) -> bool:
        """Whether any digit is predictable."""
        return self.error == 0.0 or self.error < max(abs(self.least), abs(self.most))


def uncertain(value: float, error: float = 0.0, others: Iterable[float] = ()) -> UncertainValue:
    """Return a number with its error and its range; `others`: its values at other phases."""
    values = [value, *others]
    return UncertainValue(value, error, min(values), max(values))


@dataclass(frozen=True)
class MetricRow:
    """One metric of a run, beside that of the run that it is compared with.

    Attributes:
        span: "first_impact" or "whole_run".
        metric: name of the metric, a key of FACTS[span].
        value: value of the run, SI units; nan if it is not defined.
        reference: value of the other run; None without a comparison.
        change: change from the reference to the value, in `unit`; None if it is not defined.
        unit: "dB" for energies, speeds and pressures, "%" for other quantities; for what is
            compared by its difference, the SI unit.
        from_zero: whether the reference is zero within its error, and the value is not.
    """

    span: SpanName
    metric: str
    value: UncertainValue
    reference: UncertainValue | None = None
    change: UncertainValue | None = None
    unit: str = ""
    from_zero: bool = False

    @property
    def field(self) -> Fact:
        """Label, unit and kind of comparison of the metric."""
        return FACTS[self.span][self.metric]

    @property
    def label(self) -> str:
        """Label of the metric, with its span if that is not the first impact."""
        return self.field.label + (", whole run" if self.span == "whole_run" else "")

    @property
    def level(self) -> Level:
        """Where the row is shown."""
        return self.field.whole_run if self.span == "whole_run" else self.field.level

    @property
    def size(self) -> float:
        """Size of the change in dB, by which changes are ordered."""
        if self.from_zero:
            return math.inf
        if self.change is None or self.reference is None or self.field.difference:
            return 0.0
        if self.unit == "dB":
            return abs(self.change.value)
        if self.value.value == 0.0:
            return math.inf
        return abs(decibels(self.value.value, self.reference.value, 20.0))


Rows = Sequence[MetricRow]


def row_of(rows: Rows, span: SpanName, metric: str) -> MetricRow | None:
    """Return the row of a metric; None if there is none."""
    return next((row for row in rows if (row.span, row.metric) == (span, metric)), None)


def metric_rows(
    result: RunResult,
    free: Metrics | None,
    known: Predictability,
    phases: Sequence[ValuesBySpan] = (),
) -> list[MetricRow]:
    """Return the metrics of a run beside those without control.

    Args:
        result: The run.
        free: Metrics of the same run without control; None if there is no comparison.
        known: How well the impacts of both can be known.
        phases: Metrics of the run at other touch phases.
    """
    own = uncertain_values(result.metrics, known.model_error, known.controlled, phases)
    if free is None:
        return [MetricRow(*key, value) for key, value in own.items()]
    other = uncertain_values(free, known.model_error, known.uncontrolled)
    if result.metrics.stability.unstable:
        return [MetricRow(*key, value, other[key]) for key, value in own.items()]
    return compared(own, other)


UncertainValues = Mapping[tuple[SpanName, str], UncertainValue]


def uncertain_values(
    metrics: Metrics,
    model_error: float | None,
    known: Sequence[ImpactErrors] | None,
    phases: Sequence[ValuesBySpan] = (),
) -> UncertainValues:
    """Return the metrics of one run with their errors and ranges, by span and name."""
    certain = later_impacts_known(metrics.by_impact, known)
    found = {}
    for span, values in metrics.by_span.items():
        others = [each[span] for each in phases if each[span]]
        for name, one in FACTS[span].items():
            value = float(values.get(name, math.nan))
            error = _grown_error(known, span, name, one)
            if model_error is not None and not math.isnan(value):
                speed = values["impact_speed_m_s"]
                error = max(one.error(value, model_error, speed), error)
            if name == "contacts" and span == "whole_run" and not certain:
                error = math.inf
            found[span, name] = uncertain(value, error, (float(each[name]) for each in others))
    return found


def values_in(rows: Rows) -> UncertainValues:
    """Return the values of a run by span and name of the metric."""
    return {(row.span, row.metric): row.value for row in rows}


def without_errors(metrics: RunMetrics) -> UncertainValues:
    """Return metrics of which no error is known."""
    return {
        (span, name): uncertain(float(value))
        for span in FACTS
        if (found := getattr(metrics, span)) is not None
        for name, value in vars(found).items()
    }


def compared(own: UncertainValues, other: UncertainValues) -> list[MetricRow]:
    """Return the metrics of a run beside those of another, where both have them."""
    return [_row(*key, value, other[key]) for key, value in own.items() if key in other]


def comparison(a: UncertainValues, b: UncertainValues) -> tuple[MetricRow, ...]:
    """Compare a run, b, with another, a, in the spans and metrics that both have."""
    lacking = {
        span
        for found in (a, b)
        for span in FACTS
        if (span, "contacts") not in found or math.isnan(found[span, "contacts"].value)
    }
    rows = compared(b, a)
    return tuple(row for row in rows if row.metric in SPAN_FACTS and row.span not in lacking)


def _grown_error(
    known: Sequence[ImpactErrors] | None, span: SpanName, name: str, about: Fact
) -> float:
    """Return the largest absolute error of a metric by what earlier impacts magnify; 0 if all
    digits are predictable."""
    each = [errors_of(known, i).get(name, 0.0) for i in range(len(known or ()))]
    if span == "first_impact" or about.impacts == "first":
        each = each[:1]
    elif about.impacts == "last":
        each = each[-1:]
    return max(each, default=0.0) if about.impacts == "largest" else sum(each)


def _row(span: SpanName, name: str, value: UncertainValue, reference: UncertainValue) -> MetricRow:
    """Compare two values of a metric. The larger of their errors is that of the change: both runs
    lack the same modes, so that their errors do not add up. Both may begin at any touch phase."""
    field, base = FACTS[span][name], reference.value
    pairs = (
        (value.value, base),
        (value.least, reference.most),
        (value.most, reference.least),
    )
    if field.difference:
        ends = [one - other for one, other in pairs]
        unit, error = field.unit, max(value.error, reference.error)
        if math.isnan(ends[0]):
            return MetricRow(span, name, value, reference)
        return MetricRow(span, name, value, reference, uncertain(ends[0], error, ends), unit)
    if base == 0.0 or (0.0 < base <= reference.error):
        risen = value.known and value.value > value.error
        return MetricRow(span, name, value, reference, from_zero=risen)
    if not reference.least > 0.0 or not value.least >= 0.0 or (field.db and value.least == 0.0):
        return MetricRow(span, name, value, reference)
    ratios = [one / other for one, other in pairs]
    wrong = max(value.error / value.value if value.value else 0.0, reference.error / base)
    if field.db:
        ends = [field.db * math.log10(ratio) for ratio in ratios]
        change = uncertain(ends[0], field.db / math.log(10.0) * wrong, ends)
        return MetricRow(span, name, value, reference, change, "dB")
    ends = [100.0 * (ratio - 1.0) for ratio in ratios]
    error = 100.0 * max(value.error, reference.error * ratios[0]) / base
    return MetricRow(span, name, value, reference, uncertain(ends[0], error, ends), "%")
