"""The simulation inside a fit: frozen modes, shared plants, and its accuracy."""

import numpy as np
import pytest

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.fitting.fit.impact_simulator import ImpactSimulator
from hertzloop.fitting.fit.problem_preparation import prepare_problem
from hertzloop.fitting.fit.results import ModelVerdict
from tests.fitting.fitting import THICKNESS, fitted, scene


def test_stiffness_factor_is_a_factor_on_the_contact():
    plain, twice = scene(), scene("contact.stiffness_factor=2.0")
    assert twice.mechanics.contact.stiffness == 2.0 * plain.mechanics.contact.stiffness


def test_a_thick_plate_under_a_short_contact_gets_modes_enough_for_the_noise():
    """With the modes that the gap needs, the record is wrong by half the noise and more."""
    start = scene("sphere.material=glass", "plate.thickness_m=19.4e-3", "plate.theory=kirchhoff")
    seen = truth(start, "v_p", 1.2e-4, accuracy=1e-7)
    one = measured(seen, Spoilt(noise=1e-3), 4)
    problem = prepare_problem(start, [one], [])
    [simulator], [channel] = problem.simulators, problem.channels
    fine = truth(start, "v_p", 1.2e-4, accuracy=1e-8)
    tau = np.arange(0.0, 1.3 * simulator.contact_s, 1e-7)
    error = problem.simulate_channel(0, {}, 1.2e-4).value(tau) - fine.value(tau)
    assert channel.simulation_error == 0.0
    assert float(np.sqrt(np.mean(error**2))) < 0.2 * channel.noise
    assert fitted(start, one, THICKNESS).model is ModelVerdict.FITS


@pytest.mark.full
def test_a_plate_of_which_the_highest_known_modes_are_needed_is_simulated():
    start = scene("plate.edges=cccc", "plate.thickness_m=1e-3", "plate.size_m=[0.4, 0.3]")
    simulator = ImpactSimulator(start, 1e-4, accuracy=1e-5)
    assert simulator.spec.frequency_limit_hz == start.mechanics.structure.highest_hz
    assert simulator.run({}, 1e-4).time_s[-1] >= 1e-4


@pytest.mark.full
def test_a_simulation_that_cannot_be_fine_enough_says_so():
    changes = "sphere.radius_m=1e-3", "plate.thickness_m=2e-3", "plate.loss_factor=1e-3"
    start = scene(*changes)
    record = measured(truth(start, "v_p", 5e-3), Spoilt(noise=1e-3), 0, rate_hz=1e7)
    found = fitted(start, record, THICKNESS)
    assert found.model is ModelVerdict.CANNOT_TELL
    assert "The error of the simulation can explain that" in " ".join(found.reasons)
