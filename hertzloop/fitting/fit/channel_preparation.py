"""Make a record ready for a fit: find its impact, its noise, and the samples that count."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.channel import (
    ENOUGH_QUIET,
    Channel,
    is_unfiltered_acceleration,
)
from hertzloop.fitting.fit.noise import (
    autoregressive_noise,
    clipped_samples,
    converter_step,
    noise_below_converter_step,
    robust_deviation,
)
from hertzloop.fitting.records.quantities import GAP_QUANTITIES, QUANTITIES
from hertzloop.fitting.records.record import Record

FEWEST_QUIET = 12  # samples before the impact that give the noise
ONSET_LEVELS = 8.0  # deviation of the first sample of an impact, over the noise
ONSET_SHARE = 0.02  # the same, over the peak
THIRD_DIFFERENCE = 20.0  # variance of the third differences of white noise, over its own
_BASELINE_PARTS = 50  # the first of so many parts of a record gives its baseline
_MOST_BASELINE = 500  # samples
_IMPACT_LEVELS = 6.0  # least peak of an impact, over the noise: two samples in a row
_SPIKE_LEVELS = 36.0  # deviation of single samples from which a shorter impact is likely
_MEDIAN_SAMPLES = 7  # window of the median that takes spikes out of an onset
_REST = 3  # lengths of the contacts in a force, after which it rests
# Of the peak: the error of the simulation and its splines. The acceleration of the contact point
# converges slowly with the number of modes, and without a filter hardly at all.
_FLOOR = {"v_p": 1e-4, "acceleration": 4e-4}
_FLOOR_OF_GAP, _FLOOR_UNFILTERED = 5e-5, 2e-3
_RESOLVED = 0.6  # steps of a converter: noise above it can be read off
_SPIKE = 6.0  # deviations, of single samples before the impact
_AR_FROM = 300  # quiet samples for a model of coloured noise


class RecordedImpact(NamedTuple):
    """An impact in a record.

    Attributes:
        filled: values, the baseline where there is none, (samples,).
        baseline: value at rest.
        spread: deviation from it before the impact.
        peak: largest deviation from it.
        onset: number of the first sample of the impact.
        quiet_start: whether enough samples are before it.
        step: distance of two levels of the converter.
    """

    filled: np.ndarray
    baseline: float
    spread: float
    peak: float
    onset: int
    quiet_start: bool
    step: float


def find_impact(record: Record, good: np.ndarray) -> RecordedImpact:
    """Return the impact in a record.

    Args:
        record: of any quantity.
        good: which samples are known and within the range, (samples,), bool.

    Raises:
        RecordError: there is no impact, or it is shorter than two samples.
    """
    values, known = record.value[good], np.isfinite(record.value)
    if float(np.ptp(values)) == 0.0:
        raise RecordError(
            f"{record.name}: all values are {values[0]:g}. Give a record with an impact."
        )
    step, is_gap = converter_step(record), record.quantity in GAP_QUANTITIES
    start = max(FEWEST_QUIET // 2, min(len(values) // _BASELINE_PARTS, _MOST_BASELINE))
    baseline = float(np.median(values[:start]))
    # A record that begins in the contact has no quiet start; its third differences are quiet.
    spread = robust_deviation(values[:start] - baseline)
    rough = robust_deviation(np.diff(values, 3)) / math.sqrt(THIRD_DIFFERENCE)
    spread = max(min(spread, 3.0 * max(rough, 1e-3 * spread)), 0.3 * step)
    if is_gap:
        baseline = 0.0
    filled = np.where(known, record.value, baseline)
    peak = float(np.max(np.abs(filled - baseline)))
    if not is_gap:
        _check_impact(record, values - baseline, max(spread, rough))
    onset = _find_onset(filled, baseline, spread, peak, is_gap)
    quiet_start = onset >= FEWEST_QUIET and not is_gap
    return RecordedImpact(filled, baseline, spread, peak, onset, quiet_start, step)


def _check_impact(record: Record, values: np.ndarray, spread: float) -> None:
    """Raise RecordError for a record that never leaves its noise for two samples in a row."""
    size = np.abs(values)
    pairs = np.minimum(size[1:], size[:-1])
    if float(np.max(pairs)) < _IMPACT_LEVELS * spread:
        if float(np.max(size)) > _SPIKE_LEVELS * spread:
            raise RecordError(
                f"{record.name}: only single samples leave the noise, up to "
                f"{float(np.max(size)):.3g} {QUANTITIES[record.quantity].unit}, at "
                f"{1e6 * record.interval_s:.3g} us from sample to sample. The impact is shorter. "
                "Record at a higher rate."
            )
        raise RecordError(
            f"{record.name}: no impact was found, as the largest value is "
            f"{float(np.max(size)):.3g} {QUANTITIES[record.quantity].unit} at a noise of "
            f"{spread:.3g}. Give a record with an impact."
        )


def _find_onset(
    value: np.ndarray, baseline: float, spread: float, peak: float, is_gap: bool
) -> int:
    """Return the first sample that has left the baseline; of a gap, the first below zero."""
    if is_gap:
        below = np.flatnonzero(value < 0.0)
        return int(below[0]) if len(below) else int(np.argmin(value))
    size = np.abs(value - baseline)
    steady = scipy.ndimage.median_filter(size, _MEDIAN_SAMPLES, mode="constant")
    if float(np.max(steady)) > 0.3 * peak:
        # Enough samples in the contact: a few spikes in a row are no impact.
        peak = min(peak, 1.5 * float(np.max(steady)))
        size = steady
    out = size > max(ONSET_LEVELS * spread, ONSET_SHARE * peak)
    both = out & np.append(out[1:], True)
    found = np.flatnonzero(both)
    return int(found[0]) if len(found) else int(np.argmax(size))


def prepare_channel(record: Record) -> Channel:
    """Find peak, baseline, onset and noise of a record.

    Raises:
        RecordError: there is no impact in it.
    """
    notes = list(record.notes)
    clipped = clipped_samples(record)
    if np.any(clipped):
        notes.append(
            f"{record.name}: {np.count_nonzero(clipped)} samples are at the end of the range and "
            "are not used."
        )
    good = np.isfinite(record.value) & ~clipped
    impact = find_impact(record, good)
    noise = _estimate_noise(record, impact, good)
    end = noise.end
    error = simulation_error_share(record, notes) * impact.peak
    size = max(noise.size, impact.step / math.sqrt(12.0))
    limited = noise.source != "residual" and size < error
    if noise.source == "residual":
        size = max(0.01 * impact.peak, impact.step)
    else:
        size = math.hypot(size, error)
    if noise.quiet < ENOUGH_QUIET and noise.source != "differences":
        notes.append(
            f"{record.name}: only {noise.quiet} samples before the impact tell its noise, so the "
            "fit estimates it from the whole record. Record at least 150 samples before the "
            "trigger."
        )
    if len(noise.ar):
        notes.append(
            f"{record.name}: its noise has a memory; it is modelled by {len(noise.ar)} "
            "coefficients from the samples before the impact."
        )
    return Channel(
        record=record,
        time_s=record.time_s[:end],
        value=impact.filled[:end],
        kept=good[:end],
        peak=impact.peak,
        noise=size,
        noise_from=noise.source,
        quiet=noise.quiet,
        baseline=impact.baseline,
        step=impact.step,
        ar=noise.ar,
        innovation=noise.innovation,
        onset_s=float(record.time_s[impact.onset]),
        has_quiet_start=impact.quiet_start or record.quantity in GAP_QUANTITIES,
        notes=notes,
        limited_by_simulation=limited,
        equivalent_samples=noise.equivalent_samples,
        least_noise=math.hypot(impact.step / math.sqrt(12.0), error),
    )


@dataclass
class _Noise:
    """Noise of a record, as its quiet samples tell it.

    Attributes:
        size: standard deviation.
        source: what it was found from, as `Channel.noise_from`.
        quiet: number of quiet samples.
        equivalent_samples: as that of a channel.
        ar: coefficients of coloured noise.
        innovation: as that of a channel.
        end: number of samples to use; None for all.
    """

    size: float = 0.0
    source: str = "residual"
    quiet: int = 0
    equivalent_samples: int | None = None
    ar: np.ndarray = field(default_factory=lambda: np.empty(0))
    innovation: float = 1.0
    end: int | None = None


def _estimate_noise(record: Record, impact: RecordedImpact, good: np.ndarray) -> _Noise:
    """Return the noise of a record by its samples before the impact and, of a force, after it."""
    found, onset, step = _Noise(), impact.onset, impact.step
    if not impact.quiet_start:
        if record.quantity in GAP_QUANTITIES:
            third = np.diff(record.value[good], 3)
            found.size = float(np.std(third)) / math.sqrt(THIRD_DIFFERENCE)
            found.source, found.quiet = "differences", len(third) // 4
        return found
    margin = 3 + onset // 20
    before = impact.filled[: onset - margin][good[: onset - margin]]
    before, enough = before - np.median(before), len(before) >= _AR_FROM
    end = _end_of_contacts(record, impact, int(np.count_nonzero(good)))
    after = impact.filled[end:][good[end:]]
    if len(after) >= ENOUGH_QUIET:
        before = np.concatenate([before, after - np.median(after)])
        found.end = end
    sd = robust_deviation(before) or float(np.std(before))
    calm = before[np.abs(before) <= _SPIKE * max(sd, 0.5 * step, 1e-300)]
    if len(calm) < FEWEST_QUIET:
        return found
    found.size, found.source, found.quiet = float(np.std(calm, ddof=1)), "quiet", len(calm)
    if found.size < _RESOLVED * step:
        found.size, found.equivalent_samples = noise_below_converter_step(calm, step)
    spikes = len(before) - len(calm)
    if enough and spikes == 0 and found.size > step:
        found.ar, found.innovation = autoregressive_noise(before)
    return found


def _end_of_contacts(record: Record, impact: RecordedImpact, samples: int) -> int:
    """Return the sample from which a force is as quiet as before the impact, after its last
    contact; of another record, or with enough samples before the impact, the number of samples."""
    deviation = np.abs(impact.filled - impact.baseline)
    high = max(ONSET_LEVELS * impact.spread, ONSET_SHARE * impact.peak)
    pushed = np.flatnonzero(deviation > high)
    if record.quantity != "contact_force" or impact.onset >= ENOUGH_QUIET or not len(pushed):
        return samples
    last = 1 + int(pushed[-1])
    return last + _REST * (last - impact.onset)


def simulation_error_share(record: Record, notes: list[str]) -> float:
    """Return the error of the simulation over the peak; add a note where it has no limit."""
    if is_unfiltered_acceleration(record):
        notes.append(
            f"{record.name}: without a filter the acceleration at the contact point has no "
            "limit during contact, so samples there are not used. Give record.low_pass_hz, "
            "the bandwidth of the accelerometer."
        )
        return _FLOOR_UNFILTERED
    return _FLOOR.get(record.quantity, _FLOOR_OF_GAP)
