"""Find the impact in a record of any quantity: its baseline, peak and first sample."""

import math
from typing import NamedTuple

import numpy as np
import scipy

from hertzloop.fitting.records.converter import converter_step
from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.quantities import GAP_QUANTITIES, QUANTITIES
from hertzloop.fitting.records.record import Record
from hertzloop.fitting.records.statistics import robust_deviation

FEWEST_QUIET = 12  # samples before the impact that give the noise
ONSET_LEVELS = 8.0  # deviation of the first sample of an impact, over the noise
ONSET_SHARE = 0.02  # the same, over the peak
THIRD_DIFFERENCE = 20.0  # variance of the third differences of white noise, over its own
_BASELINE_PARTS = 50  # the first of so many parts of a record gives its baseline
_MOST_BASELINE = 500  # samples
_IMPACT_LEVELS = 6.0  # least peak of an impact, over the noise: two samples in a row
_SPIKE_LEVELS = 36.0  # deviation of single samples from which a shorter impact is likely
_MEDIAN_SAMPLES = 7  # window of the median that takes spikes out of an onset


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
