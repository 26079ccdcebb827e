"""The plate by the textbook's formulas, all modes written out: nothing of plant/."""

import math

import numpy as np

from hertzloop.plant.structures.plate import Plate


def all_modes(plate: Plate, limit_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """m, n, omega of every mode up to a limit, by the textbook's formula, on a plain grid."""
    nu, e = plate.material.poisson_ratio, plate.material.youngs_modulus_pa
    bending = e * plate.thickness_m**3 / (12.0 * (1.0 - nu * nu))
    area_mass = plate.material.density_kg_m3 * plate.thickness_m
    m, n = np.meshgrid(np.arange(1, 1200), np.arange(1, 1200), indexing="ij")
    (lx, ly) = plate.size_m
    omega = math.sqrt(bending / area_mass) * np.pi**2 * ((m / lx) ** 2 + (n / ly) ** 2)
    keep = omega <= 2.0 * np.pi * limit_hz
    return m[keep], n[keep], omega[keep]


def shape(plate: Plate, m: np.ndarray, n: np.ndarray, at: tuple[float, float]) -> np.ndarray:
    (lx, ly), (x, y) = plate.size_m, at
    return np.sin(m * np.pi * x / lx) * np.sin(n * np.pi * y / ly)


def modal_scale(plate: Plate) -> float:
    (lx, ly) = plate.size_m
    return 4.0 / (plate.material.density_kg_m3 * plate.thickness_m * lx * ly)
