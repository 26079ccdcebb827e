"""Compiled kernels of the contact in a step of the second-order scheme: the discrete gradient."""

import math

from jit import kernel

_MAX_ITERATIONS = 200  # a bracket of doubles cannot be halved more often
_NEWTON_ALLOWED = 12  # then bisection takes turns with Newton
_ROUNDING = 2.0**-51


@kernel
def chord(p0, p1):
    """Mean of p^(3/2) between penetrations p0, p1 >= 0, and its derivative by p1.

    Equals (2/5)(p1^(5/2) - p0^(5/2))/(p1 - p0), written without the difference that
    would cancel: the discrete gradient of the Hertz potential over s.
    """
    a = math.sqrt(p0)
    b = math.sqrt(p1)
    if a + b == 0.0:
        return 0.0, 0.0
    total = a + b
    value = 0.4 * (b**4 + b**3 * a + b * b * a * a + b * a**3 + a**4) / total
    slope = 0.2 * (3.0 * b**3 + 6.0 * b * b * a + 4.0 * b * a * a + 2.0 * a**3) / (total * total)
    return value, slope


@kernel
def contact_force(model, xi0, xi1):
    """Force over a step from gap xi0 to xi1 (m), its damping part, and dF/dxi1.

    Elastic part: -(V(xi1) - V(xi0))/(xi1 - xi0) with V = 2/5 s p^(5/2). Viscous part:
    c (p1 - p0)/h. Hunt-Crossley part: d (V1 - V0)/h. All fall monotonically with xi1.
    """
    p0 = max(-xi0, 0.0)
    p1 = max(-xi1, 0.0)
    if p0 == 0.0 and p1 == 0.0:
        return 0.0, 0.0, 0.0
    mean, mean_slope = chord(p0, p1)
    slope1 = -1.0 if xi1 < 0.0 else 0.0  # dp1/dxi1
    if (xi0 < 0.0) == (xi1 < 0.0):
        share = 1.0  # part of the way that is in contact
        share_slope = 0.0
    else:
        way = xi0 - xi1
        share = (p1 - p0) / way
        share_slope = (slope1 + share) / way
    s = model.stiffness
    elastic = s * mean * share
    slope = s * (mean_slope * slope1 * share + mean * share_slope)
    rate = (p1 - p0) / model.step_s
    hunt = model.hunt_crossley_s_m * s
    damping = (model.viscous_n_s_m + hunt * mean) * rate
    slope += (model.viscous_n_s_m + hunt * mean) * slope1 / model.step_s
    slope += hunt * mean_slope * slope1 * rate
    return elastic + damping, damping, slope


@kernel
def solve_contact(model, xi0, xi_free, gain):
    """Solve xi1 = xi_free + gain F(xi0, xi1) for the force.

    Returns F (N), its damping part (N) and the number of evaluations. The left side minus
    the right rises monotonically, so [xi_free, xi_free + gain F(xi_free)] brackets the
    root; Newton steps that leave the bracket, or that take too long, are replaced by
    bisection, so the loop always ends.
    """
    force, damping, slope = contact_force(model, xi0, xi_free)
    other = xi_free + gain * force
    low = min(xi_free, other)
    high = max(xi_free, other)
    xi1 = xi_free
    residual = -gain * force
    for iteration in range(1, _MAX_ITERATIONS):
        if residual > 0.0:
            high = min(high, xi1)
        else:
            low = max(low, xi1)
        trial = xi1 - residual / (1.0 - gain * slope)
        exhausted = False
        if not low <= trial <= high or (iteration > _NEWTON_ALLOWED and iteration % 2 == 0):
            trial = 0.5 * (low + high)
            exhausted = trial <= low or trial >= high  # no double lies in between
        moved = abs(trial - xi1)
        xi1 = trial
        force, damping, slope = contact_force(model, xi0, xi1)
        residual = xi1 - (xi_free + gain * force)
        scale = abs(xi1) + abs(xi_free) + abs(gain * force)
        if abs(residual) <= _ROUNDING * scale or moved == 0.0 or exhausted:
            return force, damping, iteration + 1
    return force, damping, _MAX_ITERATIONS
