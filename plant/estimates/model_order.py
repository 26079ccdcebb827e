"""How many frequencies a scene needs: an a-priori estimate of what truncation costs.

The modes that are left out act as a spring between the sphere and the plate. Those among the
frequencies of the impact would also take energy.
"""

import math

import numpy as np

from hertzloop.common.protocols import Structure
from hertzloop.plant.contact.hertz import Contact, Sphere, rigid_impact
from hertzloop.plant.plant import PlantSpec

# With the spring: 95 % of 103 random scenes (steel, aluminium, oak and Sylomer, radius 1 to 25 mm,
# plates of 0.15 to 0.8 m and 1 to 13 mm, drops of 3 mm to 0.5 m) stay below this factor; the
# median is 0.22. The exponent is the one with the least scatter. A damped mode would do with 0.3
# and 1.4, which saves 0.23 of the modes at 1e-3: too little for other samples of every scene.
_SPRING_FACTOR, _SPRING_EXPONENT = 0.65, 1.3
# Twice the share is enough for the sphere alone; what answers it with a force of its own, as a law
# does, has put in up to 3 times as much again.
_ENERGY_FACTOR = 7.0
# A force held from sample to sample is a staircase. What its steps put in above half the sampling
# frequency, no modes below hold; a damped mode takes about as much. Error of the plate energy over
# share (hold/T)^2: 0.03 to 0.98 times the first in 38 of 40 random scenes with a law.
_HELD_DAMPED, _HELD_SPRING = 0.4, 1.5
# A force that is switched on a thin plate: in 22 random scenes gap and plate energy erred by 0.1 to
# 1.5 times jump times share with a damped mode, by 0.1 to 1.3 times jump^2/(limit T) with the
# spring.
_JUMP, _JUMP_SPRING = 1.6, 1.6
# A damper in the contact asks for the rate of the penetration, in which that of the spring is
# missing: errors of the plate energy were 0.9 to 2.2 times d R F/T.
_DAMPER_FACTOR = 2.5

# Modes that end far below an impact, with an infinite plate in the place of the rest:
# peak force and plate energy, relative, and the rebound speed over the impact speed are within it
# on 99 % of random plates: `python -m benchmarks.few_modes`.
_FEW = 0.15

# Share of the energy of a pulse sin(pi t/T)^1.5, on a plate of constant mobility, above the
# frequency x/T: pairs (x, share); beyond the last as x^-4.
_BEYOND = (
    (0.01, 0.986),
    (0.05, 0.93),
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

    Measured shares of 40 random first impacts were at most 1.9 times it, without a law.
    """
    if periods <= 0.0:  # of modes that end with those of a rigid body
        return 1.0
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


def is_rigid(plate: Structure) -> bool:
    """Whether a structure is a rigid body: a file of modes without a frequency above zero, and
    without a residual flexibility. Such a model leaves out nothing."""
    table = plate.mode_table
    rigid = table is not None and float(table.omega_rad_s[-1]) == 0.0
    return rigid and plate.residual_flexibility_m_n(0.0) == 0.0


def damper_error(
    sphere: Sphere, plate: Structure, contact: Contact, frequency_limit_hz: float
) -> float:
    """Estimated error of the plate energy, relative to itself, from a damper in the contact in
    series with the massless spring of the modes above a limit: 2.5 (c + d F) R/T, with peak force
    F and length T on a rigid plate. A damped mode in place of the spring is without it."""
    rigid = rigid_impact(sphere, contact)
    damper = contact.viscous_n_s_m + contact.hunt_crossley_s_m * rigid.peak_n
    flexibility = plate.residual_flexibility_m_n(2.0 * math.pi * frequency_limit_hz)
    return _DAMPER_FACTOR * damper * flexibility / rigid.contact_s


def law_error(spec: PlantSpec, force_n: float, share: float, hold_s: float) -> float:
    """Estimated error of gap or plate energy, relative, from the steps of a law's force.

    Args:
        spec: plant with modes, and something that stands for those left out.
        force_n: largest force, N; a law that says it may switch it on and off at any sample.
        share: largest force over the contact force; of a law without a largest force.
        hold_s: time between two samples, over which a force is held.
    """
    parts, damped = (spec.sphere, spec.plate, spec.contact), spec.damped_residual
    rigid, limit_hz = rigid_impact(spec.sphere, spec.contact), spec.frequency_limit_hz
    switched, bandwidth_hz = force_n < math.inf, spec.actuator.bandwidth_hz or math.inf
    rounded = min(1.0, (bandwidth_hz / (limit_hz if switched else 1.0 / hold_s)) ** 2)
    if not switched:
        factor = _HELD_DAMPED if damped else _HELD_SPRING
        return factor * (rounded * min(share, 1.0)) * (hold_s / rigid.contact_s) ** 2
    jump = rounded * force_n / rigid.peak_n
    gap = _JUMP * jump * expected_error(*parts, limit_hz)
    return gap if damped else max(gap, _JUMP_SPRING * jump**2 / (limit_hz * rigid.contact_s))


def expected_error(
    sphere: Sphere,
    plate: Structure,
    contact: Contact,
    frequency_limit_hz: float,
    *,
    spring: bool = False,
    damped: bool = False,
) -> float:
    """Estimated error of the penetration, relative to its largest value, from leaving out
    all modes above a limit; with a `spring` in their place the larger of that and the missing
    share of the plate energy (the rebound speed follows better than either), and what it costs a
    damper in the contact unless it is a `damped` mode.

    What is left out acts as a spring in series; its share is its flexibility times the
    secant stiffness s sqrt(p) of the contact at the penetration that a rigid plate would
    see, which the plate's giving way only lowers. Without the spring that share is the error:
    where it is below 0.1, measured errors were 0.1 to 1.1 times it, most for a small sphere,
    whose contact ends late by what the spring adds. With the spring only its inertia is
    missing, which counts by how many periods of the limit the contact on a rigid plate lasts:
    measured errors scatter around share (limit T)^-1.3. Step-size error is not included.
    """
    if is_rigid(plate):
        return 0.0
    rigid = rigid_impact(sphere, contact)
    flexibility = plate.residual_flexibility_m_n(2.0 * math.pi * frequency_limit_hz)
    share = flexibility * contact.stiffness * rigid.rise
    if not spring:
        return share
    periods = frequency_limit_hz * rigid.contact_s
    found = min(1.0, _ENERGY_FACTOR * energy_beyond(periods))
    if periods > 0.0:  # else the modes are those of a rigid body, and all of the energy is beyond
        found = max(_SPRING_FACTOR * share * periods**-_SPRING_EXPONENT, found)
    if plate.highest_hz < math.inf:
        found = min(found, few_modes_error(plate) if damped else 1.0)
    return found if damped else found + damper_error(sphere, plate, contact, frequency_limit_hz)


def few_modes_error(plate: Structure) -> float:
    """Estimated error of a first impact, relative, with an infinite plate in the place of all modes
    above any limit; 1 where there is no such plate. Its length may differ by more."""
    return 1.0 if plate.local_plate is None else _FEW


def beyond_m_n(plate: Structure) -> float:
    """Flexibility of the modes beyond those of a file, if they go on as they do in it: as many in a
    band, as mobile; m/N."""
    table = plate.mode_table
    assert table is not None
    if table.omega_rad_s[-1] == 0.0:  # no frequency says how the modes go on
        return 0.0
    mobile = float(np.sum(table.shape_contact**2 * table.per_modal_mass_1_kg))
    return mobile / float(table.omega_rad_s[-1]) ** 2


def frequency_limit_hz(
    sphere: Sphere,
    plate: Structure,
    contact: Contact,
    step_s: float,
    accuracy: float,
    *,
    spring: bool = False,
    damped: bool = False,
) -> float:
    """Lowest limit whose estimated error meets `accuracy`; at most pi/dt, i.e. 1/(2 step_s) Hz.

    The flexibility of the modes left out follows from it. So below pi/dt it has ten digits: the
    powers and logarithms that it is made of differ between processors in the last one.
    """
    nyquist = 0.5 / step_s
    share = expected_error(sphere, plate, contact, nyquist)
    if not spring:
        return min(nyquist, _ten_digits(nyquist * share / accuracy))
    lasts_s = rigid_impact(sphere, contact).contact_s
    error = _SPRING_FACTOR * share * (nyquist * lasts_s) ** -_SPRING_EXPONENT
    # These parts of the estimate are powers of the limit.
    for_gap = nyquist * (error / accuracy) ** (1.0 / (1.0 + _SPRING_EXPONENT))
    limit = max(for_gap, _periods_for(accuracy / _ENERGY_FACTOR) / lasts_s)
    if contact.has_damper and not damped:
        limit += nyquist * damper_error(sphere, plate, contact, nyquist) / accuracy
    return min(nyquist, _ten_digits(limit))


def _ten_digits(number: float) -> float:
    return float(f"{number:.10g}")


def least_limit_hz(
    sphere: Sphere, plate: Structure, contact: Contact, frequency_limit_hz: float
) -> float:
    """Lowest limit at which `expected_error` with a spring is below 1, so that modes hold a part
    of the impact, if those beyond `frequency_limit_hz` stay as flexible as they are; inf where a
    damper in the contact costs as much at any limit."""
    lasts_s = rigid_impact(sphere, contact).contact_s
    rest = 1.0 - damper_error(sphere, plate, contact, frequency_limit_hz)
    if rest <= 0.0:
        return math.inf
    share = expected_error(sphere, plate, contact, frequency_limit_hz)
    for_gap = (_SPRING_FACTOR * share / rest) ** (1.0 / _SPRING_EXPONENT)
    return max(for_gap, _periods_for(rest / _ENERGY_FACTOR)) / lasts_s
