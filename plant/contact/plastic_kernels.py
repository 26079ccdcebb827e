"""Compiled kernels of a contact that yields: its curves, energies and state.

See `plant.contact.plastic` for the law and `plastic_solve_kernels` for a step. The approach a = p +
k F is the negative of a modal gap: penetration, and what the spring of the modes left out takes.
The work done on the contact is W = U + D, stored energy and what yielding took, D a function of
the deepest penetration.
"""

import math
from typing import Any, NamedTuple

from jit import kernel
from plant.contact import hertz_kernels as hertz


class Yielding(NamedTuple):
    """Penetration (m), force (N) and energy (J) of first yield, and the line's rise (N/m)."""

    delta_m: float
    force_n: float
    rise_n_m: float
    energy_j: float


class Curve(NamedTuple):
    """A Hertz contact as `solve_kernels` wants it."""

    step_s: float
    stiffness: float
    flexibility_m_n: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    gains: Any
    tail: Any


@kernel(inline=True, borrowed=True)
def load(law, p):
    """Force on the line, N."""
    return law.force_n + law.rise_n_m * (p - law.delta_m)


@kernel(inline=True, borrowed=True)
def curve_of(law, stiffness, deepest):
    """Stiffness (N/m^1.5) and dent (m) of the curve that belongs to a deepest penetration."""
    if deepest <= law.delta_m:
        return stiffness, 0.0
    most = load(law, deepest)
    again = stiffness * math.sqrt(stiffness * deepest * math.sqrt(deepest) / most)
    return again, deepest - (most / again) ** (2.0 / 3.0)


@kernel(inline=True, borrowed=True)
def taken(law, deepest, dent):
    """What yielding took until a deepest penetration, J."""
    if deepest <= law.delta_m:
        return 0.0
    way = deepest - law.delta_m
    work = law.energy_j + way * (law.force_n + 0.5 * law.rise_n_m * way)
    return work - 0.4 * load(law, deepest) * (deepest - dent)


@kernel(inline=True, borrowed=True)
def hertz_curve(model, stiffness):
    """The contact on a curve of `stiffness`, without its dent."""
    return Curve(
        model.step_s,
        stiffness,
        model.flexibility_m_n,
        model.viscous_n_s_m,
        model.hunt_crossley_s_m,
        model.gains,
        model.tail,
    )


@kernel(inline=True, borrowed=True)
def approach(law, model, p):
    """Approach at a penetration on the line, m."""
    return p + model.flexibility_m_n * load(law, p)


@kernel(inline=True, borrowed=True)
def penetration(law, model, approach):
    """Penetration at an approach on the line, m."""
    start = law.delta_m + model.flexibility_m_n * law.force_n
    return law.delta_m + (approach - start) / (1.0 + model.flexibility_m_n * law.rise_n_m)


@kernel(borrowed=True)
def work(law, model, gap, deepest):
    """Force (N) at a gap and W (J) for a deepest penetration before it, which it may pass."""
    spring = model.flexibility_m_n
    if -gap >= approach(law, model, deepest):
        p = penetration(law, model, -gap)
        force, way = load(law, p), p - law.delta_m
        done = law.energy_j + way * (law.force_n + 0.5 * law.rise_n_m * way)
        return force, done + 0.5 * spring * force * force
    stiffness, dent = curve_of(law, model.stiffness, deepest)
    force, stored, _ = hertz.elastic(hertz_curve(model, stiffness), gap + dent)
    return force, stored + taken(law, deepest, dent)


@kernel(inline=True, borrowed=True)
def at(law, model, gap, rate, curve, dent, on_line):
    """Force, its damping part, dF/dgap and dF/drate on the line, or on a curve."""
    if not on_line:
        if gap + dent >= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        return hertz.damped_law(curve, gap + dent, rate)
    spring = load(law, penetration(law, model, -gap))
    share = -1.0 / (1.0 + model.flexibility_m_n * law.rise_n_m)
    slope = law.rise_n_m * share
    factor = (model.viscous_n_s_m + model.hunt_crossley_s_m * spring) * share
    by_gap = slope + model.hunt_crossley_s_m * slope * share * rate
    return spring + factor * rate, factor * rate, by_gap, factor
