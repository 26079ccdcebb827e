"""Closed forms of the study for a single short impact: eq. 3.1, 3.3 and 3.8b."""

import math
from dataclasses import dataclass

import numpy as np

from plant.structures.radiation import AIR_DENSITY_KG_M3, SOUND_SPEED_M_S

_ALL = 1e12  # times the poles: all frequencies, to rounding


def longhorn_any_j(radius_m: float, speed_m_s: float, contact_time_s: float) -> float:
    """Eq. 3.1, acceleration noise of one change of speed over any contact time, J.

    (pi R^3/3) rho0 v0^2 x^-2 {1 - exp(-x) [cos x + sin x]}, x = c t0/R; its limit for x << 1
    is eq. 3.3, `longhorn_short_j`.
    """
    x = SOUND_SPEED_M_S * contact_time_s / radius_m
    # 1 - e^-x (cos x + sin x) = x^2 - 2/3 x^3 + x^4/6 + ...; the difference rounds away there.
    shape = 1.0 - 2.0 / 3.0 * x + x * x / 6.0
    if x > 1e-3:
        shape = (1.0 - math.exp(-x) * (math.cos(x) + math.sin(x))) / (x * x)
    return longhorn_short_j(radius_m, speed_m_s) * shape


def longhorn_short_j(radius_m: float, speed_m_s: float) -> float:
    """Eq. 3.3: (pi R^3/3) rho0 v0^2, J."""
    return math.pi * radius_m**3 / 3.0 * AIR_DENSITY_KG_M3 * speed_m_s**2


@dataclass(frozen=True)
class PointMobility:
    """Y_sys of eq. 3.8b: a mass (kg) on a massless spring (N/m) on an infinite plate (N s/m)."""

    mass_kg: float
    spring_n_m: float
    impedance_n_s_m: float

    def real(self, omega: float) -> float:
        """Re [(Y_p + j w/s)/(j w m Y_p + 1 - w^2 m/s)], m/(N s)."""
        m, s, y = self.mass_kg, self.spring_n_m, 1.0 / self.impedance_n_s_m
        above = complex(y, omega / s)
        return (above / complex(1.0 - omega**2 * m / s, omega * m * y)).real

    def share(self, omega_max: float = math.inf) -> float:
        """Integral of Re Y_sys up to a frequency (rad/s) times 2 m/pi: 1 for all, whatever the
        plate, as only the mass is moved at once.

        By the residues r of the two poles p, which lie left of the imaginary axis:
        the integral of r/(j w - p) is -j r log(j w - p).
        """
        m, s, y = self.mass_kg, self.spring_n_m, 1.0 / self.impedance_n_s_m
        poles = np.roots([m / s, m * y, 1.0]).astype(complex)
        residues = (y + poles / s) / (2.0 * poles * m / s + m * y)
        high = 1j * min(omega_max, _ALL * float(np.abs(poles).max()))
        total = np.sum(-1j * residues * (np.log(high - poles) - np.log(-poles)))
        return float(2.0 * m / math.pi * total.real)

    def energy_j(self, impulse_n_s: float, omega_max: float) -> float:
        """Eq. 3.8b, I^2/pi times the integral up to a frequency (rad/s), J."""
        return impulse_n_s**2 / (2.0 * self.mass_kg) * self.share(omega_max)
