"""Noise metrics: closed forms, published constants, and energies that must agree."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hertzloop.closed_loop.parts import series_under
from hertzloop.plant.metrics import noise
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.schemes.thesis2008 import green_functions
from hertzloop.plant.structures import radiation
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.modes import Oscillators
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.time_series import F_A, F_A1, F_C, F_C1
from tests.plant.rigs import spec

PLATES = {
    "aluminium": (Plate(MATERIALS["aluminium"], (0.5, 0.5), 0.003), 3869.0),
    "oak": (Plate(MATERIALS["oak"], (0.5, 0.5), 0.01), 7504.0),
    "sylomer_m": (Plate(MATERIALS["sylomer_m"], (0.5, 0.5), 0.0125), 80738.0),
}
FREQUENCIES = np.geomspace(20.0, 2e5, 4000)


@pytest.mark.parametrize("name", PLATES)
def test_critical_frequency_is_the_published_one(name):
    plate, published = PLATES[name]
    assert radiation.critical_frequency_hz(plate) == pytest.approx(published, rel=5e-4)


@pytest.mark.parametrize("name", PLATES)
def test_radiation_efficiencies(name):
    plate, critical = PLATES[name]
    below, above = critical < FREQUENCIES, critical * 1.001 > FREQUENCIES
    simple = radiation.efficiency_fahy(plate, FREQUENCIES)
    assert np.all(np.diff(simple[~below]) > 0)
    assert np.all(simple[~above] == 1.0)
    maidanik = radiation.efficiency(plate, FREQUENCIES)
    assert np.all(maidanik > 0)
    limit = 2 * math.sqrt(0.5 * critical / 340)
    assert maidanik.max() <= limit * 1.001
    high = np.array([50 * critical])
    assert radiation.efficiency_maidanik(plate, high)[0] == pytest.approx(1.0, abs=0.02)


@given(st.floats(1e-6, 1e-2), st.floats(1e-6, 1e-2))
def test_holmes_falls_with_the_fifth_power_of_the_contact_time(t0, t1):
    ratio = noise.holmes_j(0.02, 1.0, t1) / noise.holmes_j(0.02, 1.0, t0)
    assert 10 * math.log10(ratio) == pytest.approx(-50 * math.log10(t1 / t0), abs=1e-9)


def test_published_peak_pressure_and_longhorn_rows():
    """Rows B.16: pup from dT alone, EAL from vnext (restitution 0.7)."""
    for dt, pup in ((0.7, -0.92), (1.9, -2.08), (4.6, -3.8), (11.6, -8.77), (31.2, -22.91)):
        ratio = noise.peak_pressure_pa(0.02, 1, (35 + 10 * dt) * 1e-6) / noise.peak_pressure_pa(
            0.02, 1, 35e-6
        )
        assert 20 * math.log10(ratio) == pytest.approx(pup, abs=0.011)
    for vnext, eal in ((0.64, -0.93), (0.33, -1.5), (0.11, -1.7)):
        ratio = noise.longhorn_j(0.02, 1, 0.7 * vnext) / noise.longhorn_j(0.02, 1, 0.7)
        assert 10 * math.log10(ratio) == pytest.approx(eal, abs=0.04)
    assert noise.longhorn_j(0.02, 2.0, 1.0) == pytest.approx(math.pi * 8e-6 / 3 * 1.2 * 5)
    assert noise.rebound_height_m(-1.0) == 0.0
    assert noise.rebound_height_m(0.99045) == pytest.approx(0.05, rel=1e-4)


@pytest.mark.parametrize("beside", [None, (0.28, 0.21)])
def test_spectrum_gives_the_energy_that_an_undamped_plate_took(beside):
    plant = ModalPlant(spec(loss_factor=0.0, actuator_point_m=beside, limit_hz=60e3))
    rows = series_under(plant, 20.0 * np.sin(np.arange(300) / 9.0))
    balance = plant.close_balance()
    drive = noise.modal_drive(plant.modes, 1e-6, -rows[[F_C, F_C1]], rows[[F_A, F_A1]])
    assert np.sum(noise.shares_of_drive_j(plant.modes, drive)) == pytest.approx(
        balance.modal_j, rel=1e-9
    )


@pytest.mark.parametrize(
    ("first", "steps", "frequencies"), [(0, 1, 1), (63, 64, 128), (0, 65, 300), (63, 5000, 128)]
)
def test_a_spectrum_is_the_sum_over_all_steps(first, steps, frequencies):
    draw = np.random.default_rng([first, steps, frequencies])
    force, slope = np.zeros((2, first + steps + 9))
    force[first : first + steps] = draw.normal(size=steps)
    force[first + steps // 2] = 0.0
    slope[first : first + steps] = draw.normal(size=steps)
    hertz = np.sort(draw.uniform(20.0, 4e5, frequencies))
    at_contact, at_actuator = draw.normal(size=(2, frequencies))
    modes = Oscillators(2.0 * np.pi * hertz, at_contact, at_actuator, frequencies, 0.0, 1.0)
    found = noise.modal_drive(modes, 1e-6, np.stack([force, slope]), np.stack([slope, force]))
    a = np.pi * hertz * 1e-6
    turned = np.exp(-2j * np.pi * np.outer(hertz, np.arange(len(force)) * 1e-6))
    held = 1e-6 * np.exp(-1j * a) * np.sin(a) / a
    tilted = -1j * 1e-6 * np.exp(-1j * a) * (np.sin(a) - a * np.cos(a)) / a**2
    forces, slopes = turned @ force, turned @ slope
    expected = at_contact * (held * forces + tilted * slopes)
    expected += at_actuator * (held * slopes + tilted * forces)
    assert np.max(np.abs(found - expected)) < 1e-12 * 1e-6 * steps


def test_mobility_of_many_modes_is_that_of_an_infinite_plate():
    """Mean of Re Y over frequency: 1/(8 sqrt(B' m''))."""
    plate = Plate(MATERIALS["aluminium"], (0.5, 0.37), 0.003, 0.1)
    plant = ModalPlant(
        spec(limit_hz=100e3, size_m=(0.5, 0.37), contact_point_m=(0.21, 0.163), loss_factor=0.1)
    )
    f = np.linspace(5e3, 20e3, 400)
    mean = noise.mobility(plant.modes, f).real.mean()
    assert mean * plate.infinite_plate_impedance_n_s_m == pytest.approx(1.0, rel=0.15)


def test_the_published_spectrum_takes_contact_and_actuator_force_in_their_directions():
    """Both act at one point, so their sum is a contact force alone, and the energies agree."""
    what = spec()
    plant = ModalPlant(what)
    modes = plant.modes
    force = np.hanning(60)
    green = green_functions(what.plate, modes, 1e-6, 80)[1]
    given_ = (what.sphere, what.plate, modes, what.contact_point_m, green)
    both, one = (
        noise.published_noise(
            *given_, noise.PublishedContact(elastic * force, actuator * force, 1e-6, 1.0, 0.5)
        )
        for elastic, actuator in ((10.0, 4.0), (6.0, 0.0))
    )
    assert both.transmitted_spectrum_j == pytest.approx(one.transmitted_spectrum_j, rel=1e-9)
    assert both.transmitted_j == pytest.approx(one.transmitted_j, rel=1e-9)
