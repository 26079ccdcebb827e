"""How many frequencies a scene needs: an a-priori estimate of what truncation costs."""

import math

from plant.contact import Contact, Sphere, rigid_contact_time_s
from plant.plate import Plate, residual_flexibility_m_n

# With the spring: 95 % of 103 random scenes (steel, aluminium, oak and Sylomer, radius 1 to 25 mm,
# plates of 0.15 to 0.8 m and 1 to 13 mm, drops of 3 mm to 0.5 m) stay below this factor; the
# median is 0.22. The exponent is the one with the least scatter.
_SPRING_FACTOR, _SPRING_EXPONENT = 0.65, 1.3


def expected_error(
    sphere: Sphere,
    plate: Plate,
    contact: Contact,
    frequency_limit_hz: float,
    *,
    spring: bool = False,
) -> float:
    """Estimated error of the penetration, relative to its largest value, from leaving out
    all modes above a limit, with or without a spring in their place.

    What is left out acts as a spring in series; its share is its flexibility times the
    secant stiffness s sqrt(p) of the contact at the penetration that a rigid plate would
    see, which the plate's giving way only lowers. Without the spring that share is the error:
    where it is below 0.1, measured errors were 0.1 to 1.1 times it, most for a small sphere,
    whose contact ends late by what the spring adds. With the spring only its inertia is
    missing, which counts by how many periods of the limit the contact on a rigid plate lasts:
    measured errors scatter around share (limit T)^-1.3. Step-size error is not included.
    """
    s, m, v = contact.stiffness, sphere.mass_kg, sphere.impact_speed_m_s
    p_max = (1.25 * m * v * v / s) ** 0.4
    flexibility = residual_flexibility_m_n(plate, 2.0 * math.pi * frequency_limit_hz)
    share = flexibility * s * math.sqrt(p_max)
    if not spring:
        return share
    periods = frequency_limit_hz * rigid_contact_time_s(m, s, v)
    return _SPRING_FACTOR * share * periods**-_SPRING_EXPONENT


def frequency_limit_hz(
    sphere: Sphere,
    plate: Plate,
    contact: Contact,
    step_s: float,
    accuracy: float,
    *,
    spring: bool = False,
) -> float:
    """Lowest limit whose estimated error meets `accuracy`; at most pi/dt, i.e. 1/(2 step_s) Hz."""
    nyquist = 0.5 / step_s
    error = expected_error(sphere, plate, contact, nyquist, spring=spring)
    # The estimate is a power of the limit.
    power = 1.0 + _SPRING_EXPONENT if spring else 1.0
    needed = nyquist * (error / accuracy) ** (1.0 / power)
    return nyquist if needed > nyquist else needed
