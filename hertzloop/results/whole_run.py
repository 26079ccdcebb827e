"""Metrics of a whole run, from its time series in blocks."""

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
from hertzloop.results.impact_windows import PIECE
from hertzloop.results.span_metrics import SpanMetrics, span_metrics
from hertzloop.results.statistics import Accumulator

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


class WholeRunAccumulator(Accumulator):
    """Accumulates the metrics of a run from its first contact on, for a scheme that conserves
    energy. The sums run over pieces that are counted from the first contact."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec, self._modes = spec, audible_modes(spec)
        self._parts: list[np.ndarray] = []  # steps that are not taken yet
        self._lead = 0  # steps before the first contact, or before a piece, among them: at most one
        self._done = 0
        self._touched = False
        self._work_j = self._speed_max = 0.0
        self._drive: np.ndarray | float = 0.0

    def feed(self, first: int, truth: np.ndarray) -> None:
        """Add the next steps of the time series, shape (10, steps), from step `first` on."""
        if not truth.shape[1]:
            return
        if not self._touched:
            touching = np.flatnonzero(truth[F_C])
            self._touched = bool(len(touching))
            start = int(touching[0]) if self._touched else truth.shape[1]
            if start:
                truth = truth[:, start - 1 :]
                self._parts, self._lead = [], 1
        self._parts.append(truth)
        held = sum(part.shape[1] for part in self._parts)
        while held > self._lead + PIECE:
            whole, end = self._joined(), self._lead + PIECE
            self._take(whole[:, : end + 1], PIECE)
            self._parts, self._lead = [whole[:, end - 1 :]], 1
            held = self._parts[0].shape[1]

    def result(self, impacts: list[Impact]) -> SpanMetrics | None:
        """Return the metrics of the run, whose impacts are known; None without an impact."""
        if self._touched:
            whole = self._joined()
            self._take(whole, whole.shape[1] - self._lead)
        if not impacts:
            return None
        given = NoiseInputs(
            np.asarray(self._drive),
            self._work_j,
            self._speed_max,
            impacts[0].duration_s,
            impacts[0].impact_speed_m_s,
            impacts[-1].rebound_speed_m_s,
        )
        noise = impact_noise(self._spec, self._modes, given)
        return span_metrics(len(impacts), max(i.peak_force_n for i in impacts), noise)

    def _joined(self) -> np.ndarray:
        """The steps that are held, in one array: that of the caller where it is the only one."""
        return self._parts[0] if len(self._parts) == 1 else np.concatenate(self._parts, axis=1)

    def _take(self, truth: np.ndarray, steps: int) -> None:
        """Add so many steps; `truth` has the step before them, if any, and may have the next."""
        spec, piece = self._spec, truth[:, self._lead : self._lead + steps]
        self._work_j += work_j(spec, truth, self._lead)
        self._speed_max = max(self._speed_max, float(np.abs(piece[V_P]).max(initial=0.0)))
        pushed = np.flatnonzero((piece[F_C] != 0.0) | (piece[F_A] != 0.0))
        for some in np.split(pushed, np.flatnonzero(np.diff(pushed) > _APART) + 1):
            if not len(some):
                continue
            own = piece[:, some[0] : some[-1] + 1]
            self._drive = self._drive + modal_drive(
                self._modes,
                -own[F_C],
                own[F_A],
                spec.step_s,
                -own[F_C1],
                self._done + int(some[0]),
                own[F_A1],
            )
        self._done += steps
