"""Simply supported rectangular plate of Kirchhoff's theory.

Loss factor eta on every mode: q'' + eta w q' + w^2 q = lambda phi F, with phi = sin(m pi x/l_x)
sin(n pi y/l_y) and lambda = 4/(m'' l_x l_y).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hertzloop.common.elementary_kernels import fill_sines
from hertzloop.common.protocols import Structure
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Modes
from hertzloop.plant.structures.residual_kernels import flexibility

_TAIL = 16.0  # modes left out are summed one by one up to this multiple of the limit


@dataclass(frozen=True)
class Plate(Structure):
    """Rectangular plate, sizes in m; `loss_factor` replaces the material's if given."""

    material: Material
    size_m: tuple[float, float]
    thickness_m: float
    loss_factor: float | None = None

    @cached_property
    def eta(self) -> float:
        """Loss factor."""
        return self.material.loss_factor if self.loss_factor is None else self.loss_factor

    @cached_property
    def bending_stiffness_n_m(self) -> float:
        """B' = E h^3 / (12 (1 - nu^2)), N m."""
        h = self.thickness_m
        return self.material.plane_strain_modulus_pa * (h * h * h) / 12.0

    @cached_property
    def mass_per_area_kg_m2(self) -> float:
        """m'' = rho h, kg/m^2."""
        return self.material.density_kg_m3 * self.thickness_m

    @cached_property
    def modal_scale_per_kg(self) -> float:
        """lambda = 4/(m'' l_x l_y), the inverse modal mass, 1/kg."""
        return 4.0 / (self.mass_per_area_kg_m2 * self.size_m[0] * self.size_m[1])

    @cached_property
    def infinite_plate_impedance_n_s_m(self) -> float:
        """8 sqrt(B' m''), point impedance until reflections return (Cremer & Heckl), N s/m."""
        return 8.0 * math.sqrt(self.bending_stiffness_n_m * self.mass_per_area_kg_m2)

    @cached_property
    def fundamental_hz(self) -> float:
        """Frequency of mode (1, 1), the lowest, Hz."""
        along_x, along_y, speed = self._squared_wave_numbers(0.0)
        return float(speed * (along_y + along_x)[0]) / (2.0 * math.pi)

    has_shapes = True

    @property
    def local_plate(self) -> "Plate":
        """The plate that the contact feels until reflections return: this one."""
        return self

    @property
    def simply_supported(self) -> "Plate":
        """This plate, whose modes are products of sines."""
        return self

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes the plate has up to a frequency, by its modal density."""
        density = math.sqrt(self.mass_per_area_kg_m2 / self.bending_stiffness_n_m) / (4 * math.pi)
        return density * self.size_m[0] * self.size_m[1] * 2 * math.pi * frequency_hz

    def wavelengths_to_edge(self, point_m: tuple[float, float], frequency_hz: float) -> float:
        """Distance of a point from the nearest edge in lengths of bending waves of a frequency."""
        near = min(min(x, size - x) for x, size in zip(point_m, self.size_m, strict=True))
        speed = math.sqrt(self.bending_stiffness_n_m / self.mass_per_area_kg_m2)
        return near * math.sqrt(2.0 * math.pi * frequency_hz / speed) / (2.0 * math.pi)

    def mode_numbers(self, omega_max: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All modes up to `omega_max` rad/s by rising frequency: m, n, omega."""
        along_x, along_y, speed = self._squared_wave_numbers(omega_max)
        omega = speed * (along_y[:, np.newaxis] + along_x)
        n, m = np.nonzero(omega <= omega_max)
        order = np.argsort(omega[n, m], kind="stable")
        n, m = n[order], m[order]
        return m + 1, n + 1, omega[n, m]

    def _squared_wave_numbers(self, omega_max: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Squared wave numbers (1/m^2) along both sides of the modes up to a frequency (rad/s), and
        the frequency per square."""
        speed = math.sqrt(self.bending_stiffness_n_m / self.mass_per_area_kg_m2)
        k_max = math.sqrt(omega_max / speed) / math.pi
        m, n = (np.arange(1, max(1, math.floor(k_max * length)) + 1) for length in self.size_m)
        return (m * np.pi / self.size_m[0]) ** 2, (n * np.pi / self.size_m[1]) ** 2, speed

    def mode_shape(self, m: np.ndarray, n: np.ndarray, point_m: tuple[float, float]) -> np.ndarray:
        """Shape of modes (m, n) at a point, shape (modes,), dimensionless."""
        x, y = point_m[0] / self.size_m[0], point_m[1] / self.size_m[1]
        return np.asarray(_sines(_most(m), x)[m - 1] * _sines(_most(n), y)[n - 1])

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` on a grid, (modes, x, y)."""
        m, n, _ = self.mode_numbers(omega_max)
        along_x = np.sin(np.outer(m, x_m) * (np.pi / self.size_m[0]))
        along_y = np.sin(np.outer(n, y_m) * (np.pi / self.size_m[1]))
        return np.asarray(along_x[:, :, None] * along_y[:, None, :])

    def modes(
        self, omega_max: float, contact_m: tuple[float, float], actuator_m: tuple[float, float]
    ) -> Modes:
        """All modes up to `omega_max` rad/s, by rising frequency."""
        m, n, omega = self.mode_numbers(omega_max)
        at_contact = at_actuator = self.mode_shape(m, n, contact_m)
        if actuator_m != contact_m:
            at_actuator = self.mode_shape(m, n, actuator_m)
        return Modes(omega, self.eta, self.modal_scale_per_kg, at_contact, at_actuator)

    def residual_flexibility_m_n(
        self, omega_max: float, point_m: tuple[float, float] | None = None
    ) -> float:
        """Static flexibility sum lambda phi^2/w^2 of all modes above `omega_max`, m/N.

        At a point: summed mode by mode up to _TAIL times that, beyond it from the modal density of
        the infinite plate, (2/pi) Y/w with Y = 1/(8 sqrt(B' m'')). Without a point: the latter
        only.
        """
        beyond = omega_max if point_m is None else _TAIL * omega_max
        beyond_limit = 2.0 / (math.pi * self.infinite_plate_impedance_n_s_m * beyond)
        if point_m is None:
            return beyond_limit
        along_x, along_y, speed = self._squared_wave_numbers(beyond)
        x, y = point_m[0] / self.size_m[0], point_m[1] / self.size_m[1]
        sin_x, sin_y = _sines(len(along_x), x), _sines(len(along_y), y)
        found = flexibility(along_x, along_y, sin_x, sin_y, speed, omega_max, beyond)
        return beyond_limit + self.modal_scale_per_kg * float(found)


def _sines(most: int, share: float) -> np.ndarray:
    """sin(m pi x) of m = 1 ... `most`."""
    found = np.empty(most)
    fill_sines(share, found)
    return found


def _most(numbers: np.ndarray) -> int:
    return int(np.max(numbers, initial=0))
