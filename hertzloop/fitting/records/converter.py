"""What a converter leaves in a record: clipped samples, and the distance of its levels."""

import numpy as np

from hertzloop.fitting.records.quantities import GAP_QUANTITIES
from hertzloop.fitting.records.reading import si_factor
from hertzloop.fitting.records.record import Record
from hertzloop.sensors.acquisition import converter_step as adc_step

_AT_REST = 0.1  # of the largest value, up to which a sensor is at rest
_PLATEAU = 3  # equal extreme values in a row that count as clipped
_LEVELS = 4096  # distinct values; more than these are no visible converter


def clipped_samples(record: Record) -> np.ndarray:
    """Return which samples are at the end of the range, shape (samples,), bool.

    These are samples outside the range of the table, or three and more equal extremes in a row far
    from the usual value.
    """
    value = record.value
    found = np.zeros(len(value), bool)
    if record.measurement.range is not None:
        factor = si_factor(record.quantity, record.measurement)
        low, high = sorted(factor * end for end in record.measurement.range)
        margin = 1e-6 * (high - low)
        for at_end in (value <= low + margin, value >= high - margin):
            # A sensor that rests at the end of its range is not clipped there.
            if np.mean(at_end) <= 0.5:
                found |= at_end
    usual = float(np.nanmedian(value))
    largest = float(np.nanmax(np.abs(value - usual)))
    if largest == 0.0:
        return found
    # A long contact may take most of the record; then the usual value is not that at rest.
    rest = 0.0 if record.quantity in GAP_QUANTITIES else _AT_REST * float(np.nanmax(np.abs(value)))
    for extreme in (np.nanmin(value), np.nanmax(value)):
        if abs(extreme - usual) < 0.3 * largest or abs(extreme) < rest:
            continue
        same = np.concatenate([[False], value == extreme, [False]])
        for start, end in np.flatnonzero(np.diff(same.astype(int))).reshape(-1, 2):
            if end - start >= _PLATEAU:
                found[start:end] = True
    return found


def converter_step(record: Record) -> float:
    """Distance of two levels of the converter, in SI units; zero if none is visible."""
    if record.measurement.bits and record.measurement.range:
        step = adc_step(record.measurement.bits, record.measurement.range)
        return abs(si_factor(record.quantity, record.measurement)) * step
    known = record.value[np.isfinite(record.value)]
    levels = np.unique(known)
    if not 2 <= len(levels) <= min(_LEVELS, len(known) // 2):
        return 0.0
    steps = np.diff(levels)
    step = float(np.min(steps))
    if step <= 1e-9 * (levels[-1] - levels[0]):
        return 0.0
    turns = steps / step
    return step if bool(np.all(np.abs(turns - np.round(turns)) < 0.05)) else 0.0
