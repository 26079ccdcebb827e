"""Rectangular plate whose edges are clamped, free or simply supported, in any combination."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from hertzloop.plant.structures.edge_waves import Waves, shape_along, waves
from hertzloop.plant.structures.modes import Modes, Point
from hertzloop.plant.structures.registry import Description
from hertzloop.plant.structures.ritz_modes import LowModes, low_modes
from hertzloop.plant.structures.shared_modes import RATIOS, low_modes_near, waves_near
from hertzloop.plant.structures.structure import SizedPlate, Structure

_SHARE = 0.1  # of the accuracy asked for, in k^2 of the modes taken from Ritz's method
_LEAST = 25  # low modes that are taken however little is asked
_LOOKED_AT = 0.2  # of the low modes, to find a gap and to compare with the waves
_TAIL = 4.0  # modes left out are summed one by one up to this multiple of the limit
_WORDS = {"s": "simply supported", "c": "clamped", "f": "free"}


@dataclass(frozen=True)
class RitzAccuracy:
    """What the modes of an edged plate are worth: how many come from Ritz's method, their largest
    change against a smaller basis, and by how much the modes beyond, without the corners' share,
    are off where both are known; both relative, of the frequency."""

    low_modes: int
    low_change: float
    beyond_error: float


@dataclass(frozen=True)
class EdgedPlate(SizedPlate):
    """A plate with the edges x = 0, x = l_x, y = 0, y = l_y as named, c, f or s each.

    Low modes by Ritz's method as far as it has converged to `accuracy`, those beyond by phases
    at the edges. A plate beside another shares the functions of its modes and takes as many low
    ones.
    """

    edges: str
    accuracy: float
    near: float | None = None  # Poisson's ratio of the plate that it is `beside`
    seconds_per_mode = 7e-5

    def __str__(self) -> str:
        if len(set(self.edges)) == 1:
            return f"a plate with {_WORDS[self.edges[0]]} edges"
        return f"a plate with edges '{self.edges}'"

    @cached_property
    def quality(self) -> Mapping[str, Any]:  # type: ignore[override]
        """Fields of `RitzAccuracy`."""
        return asdict(self.reached)

    def beside(self, other: Structure) -> Structure:
        """See `Structure`."""
        if not isinstance(other, EdgedPlate) or not RATIOS[0] <= self._nu <= RATIOS[1]:
            return self
        one, two = ((p.edges, p.size_m, p.accuracy) for p in (self, other))
        return replace(self, near=other._nu) if one == two and self._nu != other._nu else self

    def modes_below(self, frequency_hz: float) -> float:
        """About how many modes there are up to a frequency, by the modal density."""
        return self.plate.modes_below(frequency_hz)

    def modes(self, omega_max: float, contact_m: Point, actuator_m: Point) -> Modes:
        """All modes up to `omega_max` rad/s."""
        points = [contact_m] if actuator_m == contact_m else [contact_m, actuator_m]
        if self.near is None:
            omega, shapes = self._shapes(omega_max, points)
        else:  # of those that the residual flexibility needs as well
            omega, shapes = self._shapes(_TAIL * omega_max, points)
            count = int(np.searchsorted(omega, self._speed * self._most(omega_max), side="right"))
            omega, shapes = omega[:count], shapes[:count]
        return Modes(
            omega,
            self.plate.eta,
            self.plate.modal_scale_per_kg,
            shapes[:, 0],
            shapes[:, -1],
        )

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
        form = self._form
        low, count, beyond, squared = _parts(form, self._most(omega_max))
        groups = [low.shapes(x_m, y_m, count)]
        for group in beyond:
            along_x, along_y = _along(form, group, x_m, y_m)
            groups.append(np.einsum("xm,ym->mxy", along_x, along_y))
        order = np.argsort(squared, kind="stable")
        return np.asarray(self._unit * np.concatenate(groups)[order])

    @property
    def reached(self) -> RitzAccuracy:
        """How far the modes are converged."""
        low, count, error = _joint(self._form.alone())
        return RitzAccuracy(count, 0.5 * float(low.change[:count].max()), 0.5 * error)

    @property
    def _nu(self) -> float:
        return self.material.poisson_ratio

    @property
    def _form(self) -> "_Form":
        return _Form(self.edges, self.size_m, self._nu, self.accuracy, self.near)

    @property
    def _unit(self) -> float:
        """Turns a shape of unit integral into one of modal mass 1/lambda, as the plate's."""
        return 0.5 * math.sqrt(self.size_m[0] * self.size_m[1])

    @property
    def _speed(self) -> float:
        """w/k^2, m^2/s."""
        return math.sqrt(self.plate.bending_stiffness_n_m / self.plate.mass_per_area_kg_m2)

    def _most(self, omega_max: float) -> float:
        """k^2 at a frequency, 1/m^2, without the rounding: plates that differ in stiffness and mass
        alone have the same shapes up to limits in proportion, and share them."""
        return float(f"{omega_max / self._speed:.12g}")

    def _shapes(self, omega_max: float, points: list[Point]) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (modes,) and shapes at points (modes, points)."""
        squared, shapes = _unit_shapes(self._form, self._most(omega_max), tuple(points))
        return self._speed * squared, self._unit * shapes


class _Form(NamedTuple):
    """What the shapes of an edged plate depend on; see `EdgedPlate`."""

    edges: str
    size_m: tuple[float, float]
    nu: float
    accuracy: float
    near: float | None

    def alone(self) -> "_Form":
        """The plate that decides on the number of low modes: beside no other."""
        nu = self.nu if self.near is None else self.near
        return self._replace(nu=nu, near=None)


def _parts(form: _Form, most: float) -> tuple[LowModes, int, list[Waves], np.ndarray]:
    """Low modes, how many of them are below the limit, those beyond, and k^2 of all: low ones
    first, then group by group."""
    low, count, _ = _joint(form)
    beyond = _beyond(form, most)
    count = int(np.searchsorted(low.squared[:count], most, side="right"))
    squared = np.concatenate([low.squared[:count], *(group.squared for group in beyond)])
    return low, count, beyond, squared


def _along(form: _Form, group: Waves, x_m: np.ndarray, y_m: np.ndarray) -> list[np.ndarray]:
    sides = ((form.edges[:2], group.along_x, x_m), (form.edges[2:], group.along_y, y_m))
    return [
        shape_along(of_side, length, side, form.nu, places)
        for (of_side, side, places), length in zip(sides, form.size_m, strict=True)
    ]


@lru_cache(maxsize=16)
def _unit_shapes(
    form: _Form, most: float, points: tuple[Point, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """k^2 up to a limit (modes,), rising, and shapes of unit integral at points (modes, points)."""
    low, count, beyond, squared = _parts(form, most)
    shapes = np.empty((len(squared), len(points)))
    for i, (x, y) in enumerate(points):
        at = np.array([x]), np.array([y])
        groups = [low.shapes(*at, count)[:, 0, 0]]
        for group in beyond:
            along_x, along_y = _along(form, group, *at)
            groups.append(along_x[0] * along_y[0])
        shapes[:, i] = np.concatenate(groups)
    order = np.argsort(squared, kind="stable")
    return squared[order], shapes[order]


@lru_cache(maxsize=16)
def _joint(form: _Form) -> tuple[LowModes, int, float]:
    """Low modes, how many of them to take, and the relative error in k^2 of the waves there.

    As many as have converged; among the last of them the widest gap, so that no mode counts
    twice or is lost. A plate beside another takes as many as that.
    """
    edges, size_m, nu, accuracy, near = form
    if near is not None:
        _, count, error = _joint(form.alone())
        return low_modes_near(edges, size_m, nu, near, count), count, error
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
def _beyond(form: _Form, most: float) -> list[Waves]:
    """The waves above the low modes, up to k^2 = `most`."""
    edges, size_m, nu, _, near = form
    count = _joint(form)[1]
    k_max = math.sqrt(most)
    if near is None:
        found = waves(edges, size_m, nu, k_max)
    else:
        found = waves_near(edges, size_m, nu, near, k_max)
    squared = np.sort(np.concatenate([group.squared for group in found]))
    first = count - _missing(edges)
    if first >= len(squared):
        return []
    return [group.within(squared[first], math.inf) for group in found]


def made(description: Description) -> Structure:
    """A thin plate: in closed form where all edges are simply supported."""
    if description.edges == "ssss":
        return description.thin_plate
    return EdgedPlate(description.thin_plate, description.edges, description.accuracy)
