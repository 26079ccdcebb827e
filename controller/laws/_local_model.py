"""What a sphere on an infinite plate will do next (Zener 1941): shared by laws that look ahead."""

import math

from controller.law import kernel
from controller.laws._threshold import slope

_LEAST_PARTS, _MOST_PARTS = 16, 512  # of the time over which the model is integrated


@kernel
def acceleration(p, xi, speed):
    """xi'' of a sphere against an infinite plate, F/m + F'/Z; 0 in flight."""
    if xi >= p.contact_level:
        return 0.0
    root = math.sqrt(max(-xi, 0.0))
    force = -p.stiffness * xi * root
    return force / p.mass_kg - 1.5 * p.stiffness * root * speed / p.impedance_n_s_m


@kernel
def look_ahead(p, samples, i, ahead):
    """What the model expects `ahead` samples after sample `i`.

    Integrated from the middle of the slope's window (midpoint rule). Returns xi (m), its slope
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
    touches, crosses = math.inf, math.inf
    for k in range(parts):
        half = speed + 0.5 * dt * acceleration(p, xi, speed)
        to = xi + dt * half
        new = speed + dt * acceleration(p, xi + 0.5 * dt * speed, half)
        if touches == math.inf and to <= p.contact_level:
            share = (xi - p.contact_level) / (xi - to) if xi > p.contact_level else 0.0
            touches = (k + share) * dt / p.sample_s - back
        if crosses == math.inf and to <= p.contact_level and new > p.v_thr_m_s:
            share = (p.v_thr_m_s - speed) / (new - speed) if speed < p.v_thr_m_s else 0.0
            crosses = (k + share) * dt / p.sample_s - back
        xi, speed = to, new
    return xi, speed, touches, crosses
