"""A linear structure from step to step, against closed forms and exact solutions."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.linalg import expm

from hertzloop.plant.lanes import LANES
from hertzloop.plant.plant import PlantSpec, modes_of
from hertzloop.plant.schemes.modal import (
    ModalPlant,
    impedance_n_s_m,
    poles_of,
    residual_corner_rad_s,
    residual_m_n,
    residual_mobility_m_ns,
    residual_pole,
    series_residual_m_n,
)
from hertzloop.plant.structures.linear import IM, RE, Linear, Poles, V, X, linear_of
from tests.plant.rigs import after_steps, spec

BESIDE = {"actuator_point_m": (0.31, 0.22), "contact_point_m": (0.21, 0.13), "limit_hz": 4e3}


class Stepped(NamedTuple):
    """Poles after a step, shape (2, n), and what is seen of the points, shape (points, 3)."""

    z: np.ndarray
    seen: np.ndarray


def stepped(linear: Linear, z: np.ndarray, force: np.ndarray) -> Stepped:
    """One step under forces F_0, F_1, shape (forces, 2), by the formulas of `Linear`."""
    turned = (z[RE] + 1j * z[IM]) * (linear.turn[RE] + 1j * linear.turn[IM])
    free = np.array([turned.real, turned.imag])
    seen = np.einsum("pkcn,cn->pk", linear.see, free) + np.einsum("pkfi,fi->pk", linear.gain, force)
    seen[:, V] += linear.direct @ force.sum(axis=1)
    return Stepped(free + np.einsum("ficn,fi->cn", linear.drive, force), seen)


def kept_j(linear: Linear, z: np.ndarray) -> float:
    """Energy of poles."""
    by = linear.energy
    return float(np.sum(by[0] * z[RE] ** 2 + by[1] * z[RE] * z[IM] + by[2] * z[IM] ** 2))


def oscillator(omega: float, eta: float, push: np.ndarray, h: float, begin: np.ndarray):
    """Displacement, velocity and mean displacement of q'' + eta w q' + w^2 q = p_0 + p_1 P over a
    step from `begin`, by the exponential of a matrix."""
    turn = omega * h
    a = np.zeros((5, 5))  # by parts of a step: q, its rate, its integral, the push, its rate
    a[0, 1] = a[2, 0] = a[1, 3] = a[3, 4] = 1.0
    a[1, :2] = -turn * turn, -eta * turn
    start = [begin[0], h * begin[1], 0.0, h * h * (push[0] - push[1]), 2.0 * h * h * push[1]]
    end = expm(a) @ start
    return end[0], end[1] / h, end[2]


@pytest.mark.parametrize("step_s", [1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("eta", [0.0, 0.1])
def test_every_mode_moves_by_its_equation(eta, step_s):
    """Any force at any point, from any state: displacement, velocity, mean and energy."""
    what = replace(spec(loss_factor=eta, step_s=step_s, **BESIDE), sensor_point_m=(0.12, 0.31))
    modes = modes_of(what)
    structure = poles_of(what, modes)
    linear = linear_of(structure, step_s)
    assert linear.turn.shape[1] % LANES == 0
    assert not linear.direct.any()
    random = np.random.default_rng(3)
    n = len(modes.omega)
    q, v = random.standard_normal(n), random.standard_normal(n) * modes.omega
    delta = 0.5 * eta * modes.omega
    theta = np.sqrt(modes.omega**2 - delta**2)
    mass = 1.0 / modes.scale_per_kg
    scale = np.where(modes.contact < 0.0, -1.0, 1.0) * np.sqrt(0.5 * mass / structure.energy[0])
    moves = modes.contact != 0.0  # the contact by the sum of Im z
    assert scale[moves] == pytest.approx((modes.contact / theta)[moves], rel=1e-14)
    z = np.zeros(linear.turn.shape)
    z[RE, :n], z[IM, :n] = scale * (v + delta * q), scale * theta * q
    energy = 0.5 * mass * np.sum(v**2 + (modes.omega * q) ** 2)
    assert kept_j(linear, z) == pytest.approx(energy, rel=1e-12)
    force = random.standard_normal((2, 2)) * mass / step_s**2
    after = stepped(linear, z, force)
    shapes = np.array([modes.contact, modes.actuator, modes.sensor])
    push = modes.scale_per_kg * np.einsum("fn,fi->in", shapes[:2], force)
    exact = np.array(
        [
            oscillator(modes.omega[i], eta, push[:, i], step_s, np.array([q[i], v[i]]))
            for i in range(n)
        ]
    )
    wanted = shapes @ exact
    assert after.seen == pytest.approx(wanted, rel=1e-9, abs=1e-11 * abs(wanted).max(axis=0).min())
    energy = 0.5 * mass * np.sum(exact[:, 1] ** 2 + (modes.omega * exact[:, 0]) ** 2)
    assert kept_j(linear, after.z) == pytest.approx(energy, rel=1e-10)


def test_an_infinite_plate_keeps_what_an_impulse_moves_it_by():
    what = replace(spec(), infinite_plate=True)
    z = impedance_n_s_m(what.local_plate)
    linear = linear_of(poles_of(what, modes_of(what)), 2e-6)
    one = stepped(linear, np.zeros(linear.turn.shape), np.array([[30.0, 10.0]]))
    # Of F(t) = 20 + 20 t/h: its integral, the last value, and the integral of (h - t) F(t).
    assert one.seen[0] == pytest.approx(
        [30.0 * 2e-6 / z, 40.0 / z, (10.0 + 20.0 / 6.0) * 2e-6 / z], rel=1e-14
    )
    then = stepped(linear, one.z, np.zeros((1, 2)))
    assert then.seen[0] == pytest.approx([30.0 * 2e-6 / z, 0.0, 30.0 * 2e-6 / z], rel=1e-14)
    assert kept_j(linear, one.z) == 0.0


Y, OMEGA_C = 3.4e-3, 2.0 * math.pi * 250e3


def continuum() -> Poles:
    """The modes left out as one damped pole."""
    pole, drive, energy = residual_pole(Y, OMEGA_C)
    at = np.full((1, 1), -1j)
    return Poles(np.array([pole]), np.array([[drive]]), at, energy[:, None])


def mobility(structure: Poles, omega: np.ndarray) -> np.ndarray:
    """Velocity of point 0 by force 0 at frequencies (rad/s), m/(N s)."""
    q = 1j * omega
    residue = structure.see[0] * structure.drive[0]
    found = sum(
        0.5 * q * (r / (q - s) + r.conjugate() / (q - s.conjugate()))
        for r, s in zip(residue, structure.poles, strict=True)
    )
    return np.asarray(found)


def test_the_damped_pole_is_the_continuum_that_was_left_out():
    structure = continuum()
    omega = OMEGA_C * np.array([0.02, 0.05, 0.1])
    found = mobility(structure, omega)
    wanted = Y / math.pi * np.log((OMEGA_C + omega) / (OMEGA_C - omega))
    # Exact in w and w^3: what differs is of order w^5.
    assert np.all(abs(found.imag / wanted - 1.0) < 0.5 * (omega / OMEGA_C) ** 4)
    assert np.all(found.real < 0.2 * Y * (omega / OMEGA_C) ** 4)
    everywhere = mobility(structure, np.geomspace(1e-3, 1e3, 200) * OMEGA_C)
    assert np.all(everywhere.real > 0.0)  # passive
    assert everywhere[-1] == pytest.approx(Y, rel=1e-2)
    assert structure.direct()[0, 0] == pytest.approx(Y, rel=1e-15)


@pytest.mark.parametrize("step_s", [1e-7, 1e-6, 5e-6])
def test_the_damped_pole_answers_a_held_force_by_the_closed_form(step_s):
    a, b = 0.25 * math.pi * OMEGA_C, OMEGA_C * math.sqrt(3.0 - (math.pi / 4.0) ** 2)
    t = np.linspace(0.0, step_s, 20001)
    beside = (6.0 * OMEGA_C / math.pi - a) / b
    response = Y * np.exp(-a * t) * (np.cos(b * t) + beside * np.sin(b * t))
    linear = linear_of(continuum(), step_s)
    assert linear.gain[0, X, 0, 0] == pytest.approx(float(simpson(response, x=t)), rel=1e-6)


def test_the_damped_pole_loses_what_the_spectrum_of_the_force_says():
    """Four steps of 40 N: Parseval's sum of |F|^2 Re Y_t is the work less what the pole keeps."""
    h = 1e-6
    structure = continuum()
    linear = linear_of(structure, h)
    z, x, work, kept = np.zeros(linear.turn.shape), 0.0, 0.0, []
    for force in [40.0] * 4 + [0.0] * 40:
        after = stepped(linear, z, np.array([[force, 0.0]]))
        work += force * (after.seen[0, X] - x)
        z, x = after.z, after.seen[0, X]
        kept.append(kept_j(linear, z))
    assert kept[3] > 0.0
    assert np.all(np.diff(kept[3:]) < 0.0)
    assert kept[-1] < 1e-12 * kept[3]
    omega = np.linspace(0.0, 4e9, 400_001)[1:]
    spectrum = 40.0 * np.abs(np.sin(2.0 * omega * h)) / (0.5 * omega)
    density = spectrum**2 * mobility(structure, omega).real / math.pi
    assert work == pytest.approx(float(np.sum(density) * (omega[1] - omega[0])), rel=2e-3)


def test_the_damped_pole_of_a_plate_is_as_flexible_as_the_modes_left_out():
    what = replace(spec(limit_hz=125e3), residual_flexibility=True, damped_residual=True)
    mobility_m_ns = residual_mobility_m_ns(what)
    assert mobility_m_ns == 1.0 / what.local_plate.infinite_plate_impedance_n_s_m
    pole, drive, _ = residual_pole(
        mobility_m_ns, residual_corner_rad_s(mobility_m_ns, residual_m_n(what))
    )
    assert (-1j * drive / -pole).real == pytest.approx(residual_m_n(what), rel=1e-13)
    structure = poles_of(what, modes_of(what))
    assert structure.poles[-1] == pole
    assert structure.direct()[0, 0] == pytest.approx(mobility_m_ns, rel=1e-12)


def test_modes_left_out_act_as_a_spring():
    """Few modes and the spring come close to many modes, far closer than without."""

    def found(limit_hz: float, *, sprung: bool) -> np.ndarray:
        what = replace(spec(limit_hz=limit_hz), residual_flexibility=sprung)
        return after_steps(ModalPlant(what), np.zeros(30))

    many, bare, sprung = (
        found(480e3, sprung=True),
        found(125e3, sprung=False),
        found(125e3, sprung=True),
    )
    assert abs(sprung - many).max() < 0.1 * abs(bare - many).max()
    what: PlantSpec = replace(spec(limit_hz=125e3), residual_flexibility=True)
    assert series_residual_m_n(what) == pytest.approx(
        what.plate.residual_flexibility_m_n(2 * math.pi * 125e3), rel=0.2
    )
