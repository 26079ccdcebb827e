"""Sound of a plate in a rigid baffle, on its axis: the volume of air that the modes move.

p(r, t) = rho/(2 pi r) dQ/dt(t - r/c), with the volume velocity Q, the sum of V_i dq_i/dt over the
modes, and the volume V_i that mode i moves for each metre, the integral of its shape (Fahy and
Gardonio, Sound and Structural Vibration, 2007, section 3.3). This holds as long as the sound from
all parts of the plate arrives in phase: at a distance, or for waves in the air that are longer than
the plate.

Example: a piston of 0.09 m^2 that is accelerated by 1 m/s^2 gives 0.017 Pa at 1 m.

The sum is formed at complex frequencies s = sigma + i w: a damped transform, so that what rings on
at the end of the time looked at does not come back at its start.
"""

import math
from dataclasses import dataclass

import numpy as np

from hertzloop.plant.structures.radiation import AIR_DENSITY_KG_M3, SOUND_SPEED_M_S

_DAMPED_TO = 1e-4  # of an amplitude, over the period of the transform
FADE_FROM = 0.925  # of the upper frequency, from where on a band fades out
_VALUES_AT_ONCE = 1 << 21  # modes times bins


@dataclass(frozen=True)
class Radiator:
    """Modes as in `Modes`, arrays (modes,), with the volume that each moves for a metre, m^2."""

    omega: np.ndarray
    eta: np.ndarray
    scale_per_kg: float
    at_contact: np.ndarray
    at_actuator: np.ndarray
    volume_m2: np.ndarray


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
        """Period of the transform: twice as long as the time looked at."""
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

    def band(self) -> np.ndarray:
        """Weight of each bin: one, towards the upper end fading to zero."""
        share = self.s.imag / (2.0 * math.pi * self.up_to_hz)
        fade = np.clip((share - FADE_FROM) / (1.0 - FADE_FROM), 0.0, 1.0)
        return np.asarray(0.5 + 0.5 * np.cos(np.pi * fade))

    def in_time(self, spectrum: np.ndarray) -> np.ndarray:
        """Return the samples, (count,), of a transform at `s`, (bins,)."""
        damped = np.fft.irfft(spectrum * self.band(), 2 * self.count) / self.step_s
        times = np.arange(self.count) * self.step_s
        return np.asarray(damped[: self.count] * np.exp(self.sigma * times))


def pressure_pa(radiator: Radiator, drive: Excitation, distance_m: float, grid: Grid) -> np.ndarray:
    """Return the sound pressure on the axis of the plate, (count,), Pa.

    Args:
        radiator: The modes.
        drive: The forces.
        distance_m: Distance from the plate, m.
        grid: The samples.
    """
    s, omega = grid.s, radiator.omega
    forces = [
        _transform(force, drive.step_s, grid) for force in (drive.contact_n, drive.actuator_n)
    ]
    acceleration = np.zeros(len(s), complex)  # of the volume, m^3/s^2
    modes = max(1, _VALUES_AT_ONCE // len(s))
    for first in range(0, len(omega), modes):
        some = slice(first, first + modes)
        damping = np.outer(radiator.eta[some] * omega[some], 1.0 / s)
        mobility = 1.0 / (1.0 + damping + np.outer(omega[some] ** 2, 1.0 / s**2))
        for force, at in zip(forces, (radiator.at_contact, radiator.at_actuator), strict=True):
            acceleration += force * ((radiator.volume_m2 * at)[some] @ mobility)
    acceleration *= radiator.scale_per_kg
    late = np.exp(-s * distance_m / SOUND_SPEED_M_S)
    return grid.in_time(AIR_DENSITY_KG_M3 / (2.0 * math.pi * distance_m) * acceleration * late)


def _transform(force_n: np.ndarray, step_s: float, grid: Grid) -> np.ndarray:
    """Return the transform of a force, held over each step, at the grid's s; N s, (bins,)."""
    length = round(grid.period_s / step_s)
    damped = np.zeros(length)
    count = min(len(force_n), length)
    damped[:count] = force_n[:count] * np.exp(-grid.sigma * step_s * np.arange(count))
    s = grid.s
    held = -np.expm1(-s * step_s) / s
    return np.asarray(np.fft.rfft(damped)[: len(s)] * held)
