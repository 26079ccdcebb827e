"""A simply supported beam as a structure of its own.

In a clone, add a row to `STRUCTURES` in plant/structures/registry.py:

    "beam": Kind("own_beam:made"),

and run a scene with this file on PYTHONPATH: `PYTHONPATH=. hertzloop run own_beam.toml`.
"""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Modes, Point
from hertzloop.plant.structures.registry import Description
from hertzloop.plant.structures.structure import BaseStructure


@dataclass(frozen=True)
class Beam(BaseStructure):
    """w_n = (n pi/l)^2 sqrt(E I/(rho A)), shape sin(n pi x/l), modal mass rho A l/2."""

    material: Material
    length_m: float
    width_m: float
    height_m: float
    loss_factor: float

    def __str__(self) -> str:
        return "a simply supported beam"

    @property
    def _bending_n_m2(self) -> float:
        return self.material.youngs_modulus_pa * self.width_m * self.height_m**3 / 12.0

    @property
    def _modal_mass_kg(self) -> float:
        area_m2 = self.width_m * self.height_m
        return self.material.density_kg_m3 * area_m2 * self.length_m / 2.0

    def _omega(self, n: np.ndarray) -> np.ndarray:
        per_length = 2.0 * self._modal_mass_kg / self.length_m
        wave_numbers = n * math.pi / self.length_m
        return wave_numbers**2 * math.sqrt(self._bending_n_m2 / per_length)

    def _numbers(self, omega_max: float) -> np.ndarray:
        count = math.floor(math.sqrt(omega_max / float(self._omega(np.array(1.0)))))
        return np.arange(1.0, count + 1.0)

    def _shapes(self, n: np.ndarray, point_m: Point) -> np.ndarray:
        return np.sin(n * math.pi * point_m[0] / self.length_m)

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency."""
        return float(len(self._numbers(2.0 * math.pi * frequency_hz)))

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s; only the place along the beam counts."""
        n = self._numbers(omega_max)
        at_contact, at_actuator = self._shapes(n, contact_m), self._shapes(n, actuator_m)
        return Modes(
            self._omega(n), self.loss_factor, 1.0 / self._modal_mass_kg, at_contact, at_actuator
        )

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """The static deflection under 1 N, less what the modes up to `omega_max` give to it."""
        x = self.length_m / 2.0 if point_m is None else point_m[0]
        static = (x * (self.length_m - x)) ** 2 / (3.0 * self._bending_n_m2 * self.length_m)
        n = self._numbers(omega_max)
        held = np.sum((self._shapes(n, (x, 0.0)) / self._omega(n)) ** 2) / self._modal_mass_kg
        return max(static - float(held), 0.0)


def made(description: Description) -> Beam:
    """A beam of the sizes that a scene gives in its table `plate`."""
    plate = description.thin_plate  # says what is missing
    length_m, width_m = plate.size_m
    return Beam(plate.material, length_m, width_m, plate.thickness_m, plate.eta)
