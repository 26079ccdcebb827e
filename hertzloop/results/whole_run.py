"""Metrics of a whole run, from its time series."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from hertzloop.plant.metrics.impacts import Impact, step_work_j
from hertzloop.plant.metrics.noise import (
    RADIATED_UP_TO_HZ,
    audible,
    audible_alone,
    impact_noise,
    modal_drive,
)
from hertzloop.plant.plant import PlantSpec, modes_of
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1, V_P
from hertzloop.results.span_metrics import SpanMetrics, SpanParts, span_metrics

# Of 20 kHz: no oscillator stands for modes further apart than that.
_BEYOND_AUDIBLE = 1.01

_APART = 1 << 10  # steps without force between two parts of a force's spectrum


@lru_cache(maxsize=8)
def audible_modes(spec: PlantSpec) -> Oscillators:
    """Oscillators up to 20 kHz. An infinite plate has no use for others, which are not looked for
    where two are that low."""
    beyond_hz = _BEYOND_AUDIBLE * RADIATED_UP_TO_HZ
    if spec.infinite_plate and spec.frequency_limit_hz > beyond_hz:
        with suppress(ValueError):  # none is so low
            low = modes_of(replace(spec, frequency_limit_hz=beyond_hz))
            if audible(low) > 1:
                return audible_alone(low)
    return audible_alone(modes_of(spec))


def whole_run(spec: PlantSpec, truth: np.ndarray, impacts: Sequence[Impact]) -> SpanMetrics | None:
    """Return the metrics of a run from its first contact on, for a scheme that conserves energy.

    Args:
        spec: The plant.
        truth: The time series of the run, shape (10, steps).
        impacts: The impacts of the run.

    Returns:
        The metrics; None without an impact.
    """
    if not impacts:
        return None
    start = int(np.argmax(truth[F_C] != 0.0))
    before = min(start, 1)
    work_j = step_work_j(spec, truth[:, start - before :])[before:].sum()
    rows, modes = truth[:, start:], audible_modes(spec)
    drive = np.zeros(len(modes.omega), complex)
    pushed = np.flatnonzero((rows[F_C] != 0.0) | (rows[F_A] != 0.0))
    for some in np.split(pushed, np.flatnonzero(np.diff(pushed) > _APART) + 1):
        own = rows[:, some[0] : some[-1] + 1]
        late = np.exp(-1j * modes.omega * (some[0] * spec.step_s))
        drive += late * modal_drive(modes, spec.step_s, -own[[F_C, F_C1]], own[[F_A, F_A1]])
    whole = replace(
        impacts[0],
        rebound_speed_m_s=impacts[-1].rebound_speed_m_s,
        plate_energy_j=float(work_j),
        plate_speed_max_m_s=float(np.abs(rows[V_P]).max()),
    )
    return span_metrics(SpanParts(spec, impacts, impact_noise(spec, modes, whole, drive)))
