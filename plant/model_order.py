"""How many frequencies a scene needs: an a-priori estimate of what truncation costs."""

import math

import numpy as np

from plant.contact import Contact, Sphere, rigid_contact_time_s
from plant.plate import Plate, residual_flexibility_m_n

# With the spring: 95 % of 103 random scenes (steel, aluminium, oak and Sylomer, radius 1 to 25 mm,
# plates of 0.15 to 0.8 m and 1 to 13 mm, drops of 3 mm to 0.5 m) stay below this factor; the
# median is 0.22. The exponent is the one with the least scatter.
_SPRING_FACTOR, _SPRING_EXPONENT = 0.65, 1.3
_ENERGY_FACTOR = 2.0

# Share of the energy of a pulse sin(pi t/T)^1.5, on a plate of constant mobility, above the
# frequency x/T: pairs (x, share); beyond the last as x^-4.
_BEYOND = (
    (0.25, 0.65),
    (0.5, 0.358),
    (0.75, 0.161),
    (1, 0.0549),
    (1.25, 0.013),
    (1.5, 0.00248),
    (2, 0.0013),
    (3, 0.000212),
    (4, 6.2e-05),
    (6, 1.14e-05),
    (8, 3.49e-06),
    (12, 6.67e-07),
)


def energy_beyond(periods: float) -> float:
    """Share of the plate energy that an impact of length T puts above the frequency periods/T.

    Measured shares of 40 random first impacts were at most 1.9 times it.
    """
    x, share = (np.log(np.array(column)) for column in zip(*_BEYOND, strict=True))
    at = math.log(periods)
    if at >= x[-1]:
        return math.exp(share[-1] - 4.0 * (at - x[-1]))
    return min(1.0, math.exp(float(np.interp(at, x, share))))


def _periods_for(share: float) -> float:
    """The inverse of `energy_beyond`."""
    x, shares = (np.log(np.array(column)) for column in zip(*_BEYOND, strict=True))
    wanted = math.log(share)
    if wanted <= shares[-1]:
        return math.exp(x[-1] + 0.25 * (shares[-1] - wanted))
    return math.exp(float(np.interp(-wanted, -shares, x)))


def expected_error(
    sphere: Sphere,
    plate: Plate,
    contact: Contact,
    frequency_limit_hz: float,
    *,
    spring: bool = False,
) -> float:
    """Estimated error of the penetration, relative to its largest value, from leaving out
    all modes above a limit; with a spring in their place the larger of that and the missing
    share of the plate energy (the rebound speed follows better than either).

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
    return max(
        _SPRING_FACTOR * share * periods**-_SPRING_EXPONENT,
        min(1.0, _ENERGY_FACTOR * energy_beyond(periods)),
    )


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
    s, m, v = contact.stiffness, sphere.mass_kg, sphere.impact_speed_m_s
    share = expected_error(sphere, plate, contact, nyquist)
    if not spring:
        return min(nyquist, nyquist * share / accuracy)
    lasts_s = rigid_contact_time_s(m, s, v)
    error = _SPRING_FACTOR * share * (nyquist * lasts_s) ** -_SPRING_EXPONENT
    # That part of the estimate is a power of the limit.
    for_gap = nyquist * (error / accuracy) ** (1.0 / (1.0 + _SPRING_EXPONENT))
    return min(nyquist, max(for_gap, _periods_for(accuracy / _ENERGY_FACTOR) / lasts_s))
