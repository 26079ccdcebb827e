"""The worst value of a metric over the latencies within the jitter of each case of a sweep."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from hertzloop.results.cases import CaseFailed, CaseState
from hertzloop.results.spans import Span
from hertzloop.scene.controller import latencies_us
from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import Numbered, run_case, run_cases
from hertzloop.studies.cases.rows import Case, Row, Rows, without_result
from hertzloop.studies.worst.search import WorstSearch, largest

WORST_CASES, LATENCIES = "worst_cases", "worst_latencies_us"


def worst_columns(metric: str) -> tuple[str, str, str]:
    """Return the columns of a row: worst value, number of cases, and latency by sample, us."""
    return f"worst_{metric}", WORST_CASES, LATENCIES


def run_cases_with_worst(
    metric: str, setup: Setup, span: Span, numbered: Numbered
) -> Iterator[Row]:
    """Yield the rows of cases as `run_cases`, with the columns of the worst latencies of each.

    The worst value is infinite if the loop is unstable. Each column is None for a case that cannot
    be run, or has no jitter or law; value and latencies also if no latencies have the metric.
    """
    for number, values in numbered:
        row = run_case(setup, span, number, values) | dict.fromkeys(worst_columns(metric))
        if not without_result([row]):
            try:
                row |= _worst_of_case(setup.vary(values), metric, span)
            except CaseFailed as error:
                row |= {"status": str(error), "state": CaseState.FAILED.value}
            except Exception as error:  # one case must not end the others
                row |= {"status": f"failed: {error!r}", "state": CaseState.FAILED.value}
        yield row


def _worst_of_case(setup: Setup, metric: str, span: Span) -> dict[str, Any]:
    """Search the latencies within the jitter of a case, the drawn ones among them."""
    control = setup.scene.controller
    most_steps = round(control.jitter_us * 1000 / setup.step_ns)
    if not most_steps or not setup.has_law:
        return {}

    def run(cases: list[Case]) -> Rows:
        return list(run_cases(setup, span, [*enumerate(cases)]))

    drawn_us = latencies_us(setup) - control.latency_us
    drawn = np.round(drawn_us * 1000 / setup.step_ns).astype(np.int32)
    search = WorstSearch(setup, largest(metric), [setup.touch_phase], run)
    found = search.within(most_steps, also=[drawn])
    if found.excess == -math.inf:
        return {WORST_CASES: found.cases}
    values = found.excess, found.cases, list(found.latencies_us)
    return dict(zip(worst_columns(metric), values, strict=True))
