"""How many modes a plate in three dimensions needs: an a-priori estimate of what truncation costs.

As for a thin plate (`model_order`), and what is new in a solid: the modes left out near the contact
are heavy, so that the spring in their place is wrong by their inertia, which falls as slowly
as 1/limit. Errors of plate energy and rebound speed of impacts on thick plates were 0.3 to 1.4
times that share of the contact's flexibility, of the gap itself 1 to 4 times.
"""

import math

import scipy

from plant.contact.hertz import Contact, Sphere, rigid_contact_time_s, rigid_penetration_m
from plant.structures.model_order import expected_error
from plant.structures.solid_plate import SolidPlate

_LOWEST = 1e-2  # of the highest limit


def expected_solid_error(
    sphere: Sphere, plate: SolidPlate, contact: Contact, frequency_limit_hz: float
) -> float:
    """Estimated error of plate energy, relative to itself, and rebound speed, to the impact speed,
    from leaving out all modes above a limit."""
    s, m, v = contact.stiffness, sphere.mass_kg, sphere.impact_speed_m_s
    limit, impact = (
        2.0 * math.pi * frequency_limit_hz,
        2.0 * math.pi / rigid_contact_time_s(m, s, v),
    )
    share = plate.residual_inertia_m_n(limit, impact) * s * math.sqrt(rigid_penetration_m(m, s, v))
    return max(share, expected_error(sphere, plate, contact, frequency_limit_hz, spring=True))


def solid_limit_hz(
    sphere: Sphere, plate: SolidPlate, contact: Contact, highest_hz: float, accuracy: float
) -> float:
    """Lowest limit whose estimated error meets `accuracy`; at most `highest_hz`."""

    def excess(log_hz: float) -> float:
        return math.log(expected_solid_error(sphere, plate, contact, math.exp(log_hz)) / accuracy)

    high = math.log(highest_hz)
    low = high + math.log(_LOWEST)
    if excess(high) >= 0.0:
        return highest_hz
    return math.exp(
        low if excess(low) <= 0.0 else float(scipy.optimize.brentq(excess, low, high, rtol=1e-3))
    )
