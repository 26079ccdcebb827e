"""A plate in three dimensions: its branches against closed forms, its limits, and its effect."""

import math

import numpy as np
import pytest

from hertzloop.plant.contact.hertz import Contact, Sphere, hertz_stiffness
from hertzloop.plant.metrics.impacts import Impact, impacts_in
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes.collocation import CollocationPlant
from hertzloop.plant.structures import solid_plate as lamb
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.solid_plate import SolidPlate
from hertzloop.plant.time_series import series_under

ALUMINIUM, STEEL = MATERIALS["aluminium"], MATERIALS["steel"]
NU = ALUMINIUM.poisson_ratio


def compliance(x: np.ndarray | float, poisson_ratio: float) -> np.ndarray:
    """Deflection of a face per pressure on it, a wave of k h = x, in units of h/mu; a half space's
    is (1 - nu)/x."""
    x = np.asarray(x, dtype=float)
    # Over cosh^2: the functions themselves overflow.
    tanh, second = np.tanh(x), 1.0 / np.cosh(np.minimum(x, 300.0)) ** 2
    return (1.0 - poisson_ratio) / x * (tanh + x * second) / (tanh * tanh - x * x * second)


def test_all_branches_together_are_the_static_layer():
    """Loaded on one face: S(k) in closed form."""
    table = lamb.branches(NU)
    known = table.x >= 0.08  # below, rounding spoils A0
    exact = compliance(table.x, NU)
    assert np.all(abs(table.static / exact - 1.0)[known] < 1e-5)


def test_long_waves_bend_a_thin_plate_and_short_ones_a_half_space():
    for x in (1e-2, 3e-2):
        # 1/(B' k^4) in units of h/mu, and the first correction, of order x^2.
        thin = 6.0 * (1.0 - NU) / x**3 / x
        assert float(compliance(x, NU)) == pytest.approx(thin, rel=1.0 * x * x)
    assert float(compliance(20.0, NU)) == pytest.approx((1.0 - NU) / 20.0, rel=1e-10)
    table = lamb.branches(NU)
    rayleigh = float(table.omegas(np.array([24.0]))[0, 0]) / 24.0
    assert rayleigh == pytest.approx((0.862 + 1.14 * NU) / (1.0 + NU), rel=2e-3)


def test_small_kh_is_kirchhoff():
    """1 - c (kh)^2 with the known c of the frequency, and all mass moving with the face."""
    table = lamb.branches(NU)
    x = np.array([0.01, 0.04, 0.1])
    c = (17.0 - 7.0 * NU) / (120.0 * (1.0 - NU))
    assert np.allclose(table.bending_over_thin(x), 1.0 - c * x * x, atol=0.1 * x**4, rtol=0.0)
    assert np.allclose(table.weights(x)[0], 1.0, atol=0.25 * x * x, rtol=0.0)
    thin, solid = (
        what.modes(2e3, (0.4, 0.3), (0.4, 0.3))
        for what in (_plate(0.001, (2.0, 2.0)), SolidPlate(_plate(0.001, (2.0, 2.0))))
    )
    assert len(thin.omega) == len(solid.omega)
    assert np.allclose(thin.omega, solid.omega, rtol=3e-4)
    # Modes of one frequency come in any order.
    assert np.allclose(
        np.sort(np.abs(thin.at_contact)), np.sort(np.abs(solid.at_contact)), atol=3e-4
    )


def test_no_face_moves_against_its_force():
    table = lamb.branches(NU)
    x = np.linspace(0.0, lamb.LONGEST, 5000)
    assert np.all(table.weights(x) >= 0.0)


@pytest.mark.parametrize("limit_hz", [500e3, 1e6, 2e6])
def test_what_is_left_out_holds_less_than_a_half_space(limit_hz):
    """Below zero, about -k/(pi E'); a contact narrower than pi/(2 k) stays monotone with it."""
    solid = SolidPlate(_plate(0.003))
    omega = 2.0 * math.pi * limit_hz
    found = solid.residual_flexibility_m_n(omega, (0.1, 0.1))
    about = -solid.wave_number_1_m(omega) / (math.pi * ALUMINIUM.plane_strain_modulus_pa)
    assert about < found < 0.5 * about


def _plate(h_m: float, size_m: tuple[float, float] = (0.5, 0.5)) -> Plate:
    return Plate(ALUMINIUM, size_m, h_m)


def _impact(
    radius_m: float, h_m: float, *, solid: bool, limit_hz: float, contact: Contact | None = None
) -> tuple[Impact, float]:
    """First impact without control, and the residual of the energy."""
    stiffness = hertz_stiffness(radius_m, STEEL, ALUMINIUM)
    plate = _plate(h_m)
    what = PlantSpec(
        Sphere(STEEL, radius_m, 0.05),
        SolidPlate(plate) if solid else plate,
        contact or Contact(stiffness),
        (0.25, 0.25),
        (0.25, 0.25),
        5e-7,
        limit_hz,
        2e-6,
        residual_flexibility=True,
    )
    plant = CollocationPlant(what)
    rows = series_under(plant, np.zeros(160))
    found = impacts_in(what, rows)[0]
    return found, plant.close_balance().energy_residual


# Radius, thickness (m); 3-D against Kirchhoff: rebound over impact speed, plate energy, peak
# force, contact time, by an independent solver.
@pytest.mark.parametrize(
    ("radius_m", "h_m", "effect"),
    [
        (0.003, 0.0015, (-0.2e-2, 0.04e-2, -1.0e-2, 1.8e-2)),
        (0.003, 0.003, (-1.5e-2, 2.4e-2, -0.2e-2, -0.2e-2)),
        (0.005, 0.010, (-1.1e-2, 7.4e-2, 0.2e-2, -0.5e-2)),
    ],
)
def test_effect_of_thickness(radius_m, h_m, effect):
    solid, residual = _impact(radius_m, h_m, solid=True, limit_hz=5e5)
    thin, _ = _impact(radius_m, h_m, solid=False, limit_hz=5e5)
    found = (
        (solid.rebound_speed_m_s - thin.rebound_speed_m_s) / thin.impact_speed_m_s,
        solid.plate_energy_j / thin.plate_energy_j - 1.0,
        solid.peak_force_n / thin.peak_force_n - 1.0,
        solid.duration_s / thin.duration_s - 1.0,
    )
    print(found)
    assert abs(residual) < 1e-10
    for have, want, digits in zip(found, effect, (1e-3, 1e-3, 1e-3, 1e-3), strict=True):
        assert have == pytest.approx(want, abs=digits)


def test_limit_of_modes_settles():
    best, _ = _impact(0.003, 0.003, solid=True, limit_hz=1e6)
    coarse, _ = _impact(0.003, 0.003, solid=True, limit_hz=250e3)
    assert coarse.plate_energy_j == pytest.approx(best.plate_energy_j, rel=2e-4)
    assert coarse.rebound_speed_m_s == pytest.approx(best.rebound_speed_m_s, abs=2e-4)
