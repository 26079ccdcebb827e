"""The modes left out as one damped mode: its closed forms, and what it is worth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson

from hertzloop.plant.contact import elastic_kernels as solve
from hertzloop.plant.contact.hertz import (
    Contact,
    Damping,
    hertz_stiffness,
    hunt_crossley_parameter,
)
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes import collocation
from hertzloop.plant.schemes.collocation import CollocationPlant, damped_residual, residual_m_n
from hertzloop.plant.state_kernels import RESIDUAL_IM
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.time_series import series_under
from tests.plant.rigs import spec

Y, OMEGA_C = 3.4e-3, 2.0 * math.pi * 250e3
STIFFNESS = hertz_stiffness(0.003, MATERIALS["steel"], MATERIALS["aluminium"])
DAMPED = Contact(
    STIFFNESS, Damping.HUNT_CROSSLEY, hunt_crossley_s_m=hunt_crossley_parameter(0.5, 1.0)
)


def tailed(**changes) -> PlantSpec:
    made = spec(limit_hz=125e3, **changes)
    return replace(made, residual_flexibility=True, damped_residual=True)


def mode_mobility(mobility_m_ns: float, omega_c: float, omega: np.ndarray) -> np.ndarray:
    """Y_t at angular frequencies (rad/s); m/(N s), same shape."""
    q = 1j * np.asarray(omega)
    below = q * q + 0.5 * math.pi * omega_c * q + 3.0 * omega_c**2
    return np.asarray(mobility_m_ns * q * (q + 6.0 * omega_c / math.pi) / below)


def test_mobility_below_the_limit_is_the_continuum_that_was_left_out():
    omega = OMEGA_C * np.array([0.02, 0.05, 0.1])
    found = mode_mobility(Y, OMEGA_C, omega)
    wanted = Y / math.pi * np.log((OMEGA_C + omega) / (OMEGA_C - omega))
    # Exact in w and w^3: what differs is of order w^5.
    assert np.all(abs(found.imag / wanted - 1.0) < 0.5 * (omega / OMEGA_C) ** 4)
    assert np.all(found.real < 0.2 * Y * (omega / OMEGA_C) ** 4)
    everywhere = mode_mobility(Y, OMEGA_C, np.geomspace(1e-3, 1e3, 200) * OMEGA_C)
    assert np.all(everywhere.real > 0.0)  # passive
    assert everywhere[-1] == pytest.approx(Y, rel=1e-2)


@pytest.mark.parametrize("step_s", [1e-7, 1e-6, 5e-6])
def test_steps_answer_an_impulse_by_the_closed_form(step_s):
    made, gains = collocation.build_residual_mode(Y, OMEGA_C, step_s, True)
    a, b = 0.25 * math.pi * OMEGA_C, OMEGA_C * math.sqrt(3.0 - (math.pi / 4.0) ** 2)
    # Displacement by a force of 1 N held over a step, at its end: the integral of the response
    # exp(-a t) (Y cos b t + B sin b t).
    t = np.linspace(0.0, step_s, 20001)
    big_b = Y * (6.0 * OMEGA_C / math.pi - a) / b
    response = np.exp(-a * t) * (Y * np.cos(b * t) + big_b * np.sin(b * t))
    assert made.by_0_im == pytest.approx(float(simpson(response, x=t)), rel=1e-6)
    assert gains[solve.PX0] == made.by_0_im


def test_what_it_loses_is_what_the_spectrum_of_the_force_says():
    """On a real plate, the sphere still falling: Parseval's sum of |F|^2 Re Y_t."""
    what = tailed(lead_in_s=2e-3)
    plant = CollocationPlant(what)
    force = np.zeros(400)
    force[5:9] = 40.0
    series_under(plant, force)
    balance = plant.close_balance()
    mobility = damped_residual(what)[0]
    omega_c = collocation.residual_limit(mobility.mobility_m_ns, residual_m_n(what))
    omega = np.linspace(0.0, 4e9, 400_001)[1:]
    length = 4e-6
    spectrum = 40.0 * np.abs(np.sin(0.5 * omega * length)) / (0.5 * omega)
    density = spectrum**2 * mode_mobility(mobility.mobility_m_ns, omega_c, omega).real / math.pi
    lost = float(np.sum(density) * (omega[1] - omega[0]))
    assert balance.truncated_dissipated_j == pytest.approx(lost, rel=2e-3)
    assert abs(balance.energy_residual) < 1e-10


def test_a_wrong_mode_opens_the_balance():
    plant = CollocationPlant(tailed())
    series_under(plant, np.repeat([0.0, 20.0], [11, 5]))
    plant.state.body[RESIDUAL_IM] *= 1.001
    series_under(plant, np.full(184, 20.0))
    assert abs(plant.close_balance().energy_residual) > 1e-8


def test_gap_converges_with_the_step():
    """Order 4 with a damper, whose force takes its part of the velocity at once."""
    gaps = []
    for step_s in (2e-6, 1e-6, 5e-7, 1.25e-7):
        what = tailed(contact=DAMPED, step_s=step_s, lead_in_s=0.0)
        plant = CollocationPlant(what)
        every = round(2e-6 / step_s)
        gaps.append(series_under(plant, np.zeros(19 * every + 1))[0, ::every][:19])
    errors = [float(np.abs(g - gaps[-1]).max() / -gaps[-1].min()) for g in gaps[:-1]]
    print(errors)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders.max() > 3.0
    assert errors[1] < 3e-5
