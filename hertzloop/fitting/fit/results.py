"""The result of a fit: estimates, nuisance parameters, verdicts."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from hertzloop.fitting.records.record import Record
from hertzloop.scene.setup import Setup

WIDEST = 0.30  # relative half-width of an identified key
NORMAL = 1.959963984540054  # 95 %
OPEN = "open"  # an end of an interval that is open, in text
_NO_BOUND = 10.0  # half-widths of logarithms beyond this mean nothing


def half_width(sd: float) -> float:
    """Return half the 95 % interval over the value, by the standard deviation of the logarithm; inf
    if nothing is known."""
    return math.sinh(NORMAL * sd) if NORMAL * sd < _NO_BOUND else math.inf


class KeyVerdict(StrEnum):
    """What a fit knows of a key."""

    IDENTIFIED = "identified"
    ONE_SIDED = "one-sided"
    NOT_IDENTIFIABLE = "not identifiable"
    AT_BOUND = "at its bound"


class ModelVerdict(StrEnum):
    """Whether the class of models fits the records."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True)
class Estimate:
    """An estimate of a free key.

    Attributes:
        key: scene key.
        value: estimate, in the unit of the key.
        low: lower end of the 95 % interval; None where it is open.
        high: upper end of the 95 % interval; None where it is open.
        verdict: identified, one-sided, not identifiable or at its bound.
        start: value of the scene before the fit.
        sd_log: standard deviation of the natural logarithm; None where it is unknown.
        prior_pull: distance from the prior in its standard deviations; None without a prior.
        alone_percent: half-width if all other keys were known, %.
        resolution: distance of the values of a key in whole steps; None of another key.
    """

    key: str
    value: float
    low: float | None
    high: float | None
    verdict: KeyVerdict
    start: float
    sd_log: float | None
    prior_pull: float | None = None
    alone_percent: float | None = None
    resolution: float | None = None

    @property
    def half_width_percent(self) -> float | None:
        """Half the interval over the value, %."""
        if self.low is None or self.high is None or self.value == 0.0:
            return None
        return 50.0 * (self.high - self.low) / self.value


@dataclass(frozen=True)
class Nuisance:
    """Nuisance parameters and residual of a record: see the JSON.

    Attributes:
        in_pulse_percent: root mean square of the residual in the pulse over the peak, %; None
            without samples there.
        after_pulse_percent: the same after the pulse.
        largest_percent: largest residual over the peak, %.
        discrepancy_in_pulse_percent: discrepancy of the model in the pulse over the local signal,
            %; zero if the noise explains the residual.
        discrepancy_after_pulse_percent: the same after the pulse.
    """

    record: str
    time_shift_s: float
    gain: float
    offset: float
    clock_ppm: float
    noise_rms: float
    residual_over_noise: float
    samples: int
    rejected_samples: int
    in_pulse_percent: float | None
    after_pulse_percent: float | None
    largest_percent: float
    discrepancy_in_pulse_percent: float
    discrepancy_after_pulse_percent: float


@dataclass(kw_only=True)
class FitResult:
    """The result of `fit`.

    Attributes:
        estimates: one per free key, in the order given.
        nuisances: time shift, clock error, gain and offset of each record.
        noise_rms: noise of the first record, in the SI unit of its quantity.
        residual_over_noise: residual of all records over their noise.
        model: verdict on the model.
        statistics: the tests behind the verdict, by name.
        reasons: sentences on the verdict.
        hold_out: Comparison with the held-out records; None without any.
        evaluations: number of simulations.
        wall_s: duration of the fit, s.
        covariance: covariance of the natural logarithms of the keys, shape (keys, keys).
        setup: setup with the fitted scene, `setup.scene`; None for a check.
        notes: sentences.
        speeds_m_s: least and largest impact speed of the records, m/s.
        records: the records.
        curves: measured and simulated values by record.
        checked_only: whether no fit was made.
    """

    estimates: list[Estimate]
    nuisances: list[Nuisance]
    noise_rms: float
    residual_over_noise: float
    model: ModelVerdict
    statistics: dict[str, Any]
    reasons: list[str]
    evaluations: int
    wall_s: float
    covariance: np.ndarray
    notes: list[str]
    speeds_m_s: tuple[float, float]
    hold_out: dict[str, Any] | None = None
    setup: Setup | None = None
    records: list[Record] = field(default_factory=list)
    curves: list[dict[str, np.ndarray]] = field(default_factory=list)
    checked_only: bool = False

    @property
    def identifiable(self) -> bool:
        """Whether the records determine every key at least on one side."""
        return all(e.verdict is not KeyVerdict.NOT_IDENTIFIABLE for e in self.estimates)
