"""Rectangular plate whose edges are clamped, free or simply supported, in any combination."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from plant.structures.edge_phases import Waves, shape_along, waves
from plant.structures.materials import Material
from plant.structures.plate import Plate
from plant.structures.ritz import LowModes, low_modes
from plant.structures.structure import Modes, Point

_SHARE = 0.1  # of the accuracy asked for, in k^2 of the modes taken from Ritz's method
_LEAST = 25  # low modes that are taken however little is asked
_LOOKED_AT = 0.2  # of the low modes, to find a gap and to compare with the waves
_TAIL = 4.0  # modes left out are summed one by one up to this multiple of the limit
_WORDS = {"s": "simply supported", "c": "clamped", "f": "free"}


@dataclass(frozen=True)
class Reached:
    """What the modes of an edged plate are worth: how many come from Ritz's method, their largest
    change against a smaller basis, and by how much the modes beyond, without the corners' share,
    are off where both are known; both relative, of the frequency."""

    low_modes: int
    low_change: float
    beyond_error: float


@dataclass(frozen=True)
class EdgedPlate:
    """A plate with the edges x = 0, x = l_x, y = 0, y = l_y as named, c, f or s each.

    Low modes by Ritz's method as far as it has converged to `accuracy`, those beyond by phases
    at the edges.
    """

    plate: Plate
    edges: str
    accuracy: float

    def __str__(self) -> str:
        if len(set(self.edges)) == 1:
            return f"a plate with {_WORDS[self.edges[0]]} edges"
        return f"a plate with edges '{self.edges}'"

    @property
    def material(self) -> Material:
        """Of the plate."""
        return self.plate.material

    @property
    def local_plate(self) -> Plate:
        """What a contact feels until reflections return."""
        return self.plate

    @property
    def size_m(self) -> tuple[float, float]:
        """l_x and l_y, m."""
        return self.plate.size_m

    def same_point(self, contact_m: Point, actuator_m: Point) -> bool:
        """Whether the actuator pushes at the struck point."""
        return contact_m == actuator_m

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency, by the modal density."""
        return self.plate.modes_below(frequency_hz)

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s."""
        points = [contact_m, actuator_m]
        omega, shapes = self._shapes(omega_max, points)
        return Modes(
            omega, self.plate.eta, self.plate.modal_scale_per_kg,
            shapes[:, 0], shapes[:, 1] if actuator_m != contact_m else shapes[:, 0],
        )  # fmt: skip

    def residual_flexibility_m_n(self, omega_max: float, point_m: Point | None = None) -> float:
        """Static flexibility of all modes above `omega_max`, m/N: mode by mode up to _TAIL times
        that, beyond it, or without a point, that of an infinite plate."""
        if point_m is None:
            return self.plate.residual_flexibility_m_n(omega_max)
        omega, shapes = self._shapes(_TAIL * omega_max, [point_m])
        left_out = omega > omega_max
        summed = float(np.sum((shapes[left_out, 0] / omega[left_out]) ** 2))
        return self.plate.residual_flexibility_m_n(_TAIL * omega_max) + (
            self.plate.modal_scale_per_kg * summed
        )

    def on_grid(self, omega_max: float, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        """Shapes of all modes up to `omega_max` on a grid, (modes, x, y)."""
        low, count, beyond = self._parts(omega_max)
        groups = [low.shapes(x_m, y_m, count)]
        for group in beyond:
            along_x, along_y = self._along(group, x_m, y_m)
            groups.append(np.einsum("xm,ym->mxy", along_x, along_y))
        order = np.argsort(self._squared(omega_max), kind="stable")
        return np.asarray(self._unit * np.concatenate(groups)[order])

    @property
    def reached(self) -> Reached:
        """How far the modes are converged."""
        low, count, error = _joint(self.edges, self.size_m, self._nu, self.accuracy)
        return Reached(count, 0.5 * float(low.change[:count].max()), 0.5 * error)

    @property
    def _nu(self) -> float:
        return self.material.poisson_ratio

    @property
    def _unit(self) -> float:
        """Turns a shape of unit integral into one of modal mass 1/lambda, as the plate's."""
        return 0.5 * math.sqrt(self.size_m[0] * self.size_m[1])

    @property
    def _speed(self) -> float:
        """w/k^2, m^2/s."""
        return math.sqrt(self.plate.bending_stiffness_n_m / self.plate.mass_per_area_kg_m2)

    def _parts(self, omega_max: float) -> tuple[LowModes, int, list[Waves]]:
        """Low modes, how many of them are below the limit, and those beyond."""
        low, count, _ = _joint(self.edges, self.size_m, self._nu, self.accuracy)
        most = omega_max / self._speed
        beyond = _beyond(self.edges, self.size_m, self._nu, self.accuracy, most)
        return low, int(np.searchsorted(low.squared[:count], most, side="right")), beyond

    def _squared(self, omega_max: float) -> np.ndarray:
        """k^2 of all modes, low ones first, then group by group."""
        low, count, beyond = self._parts(omega_max)
        return np.concatenate([low.squared[:count], *(group.squared for group in beyond)])

    def _along(self, group: Waves, x_m: np.ndarray, y_m: np.ndarray) -> list[np.ndarray]:
        sides = ((self.edges[:2], group.along_x, x_m), (self.edges[2:], group.along_y, y_m))
        return [
            shape_along(edges, length, side, self._nu, places)
            for (edges, side, places), length in zip(sides, self.size_m, strict=True)
        ]

    def _shapes(self, omega_max: float, points: list[Point]) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (modes,) and shapes at points (modes, points)."""
        low, count, beyond = self._parts(omega_max)
        squared = self._squared(omega_max)
        shapes = np.empty((len(squared), len(points)))
        for i, (x, y) in enumerate(points):
            at = np.array([x]), np.array([y])
            groups = [low.shapes(*at, count)[:, 0, 0]]
            for group in beyond:
                along_x, along_y = self._along(group, *at)
                groups.append(along_x[0] * along_y[0])
            shapes[:, i] = self._unit * np.concatenate(groups)
        order = np.argsort(squared, kind="stable")
        return self._speed * squared[order], shapes[order]


@lru_cache(maxsize=16)
def _joint(
    edges: str, size_m: tuple[float, float], nu: float, accuracy: float
) -> tuple[LowModes, int, float]:
    """Low modes, how many of them to take, and the relative error in k^2 of the waves there.

    As many as have converged; among the last of them the widest gap, so that no mode counts
    twice or is lost.
    """
    low = low_modes(edges, size_m, nu)
    unconverged = np.flatnonzero(low.change > _SHARE * accuracy)
    most = max(int(unconverged[0]) if len(unconverged) else len(low.squared) - 1, _LEAST)
    k_max = math.sqrt(1.2 * low.squared[most])
    beyond = np.sort(np.concatenate([g.squared for g in waves(edges, size_m, nu, k_max)]))
    missing = _missing(edges)
    first = most - max(1, int(_LOOKED_AT * most))
    gaps = (
        beyond[first - missing + 1 : most - missing + 1] / beyond[first - missing : most - missing]
    )
    count = first + 1 + int(np.argmax(gaps))
    known = low.squared[first:count]
    error = np.abs(beyond[first - missing : count - missing] / known - 1.0)
    return low, count, float(error.max())


def _missing(edges: str) -> int:
    """Low modes that the waves do not have: nearly straight along x and y, between free edges."""
    return edges[:2].count("f") * edges[2:].count("f")


@lru_cache(maxsize=16)
def _beyond(
    edges: str, size_m: tuple[float, float], nu: float, accuracy: float, most: float
) -> list[Waves]:
    """The waves above the low modes, up to k^2 = `most`."""
    count = _joint(edges, size_m, nu, accuracy)[1]
    found = waves(edges, size_m, nu, math.sqrt(most))
    every = np.sort(np.concatenate([group.squared for group in found]))
    first = count - _missing(edges)
    if first >= len(every):
        return []
    return [group.above(every[first]) for group in found]
