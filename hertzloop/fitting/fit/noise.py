"""Noise of a record: its size, its colour, and what a converter leaves or hides of it."""

import math

import numpy as np
import scipy

from hertzloop.fitting.records.quantities import GAP_QUANTITIES
from hertzloop.fitting.records.reading import si_factor
from hertzloop.fitting.records.record import Record
from hertzloop.sensors.acquisition import converter_step as adc_step

_NORMAL = 1.4826  # standard deviation of normal noise over the median of its size
_AT_REST = 0.1  # of the largest value, up to which a sensor is at rest
_PLATEAU = 3  # equal extreme values in a row that count as clipped
_LEVELS = 4096  # distinct values; more than these are no visible converter
_AR_MOST = 8  # highest order of such a model
_AR_P = 1e-5  # probability of white noise below which the noise counts as coloured
_LAGS = 10  # of the test of a residual


def robust_deviation(deviations: np.ndarray) -> float:
    """Return the standard deviation of normal noise from deviations around its centre, (samples,).

    Missing values (nan) do not count.
    """
    return _NORMAL * float(np.nanmedian(np.abs(deviations)))


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


def noise_below_converter_step(readings: np.ndarray, step: float) -> tuple[float, int]:
    """Noise of readings away from the baseline, where a converter hides most of it.

    The readings before the impact rest on one level or change between two, whichever the baseline
    is near. The noise before the converter follows from the share of each level; every baseline
    and every noise up to a step is equally probable before.

    Returns:
        Standard deviation with that of the converter, and how many samples would show it as well.
    """
    levels = np.round((readings - readings[0]) / step).astype(int)
    values, counts = np.unique(levels, return_counts=True)
    values = values - values[np.argmax(counts)]
    sigma = np.linspace(0.01, 1.0, 100)[:, np.newaxis, np.newaxis]
    mean = np.linspace(-1.0, 1.0, 161)[:, np.newaxis]
    upper, lower = (scipy.special.ndtr((values + half - mean) / sigma) for half in (0.5, -0.5))
    likely = np.sum(counts * np.log(np.maximum(upper - lower, 1e-300)), axis=-1)
    weight = np.exp(likely - np.max(likely)).sum(axis=1)
    variance = sigma[:, 0, 0] ** 2 + 1.0 / 12.0
    found = float(np.average(variance, weights=weight))
    spread = float(np.average((variance - found) ** 2, weights=weight))
    equivalent_samples = 2.0 * found**2 / max(spread, 1e-12)
    return step * math.sqrt(found), int(min(len(readings), equivalent_samples))


def autoregressive_noise(before: np.ndarray) -> tuple[np.ndarray, float]:
    """Autoregressive coefficients of noise that is not white; none of white noise.

    Returns:
        Coefficients, shape (order,), and the driving noise over the noise.
    """
    if ljung_box(before) >= _AR_P:
        return np.empty(0), 1.0
    n = len(before)
    lags = np.array([np.dot(before[: n - k], before[k:]) / n for k in range(_AR_MOST + 1)])
    best: tuple[float, np.ndarray, float] = (math.inf, np.empty(0), 1.0)
    for order in range(1, _AR_MOST + 1):
        phi = scipy.linalg.solve_toeplitz(lags[:order], lags[1 : order + 1])
        share = max(1.0 - float(phi @ lags[1 : order + 1]) / lags[0], 1e-6)
        score = n * math.log(share) + math.log(n) * order
        if score < best[0]:
            best = (score, phi, math.sqrt(share))
    return best[1], best[2]


def ljung_box(residual: np.ndarray, whitened_by: int = 0) -> float:
    """Return the probability that white noise has correlations as large as a residual's, at ten
    lags.

    Args:
        residual: shape (samples,).
        whitened_by: how many other samples the colour of the noise was found from; their errors
            leave correlations of their own. Zero of noise that needed no whitening.

    Source: Ljung and Box 1978, Biometrika 65, 297.
    """
    n = len(residual)
    if n <= 2 * _LAGS:
        return 1.0
    r = residual - np.mean(residual)
    power = float(r @ r)
    if power == 0.0:
        return 1.0
    rho = np.array([float(r[:-k] @ r[k:]) / power for k in range(1, _LAGS + 1)])
    q = n * (n + 2) * float(np.sum(rho * rho / (n - np.arange(1, _LAGS + 1))))
    if whitened_by:
        q /= 1.0 + n / whitened_by
    return float(scipy.stats.chi2.sf(q, _LAGS))
