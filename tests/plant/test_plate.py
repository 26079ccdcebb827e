"""The plate alone: modes and their merging, free decay, mobility of an infinite plate."""

import math

import numpy as np
import pytest

from hertzloop.plant.plant import Plant
from hertzloop.plant.schemes.modal import ModalPlant
from hertzloop.plant.state_kernels import FLIGHT_X, XI, XI_S
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.structure import oscillators
from tests.plant.brute import all_modes, modal_scale, shape
from tests.plant.rigs import run, spec

ALUMINIUM = Plate(MATERIALS["aluminium"], (0.5, 0.5), 0.003)
BESIDE = Plate(MATERIALS["oak"], (0.47, 0.31), 0.01)
CENTRE = (0.25, 0.25)


def impulse_response(
    plate: Plate, omega: np.ndarray, product: np.ndarray, t: np.ndarray
) -> np.ndarray:
    """g(t) = lambda sum phi_e phi_r sin(Theta t)/Theta exp(-delta t)."""
    eta = plate.material.loss_factor
    theta = omega * math.sqrt(1.0 - eta * eta / 4.0)
    waves = np.sin(np.outer(t, theta)) * np.exp(-0.5 * eta * np.outer(t, omega))
    return modal_scale(plate) * waves @ (product / theta)


def test_modes_of_the_default_plate():
    omega_max = 2.0 * np.pi * 500e3
    found = oscillators(ALUMINIUM, CENTRE, CENTRE, omega_max)
    m, n, omega = all_modes(ALUMINIUM, 500e3)
    assert found.modes == len(m)
    assert np.count_nonzero(m % 2 * n % 2) == 3288  # even modes have a node line at the centre
    assert len(found.omega) == 1104
    # Integers: m^2 + n^2 with both odd are the frequencies that move the centre.
    odd = np.arange(1, 200, 2)
    sums = np.unique(odd[:, None] ** 2 + odd**2)
    assert len(found.omega) == np.count_nonzero(sums <= 2.0 * omega_max / omega.min())
    assert np.all(np.diff(found.omega) > 0.0)


def test_mode_numbers_are_complete_for_a_long_plate():
    plate = Plate(MATERIALS["aluminium"], (2.0, 0.03), 0.001)
    m, n, omega = plate.mode_numbers(2.0 * np.pi * 60e3)
    wanted_m, wanted_n, wanted_omega = all_modes(plate, 60e3)
    assert set(zip(m.tolist(), n.tolist(), strict=True)) == set(
        zip(wanted_m.tolist(), wanted_n.tolist(), strict=True)
    )
    np.testing.assert_allclose(omega, np.sort(wanted_omega), rtol=1e-14)


@pytest.mark.parametrize(
    ("plate", "contact", "actuator"),
    [
        (ALUMINIUM, CENTRE, CENTRE),
        (ALUMINIUM, CENTRE, (0.3, 0.2)),  # on a square plate m, n and n, m share a frequency
        (ALUMINIUM, (0.1, 0.17), (0.17, 0.1)),
        (BESIDE, (0.11, 0.2), (0.13, 0.2)),
    ],
)
def test_merging_keeps_every_impulse_response(plate, contact, actuator):
    limit_hz = 100e3
    found = oscillators(plate, contact, actuator, 2.0 * np.pi * limit_hz)
    m, n, omega = all_modes(plate, limit_hz)
    at_c, at_a = shape(plate, m, n, contact), shape(plate, m, n, actuator)
    t = np.random.default_rng(3).uniform(0.0, 2e-3, 50)
    for merged, plain in (
        (found.contact**2, at_c * at_c),
        (found.contact * found.actuator, at_c * at_a),
        (found.actuator**2, at_a * at_a),
    ):
        expected = impulse_response(plate, omega, plain, t)
        got = impulse_response(plate, found.omega, merged, t)
        # Frequencies equal to 1e-12 count as one: phases of 2e-3 s * 6e5 rad/s * 1e-12.
        bound = modal_scale(plate) * np.sum(np.abs(plain) / omega)
        np.testing.assert_allclose(got, expected, atol=2e-9 * bound, rtol=0.0)


def test_no_mode_below_the_limit_is_an_error_that_says_so():
    with pytest.raises(ValueError, match=r"no mode below 10 Hz moves the contact point"):
        oscillators(ALUMINIUM, CENTRE, CENTRE, 2.0 * np.pi * 10.0)
    # No mode moves the edge.
    with pytest.raises(ValueError, match="moves the contact point"):
        oscillators(ALUMINIUM, (0.0, 0.2), (0.0, 0.2), 2.0 * np.pi * 1e4)


@pytest.mark.parametrize(("low_hz", "high_hz"), [(50e3, 800e3), (125e3, 2e6)])
def test_residual_flexibility_is_the_sum_over_the_modes_left_out(low_hz, high_hz):
    m, n, omega = all_modes(ALUMINIUM, high_hz)
    assert max(m.max(), n.max()) < 1199  # the grid reaches far enough
    out = omega > 2.0 * np.pi * low_hz
    exact = modal_scale(ALUMINIUM) * np.sum(
        shape(ALUMINIUM, m[out], n[out], CENTRE) ** 2 / omega[out] ** 2
    )
    estimate = ALUMINIUM.residual_flexibility_m_n(2.0 * np.pi * low_hz)
    estimate -= ALUMINIUM.residual_flexibility_m_n(2.0 * np.pi * high_hz)
    # Modal density is smooth to one ring of modes: pi/(2 k L) = 5 % at 50 kHz in wave number.
    assert estimate == pytest.approx(exact, rel=0.05)


def flying(plant: Plant) -> Plant:
    """The sphere far above, so that the plate is alone."""
    plant.state.body[[FLIGHT_X, XI, XI_S]] = 1e3
    return plant


@pytest.mark.parametrize("apart", [False, True])
def test_all_modes_ring_down_in_closed_form(apart):
    # A force held for the first step: closed form from the step responses of all modes (m, n).
    h, steps, limit = 2e-6, 400, 40e3
    plate = BESIDE
    contact = (0.11, 0.2)
    actuator = (0.16, 0.05) if apart else contact
    plant = flying(
        ModalPlant(
            spec(
                material="oak",
                size_m=plate.size_m,
                thickness_m=plate.thickness_m,
                contact_point_m=contact,
                actuator_point_m=actuator,
                step_s=h,
                limit_hz=limit,
            )
        )
    )
    force = np.zeros(steps)
    force[0] = 3.0
    rows = run(plant, steps, force)
    m, n, omega = all_modes(plate, limit)
    rate = omega * (-0.5 * plate.eta + 1j * math.sqrt(1.0 - plate.eta**2 / 4.0))
    product = shape(plate, m, n, contact) * shape(plate, m, n, actuator)
    t = h * np.arange(1, steps)[:, None]
    scale = 3.0 * modal_scale(plate) * product / rate.imag
    # Integral of Im exp(s (t - u)) over 0 < u < h, and its derivative.
    x = np.sum(scale * ((np.exp(rate * t) - np.exp(rate * (t - h))) / rate).imag, axis=1)
    v = np.sum(scale * (np.exp(rate * t) - np.exp(rate * (t - h))).imag, axis=1)
    # Rounding of a few hundred additions and of 400 rotations.
    np.testing.assert_allclose(rows.xi_p[1:], x, atol=1e-12 * abs(x).max(), rtol=0.0)
    np.testing.assert_allclose(rows.v_p[1:], v, atol=1e-12 * abs(v).max(), rtol=0.0)
