"""How many frequencies a scene needs: an a-priori estimate of what truncation costs."""

import math

from plant.contact import Contact, Sphere
from plant.plate import Plate, residual_flexibility_m_n


def expected_error(
    sphere: Sphere, plate: Plate, contact: Contact, frequency_limit_hz: float
) -> float:
    """Estimated error of the penetration, relative to its largest value, from leaving out
    all modes above a limit.

    What is left out acts as a spring in series; its share is its flexibility times the
    secant stiffness s sqrt(p) of the contact at the penetration that a rigid plate would
    see, which the plate's giving way only lowers. Where the estimate is below 0.1, measured
    errors were 0.1 to 1.1 times it: most for a small sphere, whose contact ends late by what
    the spring adds. Step-size error is not included.
    """
    s, m, v = contact.stiffness, sphere.mass_kg, sphere.impact_speed_m_s
    p_max = (1.25 * m * v * v / s) ** 0.4
    flexibility = residual_flexibility_m_n(plate, 2.0 * math.pi * frequency_limit_hz)
    return flexibility * s * math.sqrt(p_max)


def frequency_limit_hz(
    sphere: Sphere, plate: Plate, contact: Contact, step_s: float, accuracy: float
) -> float:
    """Lowest limit whose estimated error meets `accuracy`; at most pi/dt, i.e. 1/(2 step_s) Hz."""
    nyquist = 0.5 / step_s
    needed = nyquist * expected_error(sphere, plate, contact, nyquist) / accuracy
    return nyquist if needed > nyquist else needed
