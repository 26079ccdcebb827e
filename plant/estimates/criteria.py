"""How large neglected effects are: closed forms, each with its source.

Lengths are in m, times in s, forces in N, speeds in m/s. A result is a ratio unless its function
says otherwise.
"""

import math
from functools import lru_cache

import numpy as np

from hertzloop.plant.contact.hertz import Sphere
from hertzloop.plant.structures import radiation
from hertzloop.plant.structures.plate import Plate
from hertzloop.plant.structures.radiation import AIR_DENSITY_KG_M3, critical_frequency_hz

_VISCOSITY_PA_S = 1.81e-5  # of air
_ROUGHNESS_M = 1e-7  # gap at which a film of air ends
_DRAG = 0.47  # coefficient of a sphere
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


def thickness_periods(plate: Plate, contact_s: float) -> float:
    """Periods of the plate's first thickness resonance, c_T/(2 h), that a contact lasts."""
    return contact_s * plate.material.shear_speed_m_s / (2.0 * plate.thickness_m)


def first_return_s(
    plate: Plate, size_m: tuple[float, float], point_m: tuple[float, float], contact_s: float
) -> float:
    """When bending waves of the frequency 1/T come back from the nearest edge, s: the way there
    and back at the group speed 2 sqrt(a w), a = sqrt(B'/m'')."""
    way = 2.0 * min(min(x, side - x) for x, side in zip(point_m, size_m, strict=True))
    a = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    return way / (2.0 * math.sqrt(a * 2.0 * math.pi / contact_s))


def revival_s(plate: Plate, side_m: float) -> float:
    """When all modes of a square simply supported plate of Kirchhoff's are in phase again, s: their
    frequencies are whole multiples of omega_unit = sqrt(B'/m'') (pi/l)^2, those that its centre
    moves in with a common step of 8 of it. Dispersion of a real plate forbids that."""
    a = math.sqrt(plate.bending_stiffness_n_m / plate.mass_per_area_kg_m2)
    return 2.0 * math.pi / (8.0 * a * (math.pi / side_m) ** 2)


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


def residual_share(
    damping_s_m: float, flexibility_m_n: float, force_n: float, contact_s: float
) -> float:
    """Relative error of the plate energy by the rate that a massless spring R_0 hides from a damper
    d in the contact: 2.5 d R_0 F/T, measured 0.9 to 2.2 times d R_0 F/T."""
    return 2.5 * damping_s_m * flexibility_m_n * force_n / contact_s


def mass_that_matters_kg(sphere: Sphere, plate: Plate, contact_s: float) -> float:
    """Mass on the plate from which on it counts, kg: 0.05 of the sphere's, or 0.05 of the plate's
    point impedance at 1/T, whichever is less."""
    impedance = plate.infinite_plate_impedance_n_s_m
    return 0.05 * min(sphere.mass_kg, impedance * contact_s / (2.0 * math.pi))
