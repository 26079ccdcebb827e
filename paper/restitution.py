"""Damping parameters of the published scheme from a coefficient of restitution.

Restitution here is that of the study's tables: relative velocity at the end of the
contact over impact speed. The end falls on a sample, so restitution jumps where a change of the
parameter moves the end by one sample; where the target lies inside a jump, the side that comes
closer is taken.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import scipy

from hertzloop.plant.contact.hertz import Damping
from hertzloop.plant.plant import PlantSpec
from hertzloop.plant.schemes import thesis2008_kernels as k
from hertzloop.plant.schemes.thesis2008 import ThesisPlant
from hertzloop.plant.state_kernels import STEP, XI

_MAX_STEPS = 1 << 15
_RESOLUTION = 1e-9  # of the parameter's logarithm
_GROWTH, _MOST_GROWTH = 1.5, 1e12
_LARGEST_JUMP = 0.02  # of restitution; one sample more or less costs 0.01 on aluminium


def first_contact(plant: ThesisPlant, steps: int) -> tuple[int, float]:
    """Step an uncontrolled plant to the end of its first contact: samples, relative velocity.

    The number of samples counts the one at xi = 0 and the first one after the end. Raises
    ValueError when the contact does not end within `steps`.
    """
    state = plant.state
    for _ in range(steps):
        if state.counts[k.TOUCHING] and state.body[XI] > 0.0:
            samples = int(state.counts[STEP] - state.counts[k.BEGAN]) + 1
            return samples, float(state.motion[k.REL_V])
        k.step(plant.model, state, 0.0)
    raise ValueError(f"the contact does not end within {steps} steps")


def restitution(spec: PlantSpec) -> float:
    """Relative velocity at the end of the first contact over the impact speed."""
    steps = 1 << 11
    while True:
        plant = ThesisPlant(replace(spec, lead_in_s=0.0), steps, most_iterations=100_000)
        try:
            return first_contact(plant, steps)[1] / spec.sphere.impact_speed_m_s
        except ValueError:
            if steps >= _MAX_STEPS:
                return 0.0  # the sphere stays: nothing is returned
            steps *= 4


def calibrate_viscous(spec: PlantSpec, target: float) -> float:
    """Damping constant c (N s/m) for a restitution. Raises ValueError if none is found."""

    def of(c: float) -> PlantSpec:
        contact = replace(spec.contact, damping=Damping.VISCOUS, viscous_n_s_m=c)
        return replace(spec, contact=contact)

    start = spec.sphere.mass_kg * 1e-3
    return _solve(lambda c: restitution(of(c)), target, start, "viscous damping")


def calibrate_relaxation(spec: PlantSpec, target: float, relaxation_s: float) -> float:
    """s_tau (N/m^1.5) for a restitution at a given tau, with the bracketed solve.

    Raises ValueError where no s_tau gives it: a memory that hardly fades within the contact
    holds the sphere before it takes enough energy. A smaller tau helps.
    """

    def of(s_tau: float) -> PlantSpec:
        contact = replace(
            spec.contact,
            damping=Damping.RELAXATION,
            relaxation_stiffness=s_tau,
            relaxation_s=relaxation_s,
            extra_state=True,
        )
        return replace(spec, contact=contact)

    def found(s_tau: float) -> float:
        # Above a full memory the force pulls so hard that the published numerics run away.
        value = restitution(of(s_tau))
        return value if value <= 1.0 else 0.0

    start = spec.contact.stiffness * relaxation_s
    return _solve(found, target, start, "relaxation")


def _solve(found: Callable[[float], float], target: float, start: float, what: str) -> float:
    """Root of found(x) = target for a falling function, on the closer side of a jump."""
    if not 0.0 < target < 1.0:
        raise ValueError(f"restitution is {target:g}; it must be above 0 and below 1")
    low = start
    while found(low) < target and low > 1e-6 * start:
        low /= 10.0
    if found(low) < target:
        raise ValueError(f"{what}: restitution {target:g} is above what hardly any damping gives")
    high = low
    while found(high) > target:
        low, high = high, _GROWTH * high
        if high > start * _MOST_GROWTH:
            raise ValueError(f"{what}: no parameter gives restitution {target:g}")
    root = scipy.optimize.brentq(
        lambda u: found(math.exp(u)) - target, math.log(low), math.log(high), xtol=_RESOLUTION
    )
    sides = [math.exp(float(root) + shift * _RESOLUTION) for shift in (-2.0, 0.0, 2.0)]
    best = min(sides, key=lambda x: abs(found(x) - target))
    if abs(found(best) - target) > _LARGEST_JUMP:
        raise ValueError(
            f"{what}: restitution jumps past {target:g} near {best:.6g}; the closest is "
            f"{found(best):.3g}"
        )
    return best
