"""The discrepancy of a model: its process, and what it does to intervals."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.discrepancy import (
    Discrepancy,
    RecordLikelihood,
    build_discrepancy,
    estimate_discrepancies,
)
from hertzloop.fitting.fit.fit import fit
from hertzloop.fitting.fit.free_keys import parse_free_key
from hertzloop.fitting.fit.report import sentences
from hertzloop.fitting.fit.results import KeyVerdict
from hertzloop.fitting.records.measurement import Measurement, parse_record_table
from hertzloop.scene.setup import load
from tests.fitting.fitting import (
    HEIGHT,
    RADIUS,
    YIELDS,
    assert_holds,
    fitted,
    record,
    scene,
)

SIZE = np.full(160, 2.0)
TIMES_S = np.linspace(-0.5e-5, 7.5e-5, 160)


def discrepancy(shares: tuple[float, float], kappa: float, noise: float = 0.5) -> Discrepancy:
    whitening = scipy.sparse.diags_array(np.full(160, 1.0 / noise)).tocsr()
    return replace(build_discrepancy(TIMES_S, SIZE, whitening, 1e-5), shares=shares, kappa=kappa)


def dense(found: Discrepancy) -> np.ndarray:
    """Covariance of the whitened samples."""
    rest, own = found.split_rows(np.eye(160))
    return np.linalg.inv(rest.T @ rest + own.T @ own)


def test_the_logarithm_is_that_of_the_determinant():
    found = discrepancy((0.3, 0.1), 4.0)
    logarithm = found.logarithm(found.system())
    assert logarithm == pytest.approx(np.linalg.slogdet(dense(found))[1], rel=1e-8)


def test_the_process_is_that_of_matern():
    """Of order 7/2: its variance is one, its correlation a polynomial times an exponential."""
    kappa = 4.0
    found = discrepancy((0.5, 0.5), kappa)
    covariance = (dense(found) - np.eye(160)) * 0.5**2  # of samples, in the unit of the record
    size = float(np.sqrt(covariance[80, 80]))
    assert size == pytest.approx(2.0 * math.sqrt(0.5), rel=0.02)  # an amplitude is sqrt(2) rms
    lag = (TIMES_S[80:130] - TIMES_S[80]) / 1e-5
    r = kappa * lag
    matern = (1.0 + r + 0.4 * r**2 + r**3 / 15.0) * np.exp(-r)
    np.testing.assert_allclose(covariance[80, 80:130] / size**2, matern, atol=0.02)


def test_a_discrepancy_is_found_with_its_size_and_not_where_there_is_noise_alone():
    generator = np.random.default_rng(2)
    nothing = discrepancy((0.0, 0.0), 2.0)
    true = dense(discrepancy((0.2, 0.2), 8.0))
    sizes: list[float] = []
    for exact in (False, True) * 5:
        white = generator.standard_normal(160)
        white = 1.3 * white if exact else np.linalg.cholesky(true) @ white
        columns = np.column_stack([np.ones(160), white])
        rows = RecordLikelihood(columns, 160.0, nothing, False, 0.0 if exact else None)
        _, [(shares, factor)], _ = estimate_discrepancies([rows], np.zeros((1, 2)))
        if exact:
            assert shares == (0.0, 0.0)
            assert factor == pytest.approx(1.3, rel=0.25)
        else:
            sizes += shares
            assert factor == 1.0
    assert 0.1 < np.median(sizes) < 0.4


@pytest.mark.full
def test_intervals_of_a_wrong_class_hold_the_truth():
    """An elastic model of a contact that yields: taken as exact, it misses the height by far."""
    one = record(scene(*YIELDS))
    keys = [parse_free_key(scene(), HEIGHT)]
    free, exact = (fit(scene(), [one], keys, exact=e) for e in (False, True))
    [estimate] = free.estimates
    assert estimate.low < 0.05 < estimate.high
    [wrong] = exact.estimates
    assert wrong.verdict is KeyVerdict.AT_BOUND
    assert wrong.high < 0.04
    assert any(s.startswith("The model is not exact.") for s in sentences(free))
    assert not any(s.startswith("The model is not exact.") for s in sentences(exact))


@pytest.mark.full
def test_a_record_with_less_noise_than_the_simulation_has_error_keeps_its_gain():
    """Fewer modes than those of the fit leave a ringing at the touch, of 0.1 % of the peak."""
    seen = truth(scene(), "v_p", 300e-6, accuracy=1e-3)
    found = fitted(scene(), measured(seen, Spoilt(noise=1e-6), 3), RADIUS)
    assert_holds(found, 0.003)
    [nuisances] = found.nuisances
    assert nuisances.gain == pytest.approx(1.0, abs=2e-3)
    assert nuisances.in_pulse_percent < 0.3
    said = sentences(found)  # the touch with the digits that samples 0.5 us apart resolve
    assert any(f"touch at {nuisances.time_shift_s:.7f} s, gain" in one for one in said)


@pytest.mark.full
def test_an_unknown_sensitivity_is_found_with_the_keys():
    """A record in volts: its gain is the sensitivity, and the time of the contact is left."""
    setup = load("aluminium-3mm", ["controller.law=off"])
    seen = truth(setup, "contact_force", 80e-6)
    table = parse_record_table(
        {"quantity": "contact_force", "unit": "V", "sensitivity_uncertainty": math.inf}, "volts.csv"
    )
    newton = measured(seen, Spoilt(), 3)
    one = replace(newton, value=0.01 * newton.value, measurement=table)
    found = fit(setup, [one], [parse_free_key(setup, RADIUS)])
    [estimate] = found.estimates
    assert estimate.low < 0.003 < estimate.high
    assert found.nuisances[0].gain == pytest.approx(0.01, rel=0.02)
    assert "synthetic: gain" in found.statistics["prior_pulls_sigma"]
    with pytest.raises(RecordError, match="sensitivity_uncertainty = inf"):
        fit(setup, [replace(one, measurement=Measurement())], [parse_free_key(setup, RADIUS)])
