"""How large neglected effects are: closed forms, each with its source.

Lengths are in m, times in s, forces in N, speeds in m/s. A result is a ratio unless its function
says otherwise.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hertzloop.plant.contact.hertz import Contact, Sphere, tangent_stiffness_n_m
from hertzloop.plant.structures import radiation
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.radiation import AIR_DENSITY_KG_M3, critical_frequency_hz

_VISCOSITY_PA_S = 1.81e-5  # of air
_ROUGHNESS_M = 1e-7  # gap at which a film of air ends
_DRAG = 0.47  # coefficient of a sphere
# Against an elastic solid, five impacts of R 3 to 20 mm on 1.5 to 10 mm: errors of the plate
# energy were 0.06 to 0.085 (k h)^2, of the rebound speed 0.012 to 0.035 (k h)^2, where lambda was
# below 0.5, and less beyond.
_THIN_ENERGY, _THIN_REBOUND = 0.085, 0.04
_LONG, _SHORT = 0.03, 20.0  # k h up to which S - 1 - 6/y^3 is 1.2/y, and from which on -6/y^3
_INTERVALS = 512  # of an integral over ln(k h), even
_SPHEROIDAL = 2.65  # lowest spheroidal mode, R omega/c_T for nu of about 0.3 (Lamb 1882)


def contact_radius_m(force_n: float, radius_m: float, stiffness: float) -> float:
    """a = (3 F R/(4 E*))^(1/3) (Hertz 1882), m, of a contact of `stiffness` s = 4/3 E* sqrt(R)."""
    modulus = 0.75 * stiffness / math.sqrt(radius_m)
    return float((0.75 * force_n * radius_m / modulus) ** (1.0 / 3.0))


def mean_pressure_pa(force_n: float, contact_radius_m: float) -> float:
    """F/(pi a^2), Pa; that in the centre is 1.5 times as much (Hertz 1882)."""
    return force_n / (math.pi * contact_radius_m**2) if contact_radius_m else 0.0


def sphere_periods(sphere: Sphere, contact_s: float) -> float:
    """Periods of the sphere's lowest vibration that a contact lasts: with few the sphere is no
    rigid mass behind a spring (Love 1927, quasi-statics of Hertz)."""
    speed = _SPHEROIDAL * sphere.material.shear_speed_m_s
    return contact_s * speed / (2.0 * math.pi * sphere.radius_m)


def thickness_number(plate: Plate, contact_s: float) -> float:
    """k h, k the wave number of bending at the frequency 1/T: k^2 = 2 pi/T sqrt(m''/B')."""
    root = math.sqrt(plate.mass_per_area_kg_m2 / plate.bending_stiffness_n_m)
    return plate.thickness_m * math.sqrt(2.0 * math.pi / contact_s * root)


class ThinPlateError(NamedTuple):
    """What Kirchhoff's theory may cost, relative: of the plate energy, of the rebound speed (to the
    impact speed), and of peak force and contact time."""

    plate_energy: float
    rebound_speed: float
    peak_force: float


def thin_plate_error(
    plate: Plate, stiffness: float, contact_s: float, peak_force_n: float
) -> ThinPlateError:
    """Bounds for an impact of known length (s) and peak force (N); `stiffness`: of the contact
    (N/m^1.5). Waves of a length near the thickness are too fast, and near the force shear and the
    half space add a static deflection beyond that of Hertz's contact."""
    number = thickness_number(plate, contact_s)
    difference = abs(static_difference_m_n(plate, number))
    return ThinPlateError(
        _THIN_ENERGY * number * number,
        _THIN_REBOUND * number * number,
        difference * tangent_stiffness_n_m(stiffness, peak_force_n),
    )


@lru_cache(maxsize=64)
def static_difference_m_n(plate: Plate, number: float) -> float:
    """By how much a solid plate gives way more under a static force than Kirchhoff's plate and
    Hertz's half space together, by waves of k h above `number`; m/N, of either sign.

    (1 - nu^2)/(pi E h) I(k h), I(x) = integral from x of S(y) - 1 - 6/y^3, S the compliance of a
    layer over that of a half space.
    """
    start, found = max(number, _LONG), 0.0
    if start < _SHORT:
        length = math.log(_SHORT / start)
        y = start * np.exp(length * np.linspace(0.0, 1.0, _INTERVALS + 1))  # dy = y d(ln y)
        sinh = np.sinh(y)
        beyond = y * ((sinh * np.cosh(y) + y) / (sinh * sinh - y * y) - 1.0 - 6.0 / y**3)
        simpson = beyond[0] + beyond[-1] + 4.0 * beyond[1::2].sum() + 2.0 * beyond[2:-1:2].sum()
        found = length / (3.0 * _INTERVALS) * float(simpson)
    found -= 3.0 / max(start, _SHORT) ** 2
    if number < _LONG:
        found += 1.2 * math.log(_LONG / number)
    return found / (math.pi * plate.material.plane_strain_modulus_pa * plate.thickness_m)


def zener_unit_s(sphere: Sphere, contact: Contact) -> float:
    """t* = (m/(s sqrt(v)))^(2/5), s."""
    root = math.sqrt(sphere.impact_speed_m_s)
    return float((sphere.mass_kg / (contact.stiffness * root)) ** 0.4)


def zener_inelasticity(sphere: Sphere, plate: Plate, contact: Contact) -> float:
    """lambda = m/(Z t*) (Zener 1941): small, the sphere bounces as on a rock; above 1 the plate
    takes everything."""
    return sphere.mass_kg / (plate.infinite_plate_impedance_n_s_m * zener_unit_s(sphere, contact))


def first_return_s(
    plate: Plate, size_m: tuple[float, float], point_m: tuple[float, float], contact_s: float
) -> float:
    """When bending waves of the frequency 1/T come back from the nearest edge, s: the way there
    and back at the group speed 2 sqrt(a w), a = sqrt(B'/m'')."""
    way = 2.0 * min(min(x, side - x) for x, side in zip(point_m, size_m, strict=True))
    a = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    return way / (2.0 * math.sqrt(a * 2.0 * math.pi / contact_s))


def reflections_error(late: float, inelasticity: float, share: float, late_copy: float) -> float:
    """Expected error of an infinite plate in the place of a simply supported one, the larger of the
    gap (relative to its largest value in contact) and the plate energy (to itself).

    Waves above the frequency late^-2/T have come back by then, of which the smooth force of a
    contact holds little. The factors are those of image sources, which 97 % of 212 random scenes
    stay below; errors of whole contacts were up to 1.44 times what these give, hence the 1.5.

    Args:
        late: time since the first touch over `first_return_s`.
        inelasticity: Zener's lambda.
        share: largest force of an actuator that copies the contact force, over that.
        late_copy: as `late`, when that force ends.
    """
    gap = 0.035 * inelasticity * (1.0 + share) * late**6
    return 1.5 * max(gap, 0.003 * late**6 + 0.008 * share * (1.0 + share) * late_copy**6)


def switched_error(late: float, inelasticity: float, share: float, contacts: float) -> float:
    """What a force that may be switched on and off at any time, of `share` of the contact's, adds
    to `reflections_error`; `contacts`: the time since the first touch in contact times."""
    gap = 0.18 * inelasticity * share * contacts
    return 1.5 * late**4 * max(gap, share * (0.09 + 0.1 * share * contacts))


def zener_contact_s(inelasticity: float, rigid_s: float) -> float:
    """How long a contact lasts on an infinite plate, s, by its length on a rigid one; a fit of
    Zener's equation up to lambda = 3, and too long between."""
    return rigid_s * (1.0 + inelasticity * (0.3 + 0.4 * inelasticity))


@lru_cache(maxsize=16)
def air_loss_factor(plate: Plate) -> float:
    """Loss factor rho0 c/(omega m''), one face, of modes that radiate as strongly as a piston, at
    1.3 times the critical frequency, above which that is so (Cremer, Heckl and Petersson 2005)."""
    piston = np.array([1.3 * critical_frequency_hz(plate)])
    return float(radiation.air_loss_factor(plate, piston, lambda _, f: np.ones_like(f))[0])


def squeezed_film(sphere: Sphere) -> float:
    """Share of the sphere's energy that the film of air takes on the way in: 6 pi mu R^2
    ln(R/1e-7 m) v against m v^2/2 (Reynolds' lubrication, without compressibility)."""
    r, v = sphere.radius_m, sphere.impact_speed_m_s
    work = 6.0 * math.pi * _VISCOSITY_PA_S * r * r * math.log(r / _ROUGHNESS_M) * v
    return work / (0.5 * sphere.mass_kg * v * v)


def drag_on_the_drop(sphere: Sphere) -> float:
    """Share of the energy of the fall that drag takes: 3/8 C_D rho0 H/(rho_s R), C_D = 0.47."""
    density = sphere.material.density_kg_m3
    radius = sphere.radius_m
    return 0.375 * _DRAG * AIR_DENSITY_KG_M3 * sphere.drop_height_m / (density * radius)


def mass_that_matters_kg(sphere: Sphere, plate: Plate, contact_s: float) -> float:
    """Mass on the plate from which on it counts, kg: 0.05 of the sphere's, or 0.05 of the plate's
    point impedance at 1/T, whichever is less."""
    impedance = plate.infinite_plate_impedance_n_s_m
    return 0.05 * min(sphere.mass_kg, impedance * contact_s / (2.0 * math.pi))
