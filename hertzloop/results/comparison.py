"""The metrics of two runs, side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

from hertzloop.results.predictability import ImpactErrors, error_of
from hertzloop.results.span_metrics import DECIBELS, SPAN_METRICS, RunMetrics, decibels


@dataclass(frozen=True)
class Difference:
    """One metric of two runs.

    Attributes:
        span: "first_impact" or "whole_run".
        metric: name of the metric in `SpanMetrics`.
        a: value of the first run, SI units.
        b: value of the second run, SI units.
        b_to_a: change from a to b in `unit`; nan where no ratio is defined.
        unit: "dB" for energies and amplitudes, "%" for other quantities, "" for a count.
        a_error: largest absolute error of `a`; 0 if all its digits are predictable, or if nothing
            is known of them.
        b_error: the same of `b`.
    """

    span: str
    metric: str
    a: float
    b: float
    b_to_a: float
    unit: str
    a_error: float = 0.0
    b_error: float = 0.0


@dataclass(frozen=True)
class Comparison:
    """All metrics of two runs.

    Attributes:
        rows: the metrics of the first impact, then those of the whole run.
    """

    rows: tuple[Difference, ...]


def compared(
    a: RunMetrics,
    b: RunMetrics,
    a_known: Sequence[ImpactErrors] | None = None,
    b_known: Sequence[ImpactErrors] | None = None,
) -> Comparison:
    """Compare the spans that both runs have.

    Args:
        a: Metrics of the first run.
        b: Metrics of the second run.
        a_known: Errors of each impact of the first run; None if they are not known.
        b_known: Errors of each impact of the second run.
    """
    return Comparison(
        tuple(
            replace(
                row,
                a_error=error_of(a_known, row.span, row.metric),
                b_error=error_of(b_known, row.span, row.metric),
            )
            for row in _rows(a, b)
        )
    )


def _rows(a: RunMetrics, b: RunMetrics) -> Iterator[Difference]:
    for span in (f.name for f in fields(RunMetrics)):
        one, other = getattr(a, span), getattr(b, span)
        if one is None or other is None:
            continue
        for name in SPAN_METRICS:
            yield _difference(span, name, getattr(one, name), getattr(other, name))


def _difference(span: str, name: str, a: float, b: float) -> Difference:
    if name in DECIBELS:
        return Difference(span, name, a, b, decibels(b, a, DECIBELS[name]), "dB")
    if name == "contacts":
        return Difference(span, name, a, b, b - a, "")
    change = 100.0 * (b / a - 1.0) if a else float("nan")
    return Difference(span, name, a, b, change, "%")
