"""Sound of a plate in a rigid baffle: Rayleigh's integral over its modes.

p(r, t) = rho/(2 pi) integral of a(x, t - R/c)/R over the plate, a: acceleration, R: distance. It is
formed at complex frequencies s = sigma + i w: a damped transform, so that what rings on at the end
of the time looked at does not come back at its start.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from hertzloop.plant.structures.radiation import AIR_DENSITY_KG_M3, SOUND_SPEED_M_S

_DAMPED_TO = 1e-4  # of an amplitude, over the period of the transform
FADE_FROM = 0.925  # of the upper frequency, from where on a band fades out
DIRECTIONS = 48  # of a half sphere
_ACROSS = 16.0  # frequencies a turn of the phase over the plate, for interpolation
_PAIRS_AT_ONCE = 1 << 22
_MODES_AT_ONCE = 48  # at most
_BINS_AT_ONCE = 1 << 22  # of all modes together
_STEPS_AT_ONCE = 1 << 20
_PRESSURES_AT_ONCE = 1 << 23  # bins of all directions together


@dataclass(frozen=True)
class Radiator:
    """Modes as in `Modes`, arrays (modes,), with their shapes on the nodes of a grid, (modes,
    nodes), places (nodes, 2) in m and the area that each node stands for (nodes,), m^2."""

    omega: np.ndarray
    eta: np.ndarray
    scale_per_kg: float
    at_contact: np.ndarray
    at_actuator: np.ndarray
    shapes: np.ndarray
    places_m: np.ndarray
    area_m2: np.ndarray


@dataclass(frozen=True)
class Excitation:
    """Forces up on the plate, held over each step of `step_s`, N, both (steps,)."""

    contact_n: np.ndarray
    actuator_n: np.ndarray
    step_s: float


@dataclass(frozen=True)
class Grid:
    """Samples in time: `count` of them, `step_s` apart, and the band that they carry."""

    count: int
    step_s: float
    up_to_hz: float

    @property
    def period_s(self) -> float:
        """Of the transform: twice as long as what is looked at."""
        return 2.0 * self.count * self.step_s

    @property
    def sigma(self) -> float:
        """Damping of the transform, 1/s."""
        return -math.log(_DAMPED_TO) / self.period_s

    @property
    def s(self) -> np.ndarray:
        """Complex frequencies of the bins up to the upper frequency, rad/s."""
        bins = np.arange(int(self.up_to_hz * self.period_s) + 1)
        return np.asarray(self.sigma + 2j * math.pi * bins / self.period_s)

    def some_bins(self, spread_s: float) -> np.ndarray:
        """Bins between which what arrives within `spread_s` can be interpolated, both ends too."""
        last = len(self.s) - 1
        apart = max(1, int(self.period_s / (_ACROSS * spread_s)))
        return np.unique(np.append(np.arange(0, last, apart), last))

    def band(self) -> np.ndarray:
        """Weight of each bin: one, towards the upper end fading to zero."""
        share = self.s.imag / (2.0 * math.pi * self.up_to_hz)
        fade = np.clip((share - FADE_FROM) / (1.0 - FADE_FROM), 0.0, 1.0)
        return np.asarray(0.5 + 0.5 * np.cos(np.pi * fade))

    def in_time(self, spectrum: np.ndarray) -> np.ndarray:
        """Samples, (..., count), of a transform at `s`, (..., bins)."""
        length = 2 * self.count
        damped = np.fft.irfft(spectrum * self.band(), length, axis=-1) / self.step_s
        times = np.arange(self.count) * self.step_s
        return np.asarray(damped[..., : self.count] * np.exp(self.sigma * times))


def transform(force_n: np.ndarray, step_s: float, grid: Grid) -> np.ndarray:
    """Transform of a force, held over each step, at the grid's s; N s, (bins,)."""
    length = round(grid.period_s / step_s)
    damped = np.zeros(length)
    for first in range(0, min(len(force_n), length), _STEPS_AT_ONCE):
        some = slice(first, min(first + _STEPS_AT_ONCE, len(force_n), length))
        times = np.arange(some.start, some.stop) * step_s
        damped[some] = force_n[some] * np.exp(-grid.sigma * times)
    s = grid.s
    held = -np.expm1(-s * step_s) / s
    return np.asarray(np.fft.rfft(damped)[: len(s)] * held)


def _groups(radiator: Radiator, grid: Grid) -> Iterator[Radiator]:
    """The modes by the dozen, fewer in a long run: all bins of all modes would not fit."""
    count = min(_MODES_AT_ONCE, max(1, _BINS_AT_ONCE // int(grid.up_to_hz * grid.period_s + 1)))
    for first in range(0, len(radiator.omega), count):
        some = slice(first, first + count)
        parts = ("omega", "eta", "at_contact", "at_actuator", "shapes")
        yield replace(radiator, **{name: getattr(radiator, name)[some] for name in parts})


def _transforms(drive: Excitation, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Of the forces at the contact and at the actuator, (bins,)."""
    return (
        transform(drive.contact_n, drive.step_s, grid),
        transform(drive.actuator_n, drive.step_s, grid),
    )


def _accelerations(
    radiator: Radiator, forces: tuple[np.ndarray, np.ndarray], grid: Grid
) -> np.ndarray:
    """Transforms of what every mode does, (modes, bins), from those of the forces."""
    s, omega = grid.s, radiator.omega[:, None]
    contact, actuator = forces
    force = np.outer(radiator.at_contact, contact) + np.outer(radiator.at_actuator, actuator)
    found = radiator.scale_per_kg * force * s * s
    found /= s * s + radiator.eta[:, None] * omega * s + omega * omega
    return np.asarray(found)


def transfer(radiator: Radiator, listener_m: np.ndarray, grid: Grid) -> np.ndarray:
    """Pressure at a point (x, y, z above the plate) by the acceleration of every mode, (modes,
    bins), Pa s^2/m.

    Formed at some frequencies only: without the travelling time it is smooth.
    """
    across = radiator.places_m - np.asarray(listener_m)[:2]
    distance = np.sqrt(np.sum(across**2, axis=1) + listener_m[2] ** 2)
    delay = distance / SOUND_SPEED_M_S
    middle = 0.5 * (delay.min() + delay.max())
    spread = max(float(delay.max() - delay.min()), 1e-6)
    s = grid.s
    at = grid.some_bins(spread)
    weights = radiator.shapes * (AIR_DENSITY_KG_M3 / (2.0 * math.pi) * radiator.area_m2 / distance)
    coarse = np.empty((len(radiator.omega), len(at)), complex)
    some = max(1, _PAIRS_AT_ONCE // len(distance))
    for first in range(0, len(at), some):
        turned = np.exp(-np.outer(delay - middle, s[at[first : first + some]]))
        coarse[:, first : first + some] = weights @ turned
    return np.asarray(_between(coarse, at, len(s)) * np.exp(-s * middle))


def _between(coarse: np.ndarray, at: np.ndarray, bins: int) -> np.ndarray:
    """Values at all bins from those at some, by cubic splines."""
    if len(at) < 4:
        everywhere = np.arange(bins)
        truth = [
            np.interp(everywhere, at, row.real) + 1j * np.interp(everywhere, at, row.imag)
            for row in coarse
        ]
        return np.array(truth)
    return np.asarray(scipy.interpolate.CubicSpline(at, coarse, axis=1)(np.arange(bins)))


def pressure_pa(
    radiator: Radiator, drive: Excitation, listener_m: np.ndarray, grid: Grid
) -> np.ndarray:
    """Sound pressure at a listener's point (x, y, z above the plate), (count,), Pa."""
    total, forces = np.zeros(len(grid.s), complex), _transforms(drive, grid)
    for some in _groups(radiator, grid):
        acceleration = _accelerations(some, forces, grid)
        total += np.sum(transfer(some, listener_m, grid) * acceleration, axis=0)
    return grid.in_time(total)


def directions(count: int) -> np.ndarray:
    """Unit vectors spread evenly over the half space above the plate, (count, 3)."""
    i = np.arange(count) + 0.5
    turn = math.pi * (1.0 + math.sqrt(5.0)) * i
    z = i / count
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


@dataclass(frozen=True)
class Products:
    """Modes whose shapes are products: along x (modes, nx) at the places `x_m`, along y (modes, ny)
    at `y_m`, places evenly apart in the middle of what each stands for."""

    along_x: np.ndarray
    x_m: np.ndarray
    along_y: np.ndarray
    y_m: np.ndarray


def radiated_j(
    radiator: Radiator, products: Products, drive: Excitation, grid: Grid, count: int = DIRECTIONS
) -> float:
    """Energy that goes through a half sphere far away within the grid's time, J."""
    s = grid.s
    spread = float(np.hypot(np.ptp(products.x_m), np.ptp(products.y_m))) / SOUND_SPEED_M_S
    at = grid.some_bins(spread)
    force = _transforms(drive, grid)
    total_j, every = 0.0, directions(count)
    together = max(1, _PRESSURES_AT_ONCE // len(s))
    for first in range(0, count, together):
        some = every[first : first + together]
        for pressure in _far_pressures(radiator, products, force, grid, at, some):
            total_j += float(np.sum(grid.in_time(pressure) ** 2)) * grid.step_s
    return 2.0 * math.pi * total_j / count / (AIR_DENSITY_KG_M3 * SOUND_SPEED_M_S)


def _far_pressures(
    radiator: Radiator,
    products: Products,
    forces: tuple[np.ndarray, np.ndarray],
    grid: Grid,
    at: np.ndarray,
    towards: np.ndarray,
) -> np.ndarray:
    """Transforms of the pressure far away times the distance, Pa m, (directions, bins), formed by
    its share a mode at the bins `at`."""
    s = grid.s
    total = np.zeros((len(towards), len(s)), complex)
    coarse = [
        _far(products.along_x, products.x_m, float(direction[0]), s[at])
        * _far(products.along_y, products.y_m, float(direction[1]), s[at])
        for direction in towards
    ]
    mode = 0
    for group in _groups(radiator, grid):
        acceleration = _accelerations(group, forces, grid)
        some = slice(mode, mode + len(acceleration))
        mode += len(acceleration)
        for pressure, share in zip(total, coarse, strict=True):
            pressure += np.sum(_between(share[some], at, len(s)) * acceleration, axis=0)
    return total * (AIR_DENSITY_KG_M3 / (2.0 * math.pi))


def rung_j(radiator: Radiator, drive: Excitation, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Of every mode the energy that a loss factor of one would have taken of its motion within the
    grid's time, and the energy that it has at the end, J, both (modes,)."""
    forces = _transforms(drive, grid)
    taken, held = [np.empty(0)], [np.empty(0)]
    for some in _groups(radiator, grid):
        found = _accelerations(some, forces, grid) / grid.s
        velocity = grid.in_time(found)
        place = grid.in_time(found / grid.s)[:, -1]
        # A mode has the mass 1/scale_per_kg and loses eta w m v^2 in a second.
        squares = np.sum(velocity**2, axis=1) * grid.step_s
        taken.append(some.omega * squares / radiator.scale_per_kg)
        both = velocity[:, -1] ** 2 + (some.omega * place) ** 2
        held.append(0.5 * both / radiator.scale_per_kg)
    return np.concatenate(taken), np.concatenate(held)


def _far(shapes: np.ndarray, places_m: np.ndarray, along: float, s: np.ndarray) -> np.ndarray:
    """Integral of shapes along one side as seen from afar, (modes, frequencies), m."""
    early = along * (places_m - places_m.mean()) / SOUND_SPEED_M_S
    return np.asarray(shapes @ np.exp(np.outer(early, s)) * (places_m[1] - places_m[0]))
