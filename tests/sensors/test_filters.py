"""Filters of a channel, as the kernel steps them, against SciPy's responses."""

import math

import numpy as np
import pytest
import scipy

from hertzloop.sensors import kernels as k
from hertzloop.sensors.acquisition import Sensor, SensorSpec

STEP_S, CORNER_HZ = 1e-6, 20e3
KINDS = {"butterworth": scipy.signal.butter, "bessel": scipy.signal.bessel}
ALL = [(kind, order) for kind in KINDS for order in range(1, 9)]


def filtered(spec: SensorSpec, signal: np.ndarray) -> np.ndarray:
    """Output of a channel at every step, shape as `signal`."""
    sensor = Sensor(spec, STEP_S, len(signal), 1)
    out = np.empty(len(signal))
    for i, value in enumerate(signal):
        k.follow(sensor.model, sensor.state, value)
        out[i] = sensor.state[k.FILTERED]
    return out


def low_pass(kind: str, order: int, corner_hz: float = CORNER_HZ) -> SensorSpec:
    return SensorSpec(low_pass_hz=corner_hz, low_pass=kind, low_pass_order=order)


def analogue(kind: str, order: int, corner_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of SciPy's filter that is 3 dB down at its corner."""
    more = {"norm": "mag"} if kind == "bessel" else {}
    return KINDS[kind](order, 2.0 * math.pi * corner_hz, analog=True, **more)


RESONANCE = 2.0 * math.pi * 40e3
ONE_SECTION = [
    *((low_pass(*one), analogue(*one, CORNER_HZ)) for one in ALL if one[1] < 3),
    (SensorSpec(low_pass_hz=2e5), analogue("butterworth", 1, 2e5)),
    (
        SensorSpec(resonance_hz=40e3, resonance_damping=0.05),
        ([RESONANCE**2], [1.0, 0.1 * RESONANCE, RESONANCE**2]),
    ),
    (SensorSpec(ac_coupling_hz=5e3), ([1.0, 0.0], [1.0, 2.0 * math.pi * 5e3])),
]


@pytest.mark.parametrize(("spec", "transfer"), ONE_SECTION)
def test_one_filter_is_exact_for_straight_lines_between_steps(spec, transfer):
    # From rest at zero, which the first value is.
    signal = np.concatenate([[0.0], np.random.default_rng(3).standard_normal(400)])
    b, a, _ = scipy.signal.cont2discrete(transfer, STEP_S, method="foh")
    expected = scipy.signal.lfilter(np.ravel(b), a, signal)
    np.testing.assert_allclose(filtered(spec, signal), expected, atol=1e-11)


@pytest.mark.parametrize(("kind", "order"), ALL)
def test_a_low_pass_has_the_response_of_scipy(kind, order):
    at_hz = np.array([100.0, 0.5 * CORNER_HZ, CORNER_HZ, 1.5 * CORNER_HZ])
    pulse = np.zeros(1500)
    pulse[1] = 1.0
    waves = np.exp(-2j * np.pi * np.outer(at_hz, STEP_S * np.arange(len(pulse))))
    found = (waves @ filtered(low_pass(kind, order), pulse)) / (waves @ pulse)
    _, exact = scipy.signal.freqs(*analogue(kind, order, CORNER_HZ), 2.0 * math.pi * at_hz)
    # Lines between the samples of a sine are too low by (w h)^2/12, in each section.
    bound = (order + 1) // 2 * (2.0 * math.pi * at_hz * STEP_S) ** 2 / 10.0 + 1e-9
    assert np.all(np.abs(found - exact) < bound)
    assert abs(found[2]) == pytest.approx(math.sqrt(0.5), abs=float(bound[2]))


@pytest.mark.parametrize(("kind", "order"), [("butterworth", 8), ("bessel", 8), ("bessel", 3)])
def test_filters_start_at_rest_and_settle_at_their_input(kind, order):
    spec = low_pass(kind, order)
    np.testing.assert_array_equal(filtered(spec, np.full(50, 3.7)), 3.7)
    steps = np.where(np.arange(2000) < 100, 2.0, 5.0)
    found = filtered(spec, steps)
    np.testing.assert_array_equal(found[:100], 2.0)  # causal: nothing before the step
    assert found[-1] == pytest.approx(5.0, rel=1e-13)
    late = float(np.sum(5.0 - found[100:])) / 3.0  # area above a step, in steps: its delay
    assert late == pytest.approx(spec.low_pass_delay_s / STEP_S, rel=1e-9)


def test_the_state_has_room_for_what_the_kernels_keep():
    """Compiled, they would write beyond it without a word."""
    spec = SensorSpec(
        resonance_hz=4e4, ac_coupling_hz=10.0, low_pass_hz=1e4, low_pass="bessel", low_pass_order=7
    )
    sensor = Sensor(spec, STEP_S, 1, 1)
    assert sensor.model.sections.shape == (6, 7)
    assert len(sensor.state) == k.OF_SECTIONS + 3 * 6
    for value in (0.0, 1.0, 3.0):
        k.follow(sensor.model, sensor.state, value)
    assert np.all(sensor.state[-3:] != 0.0)
