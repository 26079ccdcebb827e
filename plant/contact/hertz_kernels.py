"""Compiled kernels of a Hertz contact in series with the spring of the modes left out.

See `plant.contact.solve_kernels` for what they are for.
"""

import math

from jit import kernel

_HALVINGS = 90


@kernel(inline=True, borrowed=True, fused=True)
def root_penetration(model, gap):
    """y = sqrt(p) of the Hertz penetration p under a modal gap < 0: y^2 + k s y^3 = -gap.

    The spring of the modes left out takes k F = k s y^3 of the approach. Newton, from the series
    in e = k s sqrt(-gap) where that is small; what is left after a change of 3e-8 is below
    rounding.
    """
    y = math.sqrt(-gap)
    share = model.flexibility_m_n * model.stiffness
    if share == 0.0:
        return y
    e = share * y
    if e < 0.25:
        y *= 1.0 + e * (-0.5 + e * (0.625 + e * (-1.0 + e * (1.8046875 + e * -3.5))))
    else:
        y /= math.sqrt(1.0 + e)
    for _ in range(_HALVINGS):
        change = (y * y * (1.0 + share * y) + gap) / (y * (2.0 + 3.0 * share * y))
        y -= change
        if abs(change) <= 3e-8 * y:
            break
    return y


@kernel(inline=True, borrowed=True, fused=True)
def elastic(model, gap):
    """Contact force without damping (N) at a modal gap, the energy in the contact and in the
    spring of the modes left out (J), and the root of the penetration (m^0.5)."""
    if gap >= 0.0:
        return 0.0, 0.0, 0.0
    y = root_penetration(model, gap)
    force = model.stiffness * y * y * y
    return force, force * (0.4 * y * y + 0.5 * model.flexibility_m_n * force), y


@kernel(inline=True, borrowed=True, fused=True)
def elastic_near(model, gap, root):
    """The same from a root nearby, by one step of Halley's rule, which cubes what is wrong; from
    nothing if `root` is zero or not near enough."""
    if root == 0.0 or gap >= 0.0:
        return elastic(model, gap)
    share = model.flexibility_m_n * model.stiffness
    wrong = root * root * (1.0 + share * root) + gap
    slope = root * (2.0 + 3.0 * share * root)
    change = wrong * slope / (slope * slope - wrong * (1.0 + 3.0 * share * root))
    if abs(change) > 3e-6 * root:
        return elastic(model, gap)
    y = root - change
    force = model.stiffness * y * y * y
    return force, force * (0.4 * y * y + 0.5 * model.flexibility_m_n * force), y


@kernel(inline=True, borrowed=True, fused=True)
def damped_law(model, gap, rate):
    """Force, its damping part, dF/dgap, dF/drate at a modal gap < 0 and its rate (m/s)."""
    s = model.stiffness
    y = root_penetration(model, gap)
    soft = 2.0 + 3.0 * model.flexibility_m_n * s * y
    spring = s * y * y * y
    slope = -3.0 * s * y / soft
    if model.viscous_n_s_m == 0.0 and model.hunt_crossley_s_m == 0.0:
        return spring, 0.0, slope, 0.0
    share = -2.0 / soft  # dp/dgap
    factor = (model.viscous_n_s_m + model.hunt_crossley_s_m * spring) * share
    # The change of `share` with the gap is left to Newton's next iteration.
    return (
        spring + factor * rate,
        factor * rate,
        slope + model.hunt_crossley_s_m * slope * share * rate,
        factor,
    )
