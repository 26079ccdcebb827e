"""Sound of a simply supported plate in a baffle: efficiencies, and what air takes from its modes.

Equation numbers are those of the published study. Frequencies are arrays in Hz; efficiencies have
their shape and no unit.
"""

import math
from collections.abc import Callable

import numpy as np

from hertzloop.plant.structures.plate import Plate

AIR_DENSITY_KG_M3 = 1.2
SOUND_SPEED_M_S = 340.0
Efficiency = Callable[[Plate, np.ndarray], np.ndarray]


def critical_frequency_hz(plate: Plate) -> float:
    """c^2/(2 pi) sqrt(m''/B'): bending waves are as fast as sound, Hz."""
    root = math.sqrt(plate.mass_per_area_kg_m2 / plate.bending_stiffness_n_m)
    return SOUND_SPEED_M_S**2 / (2.0 * math.pi) * root


def maidanik_from_hz(plate: Plate) -> float:
    """c/(4 sqrt(S)), the lowest frequency of eq. 3.13, Hz."""
    return SOUND_SPEED_M_S / (4.0 * math.sqrt(plate.size_m[0] * plate.size_m[1]))


def efficiency_fahy(plate: Plate, frequency_hz: np.ndarray) -> np.ndarray:
    """Eq. 3.12 (Fahy), the study's choice: U c/(pi^2 f_c S) sqrt(f/f_c) below f_c, 1 above."""
    (x, y), critical = plate.size_m, critical_frequency_hz(plate)
    f = np.asarray(frequency_hz, dtype=float)
    edge = 2.0 * (x + y) * SOUND_SPEED_M_S / (math.pi**2 * critical * x * y)
    return np.where(f < critical, edge * np.sqrt(f / critical), 1.0)


def efficiency_maidanik(plate: Plate, frequency_hz: np.ndarray) -> np.ndarray:
    """Eq. 3.13 (Maidanik 1962); nan, not defined, below `maidanik_from_hz`.

    Corner and edge modes below f_c, (1 - f_c/f)^(-1/2) above, both limited to the value at f_c,
    sqrt(l_x/lambda_c) + sqrt(l_y/lambda_c). With 4 pi^2 in the edge term, as Maidanik has it; the
    study's text prints 4 pi^4.
    """
    (x, y), critical = plate.size_m, critical_frequency_hz(plate)
    wavelength = SOUND_SPEED_M_S / critical
    limit = math.sqrt(x / wavelength) + math.sqrt(y / wavelength)
    f = np.asarray(frequency_hz, dtype=float)
    below = f < critical
    ratio = np.where(below, f / critical, 0.25)
    a = np.sqrt(np.clip(ratio, 1e-30, 1.0 - 1e-12))
    rest = 1.0 - a * a
    corner = np.where(ratio < 0.5, 4.0 / math.pi**4 * (1.0 - 2.0 * a * a) / (a * np.sqrt(rest)), 0)
    edge = (rest * np.log((1.0 + a) / (1.0 - a)) + 2.0 * a) / (4.0 * math.pi**2 * rest**1.5)
    area, perimeter = x * y, 2.0 * (x + y)
    slow = wavelength**2 / area * 2.0 * corner + perimeter * wavelength / area * edge
    fast = 1.0 / np.sqrt(np.maximum(1.0 - critical / np.where(below, np.inf, f), 1e-12))
    found = np.minimum(np.where(below, slow, fast), limit)
    return np.where(f < maidanik_from_hz(plate), np.nan, found)


def efficiency(plate: Plate, frequency_hz: np.ndarray) -> np.ndarray:
    """Eq. 3.13 where it is defined, eq. 3.12 below."""
    found = efficiency_maidanik(plate, frequency_hz)
    return np.where(np.isnan(found), efficiency_fahy(plate, frequency_hz), found)


def air_loss_factor(
    plate: Plate, frequency_hz: np.ndarray, by: Efficiency = efficiency
) -> np.ndarray:
    """eta_rad = rho0 c sigma/(w m''): what air on one face adds to a mode's loss factor."""
    omega = 2.0 * math.pi * np.asarray(frequency_hz, dtype=float)
    moved = AIR_DENSITY_KG_M3 * SOUND_SPEED_M_S * by(plate, frequency_hz)
    return np.asarray(moved / (omega * plate.mass_per_area_kg_m2))


def radiated_parts(material_eta: float, air_eta: np.ndarray) -> np.ndarray:
    """eta_rad/(eta + eta_rad): what an oscillator radiates of its energy until it is at rest."""
    total = material_eta + air_eta
    return np.divide(air_eta, total, out=np.zeros_like(total), where=total > 0.0)
