"""Metrics of a whole run, from its time series."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from hertzloop.plant.metrics.impacts import Impact, work_j
from hertzloop.plant.metrics.noise import (
    RADIATED_UP_TO_HZ,
    NoiseInputs,
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
    work = work_j(spec, truth[:, start - before :], before)
    rows, modes = truth[:, start:], audible_modes(spec)
    drive: np.ndarray | float = 0.0
    pushed = np.flatnonzero((rows[F_C] != 0.0) | (rows[F_A] != 0.0))
    for some in np.split(pushed, np.flatnonzero(np.diff(pushed) > _APART) + 1):
        own, first = rows[:, some[0] : some[-1] + 1], int(some[0])
        drive = drive + modal_drive(
            modes, -own[F_C], own[F_A], spec.step_s, -own[F_C1], first, own[F_A1]
        )
    given = NoiseInputs(
        np.asarray(drive),
        work,
        float(np.abs(rows[V_P]).max()),
        impacts[0].duration_s,
        impacts[0].impact_speed_m_s,
        impacts[-1].rebound_speed_m_s,
    )
    noise = impact_noise(spec, modes, given)
    return span_metrics(SpanParts(spec, impacts, noise))
