"""Compiled kernels of `discrete_gradient`: exact modal propagation, discrete-gradient contact.

Conventions. Step k runs from time k h to (k+1) h; forces are held over a step. The
contact force F_c > 0 pushes the sphere up and the plate down, the actuator force F_a > 0
pushes the plate up. Every oscillator is one complex number z = (q' + delta q + i Theta q)
b/Theta, so that its share of the displacement is Im z, of the velocity Theta (Re z - rho
Im z) with rho = delta/Theta, and free motion over a step is a multiplication by
exp((-delta + i Theta) h).

One pass per step: z is stored as propagated *without* the forces of the last step, which
are folded in when the next step propagates it. Sums run in LANES fixed lanes, and no
fast-math is used, so the bits do not depend on who calls or on the vector width.
"""

import math
from typing import NamedTuple

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.plant.state_kernels import (
    A_P,
    CONTACT_DISSIPATED,
    CONTACT_IMPULSE,
    CONTACT_STEPS,
    F_A,
    F_C,
    FLIGHT_STEP,
    FLIGHT_V,
    FLIGHT_X,
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

LANES = 48  # oscillators summed side by side; 1104 frequencies are exactly 23 rows

# First index into PlantModel.table. C and A: change of z over a step by a unit force (up
# on the plate) at the contact and at the actuator; SWING: the same less the rest position;
# B: shapes at both points, the weights of the outputs;
# ENERGY: modal mass/2; LOSS: energy lost in a step as a quadratic form of z
# minus its rest position.
ROT_RE, ROT_IM, C_RE, C_IM, THETA, A_RE, A_IM, B_C, B_A = range(9)
ENERGY, SWING_C_RE, SWING_C_IM, SWING_A_RE, SWING_A_IM, LOSS_RR, LOSS_RI, LOSS_II = range(9, 17)
COLUMNS = 17
_MAX_ITERATIONS = 200  # a bracket of doubles cannot be halved more often
_NEWTON_ALLOWED = 12  # then bisection takes turns with Newton
_ROUNDING = 2.0**-51


class PlantModel(NamedTuple):
    """What does not change during a run.

    `gain_xy` and `speed_gain_xy`: displacement (m/N) and velocity (m/s/N) at x after one
    step of unit force at y, up on the plate; c = contact, a = actuator. `table` holds the
    coefficients of all oscillators, shape (COLUMNS, rows, LANES); one array, because a
    call pays for every array it is handed.
    """

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    stiffness: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    damped: bool
    rho: float
    gain_cc: float
    gain_ca: float
    gain_ac: float
    gain_aa: float
    speed_gain_cc: float
    speed_gain_ca: float
    table: np.ndarray


class PlantState(NamedTuple):
    """What changes: z, scalars by the indices above, and scratch lanes (3, LANES)."""

    z: np.ndarray  # (2, rows, LANES): real and imaginary parts
    lanes: np.ndarray
    body: np.ndarray
    balance: np.ndarray
    counts: np.ndarray


@kernel(inline=True)
def lane_sum(lanes):
    """Sum of LANES numbers, in halves: a fixed order that vectorises. Changes `lanes`."""
    width = LANES
    while width % 2 == 0:
        width //= 2
        for j in range(width):
            lanes[j] += lanes[j + width]
    total = 0.0
    for j in range(width):
        total += lanes[j]
    return total


@kernel
def _propagate(model, state, f_contact, f_actuator):
    """Fold the forces (up on the plate) in and propagate one step; displacement and velocity at the
    contact, displacement at the actuator."""
    x_lanes, v_lanes, y_lanes = state.lanes[0], state.lanes[1], state.lanes[2]
    for j in range(LANES):
        x_lanes[j] = 0.0
        v_lanes[j] = 0.0
        y_lanes[j] = 0.0
    rho, z, table = model.rho, state.z, model.table
    for i in range(z.shape[1]):
        zr, zi, er, ei = z[0, i], z[1, i], table[ROT_RE, i], table[ROT_IM, i]
        cr, ci, ar, ai = table[C_RE, i], table[C_IM, i], table[A_RE, i], table[A_IM, i]
        bc, ba, th = table[B_C, i], table[B_A, i], table[THETA, i]
        for j in range(LANES):
            a = zr[j] + cr[j] * f_contact + ar[j] * f_actuator
            b = zi[j] + ci[j] * f_contact + ai[j] * f_actuator
            c = er[j] * a - ei[j] * b
            d = er[j] * b + ei[j] * a
            zr[j] = c
            zi[j] = d
            x_lanes[j] += bc[j] * d
            v_lanes[j] += bc[j] * th[j] * (c - rho * d)
            y_lanes[j] += ba[j] * d
    return lane_sum(x_lanes), lane_sum(v_lanes), lane_sum(y_lanes)


@kernel
def _dissipated_in_step(model, state, f_contact, f_actuator):
    """Energy that the modes lost in the step just done, J, from z at its end.

    Under a held force z turns about a rest position; with y = z - rest the loss is a
    quadratic form in y whose coefficients follow from `dissipation`.
    """
    lanes, z, table = state.lanes[0], state.z, model.table
    for j in range(LANES):
        lanes[j] = 0.0
    for i in range(z.shape[1]):
        zr, zi = z[0, i], z[1, i]
        cr, ci, ar, ai = (
            table[SWING_C_RE, i],
            table[SWING_C_IM, i],
            table[SWING_A_RE, i],
            table[SWING_A_IM, i],
        )
        rr, ri, ii = table[LOSS_RR, i], table[LOSS_RI, i], table[LOSS_II, i]
        for j in range(LANES):
            yr = zr[j] + cr[j] * f_contact + ar[j] * f_actuator
            yi = zi[j] + ci[j] * f_contact + ai[j] * f_actuator
            lanes[j] += rr[j] * yr * yr + ri[j] * yr * yi + ii[j] * yi * yi
    return lane_sum(lanes)


@kernel
def settle_balance(model, state):
    """Book the modal dissipation of the step just done. Called before z moves on."""
    if not model.damped:
        return
    f_contact, f_actuator = _forces_on_plate(state)
    state.balance[MODAL_DISSIPATED] += _dissipated_in_step(model, state, f_contact, f_actuator)


@kernel
def _forces_on_plate(state):
    """Forces of the last step, up on the plate: at the contact, at the actuator."""
    return -state.body[F_C], state.body[F_A]


@kernel
def modal_energy(model, state):
    """Kinetic and elastic energy of all oscillators at the present step, J."""
    f_contact, f_actuator = _forces_on_plate(state)
    total = 0.0
    rho = model.rho
    for i in range(state.z.shape[1]):
        for j in range(LANES):
            zr = state.z[0, i, j] + model.table[C_RE, i, j] * f_contact
            zi = state.z[1, i, j] + model.table[C_IM, i, j] * f_contact
            zr += model.table[A_RE, i, j] * f_actuator
            zi += model.table[A_IM, i, j] * f_actuator
            speed = zr - rho * zi
            # omega^2 = Theta^2 (1 + rho^2)
            th2 = model.table[THETA, i, j] * model.table[THETA, i, j]
            total += model.table[ENERGY, i, j] * th2 * (speed * speed + (1.0 + rho * rho) * zi * zi)
    return total


@kernel(inline=True)
def contact_energy(model, state):
    """Energy stored in the contact at the present step, J."""
    return 0.4 * model.stiffness * max(-state.body[XI], 0.0) ** 2.5


@kernel
def close_balance(model, state):
    """Book the last step; to be called once, after it. Returns the `modal_energy` then, J."""
    if state.counts[STEP] > 0:
        settle_balance(model, state)
    return modal_energy(model, state)


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
    body, counts, h = state.body, state.counts, model.step_s
    if counts[STEP] > 0:
        settle_balance(model, state)
    f_contact, f_actuator = _forces_on_plate(state)
    x, v, y = _propagate(model, state, f_contact, f_actuator)

    t = (counts[STEP] + 1 - counts[FLIGHT_STEP]) * h
    g = model.gravity_m_s2
    sphere = body[FLIGHT_X] + t * (body[FLIGHT_V] - 0.5 * g * t)
    sphere_speed = body[FLIGHT_V] - g * t
    plate = x + model.gain_ca * f_a
    xi_free = sphere - plate
    f_c = 0.0
    touches = body[XI] <= 0.0 or xi_free < 0.0
    if touches:
        ballistic = 0.5 * h * h / model.mass_kg
        f_c, f_damping, iterations = solve_contact(
            model, body[XI], xi_free, ballistic + model.gain_cc
        )
        counts[NEWTON_TOTAL] += iterations
        counts[NEWTON_MAX] = max(counts[NEWTON_MAX], iterations)
    if f_c != 0.0:
        plate -= model.gain_cc * f_c
        sphere += ballistic * f_c
        body[FLIGHT_X] = sphere
        body[FLIGHT_V] = sphere_speed + f_c * h / model.mass_kg
        counts[FLIGHT_STEP] = counts[STEP] + 1
        counts[CONTACT_STEPS] += 1
        state.balance[CONTACT_IMPULSE] += f_c * h
        state.balance[CONTACT_DISSIPATED] -= f_damping * (sphere - plate - body[XI])
    speed = v + model.speed_gain_ca * f_a - model.speed_gain_cc * f_c
    body[V_P_OF_STEP] = body[V_P]
    actuator = y + model.gain_aa * f_a - model.gain_ac * f_c
    state.balance[INJECTED] += f_a * (actuator - body[XI_A])
    body[A_P] = (speed - body[V_P]) / h
    body[XI] = sphere - plate
    body[XI_S] = sphere
    body[XI_P] = plate
    body[V_P] = speed
    body[XI_A] = actuator
    body[F_C] = f_c
    body[F_A] = f_a
    counts[STEP] += 1
    return f_c
