"""The worst value of a metric over the latencies within the jitter of one case of a sweep."""

import math
from typing import Any

import numpy as np

from hertzloop.scene.controller import latencies_us
from hertzloop.scene.setup import Setup
from hertzloop.studies.worst.search import Run, WorstSearch, largest

# Among the values of a case, beside its scene keys: the metric to search.
WORST_OF = "worst"
WORST_CASES, LATENCIES = "worst_cases", "worst_latencies_us"


def worst_columns(metric: str) -> tuple[str, str, str]:
    """Return the columns of a row: worst value, number of cases, and latency by sample, us."""
    return f"worst_{metric}", WORST_CASES, LATENCIES


def worst_of_case(setup: Setup, metric: str, run: Run) -> dict[str, Any]:
    """Search the latencies within the jitter of a case, the drawn ones among them.

    Args:
        setup: The case.
        metric: Name of the metric whose largest value is the worst.
        run: Returns the rows of cases of this setup, in their order.

    Returns:
        The columns: the worst value is infinite if the loop is unstable. Each is None for a case
        without jitter or law; value and latencies also if no case has the metric.
    """
    names, control = worst_columns(metric), setup.scene.controller
    most_steps = round(control.jitter_us * 1000 / setup.step_ns)
    if not most_steps or not setup.has_law:
        return dict.fromkeys(names)
    drawn_us = latencies_us(setup) - control.latency_us
    drawn = np.round(drawn_us * 1000 / setup.step_ns).astype(np.int32)
    search = WorstSearch(setup, largest(metric), [setup.touch_phase], run)
    found = search.within(most_steps, also=[drawn])
    if found.excess == -math.inf:
        return dict.fromkeys(names) | {WORST_CASES: found.cases}
    return dict(zip(names, (found.excess, found.cases, list(found.latencies_us)), strict=True))
