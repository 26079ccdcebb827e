"""An impact on an infinite thin plate, without gravity (Zener 1941, Phys. Rev. 59, 669).

p'' + p^1.5 + lambda (p^1.5)' = 0, p(0) = 0, p'(0) = 1, until the penetration p is zero again. The
units of time and force are t* = (m/(s sqrt(v)))^(2/5) and m v/t*.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from hertzloop.plant.contact.hertz import Contact, Sphere
from hertzloop.plant.estimates.criteria import zener_inelasticity, zener_unit_s
from hertzloop.plant.structures.plate import Plate

_LONGEST = 40.0  # times 1 + lambda


class ZenerImpact(NamedTuple):
    """Lambda, contact time (s) and peak force (N) of an impact."""

    inelasticity: float
    contact_s: float
    peak_force_n: float


@lru_cache(maxsize=4096)
def solved(inelasticity: float) -> tuple[float, float, float]:
    """Length, peak force and coefficient of restitution, in the units above."""

    # With x = sqrt(p), dt = x dz and the speed v of the sphere, which is smooth at both ends.
    def rates(_: float, y: np.ndarray) -> list[float]:
        x, v, _t = y
        return [0.5 * (v - inelasticity * x**3), -(x**4), x]

    def deepest(_: float, y: np.ndarray) -> float:
        return float(y[1] - inelasticity * y[0] ** 3)

    def out(z: float, y: np.ndarray) -> float:
        return float(y[0]) if z > 0.0 else 1.0

    def long(_: float, y: np.ndarray) -> float:
        return float(y[2]) - _LONGEST * (1.0 + inelasticity)

    out.terminal = long.terminal = True  # type: ignore[attr-defined]
    found = scipy.integrate.solve_ivp(
        rates, (0.0, 1e6), [0.0, 1.0, 0.0], "LSODA", None, False, (deepest, out, long),
        rtol=1e-9, atol=1e-11,
    )  # fmt: skip
    peak = max(float(y[0]) ** 3 for y in found.y_events[0])  # type: ignore[index]
    _, speed, length = found.y[:, -1].tolist()
    return length, peak, -speed


def zener_impact(sphere: Sphere, plate: Plate, contact: Contact) -> ZenerImpact:
    """The impact on an infinite plate. Where lambda is large that keeps the sphere for long, and
    only reflections throw it off: a measured length is better there."""
    number, unit_s = zener_inelasticity(sphere, plate, contact), zener_unit_s(sphere, contact)
    length, peak, _ = solved(float(f"{number:.6g}"))
    force_n = sphere.mass_kg * sphere.impact_speed_m_s / unit_s
    return ZenerImpact(number, length * unit_s, peak * force_n)
