"""Filters of a measuring chain: against SciPy's frequency responses."""

import numpy as np
import pytest

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.simulated_impact import MeasuringChain, observe
from hertzloop.fitting.records.measurement import parse_record_table
from hertzloop.loop.simulate import simulate
from tests.fitting.fitting import scene

STEP_S, CORNER_HZ = 1e-7, 50e3


def response(chain: MeasuringChain, frequency_hz: np.ndarray) -> np.ndarray:
    """Of a chain, by the spectrum of its output of a narrow pulse."""
    pulse = np.zeros(16384)
    pulse[8000:8003] = 0.5, 1.0, 0.5  # twice a triangle, which a line between samples makes
    time_s = STEP_S * np.arange(len(pulse))
    waves = np.exp(-2j * np.pi * np.outer(frequency_hz, time_s))
    return np.asarray((waves @ chain.filtered(pulse, STEP_S)) / (waves @ pulse))


def test_a_sigma_delta_converter_passes_all_below_its_corner_without_delay():
    chain = MeasuringChain(low_pass_hz=CORNER_HZ, low_pass="sigma-delta")
    found = response(chain, np.array([1e3, 30e3, 42e3, 58e3, 100e3]))
    np.testing.assert_allclose(found, [1.0, 1.0, 1.0, 0.0, 0.0], atol=5e-3)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"low_pass_order": 9, "low_pass_hz": 1e4}, "less than or equal to 8"),
        ({"resonance_damping": 0.1}, "Give record.resonance_hz"),
        ({"low_pass": "sigma-delta", "low_pass_order": 2, "low_pass_hz": 1e4}, "Leave it out"),
    ],
)
def test_a_wrong_filter_is_refused(table, words):
    with pytest.raises(RecordError, match=words):
        parse_record_table(table, "drop.csv")


def test_the_chain_agrees_with_the_sensor_of_a_run():
    """Both take straight lines, the scene's sensor between steps, the chain on a finer grid."""
    changes = (
        "sensors.quantity=v_p",
        "sensors.low_pass_hz=80e3",
        "sensors.ac_coupling_hz=2e3",
        "sensors.resonance_hz=150e3",
        "sensors.resonance_damping=0.1",
        "run.step_ns=100",
        "sensors.low_pass_order=4",
        "run.duration_s=3e-4",
        "run.lead_in_s=1e-4",
        "run.plate_model=modal",
        "run.accuracy=1e-4",
    )
    setup = scene(*changes)
    values = simulate(setup).values
    # The touch lies in the middle of a step.
    time_s = 100e-9 * (np.arange(len(values)) - 0.5) - 1e-4
    simulator = ImpactSimulator(setup, 2.5e-4, 1e-4)
    chain = MeasuringChain(150e3, 0.1, 2e3, 80e3, low_pass_order=4)
    seen = observe(simulator.run({}, 2.5e-4), "v_p", chain, False).value(time_s)
    inside = time_s < 1.9e-4
    peak = np.max(np.abs(values))
    assert np.max(np.abs(seen - values)[inside]) < 2e-4 * peak
