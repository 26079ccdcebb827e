"""How many modes a scene needs: the estimate against measured errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hertzloop.plant.estimates.model_order import (
    energy_beyond,
    expected_error,
    frequency_limit_hz,
    law_error,
)
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.modal import ModalPlant
from tests.plant.rigs import run, spec

STEP_S = 2.5e-7


def estimate(what: PlantSpec, limit_hz: float, *, spring: bool = False) -> float:
    return expected_error(what.sphere, what.plate, what.contact, limit_hz, spring=spring)


@pytest.mark.parametrize(
    ("changes", "duration_s", "lowest"),
    [
        # A light ball: the plate gives way little, so the secant stiffness is nearly met.
        ({"radius_m": 0.003}, 32e-6, 0.5),
        ({"radius_m": 0.006, "thickness_m": 0.005}, 80e-6, 0.5),
        # A heavy one: it penetrates far less than into a rigid plate.
        ({"radius_m": 0.02, "thickness_m": 0.010, "material": "oak"}, 2e-3, 0.1),
    ],
    ids=["3 mm", "6 mm", "oak"],
)
def test_measured_errors_are_what_was_estimated(changes, duration_s, lowest):
    def gap(limit_hz: float) -> np.ndarray:
        plant = ModalPlant(spec(step_s=STEP_S, limit_hz=limit_hz, **changes))
        return run(plant, round(duration_s / STEP_S)).xi

    # Same step, all modes to half the sampling rate: what differs is the modes left out.
    full = gap(0.5 / STEP_S)
    for limit_hz in (60e3, 125e3, 250e3):
        error = abs(gap(limit_hz) - full)[full < 0.0].max() / -full.min()
        expected = estimate(spec(**changes), limit_hz)
        print(f"{limit_hz / 1e3:g} kHz: error {error:.2e}, estimated {expected:.2e}")
        # The factor 1.1 is of second order in what is left out, hence at the lowest limit only.
        assert lowest * expected < error < 1.1 * expected


@given(st.floats(1e3, 1e7), st.floats(1.001, 100.0))
def test_estimate_falls_with_the_limit(limit_hz, ratio):
    what = spec()
    assert estimate(what, limit_hz) > estimate(what, limit_hz * ratio) > 0.0


@given(st.floats(1e-9, 0.5), st.floats(1e-9, 1e-3), st.booleans())
def test_limit_meets_the_accuracy_or_half_the_sampling_rate(accuracy, step_s, spring):
    what = spec()
    limit = frequency_limit_hz(
        what.sphere, what.plate, what.contact, step_s, accuracy, spring=spring
    )
    nyquist = 0.5 / step_s
    assert 0.0 < limit <= nyquist
    if limit < nyquist:
        assert estimate(what, limit, spring=spring) == pytest.approx(
            accuracy, rel=1e-9
        )  # the lowest that does
    else:
        assert estimate(what, nyquist, spring=spring) >= accuracy * (1.0 - 1e-12)


def test_energy_beyond_is_that_of_a_hertz_like_pulse():
    """Against the spectrum of the pulse, and beyond the table as the fourth power."""
    t = (np.arange(4000) + 0.5) / 4000
    power = np.abs(np.fft.rfft(np.sin(np.pi * t) ** 1.5, 4000 * 64)) ** 2
    beyond = np.cumsum(power[::-1])[::-1] / power.sum()
    for periods in (0.25, 0.5, 1.0, 1.5, 2.0, 4.0, 8.0, 12.0):
        assert energy_beyond(periods) == pytest.approx(beyond[int(64 * periods)], rel=0.02)
    assert energy_beyond(24.0) == pytest.approx(energy_beyond(12.0) / 16.0)
    falls = [energy_beyond(x) for x in np.geomspace(0.05, 100.0, 200)]
    assert falls == sorted(falls, reverse=True)
    assert falls[0] <= 1.0


def test_a_force_that_is_held_errs_less_where_all_modes_are_damped():
    """And by the square of the time for which it is held."""
    what = spec(step_s=STEP_S, limit_hz=1e5)

    def error(hold_s: float, share: float, damped: bool) -> float:
        return law_error(replace(what, damped_residual=damped), math.inf, share, hold_s)

    assert 0.0 < error(1e-6, 0.8, True) < 0.5 * error(1e-6, 0.8, False)
    assert error(2e-6, 0.4, True) == pytest.approx(2.0 * error(1e-6, 0.8, True))
