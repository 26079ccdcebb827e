"""The table of at most ten metrics that ends a run."""

import math

from hertzloop.controller.loading.registry import NO_CONTROL
from hertzloop.results.metrics import Metrics, RunResult
from hertzloop.results.predictability import Predictability, error_of
from hertzloop.results.span_metrics import DECIBELS, SPAN_METRICS
from hertzloop.views.digits import UNKNOWN, cells, change_cell
from hertzloop.views.format import Table

# Label, span, key and format of a metric.
_METRICS: tuple[tuple[str, str, str, str], ...] = (
    ("contacts, whole run", "whole_run", "contacts", ".0f"),
    ("contact time, first contact", "first_impact", "contact_time_s", ".4g"),
    ("peak contact force", "first_impact", "peak_force_n", ".4g"),
    ("rebound speed", "first_impact", "rebound_speed_m_s", ".3g"),
    ("rebound height", "first_impact", "rebound_height_m", ".3g"),
    ("plate energy, whole run", "whole_run", "plate_energy_j", ".4g"),
    ("plate energy", "first_impact", "plate_energy_j", ".4g"),
    ("radiated energy to 20 kHz", "first_impact", "radiated_j", ".4g"),
    ("largest plate speed", "first_impact", "plate_speed_max_m_s", ".4g"),
    ("peak pressure at 1 m (bound)", "first_impact", "peak_pressure_pa", ".3g"),
)

_IN_DB = DECIBELS | {"peak_force_n": 0.0}


def metrics_table(result: RunResult, known: Predictability, free: Metrics | None = None) -> Table:
    """Return the table of at most ten metrics that ends a run.

    Args:
        result: The run.
        known: How well its metrics, and those without control, can be known.
        free: The metrics of the same run without control. None if there is no comparison.

    Returns:
        One row for each metric: with control, without control, and the change, in dB for energies
        and amplitudes, and in per cent of the value without control otherwise.
    """
    compare = free is not None and not result.metrics.stability.unstable
    cases = [(result.metrics, known.controlled), *([(free, known.uncontrolled)] if free else [])]
    own = "no control" if result.scene_law == NO_CONTROL else "with control"
    right = [own, "without"][: len(cases)] + ["change"] * compare
    table = Table("metric", right=right, title="Metrics of the first impact")
    for label, span, key, form in _METRICS:
        found = [getattr(getattr(metrics, span), key, math.nan) for metrics, _ in cases]
        wrong = [error_of(digits, span, key) for _, digits in cases]
        lost = span == "whole_run" and not result.complete
        row = cells(SPAN_METRICS[key], found, wrong, form, UNKNOWN if lost else "-")
        if compare:
            row.append(
                "" if key == "contacts" else change_cell(_IN_DB.get(key, 0.0), found, wrong, 1)
            )
        table.add_row(label, *(cell.strip() for cell in row))
    return table
