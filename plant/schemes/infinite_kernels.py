"""Compiled kernels of the infinite plate: until a reflection returns, a dashpot (Zener 1941).

The contact point moves with v = F/Z under the force F up on the plate, and has no memory but its
displacement. The contact force of a step is F_0 + F_1 (2 t/h - 1) as in
`plant.schemes.collocation_kernels`, found by the same scalar elastic. What goes into the plate, the
integral of F^2/Z, does not come back: the balance counts it as modal dissipation.
"""

from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.plant import state_kernels
from hertzloop.plant.contact import elastic_kernels as elastic
from hertzloop.plant.state_kernels import (
    A_P,
    F_A,
    F_C,
    F_C1,
    INJECTED,
    MODAL_DISSIPATED,
    NEWTON_MAX,
    NEWTON_TOTAL,
    STEP,
    V_P,
    V_P_OF_STEP,
    XI,
    XI_A,
    XI_P,
    XI_S,
)

STORED = state_kernels.BODY_SIZE  # further index into the state's body: energy in the contact, J
BODY_SIZE = state_kernels.BODY_SIZE + 1


class InfiniteModel(NamedTuple):
    """What does not change during a run; `gains`: (GAINS,)."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    stiffness: float
    flexibility_m_n: float  # zero; the contact solve asks for it
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    same_point: bool
    impedance_n_s_m: float
    gains: np.ndarray


class InfiniteState(NamedTuple):
    """What changes: scalars by the indices of `hertzloop.plant.state_kernels`."""

    body: np.ndarray
    balance: np.ndarray
    counts: np.ndarray


@kernel(inline=True)
def plate_speed(model, gap, sphere_v, f_a):
    """Velocity of the contact point (m/s) at a gap under the contact law and F_a: from
    Z v = F_a - s p^1.5 - D (v - v_sphere), D = c + d s p^1.5."""
    if gap >= 0.0:
        return f_a / model.impedance_n_s_m
    spring = elastic.elastic(elastic.contact_of(model, model.stiffness), gap)[0]
    damper = model.viscous_n_s_m + model.hunt_crossley_s_m * spring
    return (f_a - spring + damper * sphere_v) / (model.impedance_n_s_m + damper)


@kernel
def step(model, state, f_a):
    """Advance one step under the actuator force `f_a` (N); returns the mean contact force (N)."""
    body, counts, balance, g = state.body, state.counts, state.balance, model.gains
    h, gravity = model.step_s, model.gravity_m_s2
    sphere_0, before_v, sphere, sphere_v = state_kernels.flight(model, body, counts)
    plate_0 = body[XI_P]
    plate = plate_0 + g[elastic.CA] * f_a
    gap_0 = sphere_0 - plate_0
    free = sphere - plate
    # The plate's velocity follows the force at once: at the start it is that under the new F_a.
    slope_0 = h * (before_v - plate_speed(model, gap_0, before_v, f_a))
    slope = h * (sphere_v - g[elastic.VA] * f_a)
    contact = elastic.contact_of(model, model.stiffness)
    f_c = 0.0
    f_c1 = 0.0
    lost = 0.0
    touches = gap_0 < 0.0 or free < 0.0 or (slope_0 < 0.0 < slope)
    if touches:
        sphere_mean = sphere_0 + 0.5 * h * before_v - h * h * gravity / 6.0
        free_mean = sphere_mean - plate_0 - g[elastic.MA] * f_a
        guess1 = body[F_C1]
        f_c, f_c1, lost, evaluations, _ = elastic.solve_contact(
            contact,
            gap_0,
            slope_0,
            free,
            slope,
            free_mean,
            body[STORED],
            body[F_C] + 2.0 * guess1,
            guess1,
        )
        counts[NEWTON_TOTAL] += evaluations
        counts[NEWTON_MAX] = max(counts[NEWTON_MAX], evaluations)
    if f_c != 0.0 or f_c1 != 0.0:
        plate -= g[elastic.PX0] * f_c + g[elastic.PX1] * f_c1
        sphere, sphere_v = state_kernels.push(model, state, sphere, sphere_v, f_c, f_c1, lost)
    driven = f_a - f_c
    balance[MODAL_DISSIPATED] += h * (driven * driven + f_c1 * f_c1 / 3.0) / model.impedance_n_s_m
    balance[INJECTED] += f_a * (plate - plate_0)
    gap = sphere - plate
    body[STORED] = elastic.elastic(contact, gap)[1]
    speed = plate_speed(model, gap, sphere_v, f_a)
    body[V_P_OF_STEP] = body[V_P]
    body[A_P] = (speed - body[V_P]) / h
    body[XI] = sphere - plate
    body[XI_S] = sphere
    body[XI_P] = plate
    body[XI_A] = plate
    body[V_P] = speed
    body[F_C] = f_c
    body[F_C1] = f_c1
    body[F_A] = f_a
    counts[STEP] += 1
    return f_c


@kernel(inline=True)
def contact_energy(model, state):
    """Energy stored in the contact at the present step, J."""
    return state.body[STORED]


@kernel
def modal_energy(model, state):
    """An infinite plate gives nothing back: zero."""
    return 0.0


@kernel
def close_balance(model, state):
    """Every step is booked when it is made. Returns the `modal_energy`."""
    return 0.0


@kernel
def pulse(model, state, force, gap):
    """Step without control; force up on the plate (N) and gap (m) after every step."""
    for i in range(force.size):
        step(model, state, 0.0)
        force[i] = model.impedance_n_s_m * state.body[V_P]
        gap[i] = state.body[XI]
