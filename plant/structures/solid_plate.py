"""Rectangular plate as an elastic solid: the modes of three-dimensional elasticity.

Edges hold the deflection and the motion along them and let the normal stress be zero, which
sin sin across with cos sin in the plane fulfils exactly (Srinivas, Rao and Rao 1970): every
k_mn = pi sqrt((m/l_x)^2 + (n/l_y)^2) has its own Rayleigh-Lamb branches, of which the faces move by
sqrt(P_b). Waves that shear in the plane alone do not move a face.

A contact's Hertz law holds the flexibility of a half space. It is taken off that of the modes left
out, so that it counts once; what is left is below zero, for the modes taken along hold a part
of the half space as well. Contact and actuator are on the same face.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plant.structures.lamb import HIGHEST, LONGEST, Branches, branches
from plant.structures.materials import Material
from plant.structures.plate import Plate
from plant.structures.structure import Modes, Point

_COUNTED = 2000  # wave numbers at which branches are counted


@lru_cache(maxsize=64)
def _left_out(poisson_ratio: float, omega_c: float) -> tuple[float, float]:
    return branches(poisson_ratio).left_out(omega_c)


@dataclass(frozen=True)
class SolidPlate:
    """A simply supported plate with thickness; sizes and material are those of `plate`."""

    plate: Plate

    def __str__(self) -> str:
        return "a simply supported plate in three dimensions"

    @property
    def material(self) -> Material:
        """Of the plate."""
        return self.plate.material

    @property
    def size_m(self) -> tuple[float, float]:
        """l_x and l_y, m."""
        return self.plate.size_m

    @property
    def local_plate(self) -> Plate:
        """The thin plate that bending waves of long contacts feel."""
        return self.plate

    @property
    def unit_rad_s(self) -> float:
        """c_T/h, in which the branches count frequencies, rad/s."""
        return self.material.shear_speed_m_s / self.plate.thickness_m

    @property
    def highest_hz(self) -> float:
        """Up to where the branches are known, Hz."""
        return (1.0 - 1e-12) * HIGHEST * self.unit_rad_s / (2.0 * math.pi)  # whatever the rounding

    def wave_number_1_m(self, omega: float) -> float:
        """Largest wave number of any branch at a frequency, 1/m."""
        return self._branches.bending_x(omega / self.unit_rad_s) / self.plate.thickness_m

    def frequency_hz(self, wave_number_1_m: float) -> float:
        """Frequency of A0 at a wave number, Hz; at most `highest_hz`."""
        x = np.array([wave_number_1_m * self.plate.thickness_m])
        bending = float(self._branches.omegas(np.minimum(x, LONGEST))[0, 0])
        return min(bending * self.unit_rad_s / (2.0 * math.pi), self.highest_hz)

    def same_point(self, contact_m: Point, actuator_m: Point) -> bool:
        """Whether the actuator pushes at the struck point."""
        return contact_m == actuator_m

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency, those of all branches, by the area of
        the wave numbers that each has there."""
        limit = 2.0 * math.pi * frequency_hz / self.unit_rad_s
        squared = np.linspace(0.0, self._branches.bending_x(min(limit, HIGHEST)) ** 2, _COUNTED)
        squared = 0.5 * (squared[1:] + squared[:-1])
        below = self._branches.omegas(np.sqrt(squared)) <= limit
        area = self.size_m[0] * self.size_m[1] / self.plate.thickness_m**2
        return float(area * squared[-1] * np.mean(np.sum(below, axis=0)) / (4.0 * math.pi))

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s, by rising frequency. Raises ValueError beyond what the
        branches hold."""
        m, n, omega, face = self._numbers(omega_max)
        shapes = [face * self.plate.mode_shape(m, n, point) for point in (contact_m, actuator_m)]
        return Modes(omega, self.plate.eta, self.plate.modal_scale_per_kg, *shapes)

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max` without a half space's, m/N, below
        zero for all but the lowest limits: that of an infinite plate. Without a point: about how
        much what is left out moves, that of the thin plate."""
        if point_m is None:
            return self.plate.residual_flexibility_m_n(omega_max)
        unit = 1.0 / (self.material.shear_modulus_pa * self.plate.thickness_m)
        return unit * _left_out(self.material.poisson_ratio, omega_max / self.unit_rad_s)[0]

    def residual_inertia_m_n(self, omega_max: float, omega: float) -> float:
        """By how much the inertia of all modes above `omega_max` adds to their flexibility at a
        lower frequency `omega`, m/N."""
        unit = 1.0 / (self.material.shear_modulus_pa * self.plate.thickness_m)
        inertia = _left_out(self.material.poisson_ratio, omega_max / self.unit_rad_s)[1]
        return unit * inertia * (omega / self.unit_rad_s) ** 2

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of the struck face of all modes up to `omega_max`, (modes, x, y)."""
        m, n, _, face = self._numbers(omega_max)
        along_x = np.sin(np.outer(m, x_m) * (np.pi / self.size_m[0]))
        along_y = np.sin(np.outer(n, y_m) * (np.pi / self.size_m[1]))
        return np.asarray(face[:, None, None] * along_x[:, :, None] * along_y[:, None, :])

    @property
    def _branches(self) -> Branches:
        return branches(self.material.poisson_ratio)

    def _numbers(self, omega_max: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """m, n, frequency (rad/s) and sqrt(P rho h) of all modes up to a frequency, rising."""
        limit = omega_max / self.unit_rad_s
        if not limit <= HIGHEST:
            raise ValueError(
                f"modes in three dimensions are known up to {self.highest_hz:.3g} Hz, not to "
                f"{omega_max / (2.0 * math.pi):.3g} Hz"
            )
        lx, ly = self.size_m
        k_max = self.wave_number_1_m(omega_max)
        m_max, n_max = (max(1, math.floor(k_max * length / math.pi)) for length in (lx, ly))
        m, n = (a.ravel() for a in np.meshgrid(np.arange(1, m_max + 1), np.arange(1, n_max + 1)))
        k = np.sqrt((m * np.pi / lx) ** 2 + (n * np.pi / ly) ** 2)
        near = k <= k_max * (1.0 + 1e-9)
        m, n, x = m[near], n[near], k[near] * self.plate.thickness_m
        omega, weight = self._branches.omegas(x), self._branches.weights(x)
        branch, mode = np.nonzero(omega <= limit)
        order = np.argsort(omega[branch, mode], kind="stable")
        branch, mode = branch[order], mode[order]
        return (
            m[mode], n[mode], omega[branch, mode] * self.unit_rad_s, np.sqrt(weight[branch, mode])
        )  # fmt: skip
