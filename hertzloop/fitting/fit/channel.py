"""A record made ready for a fit: what is used of it, its noise, and where the impact is."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from hertzloop.fitting.fit.discrepancy import Discrepancy
from hertzloop.fitting.records.quantities import GAP_QUANTITIES
from hertzloop.fitting.records.record import Record

_FASTEST_HZ = 300e3  # of a filter that makes an acceleration converge
ENOUGH_QUIET = 100  # for one that a test of the model can rest on; the last of them are not counted
LASTING_S = 0.06  # time after the impact that a fit uses
_UNKNOWN_CONTACTS = 1.6
_LONG_RUN = 8  # samples on one level, more than a slope makes
_MOST_SAMPLES = 60_000
_DENSE_CONTACTS = 12.0


@dataclass
class Channel:
    """A record made ready.

    Attributes:
        record: the record.
        time_s: times by the record's clock, s, of the samples that are used, (samples,).
        value: values there, in the SI unit of the quantity, (samples,).
        kept: which of them count, (samples,); the others are clipped or spikes.
        peak: largest deviation from the baseline.
        noise: standard deviation of a sample.
        noise_from: "quiet" samples, "differences" of samples, or "residual" of the fit.
        quiet: number of samples before the impact that the noise rests on.
        baseline: value at rest.
        step: distance of two levels of a visible converter; zero if none is visible.
        ar: coefficients of coloured noise, (order,).
        innovation: standard deviation of the noise that drives it, over `noise`.
        onset_s: time of the first sample of the impact, s.
        has_quiet_start: whether the record begins before the impact.
        touch_s: time of the first touch, s, and `gain` and `offset`, as first found.
        notes: sentences for the user.
        rejected: number of outliers.
        limited_by_simulation: whether the error of the simulation is larger than the noise.
        simulation_error: error of the simulation during contact over the noise, where a test of the
            model would show it; else zero.
        equivalent_samples: how many samples of a finer converter would show the noise as well; None
            of a converter with steps below the noise.
        weight: of each sample in a fit, (samples,); None if all are one.
        least_noise: noise that the record has at least, by its converter and the simulation.
        discrepancy: of the model; None if the noise explains the residual.
    """

    record: Record
    time_s: np.ndarray
    value: np.ndarray
    kept: np.ndarray
    peak: float
    noise: float
    noise_from: str
    quiet: int
    baseline: float
    step: float
    ar: np.ndarray
    innovation: float
    onset_s: float
    has_quiet_start: bool
    touch_s: float = math.nan
    gain: float = 1.0
    offset: float = 0.0
    notes: list[str] = field(default_factory=list)
    rejected: int = 0
    limited_by_simulation: bool = False
    simulation_error: float = 0.0
    equivalent_samples: int | None = None
    weight: np.ndarray | None = None
    least_noise: float = 0.0
    discrepancy: Discrepancy | None = None

    @property
    def is_gap(self) -> bool:
        """Whether the values are distances from the plate, which are not zero at rest."""
        return self.record.quantity in GAP_QUANTITIES

    @property
    def away_from_contact(self) -> bool:
        """Whether the values are of another point than that of the contact."""
        return self.record.measurement.point_m is not None

    @property
    def noise_unknown(self) -> bool:
        """Whether the samples before the impact are too few for the noise."""
        return self.quiet < ENOUGH_QUIET

    @property
    def noise_estimated(self) -> bool:
        """Whether the noise is estimated from the residual: the samples before the impact tell
        neither an error of the simulation nor, if they are few, the noise."""
        return self.noise_unknown or self.limited_by_simulation

    @property
    def contact_unknown(self) -> bool:
        """Whether the simulation does not converge during contact."""
        return is_unfiltered_acceleration(self.record)

    @property
    def interval_s(self) -> float:
        """Median distance of samples, s."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def noise_over_peak(self) -> float:
        """Noise over the largest deviation from the baseline."""
        return self.noise / self.peak

    def after_touch_s(self, touch_s: float, ppm: float) -> np.ndarray:
        """True times after the first touch, s: the record's clock is fast by `ppm`."""
        return (self.time_s - touch_s) / (1.0 + 1e-6 * ppm)

    @property
    def duration_s(self) -> float:
        """From the first touch to the last sample, s."""
        return float(self.time_s[-1]) - self.touch_s

    def whitened(self, rows: np.ndarray) -> np.ndarray:
        """Divide rows of a residual or of its derivatives by the noise, and take its colour out.

        Args:
            rows: shape (samples,) or (samples, columns), zero where samples do not count.

        Returns:
            Rows with white noise of standard deviation one, the same shape.
        """
        scaled = rows / self.noise
        if self.weight is not None:
            scaled = (scaled.T * self.weight).T
        if not len(self.ar):
            return scaled
        found = scipy.signal.lfilter(np.concatenate([[1.0], -self.ar]), [1.0], scaled, axis=0)
        return np.asarray(found / self.innovation)

    def prior_sds(self) -> tuple[float, float]:
        """Standard deviations of the priors of gain and clock (ppm)."""
        m = self.record.measurement
        return max(m.sensitivity_uncertainty, 1e-9), max(m.clock_tolerance_ppm, 1e-6)

    def whitening(self) -> Any:
        """The matrix of `whitened`, (samples, samples)."""
        n = len(self.time_s)
        scale = (self.weight if self.weight is not None else np.ones(n)) / self.noise
        taps = [np.ones(n), *(np.full(n - k, -a) for k, a in enumerate(self.ar, 1))]
        # pyrefly: ignore[no-matching-overload]
        memory: Any = scipy.sparse.diags_array(taps, offsets=[-k for k in range(len(taps))])
        return (memory @ scipy.sparse.diags_array(scale / self.innovation)).tocsr()

    def independent(self, counted: np.ndarray) -> np.ndarray:
        """How many independent samples each of the counted rows is; shape (rows,)."""
        if self.weight is None:
            return np.ones(np.count_nonzero(counted))
        return np.asarray(self.weight[counted] ** 2)

    def counted(self, within: np.ndarray) -> np.ndarray:
        """Which rows count: kept samples `within`, whose predecessors count as well where the
        noise has a memory; shape (samples,)."""
        good = self.kept & within
        for lag in range(1, len(self.ar) + 1):
            good[lag:] &= self.kept[:-lag]
            good[:lag] = False
        return good


def is_unfiltered_acceleration(record: Record) -> bool:
    """Whether a record is an acceleration at the contact point without a filter."""
    if record.quantity != "acceleration" or record.measurement.point_m is not None:
        return False
    limits = [f for f in (record.measurement.low_pass_hz, record.measurement.resonance_hz) if f]
    return not limits or min(limits) > _FASTEST_HZ


def thin_samples(channel: Channel, contact_s: float) -> None:
    """Use every n-th sample of a very long record: more of those in the first contacts."""
    n = len(channel.time_s)
    if n <= _MOST_SAMPLES:
        return
    tau = channel.time_s - channel.touch_s
    dense = np.abs(tau) < _DENSE_CONTACTS * contact_s
    within = math.ceil(np.count_nonzero(dense) / (0.3 * _MOST_SAMPLES)) or 1
    beyond = math.ceil(np.count_nonzero(~dense) / (0.7 * _MOST_SAMPLES)) or 1
    chosen = np.arange(n) % np.where(dense, within, beyond) == 0
    channel.time_s, channel.value = channel.time_s[chosen], channel.value[chosen]
    channel.kept = channel.kept[chosen]
    channel.ar, channel.innovation = np.empty(0), 1.0
    channel.notes.append(
        f"{channel.record.name}: of {n} samples {np.count_nonzero(chosen)} are used, one in "
        f"{within} of the first {_DENSE_CONTACTS:g} contact times and one in {beyond} beyond."
    )


def weight_equal_readings(channel: Channel) -> None:
    """Give the samples of a long run of equal readings together the weight of one sample.

    Where the noise is hidden in the steps of a converter, they share one error: the readings before
    the impact would fix the offset to a level of the converter, up to half a step from the truth.
    """
    if channel.equivalent_samples is None:
        return
    starts = np.flatnonzero(np.diff(channel.value, prepend=math.nan) != 0.0)
    lengths = np.diff(np.append(starts, len(channel.value)))
    each = np.repeat(np.where(lengths > _LONG_RUN, lengths, 1), lengths)
    channel.weight = 1.0 / np.sqrt(each)


def exclude_contact(channel: Channel, contact_s: float) -> None:
    """Leave the contact out of an acceleration without a filter, where the record goes on long
    enough: there it grows with the number of modes."""
    if not channel.contact_unknown or channel.duration_s < 4.0 * contact_s:
        return
    tau = channel.time_s - channel.touch_s
    channel.kept = channel.kept & ~((tau > -1e-6) & (tau < _UNKNOWN_CONTACTS * contact_s))


def cut_late_samples(channel: Channel) -> None:
    """Leave out samples later after the impact than a simulation is worth."""
    late = channel.time_s > channel.onset_s + LASTING_S
    if np.any(late):
        channel.kept = channel.kept & ~late
        keep = ~late
        channel.time_s, channel.value = channel.time_s[keep], channel.value[keep]
        channel.kept = channel.kept[keep]
        channel.notes.append(
            f"{channel.record.name}: {np.count_nonzero(late)} samples later than "
            f"{1e3 * LASTING_S:g} ms after the impact are not used."
        )
