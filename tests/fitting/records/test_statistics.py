"""Statistics that a few outliers do not change."""

import numpy as np
import pytest

from hertzloop.fitting.records.statistics import robust_deviation


def test_outliers_and_gaps_do_not_change_the_deviation():
    noise = 2.0 * np.random.default_rng(1).standard_normal(100_000)
    assert robust_deviation(noise) == pytest.approx(2.0, rel=0.02)
    noise[:1000], noise[1000:2000] = 1e6, np.nan
    assert robust_deviation(noise) == pytest.approx(2.0, rel=0.03)
