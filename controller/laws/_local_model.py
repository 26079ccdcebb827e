"""What a sphere on an infinite plate will do next (Zener 1941): shared by laws that look ahead."""

import math

from hertzloop.common.elementary_kernels import exp, log
from hertzloop.controller.law import kernel
from hertzloop.controller.laws._threshold import slope

_LEAST_PARTS, _MOST_PARTS = 16, 512  # of the time over which the model is integrated
# Steps as shares of the time in which the contact changes: the longest that is taken as it is, and
# what is taken instead of longer ones, which would be unstable.
_LONGEST, _INSTEAD = 1.0, 0.25


@kernel
def acceleration(p, xi, speed):
    """xi'' of a sphere against an infinite plate, F/m + F'/Z; 0 in flight."""
    if xi >= p.contact_level:
        return 0.0
    root = math.sqrt(max(-xi, 0.0))
    force = -p.stiffness * xi * root
    return force / p.mass_kg - 1.5 * p.stiffness * root * speed / p.impedance_n_s_m


@kernel
def contact_time_s(p, xi, speed):
    """In what time a contact changes, s: one over the sum of natural frequency and decay rate,
    where the state's whole energy is in the contact; infinite without energy."""
    depth = max(-xi, 0.0)
    energy = depth * depth * math.sqrt(depth) + 1.25 * p.mass_kg / p.stiffness * speed * speed
    if not energy > 0.0:
        return math.inf
    spring = 1.5 * p.stiffness * exp(0.2 * log(energy))  # 1.5 s sqrt(p)
    return 1.0 / (math.sqrt(spring / p.mass_kg) + spring / p.impedance_n_s_m)


@kernel
def step_s(p, xi, speed):
    """A step that the midpoint rule can take: a flight is exact in one, up to the contact."""
    within = _INSTEAD * contact_time_s(p, xi, speed)
    if xi < p.contact_level:
        return within
    return (xi - p.contact_level) / -speed + within if speed < 0.0 else math.inf


@kernel
def predict_contact(p, samples, i, ahead):
    """What the model expects `ahead` samples after sample `i`.

    Integrated from the middle of the slope's window (midpoint rule), in equal steps where these
    resolve the contact. Returns xi (m), its slope
    (m/s), and, in samples after `i` or infinite: when contact begins, when the slope
    first passes the threshold in contact.
    """
    width = p.slope_weights.size
    xi = 0.0
    for k in range(width):
        xi += samples[i - k]
    xi /= width
    speed = slope(p, samples, i)
    back = 0.5 * (width - 1)
    parts = min(max(int(back + ahead) + 1, _LEAST_PARTS), _MOST_PARTS)
    dt = (back + ahead) * p.sample_s / parts
    equal = dt <= _LONGEST * contact_time_s(p, xi, speed)
    touches, crosses = math.inf, math.inf
    at, steps = 0.0, 0  # `at` counts parts
    while at < parts and steps < _MOST_PARTS:
        part = 1.0 if equal else min(step_s(p, xi, speed) / dt, parts - at)
        h = part * dt
        half = speed + 0.5 * h * acceleration(p, xi, speed)
        to = xi + h * half
        new = speed + h * acceleration(p, xi + 0.5 * h * speed, half)
        if touches == math.inf and to <= p.contact_level:
            share = (xi - p.contact_level) / (xi - to) if xi > p.contact_level else 0.0
            touches = (at + share * part) * dt / p.sample_s - back
        if crosses == math.inf and to <= p.contact_level and new > p.v_thr_m_s:
            share = (p.v_thr_m_s - speed) / (new - speed) if speed < p.v_thr_m_s else 0.0
            crosses = (at + share * part) * dt / p.sample_s - back
        xi, speed = to, new
        at += part
        steps += 1
    if at < parts:  # a heavy sphere never leaves: F/m = F'/Z from here on
        faded = exp(-(parts - at) * dt * p.impedance_n_s_m / (1.5 * p.mass_kg))
        return xi * faded, speed * faded, touches, crosses
    return xi, speed, touches, crosses
