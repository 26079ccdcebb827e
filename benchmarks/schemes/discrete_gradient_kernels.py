"""Compiled kernels of `discrete_gradient`: the structure of the default scheme, another contact.

Step k runs from time k h to (k+1) h; forces are held over a step. The contact force F_c > 0 pushes
the sphere up and the structure down, the actuator force F_a > 0 pushes the structure up. Its poles
are propagated as those of the default scheme.
"""

import math
from typing import NamedTuple

from hertzloop.common.jit import kernel
from hertzloop.plant import state_kernels
from hertzloop.plant.schemes.modal_kernels import (
    CONTACT,
    WORK,
    close_balance,
    propagate,
    push_structure,
)
from hertzloop.plant.state_kernels import (
    F_A,
    F_C,
    FALLBACKS,
    INJECTED,
    NEWTON_MAX,
    NEWTON_TOTAL,
    STEP,
    XI,
    XI_A,
)
from hertzloop.plant.structures.linear import Linear, V, X

__all__ = ["DiscreteModel", "close_balance", "contact_energy", "step"]
_MAX_ITERATIONS = 200  # a bracket of doubles cannot be halved more often
_NEWTON_ALLOWED = 12  # then bisection takes turns with Newton
_ROUNDING = 2.0**-51


class DiscreteModel(NamedTuple):
    """What does not change during a run. `actuator`: its force and its point in the structure."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    stiffness: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    linear: Linear
    actuator: int
    damped: bool


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


@kernel
def step(model, state, f_a):
    """Advance one step under the actuator force `f_a` (N); returns the contact force (N)."""
    linear, body, counts, h = model.linear, state.body, state.counts, model.step_s
    propagate(linear, state)
    push_structure(linear, state, model.actuator, f_a, 0.0)
    _, _, sphere, sphere_speed = state_kernels.flight(model, body, counts)
    gap = sphere - state.seen[CONTACT, X]
    f_c = lost = 0.0
    if body[XI] <= 0.0 or gap < 0.0:
        gain = 0.5 * h * h / model.mass_kg + linear.gain[CONTACT, X, CONTACT, 0]
        f_c, damping, iterations = solve_contact(model, body[XI], gap, gain)
        lost = damping * (body[XI] - gap - gain * f_c)
        counts[NEWTON_TOTAL] += iterations
        counts[NEWTON_MAX] = max(counts[NEWTON_MAX], iterations)
        counts[FALLBACKS] += iterations > _NEWTON_ALLOWED + 2
    if f_c != 0.0:
        push_structure(linear, state, CONTACT, -f_c, 0.0)
        sphere, _ = state_kernels.push_sphere(model, state, sphere, sphere_speed, f_c, 0.0, lost)
    plate, there = state.seen[CONTACT, X], state.seen[model.actuator, X]
    injected = f_a * (there - state.before[model.actuator, X])
    state.balance[INJECTED] += injected
    state.balance[WORK] += injected - f_c * (plate - state.before[CONTACT, X])
    state_kernels.note_contact_point(body, h, sphere, plate, state.seen[CONTACT, V])
    body[XI_A] = there
    body[F_C] = f_c
    body[F_A] = f_a
    counts[STEP] += 1
    return f_c


@kernel(inline=True)
def contact_energy(model, state):
    """Energy stored in the contact at the present step, J."""
    return 0.4 * model.stiffness * max(-state.body[XI], 0.0) ** 2.5
