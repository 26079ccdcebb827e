"""When is a thin plate thin enough? What Kirchhoff's theory leaves out of an impact, a priori.

Kirchhoff's plate has no thickness but in its stiffness: waves of a length near the thickness
h are too fast, and the static deflection near a force lacks what shear and the half space
add beyond Hertz's contact. How much either costs follows from two numbers: k h, k the wave number
of bending at the frequency 1/T of a contact of length T, and Zener's lambda, the sphere's mass
over the plate's point impedance in units of the contact's time.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.plant.contact.hertz import (
    Contact,
    Sphere,
    tangent_stiffness_n_m,
)
from hertzloop.plant.structures.plate import Plate

# Against an elastic solid, five impacts of R 3 to 20 mm on 1.5 to 10 mm: errors of the plate
# energy were 0.06 to 0.085 (k h)^2, of the rebound speed 0.012 to 0.035 (k h)^2, where lambda was
# below 0.5, and less beyond.
_ENERGY_FACTOR, _REBOUND_FACTOR = 0.085, 0.04
_SERIES = 0.03  # of k h, below which the integral is a logarithm
_RAYLEIGH = 20.0  # k h from which on a layer is a half space, and S - 1 - 6/y^3 its last term alone
_INTERVALS = 512  # of an integral over ln(k h), even
_LONGEST = 40.0  # of Zener's impact, in units of (1 + lambda) t*
_TOLERANCE = 1e-9  # of a step of Zener's impact, in units of t* and of the impact speed
_COLUMNS = 6  # of its extrapolation
_NEWTON = 6  # iterations to a peak or an end within a step


class KirchhoffError(NamedTuple):
    """What Kirchhoff's theory may cost, relative: of the plate energy to itself, of the rebound
    speed to the impact speed, of the peak force and the contact time to themselves; the `largest`
    of the three, what `run.accuracy` is compared with."""

    plate_energy: float
    rebound_speed: float
    peak_force: float
    largest: float


class ZenerImpact(NamedTuple):
    """An impact on an infinite thin plate (Zener 1941): lambda, contact (s), peak (N)."""

    inelasticity: float
    contact_s: float
    peak_force_n: float


def thickness_number(plate: Plate, contact_s: float) -> float:
    """k h at the frequency 1/T of a contact of `contact_s` (s): k^2 = 2 pi/T sqrt(m''/B')."""
    root = math.sqrt(plate.mass_per_area_kg_m2 / plate.bending_stiffness_n_m)
    return plate.thickness_m * math.sqrt(2.0 * math.pi / contact_s * root)


def zener_inelasticity(sphere: Sphere, plate: Plate, contact: Contact) -> float:
    """lambda = m/(Z t*), t* = (m/(s sqrt(v)))^(2/5): small, the sphere bounces as on a rock; above
    1 the plate takes everything."""
    return sphere.mass_kg / (plate.infinite_plate_impedance_n_s_m * _unit_s(sphere, contact))


def zener_impact(sphere: Sphere, plate: Plate, contact: Contact) -> ZenerImpact:
    """What an impact without gravity and contact damping is on an infinite thin plate. Where lambda
    is large that keeps the sphere for long, and only reflections throw it off: a measured length
    is better there."""
    number = zener_inelasticity(sphere, plate, contact)
    lasts, peak = _zener(number)
    unit_s = _unit_s(sphere, contact)
    force_n = sphere.mass_kg * sphere.impact_speed_m_s / unit_s
    return ZenerImpact(number, lasts * unit_s, peak * force_n)


def static_difference_m_n(plate: Plate, number: float) -> float:
    """By how much a solid plate gives way more under a static force than Kirchhoff's plate and
    Hertz's half space together, by waves of k h above `number`; m/N, of either sign.

    (1 - nu^2)/(pi E h) I(k h), I(x) = integral from x of S(y) - 1 - 6/y^3, S the compliance of a
    layer over that of a half space.
    """
    return _beyond(number) / (math.pi * plate.material.plane_strain_modulus_pa * plate.thickness_m)


def kirchhoff_error(
    plate: Plate, stiffness: float, contact_s: float, peak_force_n: float
) -> KirchhoffError:
    """What Kirchhoff's theory may cost an impact of known length (s) and peak force (N), as bounds;
    `stiffness`: of the contact (N/m^1.5)."""
    number = thickness_number(plate, contact_s)
    share = tangent_stiffness_n_m(stiffness, peak_force_n)
    energy, speed = _ENERGY_FACTOR * number * number, _REBOUND_FACTOR * number * number
    force = abs(static_difference_m_n(plate, number)) * share
    return KirchhoffError(energy, speed, force, max(energy, speed, force))


def _unit_s(sphere: Sphere, contact: Contact) -> float:
    """Zener's unit of time."""
    root = math.sqrt(sphere.impact_speed_m_s)
    return float((sphere.mass_kg / (contact.stiffness * root)) ** 0.4)


@lru_cache(maxsize=64)
def _zener(number: float) -> tuple[float, float]:
    """Length and peak force of a'' + (1 + 1.5 lambda a'/a) a^1.5 = 0, a = 0 and a' = 1 before.

    With x = sqrt(a), dt = x ds and the sphere's speed v this is dx/ds = (v - lambda x^3)/2 and
    dv/ds = -x^4, which is smooth at both ends of the contact. A large lambda makes it stiff. Takes
    0.5 ms; SciPy's solver takes 5 ms, and 0.2 s of every start to import.
    """
    state, length, peak = (0.0, 1.0, 0.0), 0.5 / (1.0 + number) ** (1.0 / 3.0), 0.0
    while True:
        (x, v, t), error = _zener_step(number, state, length)
        if error > _TOLERANCE:
            length *= max(0.2, 0.8 * (_TOLERANCE / error) ** (1.0 / _COLUMNS))
            continue
        falls = v < number * x**3  # dx/ds < 0
        if falls and state[1] >= number * state[0] ** 3:
            at = length
            for _ in range(_NEWTON):
                (top, v_top, _), _ = _zener_step(number, state, at)
                rate = v_top - number * top**3
                at += rate / (top**4 + 1.5 * number * top * top * rate)
            peak = max(peak, top**3)
        if x <= 0.0:
            for _ in range(_NEWTON):
                (x, v, t), _ = _zener_step(number, state, length)
                length -= 2.0 * x / (v - number * x**3)
            return t, peak
        if t >= _LONGEST * (1.0 + number):
            return t, peak
        state = (x, v, t)
        length *= min(3.0, 0.8 * (_TOLERANCE / max(error, 1e-30)) ** (1.0 / _COLUMNS))


def _zener_step(
    number: float, state: tuple[float, float, float], length: float
) -> tuple[tuple[float, float, float], float]:
    """x, v and t of `_zener` after a step in s, and the error of x and v: linearly implicit Euler
    steps, extrapolated (Deuflhard 1985)."""
    x0, v0, t0 = state
    rows: list[tuple[float, float, float]] = []
    for parts in range(1, _COLUMNS + 1):
        h = length / parts
        to_x, to_v = -1.5 * number * x0 * x0, -4.0 * x0**3  # of the rates, by x
        shared = 1.0 - h * to_x - 0.5 * h * h * to_v
        x, v, t = x0, v0, t0
        for _ in range(parts):
            fall = -(x**4)
            by_x = (0.5 * (v - number * x**3) + 0.5 * h * fall) / shared
            t += h * (x + h * by_x)
            v += h * (fall + h * to_v * by_x)
            x += h * by_x
        row = [(x, v, t)]
        for k, before in enumerate(rows):
            over = parts / (parts - k - 1) - 1.0
            (x, v, t), (x_1, v_1, t_1) = row[k], before
            row.append((x + (x - x_1) / over, v + (v - v_1) / over, t + (t - t_1) / over))
        rows = row
    best, other = rows[-1], rows[-2]
    in_x = abs(best[0] - other[0]) * (1.0 + number) ** (1.0 / 3.0)  # no larger than 1 without
    return best, max(in_x, abs(best[1] - other[1]))


@lru_cache(maxsize=64)
def _beyond(number: float) -> float:
    """I(x) of `static_difference_m_n`."""
    start, found = max(number, _SERIES), 0.0
    if start < _RAYLEIGH:
        length = math.log(_RAYLEIGH / start)
        y = start * np.exp(length * np.linspace(0.0, 1.0, _INTERVALS + 1))  # dy = y d(ln y)
        sinh = np.sinh(y)
        beyond = y * ((sinh * np.cosh(y) + y) / (sinh * sinh - y * y) - 1.0 - 6.0 / y**3)
        simpson = beyond[0] + beyond[-1] + 4.0 * beyond[1::2].sum() + 2.0 * beyond[2:-1:2].sum()
        found = length / (3.0 * _INTERVALS) * float(simpson)
    found -= 3.0 / max(start, _RAYLEIGH) ** 2
    if number < _SERIES:
        found += 1.2 * math.log(_SERIES / number)  # S - 1 - 6/y^3 -> 1.2/y
    return found
