"""Radiation: efficiencies in their limits, energy that air takes, and the balance with air."""

import math

import numpy as np
import pytest

from hertzloop.plant.one_thread import gauss
from hertzloop.plant.structures import radiation
from hertzloop.plant.structures.materials import MATERIALS
from hertzloop.plant.structures.plate import Plate

pytestmark = pytest.mark.full

LARGE = Plate(MATERIALS["aluminium"], (1.5, 1.2), 0.003)
SMALL = Plate(MATERIALS["aluminium"], (0.5, 0.5), 0.003)


def efficiency_wallace(plate: Plate, m: int, n: int, frequency_hz: float, nodes: int = 0) -> float:
    """Efficiency of mode (m, n) at a frequency by its far field (Wallace 1972), in a baffle.

    64 k^2 l_x l_y/(pi^6 m^2 n^2) times the integral over a quarter of the half space of
    [cs(a/2) cs(b/2)/((a^2/(m pi)^2 - 1)(b^2/(n pi)^2 - 1))]^2, a = k l_x sin(theta) cos(phi),
    b = k l_y sin(theta) sin(phi), cs: cos for odd, sin for even numbers; by Gauss's rule.
    """
    wave_number = 2.0 * math.pi * frequency_hz / radiation.SOUND_SPEED_M_S
    nodes = nodes or 100 * math.ceil(0.4 + 0.02 * wave_number * max(plate.size_m))
    at, weights = gauss(nodes)
    angle, weights = math.pi / 4.0 * (at + 1.0), math.pi / 4.0 * weights
    across = wave_number * np.sin(angle)[:, None]

    def along(length_m: float, number: int, part: np.ndarray) -> np.ndarray:
        phase = across * part * length_m
        x = phase / (number * math.pi)
        # cs(phase/2)/(x^2 - 1) without its removable pole at x = 1; sinc for both parities.
        half = 0.5 * (phase - number * math.pi)
        return np.asarray(np.sinc(half / math.pi) * 0.5 * number * math.pi / (x + 1.0))

    (lx, ly) = plate.size_m
    both = (along(lx, m, np.cos(angle)) * along(ly, n, np.sin(angle))) ** 2
    integral = float(np.sum(both * (np.sin(angle) * weights)[:, None] * weights))
    return 64.0 * wave_number**2 * lx * ly / (math.pi**6 * (m * n) ** 2) * integral


def band(plate: Plate, ratio: float) -> tuple[np.ndarray, float]:
    """Frequencies of the modes within 30 % of a share of f_c, their mean efficiency by Wallace."""
    middle = ratio * radiation.critical_frequency_hz(plate)
    m, n, omega = plate.mode_numbers(2.0 * math.pi * 1.3 * middle)
    f = omega / (2.0 * math.pi)
    chosen = f > 0.7 * middle
    found = [
        efficiency_wallace(plate, int(a), int(b), float(at))
        for a, b, at in zip(m[chosen], n[chosen], f[chosen], strict=True)
    ]
    return f[chosen], float(np.mean(found))


@pytest.mark.parametrize("ratio", [0.2, 0.3, 0.4])  # below, few modes make a band
def test_maidanik_is_the_mean_of_the_modes_of_a_large_plate(ratio):
    f, mean = band(LARGE, ratio)
    assert np.mean(radiation.efficiency_maidanik(LARGE, f)) / mean == pytest.approx(1.0, abs=0.1)


def test_maidanik_is_not_defined_below_a_quarter_of_a_wavelength():
    assert radiation.maidanik_from_hz(SMALL) == pytest.approx(170.0)
    f = np.array([169.0, 171.0])
    defined = np.isfinite(radiation.efficiency_maidanik(SMALL, f))
    assert list(defined) == [False, True]
    low = radiation.efficiency(SMALL, f)[0]
    assert low == radiation.efficiency_fahy(SMALL, f)[0]


def test_corner_term_has_no_factor_of_frequency():
    f = np.array([300.0])
    critical = radiation.critical_frequency_hz(SMALL)
    wavelength, a = radiation.SOUND_SPEED_M_S / critical, math.sqrt(300.0 / critical)
    g1 = 4.0 / math.pi**4 * (1.0 - 2.0 * a * a) / (a * math.sqrt(1.0 - a * a))
    g2 = ((1.0 - a * a) * math.log((1.0 + a) / (1.0 - a)) + 2.0 * a) / (
        4.0 * math.pi**2 * (1.0 - a * a) ** 1.5
    )
    expected = (wavelength**2 * 2.0 * g1 + 2.0 * wavelength * g2) / 0.25
    assert radiation.efficiency_maidanik(SMALL, f)[0] == pytest.approx(expected, rel=1e-12)
