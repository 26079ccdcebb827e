"""Rectangular plate whose edges are clamped, free or simply supported, in any combination."""

import math
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from hertzloop.common.protocols import Point, Structure
from hertzloop.plant.structures.materials import Material
from hertzloop.plant.structures.modes import Modes
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.registry import Description
from hertzloop.plant.structures.ritz_modes import RitzModes, ritz_modes

_SIZES = (500, 1000, 2000)  # of Ritz's method, in modes; seconds on a plate without symmetry
_SPARE = 1.5  # modes that are computed, over those asked for
_MOST_S = 12.0  # of processor time for the largest, without symmetry
_FREQUENCY_ERROR = 1e-3  # relative, largest: tests/plant/structures/test_edges.py
_WORDS = {"s": "simply supported", "c": "clamped", "f": "free"}


@dataclass(frozen=True)
class EdgedPlate(Structure):
    """A plate with the edges x = 0, x = l_x, y = 0, y = l_y as named, c, f or s each.

    Its modes are known up to `highest_hz`.
    """

    plate: Plate
    edges: str
    has_shapes = True
    quality = MappingProxyType(
        {"most_modes": _SIZES[-1], "largest_frequency_error": _FREQUENCY_ERROR}
    )

    def __str__(self) -> str:
        if len(set(self.edges)) == 1:
            return f"a plate with {_WORDS[self.edges[0]]} edges"
        return f"a plate with edges '{self.edges}'"

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
        """The thin plate that bending waves of long contacts feel until reflections return."""
        return self.plate

    @cached_property
    def highest_hz(self) -> float:  # type: ignore[override]  # a constant in other structures
        """Frequency below which there are about as many modes as are computed at most, Hz."""
        return _SIZES[-1] / self.plate.modes_below(1.0)

    @property
    def seconds_per_mode(self) -> float:  # type: ignore[override]  # likewise
        """About how much processor time it takes to compute a mode, s."""
        problems = 2 ** sum(self.edges[n] == self.edges[n + 1] for n in (0, 2))
        return _MOST_S / _SIZES[-1] / problems**2

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency, by the modal density."""
        return self.plate.modes_below(frequency_hz)

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s. Raises ValueError above `highest_hz`."""
        ritz, omega = self._ritz(omega_max)
        count = int(np.searchsorted(omega, omega_max, side="right"))
        at_contact = at_actuator = self._shapes(ritz, contact_m)[:count]
        if actuator_m != contact_m:
            at_actuator = self._shapes(ritz, actuator_m)[:count]
        plate = self.plate
        return Modes(omega[:count], plate.eta, plate.modal_scale_per_kg, at_contact, at_actuator)

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max`, m/N: mode by mode as far as they are
        computed, beyond them, or without a point, that of an infinite plate."""
        if point_m is None:
            return self.plate.residual_flexibility_m_n(omega_max)
        ritz, omega = self._ritz(omega_max)
        above = omega > omega_max
        summed = float(np.sum((self._shapes(ritz, point_m)[above] / omega[above]) ** 2))
        beyond = self.plate.residual_flexibility_m_n(max(omega_max, self._top(omega_max)))
        return beyond + self.plate.modal_scale_per_kg * summed

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` on a grid, (modes, x, y)."""
        ritz, omega = self._ritz(omega_max)
        count = int(np.searchsorted(omega, omega_max, side="right"))
        return np.asarray(self._unit * ritz.shapes(x_m, y_m)[:count])

    def _ritz(self, omega_max: float) -> tuple[RitzModes, np.ndarray]:
        """Modes up to a limit and some beyond, and their frequencies, rad/s."""
        if omega_max > 2.0 * math.pi * self.highest_hz * (1.0 + 1e-9):
            raise ValueError(
                f"{self}: its modes are known up to {self.highest_hz:.6g} Hz, not to "
                f"{omega_max / (2.0 * math.pi):.6g} Hz. Use a lower limit."
            )
        k_max = math.sqrt(self._top(omega_max) / self._speed)
        ritz = ritz_modes(
            self.edges, self.size_m, self.material.poisson_ratio, float(f"{k_max:.12g}")
        )
        return ritz, self._speed * ritz.squared

    def _top(self, omega_max: float) -> float:
        """Frequency up to which modes are computed, rad/s."""
        wanted = _SPARE * self.modes_below(omega_max / (2.0 * math.pi))
        count = next((size for size in _SIZES if size >= wanted), _SIZES[-1])
        return 2.0 * math.pi * count / self.modes_below(1.0)

    def _shapes(self, ritz: RitzModes, point_m: Point) -> np.ndarray:
        """Shapes at a point, (modes,)."""
        x, y = point_m
        return np.asarray(self._unit * ritz.shapes(np.array([x]), np.array([y]))[:, 0, 0])

    @property
    def _unit(self) -> float:
        """Turns a shape of unit integral into one of modal mass 1/lambda, as the plate's."""
        return 0.5 * math.sqrt(self.size_m[0] * self.size_m[1])

    @property
    def _speed(self) -> float:
        """w/k^2, m^2/s."""
        return math.sqrt(self.plate.bending_stiffness_n_m / self.plate.mass_per_area_kg_m2)


def made(description: Description) -> Structure:
    """A thin plate: in closed form where all edges are simply supported."""
    if description.edges == "ssss":
        return description.thin_plate
    return EdgedPlate(description.thin_plate, description.edges)
