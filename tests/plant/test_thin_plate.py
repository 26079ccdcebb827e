"""What Kirchhoff's theory leaves out, against numbers known from an elastic solid."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.zener import solved, zener_impact
from hertzloop.plant.contact.hertz import Contact, Sphere, hertz_stiffness
from hertzloop.plant.estimates import criteria
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate

STEEL, ALUMINIUM = MATERIALS["steel"], MATERIALS["aluminium"]


def _impact(radius_m: float, h_m: float, drop_m: float) -> tuple[Sphere, Plate, Contact]:
    contact = Contact(hertz_stiffness(radius_m, STEEL, ALUMINIUM))
    return Sphere(STEEL, radius_m, drop_m), Plate(ALUMINIUM, (0.5, 0.5), h_m), contact


def _expected_error(sphere: Sphere, plate: Plate, contact: Contact) -> criteria.ThinPlateError:
    impact = zener_impact(sphere, plate, contact)
    return criteria.thin_plate_error(
        plate, contact.stiffness, impact.contact_s, impact.peak_force_n
    )


# Radius, thickness, drop (m); k h at 1/T and lambda of impacts solved in three dimensions.
SOLVED = [
    (0.003, 0.0015, 0.05, 0.36, 1.37),
    (0.003, 0.003, 0.05, 0.64, 0.34),
    (0.005, 0.010, 0.05, 0.93, 0.09),
]


@pytest.mark.parametrize(("radius", "h", "drop", "number", "inelasticity"), SOLVED)
def test_the_two_numbers(radius, h, drop, number, inelasticity):
    sphere, plate, contact = _impact(radius, h, drop)
    found = zener_impact(sphere, plate, contact)
    assert found.inelasticity == pytest.approx(inelasticity, abs=0.006)
    assert criteria.thickness_number(plate, found.contact_s) == pytest.approx(number, abs=0.006)


def test_a_heavy_ball_stays_until_reflections_throw_it_off():
    sphere, plate, contact = _impact(0.02, 0.003, 0.05)
    found = zener_impact(sphere, plate, contact)
    assert found.inelasticity == pytest.approx(15.0, abs=0.5)
    assert found.contact_s > 5e-3
    assert found.peak_force_n == pytest.approx(296.0, abs=1.0)  # as on the finite plate


@pytest.mark.parametrize(
    ("number", "integral"), [(0.2, 1.00), (0.36, 0.45), (0.64, 0.01), (0.93, -0.19)]
)
def test_static_difference(number, integral):
    plate = Plate(ALUMINIUM, (1.0, 1.0), 0.003)
    unit = math.pi * ALUMINIUM.plane_strain_modulus_pa * 0.003
    assert criteria.static_difference_m_n(plate, number) * unit == pytest.approx(
        integral, abs=0.006
    )


def test_errors_of_solved_impacts():
    """Peak forces and energies that were off by 1 and 2.4 per cent."""
    thin = _expected_error(*_impact(0.003, 0.0015, 0.05))
    assert 0.010 <= thin.peak_force <= 0.02
    thick = _expected_error(*_impact(0.003, 0.003, 0.05))
    assert 0.024 <= thick.plate_energy <= 0.04
    assert 0.015 <= thick.rebound_speed <= 0.02


@pytest.mark.parametrize("number", [0.0, 0.1, 1.0, 15.0])
def test_zeners_impact_as_another_program_integrates_it(number):
    def rates(_: float, state: np.ndarray) -> list[float]:
        depth = max(state[0], 0.0)
        return [state[1] - number * depth**1.5, -(depth**1.5)]

    def apart(t: float, state: np.ndarray) -> float:
        return float(state[0]) if t > 0.0 else 1.0

    def deepest(t: float, state: np.ndarray) -> float:
        return float(rates(t, state)[0])

    apart.terminal = True
    exact = solve_ivp(
        rates, (0.0, 1e4), [0.0, 1.0], "LSODA", events=(apart, deepest), rtol=1e-12, atol=1e-15
    )
    length, peak = solved(number)[:2]
    assert length == pytest.approx(exact.t[-1], rel=1e-6)
    assert peak == pytest.approx(exact.y_events[1][:, 0].max() ** 1.5, rel=1e-6)
