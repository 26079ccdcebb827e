"""The table of noise and vibration metrics of the first impact."""

import math
from collections.abc import Sequence

from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.results.metric_fields import MetricField
from hertzloop.results.span_metrics import SPAN_METRICS
from hertzloop.views.digits import LEGEND, UNKNOWN, cells, change_cell
from hertzloop.views.format import Table

# Words and units of the noise metrics that no span has.
_OF_NOISE = {
    "contact_time_s": MetricField("", "contact time", "us", 1e6),
    "next_impact_speed_m_s": MetricField("", "next impact speed", "m/s"),
    "transmitted_j": MetricField("", "transmitted energy, in time", "uJ", 1e6, 10.0),
    "transmitted_spectrum_j": MetricField("", "transmitted energy, by spectrum", "uJ", 1e6, 10.0),
    "radiated_maidanik_j": MetricField("", "sigma E to 20 kHz, eq. 3.13", "uJ", 1e6, 10.0),
    "sound_maidanik_j": MetricField("", "radiated to 20 kHz, eq. 3.13", "uJ", 1e6, 10.0),
}

_ORDER = (
    "contact_time_s",
    "next_impact_speed_m_s",
    "rebound_height_m",
    "longhorn_j",
    "holmes_j",
    "peak_pressure_pa",
    "transmitted_j",
    "transmitted_spectrum_j",
    "plate_speed_max_m_s",
    "radiated_j",
    "radiated_maidanik_j",
    "sound_j",
    "sound_maidanik_j",
)
_NOISE_ROWS = {name: _OF_NOISE.get(name) or SPAN_METRICS[name] for name in _ORDER}


def noise_table(
    columns: list[tuple[str, ImpactNoise]],
    compare: bool = True,
    errors: Sequence[dict[str, float]] = (),
) -> Table:
    """Return the table of noise metrics.

    Args:
        columns: Heading and metrics of one or two cases.
        compare: Whether two cases get a column with the change from the second to the first, in dB
            for energies and amplitudes, in per cent for speed, height and time.
        errors: Largest absolute errors of each case by metric; empty if all digits count.
    """
    compare = compare and len(columns) == 2
    right = [*(heading for heading, _ in columns), *["change"] * compare]
    table = Table("metric", right=right, title="Noise and vibration of the first impact")
    rows = noise_rows([metrics for _, metrics in columns], compare, errors)
    for row in rows:
        table.add_row(*row)
    notes = []
    if any(math.isnan(metrics.radiated_j) for _, metrics in columns):
        notes.append("radiation is known for simply supported plates with modes that can be summed")
    if any(UNKNOWN in row for row in rows):
        notes.append(LEGEND)
    table.caption = "; ".join(notes) or None
    return table


def noise_rows(
    columns: Sequence[ImpactNoise], compare: bool, errors: Sequence[dict[str, float]] = ()
) -> list[list[str]]:
    """Return the rows of that table: label, a cell for each case, and the change if compared."""
    rows = []
    for key, row in _NOISE_ROWS.items():
        values = [getattr(one, key) for one in columns]
        wrong = [found.get(key, 0.0) for found in errors] or [0.0] * len(values)
        written = cells(row, values, wrong, ".4g", "not defined")
        if compare:
            written.append(change_cell(row.db, values, wrong, 2, "from nearly zero"))
        rows.append([row.words, *written])
    return rows
