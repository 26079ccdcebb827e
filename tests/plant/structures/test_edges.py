"""Plates with clamped, free and simply supported edges against published tables, closed forms and
finite elements."""

import math

import numpy as np
import pytest

from hertzloop.plant.structures.edged_plate import EdgedPlate
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.ritz_modes import ritz_modes
from hertzloop.plant.structures.structure import oscillators

NU = 0.3
METAL = Material(7.2e10, 2700.0, NU)
SQUARE, OBLONG = (1.0, 1.0), (1.0, 0.62)


def edged(edges: str, size_m: tuple[float, float] = SQUARE) -> EdgedPlate:
    return EdgedPlate(Plate(METAL, size_m, 0.003), edges)


def lowest(edges: str, size_m: tuple[float, float] = SQUARE, count: int = 20) -> np.ndarray:
    """k^2 of the lowest modes, 1/m^2."""
    plate = edged(edges, size_m)
    limit = 2.0 * np.pi * 2e3
    omega = plate.modes(limit, (0.3, 0.2), (0.3, 0.2)).omega
    root = math.sqrt(plate.plate.mass_per_area_kg_m2 / plate.plate.bending_stiffness_n_m)
    return np.asarray(omega[:count] * root)


# Leissa 1973 (J. Sound Vib. 31, 257), w a^2 sqrt(rho h/D) of square plates, nu = 0.3: where his
# values are exact (two opposite edges simply supported, to 1e-4) or within 0.1 % of it.
LEISSA = {
    "ssss": (19.7392, 49.3480, 49.3480, 78.9568, 98.6960, 98.6960),
    "sscc": (28.9509, 54.7431, 69.3270, 94.5853, 102.2162, 129.0955),
    "sssc": (23.6463, 51.6743, 58.6464, 86.1345, 100.2698, 113.2281),
    "sscf": (12.6874, 33.0651, 41.7019, 63.0148, 72.3976, 90.6114),
    "sssf": (11.6845, 27.7563, 41.1967, 59.0655, 61.8606, 90.2941),
    "ssff": (9.6314, 16.1348, 36.7256, 38.9450, 46.7381, 70.7401),
    "cccc": (35.992, 73.413, 73.413, 108.27, 131.64, 132.24),
}


@pytest.mark.parametrize("edges", LEISSA)
def test_published_frequencies_of_square_plates(edges):
    exact = edges.startswith("ss")
    np.testing.assert_allclose(lowest(edges, count=6), LEISSA[edges], rtol=1e-4 if exact else 1e-3)


@pytest.mark.full
@pytest.mark.parametrize(
    ("edges", "size_m"),
    [("ffff", SQUARE), *((e, OBLONG) for e in ("cccc", "cfff", "ffff", "ccff", "cfsc", "ccfs"))],
)
def test_twenty_frequencies_by_finite_elements(edges, size_m):
    from tests.plant.structures.argyris import plate_squared

    reference = plate_squared(edges, size_m, NU, 20)
    found = lowest(edges, size_m)
    rigid = 3 if edges == "ffff" else 0
    assert not found[:rigid].any()
    np.testing.assert_allclose(found[rigid:], reference[rigid:], rtol=1e-3)


def test_central_load_on_a_clamped_plate_is_timoshenkos():
    """w = 0.00560 F a^2/D (Timoshenko and Woinowsky-Krieger, table 37), whatever the limit."""
    plate = edged("cccc")
    for limit_hz in (500.0, 5e3, 18e3):
        limit = 2.0 * np.pi * limit_hz
        found = oscillators(plate, (0.5, 0.5), (0.5, 0.5), limit)
        flexibility = found.scale_per_kg * np.sum((found.contact / found.omega) ** 2)
        flexibility += plate.residual_flexibility_m_n(limit, (0.5, 0.5))
        assert flexibility * plate.plate.bending_stiffness_n_m == pytest.approx(0.00560, rel=5e-3)


def test_supported_edges_by_ritz_are_the_closed_form():
    plate, closed = edged("ssss", OBLONG), Plate(METAL, OBLONG, 0.003)
    at, limit = ((0.31, 0.22), (0.44, 0.37)), 2.0 * np.pi * 2e4
    found, exact = plate.modes(limit, *at), closed.modes(limit, *at)
    np.testing.assert_allclose(found.omega, exact.omega, rtol=1e-6)
    np.testing.assert_allclose(abs(found.at_contact), abs(exact.at_contact), atol=1e-2)
    products = found.at_contact * found.at_actuator
    np.testing.assert_allclose(products, exact.at_contact * exact.at_actuator, atol=1e-2)


@pytest.mark.parametrize(
    "edges",
    [*(pytest.param(e, marks=pytest.mark.full) for e in ("cccc", "cfff", "scff", "ffff")), "cfsc"],
)
def test_all_modes_of_a_size_are_right_within_the_stated_error(edges):
    """Against more functions, and by the modal density: none is lost."""
    plate = edged(edges, OBLONG)
    for count in (500, 2000) if edges == "cccc" else (500,):
        k_max = math.sqrt(4.0 * math.pi * count / (OBLONG[0] * OBLONG[1]))
        found, more = (ritz_modes(edges, OBLONG, NU, by * k_max).squared for by in (1.0, 1.3))
        rigid = np.count_nonzero(found == 0.0)
        ratio = np.sqrt(found[rigid:] / more[rigid : len(found)])
        assert abs(ratio - 1.0).max() < plate.quality["largest_frequency_error"] - 3e-4
        assert abs(ratio[:20] - 1.0).max() < 5e-5
        half_waves = k_max * sum(OBLONG) / math.pi
        assert abs(len(found) - count) < half_waves


def test_modes_end_at_what_is_computed():
    plate = edged("cccc")
    limit = 2.0 * np.pi * plate.highest_hz
    assert plate.modes_below(plate.highest_hz) == pytest.approx(2000)
    assert len(plate.modes(limit, (0.3, 0.2), (0.3, 0.2)).omega) == pytest.approx(2000, rel=0.06)
    with pytest.raises(ValueError, match="are known up to 18"):
        plate.modes(1.01 * limit, (0.3, 0.2), (0.3, 0.2))


@pytest.mark.full
def test_participation_of_free_edges_is_not_lost():
    """Sum of phi^2 up to a frequency: that of the modal density."""
    limit, plate = 2.0 * np.pi * 5e4, edged("ffff", (0.5, 0.4))
    modes = plate.modes(limit, (0.21, 0.17), (0.21, 0.17))
    mean = modes.scale_per_kg * np.sum(modes.at_contact**2) * np.pi / 2.0 / limit
    assert mean * plate.plate.infinite_plate_impedance_n_s_m == pytest.approx(1.0, rel=0.02)
