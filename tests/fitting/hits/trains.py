"""Records of a force with pulses."""

import numpy as np

from hertzloop.fitting.records.record import Record

RATE_HZ = 51_200.0


def train(*pulses: tuple[float, float], noise: float = 1e-3, lasts_s: float = 1.0) -> Record:
    """Half sines of 1 ms in a record, each with its start (s) and its size."""
    time_s = np.arange(round(lasts_s * RATE_HZ)) / RATE_HZ
    value = noise * np.random.default_rng(2).standard_normal(len(time_s))
    for start_s, size in pulses:
        phase = (time_s - start_s) / 1e-3
        value += np.where((phase > 0) & (phase < 1), size * np.sin(np.pi * phase), 0.0)
    return Record("train.csv", time_s, value, "contact_force")
