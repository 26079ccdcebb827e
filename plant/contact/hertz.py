"""The sphere, its contact by Hertz, and the damping of the contact."""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import scipy

from hertzloop.plant.state_kernels import GRAVITY_M_S2
from hertzloop.plant.structures.materials import Material


class Damping(IntEnum):
    """Families of contact damping."""

    NONE = 0
    VISCOUS = 1  # F = c dp/dt
    HUNT_CROSSLEY = 2  # F = d s p^(3/2) dp/dt
    RELAXATION = 3  # F = -(s_tau/tau) sqrt(p) int p(t') exp(-(t - t')/tau) dt' (thesis2008 only)


@dataclass(frozen=True)
class Sphere:
    """Falling sphere: radius in m, height of the drop in m, from which its mass and speed follow
    unless they are `given` (kg, m/s)."""

    material: Material
    radius_m: float
    drop_height_m: float
    given_mass_kg: float | None = None
    given_speed_m_s: float | None = None

    @cached_property
    def mass_kg(self) -> float:
        """Mass, kg: as given, or of a ball of this radius."""
        if self.given_mass_kg is not None:
            return self.given_mass_kg
        return self.material.density_kg_m3 * 4.0 / 3.0 * math.pi * self.radius_m**3

    @cached_property
    def impact_speed_m_s(self) -> float:
        """Speed at the first contact: as given, or sqrt(2 g h), m/s."""
        if self.given_speed_m_s is not None:
            return self.given_speed_m_s
        return math.sqrt(2.0 * GRAVITY_M_S2 * self.drop_height_m)


def tangent_stiffness_n_m(stiffness: float, force_n: float) -> float:
    """dF/dp = 3/2 s^(2/3) F^(1/3) of F = s p^(3/2), N/m."""
    return float(1.5 * stiffness ** (2.0 / 3.0) * force_n ** (1.0 / 3.0))


@dataclass(frozen=True)
class Limit:
    """Where a contact yields: limiting pressure (Pa) and radius of the sphere (m)."""

    pressure_pa: float
    radius_m: float


@dataclass(frozen=True)
class Contact:
    """Contact force s p^(3/2) plus damping; p = penetration in m, s in N/m^1.5.

    `viscous_n_s_m` is c, `hunt_crossley_s_m` is d of the family in `damping`;
    `relaxation_stiffness` is s_tau (N/m^1.5), `relaxation_s` is tau, `extra_state` whether
    the relaxation's memory is one extra state, solved with a bracket, or the published sum;
    `limit`: of a contact that yields (hertzloop.plant.contact.yielding), None of an elastic one.
    """

    stiffness: float
    damping: Damping = Damping.NONE
    viscous_n_s_m: float = 0.0
    hunt_crossley_s_m: float = 0.0
    relaxation_stiffness: float = 0.0
    relaxation_s: float = 0.0
    extra_state: bool = False
    limit: Limit | None = None

    @cached_property
    def has_damper(self) -> bool:
        """Whether a force follows the rate of the penetration."""
        return self.viscous_n_s_m > 0.0 or self.hunt_crossley_s_m > 0.0


def hertz_stiffness(radius_m: float, sphere: Material, plate: Material) -> float:
    """s = 4/3 sqrt(R) E_s' E_p'/(E_s' + E_p'), N/m^1.5 (Hertz 1882)."""
    a, b = sphere.plane_strain_modulus_pa, plate.plane_strain_modulus_pa
    return 4.0 / 3.0 * math.sqrt(radius_m) * a * b / (a + b)


def hunt_crossley_parameter(restitution: float, impact_speed_m_s: float) -> float:
    """Damping d, s/m, that gives a coefficient of restitution against a rigid support.

    Exact for F = s p^(3/2) (1 + d dp/dt): dividing the equation of motion by the velocity
    and integrating both halves of the contact gives, with x = d v0 and e the restitution,
    x - ln(1 + x) + e x + ln(1 - e x) = 0, independent of s and of the mass.
    Raises ValueError unless 0 < restitution <= 1.
    """
    if not 0.0 < restitution <= 1.0:
        raise ValueError(f"restitution is {restitution:g}; it must be above 0 and at most 1")
    loss = 1.0 - restitution
    if loss < 1e-5:  # the equation's terms cancel; its root is 1.5 loss (1 + O(loss))
        return 1.5 * loss / impact_speed_m_s

    def mismatch(u: float) -> float:
        """The equation in u = -ln(1 - e x): for a small e, x is 1/e to the last digit."""
        x = -math.expm1(-u) / restitution
        return x - math.log1p(x) + restitution * x - u

    # At x = 1 - e the mismatch is above zero, at u = 1/e + 1 it is -ln(1 + x) or less.
    lower, upper = -math.log1p(-restitution * loss), 1.0 / restitution + 1.0
    u = float(scipy.optimize.brentq(mismatch, lower, upper, xtol=1e-300, rtol=1e-14))
    return -math.expm1(-u) / restitution / impact_speed_m_s


def rigid_contact_time_s(mass_kg: float, stiffness: float, speed_m_s: float) -> float:
    """Impact on a rigid half-space, without gravity, s: 3.218 (m/s)^(2/5) v^(-1/5) (Hertz 1882)."""
    factor = 4.0 * math.sqrt(math.pi) * math.gamma(0.4) / (5.0 * math.gamma(0.9)) * 1.25**0.4
    return factor * (mass_kg / stiffness) ** 0.4 * speed_m_s**-0.2


def rigid_penetration_m(mass_kg: float, stiffness: float, speed_m_s: float) -> float:
    """Largest penetration of the same impact: (5 m v^2 / (4 s))^(2/5), m."""
    return float((1.25 * mass_kg * speed_m_s**2 / stiffness) ** 0.4)


def rigid_peak_force_n(mass_kg: float, stiffness: float, speed_m_s: float) -> float:
    """Largest force of the same impact, s p^(3/2), N."""
    return stiffness * rigid_penetration_m(mass_kg, stiffness, speed_m_s) ** 1.5


class RigidImpact(NamedTuple):
    """Impact of a body on a rigid plate: contact time (s), deepest penetration p (m), largest force
    (N), and sqrt(p), which times the stiffness is the secant stiffness there."""

    contact_s: float
    deepest_m: float
    peak_n: float
    rise: float


def rigid_impact(sphere: Sphere, contact: Contact) -> RigidImpact:
    """The impact of a body by the elastic part of a contact, as the functions above."""
    given = sphere.mass_kg, contact.stiffness, sphere.impact_speed_m_s
    deepest = rigid_penetration_m(*given)
    return RigidImpact(
        rigid_contact_time_s(*given),
        deepest,
        rigid_peak_force_n(*given),
        math.sqrt(deepest),
    )
