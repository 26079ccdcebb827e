"""Find the first sample of a single hit, as exactly as noise and filters allow."""

import numpy as np

from hertzloop.fitting.records.statistics import robust_deviation

NOISE_LEVELS = 5.0  # a force is above the noise from here on
_REST_SAMPLES = 8  # samples that give the force at rest
_RISE, _MOST_RISE = 0.02, 0.5  # share of the peak at which a hit begins, without and with noise
_CERTAIN = 0.3  # share of the peak that a filter, which rings before a hit, does not reach


def noise_after(force_n: np.ndarray) -> float:
    """Return the standard deviation of the noise in the last quarter of a force, (samples,)."""
    last = force_n[-(-len(force_n) // 4) :]
    return robust_deviation(last - np.median(last))


def find_onset(force_n: np.ndarray, noise: float) -> int:
    """Return the first sample of the hit in a force, (samples,), with noise of this size."""
    size = np.abs(force_n - np.median(force_n[:_REST_SAMPLES]))
    peak = np.max(size)
    rise = np.clip(NOISE_LEVELS * noise / peak, _RISE, _MOST_RISE)
    certain = int(np.argmax(size > max(rise, _CERTAIN) * peak))
    at_rest = np.flatnonzero(size[:certain] <= rise * peak)
    return int(at_rest[-1]) + 1 if len(at_rest) else 0
