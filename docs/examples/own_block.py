"""A rigid block on a spring as a structure of its own: one mode.

The file adds its own row to `STRUCTURES`, so that a program needs nothing but to import it. As a
program it simulates the scene beside it: `python own_block.py`.

`hertzloop run` uses several processes, all of which have to know the row. In a clone, add it to
plant/structures/registry.py and run `PYTHONPATH=. hertzloop run own_block.toml`.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hertzloop.common.protocols import Point, Structure
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Modes
from hertzloop.plant.structures.registry import STRUCTURES, Description, Kind

# A scene has no keys for these.
MASS_KG, STIFFNESS_N_M, DAMPING_RATIO = 0.05, 2e4, 0.05


@dataclass(frozen=True)
class Block(Structure):
    """m q'' + 2 zeta sqrt(k m) q' + k q = F: w = sqrt(k/m), loss factor 2 zeta, shape 1."""

    material: Material
    mass_kg: float
    stiffness_n_m: float
    damping_ratio: float

    def __str__(self) -> str:
        return "a rigid block on a spring"

    def _omega(self, omega_max: float) -> np.ndarray:
        omega = np.array([math.sqrt(self.stiffness_n_m / self.mass_kg)])
        return omega[omega <= omega_max]

    def modes_below(self, frequency_hz: float) -> float:
        """One mode, from its frequency on."""
        return float(len(self._omega(2.0 * math.pi * frequency_hz)))

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """The mode, if it is below `omega_max` rad/s. All points of the block move alike."""
        omega = self._omega(omega_max)
        shape = np.ones_like(omega)
        return Modes(omega, 2.0 * self.damping_ratio, 1.0 / self.mass_kg, shape, shape)

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Zero with the mode, because the block is rigid; without it, that of the spring."""
        return 0.0 if len(self._omega(omega_max)) else 1.0 / self.stiffness_n_m


def made(description: Description) -> Block:
    """A block whose surface is of the scene's `plate.material`."""
    return Block(description.material, MASS_KG, STIFFNESS_N_M, DAMPING_RATIO)


STRUCTURES["block"] = Kind("own_block:made")

if __name__ == "__main__":
    import hertzloop

    run = hertzloop.simulate(Path(__file__).with_suffix(".toml"))
    first = run.impacts[0]
    print(
        f"{1e6 * first.duration_s:.1f} us, {first.peak_force_n:.0f} N, energy residual "
        f"{run.energy_residual:.1e}"
    )
