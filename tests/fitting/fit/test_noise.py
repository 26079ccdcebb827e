"""Noise of a record, and what a converter leaves in it: clipped samples, and its levels."""

import numpy as np
import pytest

from hertzloop.fitting.fit.noise import clipped_samples, converter_step, robust_deviation
from hertzloop.fitting.records.measurement import parse_record_table
from hertzloop.fitting.records.record import Record


@pytest.mark.parametrize("sensitivity", [0.5, -0.5])
def test_a_negative_sensitivity_keeps_range_and_step(sensitivity):
    table = {"sensitivity": sensitivity, "range": [-5.0, 2.0], "bits": 8}
    volts = np.concatenate([np.zeros(20), [1.0, 2.0, 2.0, -5.0, -1.0], np.zeros(20)])
    measurement = parse_record_table(table, "drop.csv")
    record = Record(
        "drop.csv",
        1e-6 * np.arange(45),
        volts / sensitivity,
        "contact_force",
        measurement=measurement,
    )
    assert list(np.flatnonzero(clipped_samples(record))) == [21, 22, 23]
    assert converter_step(record) == pytest.approx(7.0 / 256 / 0.5)


def test_outliers_and_gaps_do_not_change_the_deviation():
    noise = 2.0 * np.random.default_rng(1).standard_normal(100_000)
    assert robust_deviation(noise) == pytest.approx(2.0, rel=0.02)
    noise[:1000], noise[1000:2000] = 1e6, np.nan
    assert robust_deviation(noise) == pytest.approx(2.0, rel=0.03)
