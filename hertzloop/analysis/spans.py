"""Figures of a span of a run, its first impact or the whole of it, and what control changes."""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from hertzloop.analysis.impacts import (
    F_A,
    F_A1,
    F_C,
    F_C1,
    PIECE,
    V_P,
    RowsOfImpact,
    modal_displacement,
    starting_speed,
    work_j,
)
from hertzloop.analysis.meters import Meter
from hertzloop.plant.figures import rows_kernels as k
from hertzloop.plant.figures.impacts import Impact
from hertzloop.plant.figures.noise import (
    RADIATED_UP_TO_HZ,
    ImpactNoise,
    audible,
    audible_alone,
    impact_noise,
    modal_drive,
    shares_of_drive_j,
)
from hertzloop.plant.plant import PlantSpec, modes_of
from hertzloop.plant.structures.modes import Oscillators

# Of 20 kHz: no oscillator stands for modes further apart than that.
_BEYOND_AUDIBLE = 1.01
_APART = 1 << 10  # steps without force between two parts of a force's spectrum


@dataclass(frozen=True)
class SpanFigures:
    """Figures of the first impact, or of the whole run.

    `plant.figures.rows_kernels` defines the first impact. The whole run lasts from the first touch
    to its end.

    Attributes:
        contacts: number of contacts.
        contact_time_s: duration of the first contact, s.
        impact_speed_m_s: speed of the sphere before the first contact, m/s.
        rebound_speed_m_s: speed of the sphere after the last contact, m/s.
        rebound_height_m: height of the sphere after the last contact, by energy, m.
        peak_force_n: largest contact force, N.
        plate_energy_j: work of contact force and actuator force on the plate, J.
        plate_speed_max_m_s: largest plate speed at the contact point, m/s.
        radiated_j: figure of the study, sum of sigma E up to 20 kHz, J; nan unless the structure
            is a simply supported plate.
        sound_j: energy that the plate radiates up to 20 kHz, J; nan as `radiated_j`.
        longhorn_j: acceleration noise energy (Longhorn 1952), J.
        holmes_j: acceleration noise energy (Holmes 1974), J.
        peak_pressure_pa: bound of the sound pressure at 1 m, Pa.
    """

    contacts: int
    contact_time_s: float
    impact_speed_m_s: float
    rebound_speed_m_s: float
    rebound_height_m: float
    peak_force_n: float
    plate_energy_j: float
    plate_speed_max_m_s: float
    radiated_j: float
    sound_j: float
    longhorn_j: float
    holmes_j: float
    peak_pressure_pa: float


@dataclass(frozen=True)
class RunFigures:
    """Figures of a run.

    Attributes:
        first_impact: figures of the first impact; None without a contact.
        whole_run: figures of all contacts; None without a contact and for the published scheme.
    """

    first_impact: SpanFigures | None
    whole_run: SpanFigures | None


_ENERGIES = ("plate_energy_j", "radiated_j", "sound_j", "longhorn_j", "holmes_j")
_AMPLITUDES = ("peak_force_n", "plate_speed_max_m_s", "peak_pressure_pa")
MUCH_DB = 0.5  # between the change in the first impact and that over all contacts
# Factor of the logarithm of a ratio: of energies, and of amplitudes.
DECIBELS = dict.fromkeys(_ENERGIES, 10.0) | dict.fromkeys(_AMPLITUDES, 20.0)
_SHARED = {f.name for f in fields(ImpactNoise)} & {f.name for f in fields(SpanFigures)}


def of_impact(found: RowsOfImpact) -> SpanFigures:
    """Figures of one impact."""
    return _figures(1, found.impact.peak_force_n, found.noise)


def _figures(contacts: int, peak_force_n: float, noise: ImpactNoise) -> SpanFigures:
    return SpanFigures(
        contacts=contacts,
        rebound_speed_m_s=noise.next_impact_speed_m_s,
        peak_force_n=peak_force_n,
        plate_energy_j=noise.transmitted_j,
        **{name: value for name, value in vars(noise).items() if name in _SHARED},
    )


def decibels(value: float, reference: float, factor: float = 10.0) -> float:
    """`factor` times lg of a ratio; nan where it has no logarithm."""
    ratio = value / reference if reference else math.nan
    return factor * math.log10(ratio) if ratio > 0.0 else math.nan


def changes_db(value: SpanFigures, reference: SpanFigures) -> dict[str, float]:
    """By how many dB energies (10 lg) and amplitudes (20 lg) differ, by the figures' names."""
    ours, theirs = vars(value), vars(reference)
    return {name: decibels(ours[name], theirs[name], by) for name, by in DECIBELS.items()}


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


class WholeRunMeter(Meter):
    """Follows a run of a consistent scheme from its first touch on, over rows of truth that come
    in blocks. It sums over pieces that are counted from there."""

    def __init__(self, spec: PlantSpec) -> None:
        self._spec, self._modes = spec, audible_modes(spec)
        self._parts: list[np.ndarray] = []
        self._before = np.zeros((10, 0))
        self._held = self._done = 0
        self._touched = False
        self._work_j = self._speed_max = 0.0
        self._drive: np.ndarray | float = 0.0

    def feed(self, first: int, rows: np.ndarray) -> None:
        """Take the next rows, shape (10, steps), from step `first` on."""
        if not self._touched:
            touching = np.flatnonzero(rows[F_C])
            self._touched = bool(len(touching))
            start = int(touching[0]) if self._touched else rows.shape[1]
            if start:
                self._before = rows[:, start - 1 : start].copy()
            rows = rows[:, start:]
        if not rows.shape[1]:
            return
        self._parts.append(rows)
        self._held += rows.shape[1]
        while self._held > PIECE:
            rows = np.concatenate(self._parts, axis=1)
            self._take(rows[:, :PIECE], rows[:, PIECE : PIECE + 1])
            self._parts, self._held = [rows[:, PIECE:]], rows.shape[1] - PIECE

    def result(self, impacts: list[Impact]) -> SpanFigures | None:
        """Figures of the run, whose impacts are known; None without any."""
        if self._parts:
            self._take(np.concatenate(self._parts, axis=1), np.zeros((10, 0)))
            self._parts = []
        if not impacts:
            return None
        noise = impact_noise(
            self._spec.sphere, self._spec.plate, self._modes,
            shares_of_drive_j(self._modes, np.asarray(self._drive)),
            self._work_j, self._speed_max, impacts[0].duration_s,
            impacts[0].impact_speed_m_s, impacts[-1].rebound_speed_m_s,
            faces=self._spec.radiating_faces or 1,
        )  # fmt: skip
        return _figures(len(impacts), max(i.peak_force_n for i in impacts), noise)

    def _take(self, piece: np.ndarray, following: np.ndarray) -> None:
        spec, lead = self._spec, self._before.shape[1]
        rows = np.concatenate([self._before, piece, following], axis=1)
        displaced, v_start = modal_displacement(spec, rows), starting_speed(spec, rows)
        self._work_j += work_j(spec, rows[:, lead:], displaced[lead:], v_start[lead:])
        self._speed_max = max(self._speed_max, k.largest(piece[V_P]))
        pushed = np.flatnonzero((piece[F_C] != 0.0) | (piece[F_A] != 0.0))
        for some in np.split(pushed, np.flatnonzero(np.diff(pushed) > _APART) + 1):
            if not len(some):
                continue
            own = piece[:, some[0] : some[-1] + 1]
            self._drive = self._drive + modal_drive(
                self._modes, -own[F_C], own[F_A], spec.step_s, -own[F_C1],
                self._done + int(some[0]), own[F_A1],
            )  # fmt: skip
        self._before = piece[:, -1:].copy()
        self._done += piece.shape[1]


def change_db(
    value: float,
    reference: float,
    factor: float = 10.0,
    error: float = 0.0,
    reference_error: float = 0.0,
) -> tuple[float, float]:
    """A ratio in dB, nan where there is none, and its error by those of both numbers."""
    change = decibels(value, reference, factor)
    if math.isnan(change):
        return math.nan, math.nan
    wrong = error / abs(value) + reference_error / abs(reference)
    return change, factor / math.log(10.0) * wrong


@dataclass(frozen=True)
class Difference:
    """One figure of two runs.

    Attributes:
        span: "first impact" or "whole run".
        figure: name of the figure in `SpanFigures`.
        a: value of the first run, SI units.
        b: value of the second run, SI units.
        b_to_a: change from a to b in `unit`; nan where no ratio is defined.
        unit: "dB" for energies and amplitudes, "%" for other quantities, "" for a count.
    """

    span: str
    figure: str
    a: float
    b: float
    b_to_a: float
    unit: str


@dataclass(frozen=True)
class Comparison:
    """All figures of two runs.

    Attributes:
        rows: the figures of the first impact, then those of the whole run.
    """

    rows: tuple[Difference, ...]


def compared(a: RunFigures, b: RunFigures) -> Comparison:
    """Compare the spans that both runs have."""
    return Comparison(tuple(_rows(a, b)))


def _rows(a: RunFigures, b: RunFigures) -> Iterator[Difference]:
    for span in (f.name for f in fields(RunFigures)):
        one, other = getattr(a, span), getattr(b, span)
        if one is None or other is None:
            continue
        for figure in (f.name for f in fields(SpanFigures)):
            yield _difference(span, figure, getattr(one, figure), getattr(other, figure))


def _difference(span: str, figure: str, a: float, b: float) -> Difference:
    if figure in DECIBELS:
        return Difference(span, figure, a, b, decibels(b, a, DECIBELS[figure]), "dB")
    if figure == "contacts":
        return Difference(span, figure, a, b, b - a, "")
    change = 100.0 * (b / a - 1.0) if a else float("nan")
    return Difference(span, figure, a, b, change, "%")


def predictable(value: float, error: float) -> bool:
    """Whether any digit of a number is, by its largest absolute error; 0 where all digits are."""
    return error == 0.0 or error < abs(value)
