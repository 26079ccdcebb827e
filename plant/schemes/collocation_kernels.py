"""Compiled kernels of the default scheme `modal`: energy-preserving exponential collocation.

Every mode is propagated exactly under a contact force that is linear over the step,
F(t) = F_0 + F_1 P(t), P = 2 t/h - 1; the two numbers are the projection of the contact law on
linear functions, so the scheme has order 4 (Hairer 2010 for the projection; Brugnano,
Iavernaro and Trigiante for the correction that makes the energy exact). The law is
integrated along the quartic through gap and velocity at both ends and the mean gap, which
the modes give exactly, over the part of the step that is in contact.

Step k runs from time k h to (k+1) h. The contact force F_c > 0 pushes the sphere up and the plate
down, the actuator force F_a > 0 pushes the plate up. Every oscillator is one complex number
z = (q' + delta q + i Theta q) b, so that its share of the velocity is Re z - rho Im z with
rho = delta/Theta, of the displacement Im z/Theta, and free motion over a step is a multiplication
by exp((-delta + i Theta) h). One pass per step: z is stored as propagated *without* the forces of
the last step, which are folded in when the next step propagates it.

Modes left out act as a massless spring, `flexibility`, in series with the contact, or as one more
mode, `residual_mode`, by which the plate's velocity follows a force at once. The scalar equations
of a step are in `hertzloop.plant.contact.elastic_kernels`.

Nothing here allocates.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from hertzloop.common.jit import kernel
from hertzloop.common.jit.by_type import apart, by_type, nothing, zero
from hertzloop.plant import actuator_kernels as act
from hertzloop.plant import state_kernels
from hertzloop.plant.contact import elastic_kernels as elastic
from hertzloop.plant.contact import residual_mode_kernels
from hertzloop.plant.contact import yielding_kernels as yielding
from hertzloop.plant.state_kernels import (
    A_P,
    A_S,
    AWAKE,
    F_A,
    F_A1,
    F_C,
    F_C1,
    FREE_SINCE,
    INJECTED,
    LOOK_EVERY,
    MODAL_DISSIPATED,
    NEWTON_MAX,
    NEWTON_TOTAL,
    PLASTIC_DISSIPATED,
    SILENT_M,
    STEP,
    V_P,
    V_P_OF_STEP,
    V_S,
    XI,
    XI_A,
    XI_P,
    XI_S,
)

# Columns of CollocationModel.table. ROT: e^(s h); C0, C1: change of z by a unit constant force
# and a unit P(t) at the contact; A: by a constant force at the actuator; OUT, B_A: displacement
# at contact and actuator by Im z; B_C: velocity at the contact by z; MEAN: mean displacement
# over the step from z at its end without force.
ROT_RE, ROT_IM, OUT, C0_RE, C0_IM, C1_RE, C1_IM = range(7)
MEAN_RE, MEAN_IM, A_RE, A_IM, B_C, B_A, THETA, ENERGY = range(7, 15)
# Energy lost in a step: a quadratic form of z at its end without forces and F_0, F_1, F_a; the
# terms without z are summed over all modes, in `gains`.
LOSS_RR, LOSS_RI, LOSS_II, LOSS_R0, LOSS_I0, LOSS_R1, LOSS_I1, LOSS_RA, LOSS_IA = range(15, 24)
# The same by the slope F_a1 of a separate actuator's force, and the mean displacement there.
A1_RE, A1_IM, LOSS_RB, LOSS_IB, MEAN_A_RE, MEAN_A_IM = range(24, 30)
COLUMNS = 30
# Further indices into the state's body: displacement and velocity at the contact and
# displacement at the actuator by the modes alone, energy stored in the contact (J), what the
# actuator bends the spring of the modes left out by (m), `swing` of `propagate_same_point`
# (m s; known after steps with force), F_C1 of the step before the last (N).
MODAL_X, MODAL_V, MODAL_Y, STORED, OWN, SWING, F_C1_BEFORE = range(
    state_kernels.BODY_SIZE, state_kernels.BODY_SIZE + 7
)
BODY_SIZE = state_kernels.BODY_SIZE + 7


class CollocationState(NamedTuple):
    """What changes: z by modes, and scalars by the indices above."""

    z: np.ndarray  # (2, modes): real and imaginary parts, m/s
    free: np.ndarray  # z at step counts[FREE_SINCE], while no force acts
    body: np.ndarray
    balance: np.ndarray
    counts: np.ndarray


class CollocationModel(NamedTuple):
    """What does not change during a run; `table`: (COLUMNS, modes), `gains`: (GAINS,), `rho`: one
    number, or where loss factors differ one for every mode, (modes,)."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    stiffness: float
    flexibility_m_n: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    same_point: bool
    damped: bool
    rho: float | np.ndarray
    slow: int  # the first modes, whose mean over a step is taken one by one
    law: Any  # of the contact, hertzloop.plant.contact.yielding_kernels; as the actuator's
    actuator: Any  # of hertzloop.plant.actuator_kernels; its type decides what is compiled
    residual_mode: Any  # of hertzloop.plant.contact.residual_mode_kernels, the same
    probe: Any  # Probe, or None of a sensor at the contact
    gains: np.ndarray
    table: np.ndarray


def of_mode(rho, i):
    """rho of mode `i`, whether it is one for all modes or each has its own. Which of the two is
    settled when a pass is compiled: one for all costs nothing."""
    return rho[i] if isinstance(rho, np.ndarray) else rho


@overload(of_mode, inline="always", jit_options={"_nrt": False})
def _compiled_of_mode(rho, i):
    if isinstance(rho, types.Array):
        return lambda rho, i: rho[i]
    return lambda rho, i: rho


class Probe(NamedTuple):
    """Velocity where a sensor elsewhere is: by Re z - rho Im z of the modes (modes,), and by F_0,
    F_1 at the contact and F_a, F_a1 within a step, m/(N s). What stands for the modes left out
    is not felt there."""

    weight: np.ndarray
    by_c0: float
    by_c1: float
    by_a0: float
    by_a1: float


@kernel(fastmath={"contract", "reassoc"})
def _probed(probe, model, z, awake):
    total = 0.0
    for i in range(awake):
        total += probe.weight[i] * (z[0, i] - of_mode(model.rho, i) * z[1, i])
    return total


@kernel(inline=True)
def _noted(probe, model, body, drift, f_c, f_c1, f_a, f_a1):
    speed = drift + probe.by_a0 * f_a + probe.by_a1 * f_a1
    speed -= probe.by_c0 * f_c + probe.by_c1 * f_c1
    body[A_S] = (speed - body[V_S]) / model.step_s
    body[V_S] = speed


# Velocity there after a step without forces, and its value and mean acceleration with them.
_probe = by_type({type(None): zero, Probe: _probed})
_note = by_type({type(None): nothing, Probe: _noted})


@apart
@kernel(fastmath={"contract", "reassoc"})
def drift(n, z, table, rho):
    """One step without force of the first `n` modes: displacement and velocity at the point."""
    x = 0.0
    v = 0.0
    for i in range(n):
        c = table[ROT_RE, i] * z[0, i] - table[ROT_IM, i] * z[1, i]
        d = table[ROT_RE, i] * z[1, i] + table[ROT_IM, i] * z[0, i]
        z[0, i] = c
        z[1, i] = d
        x += table[OUT, i] * d
        v += c - of_mode(rho, i) * d
    return x, v


@apart
@kernel(fastmath={"contract", "reassoc"})
def mean_of_drift(slow, n, z, table, rho):
    """Mean displacement over the step that `drift` has just made, and `swing` at its end."""
    mean = 0.0
    swing = 0.0
    for i in range(n):
        mean += table[MEAN_RE, i] * z[1, i] + table[MEAN_IM, i] * z[0, i]
    for i in range(np.uint64(slow), np.uint64(n)):  # unsigned: no negative index to look for
        swing += table[OUT, i] * (table[OUT, i] * (z[0, i] + of_mode(rho, 0) * z[1, i]))
    return mean, swing


@apart
@kernel(fastmath={"contract", "reassoc"})
def propagate_slow(slow, z, table, rho, f0, f1):
    """Fold f0 + f1 P into the first `slow` modes, propagate one step; displacement, velocity, mean
    displacement at the point.

    These modes turn so little in a step that a difference of `swing` would be all rounding.
    """
    x = 0.0
    v = 0.0
    mean = 0.0
    for i in range(slow):
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        v += c - of_mode(rho, i) * d
        x += table[OUT, i] * d
        mean += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
    return x, v, mean


@apart
@kernel(fastmath={"contract", "reassoc"})
def propagate_same_point(slow, n, z, table, rho, f0, f1):
    """The same for the other awake modes; displacement, velocity, swing at the point.

    `swing` is the sum of (Re z + rho Im z)/Theta^2, which falls by (1 + rho^2) times the time
    integral of the displacement while no force acts. Only for modes of one rho: where each has its
    own, all count as slow.
    """
    x = 0.0
    v = 0.0
    w = 0.0
    swing = 0.0
    for i in range(np.uint64(slow), np.uint64(n)):  # unsigned: no negative index to look for
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        v += c
        w += d
        out = table[OUT, i]
        x += out * d
        swing += out * (out * (c + of_mode(rho, 0) * d))
    return x, v - of_mode(rho, 0) * w, swing


@apart
@kernel(fastmath={"contract", "reassoc"})
def propagate_two_points(n, z, table, rho, f0, f1, f_a):
    """The same with the actuator elsewhere: displacement, velocity, mean displacement over the
    step at the contact, displacement at the actuator."""
    x = 0.0
    v = 0.0
    m = 0.0
    y = 0.0
    for i in range(n):
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1 + table[A_RE, i] * f_a
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1 + table[A_IM, i] * f_a
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        x += table[OUT, i] * d
        v += table[B_C, i] * (c - of_mode(rho, i) * d)
        m += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
        y += table[B_A, i] * d
    return x, v, m, y


@apart
@kernel(fastmath={"contract", "reassoc"})
def dissipated_with_modes(n, z, table, f0, f1):
    """The terms of a step's loss that depend on z and the force at the contact, J."""
    lost = 0.0
    for i in range(n):
        zr, zi = z[0, i], z[1, i]
        by_r = table[LOSS_R0, i] * f0 + table[LOSS_R1, i] * f1
        by_i = table[LOSS_I0, i] * f0 + table[LOSS_I1, i] * f1
        lost += zr * (table[LOSS_RR, i] * zr + table[LOSS_RI, i] * zi + by_r)
        lost += zi * (table[LOSS_II, i] * zi + by_i)
    return lost


@apart
@kernel(fastmath={"contract", "reassoc"})
def weighted(n, z, real, imaginary):
    """Sum of z by two columns of the table."""
    total = 0.0
    for i in range(n):
        total += real[i] * z[0, i] + imaginary[i] * z[1, i]
    return total


@apart
@kernel
def fold_slope(n, z, table, f_a1):
    """Fold the slope of a separate actuator's force into the first `n` modes."""
    for i in range(n):
        z[0, i] += table[A1_RE, i] * f_a1
        z[1, i] += table[A1_IM, i] * f_a1


@kernel(inline=True)
def _dissipated_in_step(model, state, g, table, f0, f1, f_a):
    """Energy that the modes lost in the step just done, by the losses in gains `g` and `table`, J;
    forces up on the plate."""
    count = state.z.shape[1]
    lost = dissipated_with_modes(count, state.z, table, f0, f1)
    if f_a != 0.0:
        lost += f_a * weighted(count, state.z, table[LOSS_RA], table[LOSS_IA])
    if act.has_slope(model.actuator) and not model.same_point:
        slope = state.body[F_A1]
        by_slope = weighted(count, state.z, table[LOSS_RB], table[LOSS_IB])
        by_slope += g[elastic.LOSS_0B] * f0 + g[elastic.LOSS_1B] * f1 + g[elastic.LOSS_AB] * f_a
        lost += slope * (by_slope + g[elastic.LOSS_BB] * slope)
    lost += (
        g[elastic.LOSS_00] * f0 * f0 + g[elastic.LOSS_01] * f0 * f1 + g[elastic.LOSS_11] * f1 * f1
    )
    return lost + f_a * (
        g[elastic.LOSS_0A] * f0 + g[elastic.LOSS_1A] * f1 + g[elastic.LOSS_AA] * f_a
    )


@kernel
def _dissipated_in_flight(model, state, table, steps):
    """Energy that the modes lost in `steps` steps without force since the snapshot, J."""
    lost = 0.0
    duration = steps * model.step_s
    for i in range(state.z.shape[1]):
        th = table[THETA, i]
        rho = of_mode(model.rho, i)
        size = math.exp(-rho * th * duration)
        er = size * math.cos(th * duration)
        ei = size * math.sin(th * duration)
        yr, yi = state.free[0, i] / th, state.free[1, i] / th
        lost += table[ENERGY, i] * state_kernels.dissipation(th, rho, duration, yr, yi, er, ei)
    return lost


@kernel(inline=True)
def forces_on_plate(model, state):
    """Forces of the last step, up on the plate: F_0, F_1 at the contact, a separate actuator."""
    body = state.body
    if model.same_point:
        if act.has_slope(model.actuator):
            return body[F_A] - body[F_C], body[F_A1] - body[F_C1], 0.0
        return body[F_A] - body[F_C], -body[F_C1], 0.0
    return -body[F_C], -body[F_C1], body[F_A]


@kernel(inline=True)
def unforced(model, state, f0, f1, f_a):
    """Whether none of the last step's forces acted."""
    quiet = f0 == 0.0 and f1 == 0.0 and f_a == 0.0
    if act.has_slope(model.actuator):
        return quiet and state.body[F_A1] == 0.0
    return quiet


@kernel(inline=True)
def _book_flight(model, state, steps):
    """Book what the modes lost in `steps` steps without force since the snapshot."""
    state.balance[MODAL_DISSIPATED] += _dissipated_in_flight(model, state, model.table, steps)


@kernel(inline=True)
def settle_balance(model, state):
    """Book the modal dissipation of the step just done. Called before z moves on."""
    if not model.damped:
        return
    counts = state.counts
    step = counts[STEP]
    f0, f1, f_a = forces_on_plate(model, state)
    quiet = unforced(model, state, f0, f1, f_a)
    if quiet and counts[FREE_SINCE] >= 0:
        return
    if counts[FREE_SINCE] >= 0:
        steps = step - 1 - counts[FREE_SINCE]
        _book_flight(model, state, steps)
        counts[FREE_SINCE] = -1
    state.balance[MODAL_DISSIPATED] += _dissipated_in_step(
        model, state, model.gains, model.table, f0, f1, f_a
    )
    if quiet:
        for i in range(state.z.shape[1]):
            state.free[0, i] = state.z[0, i]
            state.free[1, i] = state.z[1, i]
        counts[FREE_SINCE] = step


@kernel
def modal_energy(model, state):
    """Kinetic and elastic energy of all oscillators and a residual mode at the present step, J."""
    f0, f1, f_a = forces_on_plate(model, state)
    table = model.table
    total = residual_mode_kernels.energy(model.residual_mode, state.body)
    for i in range(state.z.shape[1]):
        rho = of_mode(model.rho, i)
        zr = state.z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        zi = state.z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        if not model.same_point:
            zr += table[A_RE, i] * f_a
            zi += table[A_IM, i] * f_a
            if act.has_slope(model.actuator):
                zr += table[A1_RE, i] * state.body[F_A1]
                zi += table[A1_IM, i] * state.body[F_A1]
        speed = zr - rho * zi
        total += table[ENERGY, i] * (speed * speed + (1.0 + rho * rho) * zi * zi)
    return total


@kernel
def close_balance(model, state):
    """Book the last step and the last flight; to be called once, after the last step. Returns the
    `modal_energy` then, J."""
    if model.damped and state.counts[STEP] > 0:
        settle_balance(model, state)
        if state.counts[FREE_SINCE] >= 0:
            flight = state.counts[STEP] - state.counts[FREE_SINCE]
            _book_flight(model, state, flight)
    return modal_energy(model, state)


@kernel(inline=True)
def contact_energy(model, state):
    """Energy stored in the contact and the spring of the modes left out, J."""
    return state.body[STORED]


@kernel(inline=True)
def has_slope(model):
    """Whether the actuator's force can change within a step."""
    return act.has_slope(model.actuator)


@kernel(inline=True)
def yields(model):
    """Whether the contact has a deepest penetration to remember."""
    return yielding.yields(model.law)


@kernel(inline=True)
def _silence(state):
    """Leave out the modes of highest frequency that have died away."""
    n = state.counts[AWAKE]
    while n > 0 and abs(state.z[0, n - 1]) + abs(state.z[1, n - 1]) <= SILENT_M:
        n -= 1
        state.z[0, n] = 0.0
        state.z[1, n] = 0.0
    state.counts[AWAKE] = n


@kernel(inline=True)
def _observe(model, body, sphere, sphere_v, gap, force, root, f_a, f_a1, push):
    """Write what can be seen: gap and plate with the spring of the modes left out, which the
    contact force `force` (N, without damping) at the modal gap `gap` compresses; `root`: of the
    penetration; `push`: force on a residual mode at the step's end, N."""
    spring, h = model.flexibility_m_n, model.step_s
    plate, speed = body[MODAL_X], body[MODAL_V]
    if residual_mode_kernels.there(model.residual_mode):
        speed += residual_mode_kernels.mobility(model.residual_mode) * push
    if spring != 0.0:
        if model.same_point:
            plate += spring * f_a
            if act.has_slope(model.actuator):
                plate += spring * f_a1
                speed += 2.0 * spring * f_a1 / h
        if force > 0.0:
            plate -= spring * force
            contact = elastic.contact_of(model, model.stiffness)
            by_gap = yielding.slope(model.law, contact, body, gap, root, sphere_v < speed)
            speed -= spring * by_gap * (sphere_v - speed)
    body[V_P_OF_STEP] = body[V_P]
    body[A_P] = (speed - body[V_P]) / h
    body[XI] = sphere - plate
    body[XI_S] = sphere
    body[XI_P] = plate
    body[V_P] = speed
    body[XI_A] = plate if model.same_point else body[MODAL_Y]


@kernel(inline=True)
def _bend_own_spring(model, state, gap, own):
    """Let the actuator's force at the start of a step bend the spring of the modes left out, `own`
    (m), at once; energy in the contact then (J), at the modal gap `gap`."""
    before = state.body[STORED]
    if own != state.body[OWN]:
        taken = state.balance[PLASTIC_DISSIPATED]
        contact = elastic.contact_of(model, model.stiffness)
        after = yielding.settle(model.law, contact, state, gap, 0.0)[1]
        taken = state.balance[PLASTIC_DISSIPATED] - taken
        state.balance[INJECTED] += (after - before) + taken
        return after
    return before


@kernel
def step(model, state, command):
    """Advance one step under a commanded actuator force (N); returns the mean contact force (N)."""
    body, counts, g, h = state.body, state.counts, model.gains, model.step_s
    if counts[STEP] > 0:
        settle_balance(model, state)
    f0, f1, f_act = forces_on_plate(model, state)
    quiet = unforced(model, state, f0, f1, f_act)
    command = max(-act.MOST_N, min(act.MOST_N, command))
    f_a, f_a1 = act.force(model.actuator, body, command)
    sloped = act.has_slope(model.actuator)
    pushed = f_a != 0.0 or (sloped and f_a1 != 0.0)
    if not quiet or pushed:
        counts[AWAKE] = state.z.shape[1]
    elif counts[STEP] % LOOK_EVERY == 0:
        _silence(state)
    awake = counts[AWAKE]
    swing = mean = 0.0
    drifts = quiet and model.same_point
    if drifts:
        x, v = drift(awake, state.z, model.table, model.rho)
        y = x
    elif model.same_point:
        slow = model.slow
        x, v, swing = propagate_same_point(slow, awake, state.z, model.table, model.rho, f0, f1)
        x_slow, v_slow, mean = propagate_slow(slow, state.z, model.table, model.rho, f0, f1)
        x += x_slow
        v += v_slow
        mean += g[elastic.MEAN_BY_SWING] * (swing - body[SWING])
        y = x
    else:
        if sloped and not quiet:
            fold_slope(awake, state.z, model.table, body[F_A1])
        x, v, mean, y = propagate_two_points(awake, state.z, model.table, model.rho, f0, f1, f_act)
    drifted = _probe(model.probe, model, state.z, awake)
    x_residual, v_residual, mean_residual = residual_mode_kernels.turned(model.residual_mode, body)
    if residual_mode_kernels.there(model.residual_mode):
        x += x_residual
        v += v_residual
    x += g[elastic.CA] * f_a
    v += g[elastic.VA] * f_a
    if sloped:
        x += g[elastic.CA1] * f_a1
        v += g[elastic.VA1] * f_a1
    gravity = model.gravity_m_s2
    sphere_0, before_v, sphere, sphere_v = state_kernels.flight(model, body, counts)
    # Modal gaps: without the spring of the modes left out, whose share of F_a is added.
    spring = model.flexibility_m_n if model.same_point else 0.0
    own = spring * f_a
    bent = spring * f_a1  # by which it differs from `own` at both ends
    own_0, own_1 = own, own
    if sloped:
        own_0, own_1 = own - bent, own + bent
    gap_0 = sphere_0 - body[MODAL_X] - own_0
    free = sphere - x - own_1
    slope_0 = h * (before_v - body[MODAL_V])
    slope = h * (sphere_v - v)
    if sloped:
        slope_0 -= 2.0 * bent
        slope -= 2.0 * bent
    if residual_mode_kernels.there(model.residual_mode) and model.same_point:
        slope_0 -= h * residual_mode_kernels.mobility(model.residual_mode) * (f_a - f_a1)
    f_c = 0.0
    f_c1 = 0.0
    lost = 0.0
    before = _bend_own_spring(model, state, gap_0, own_0)
    body[OWN] = own_1
    rest = -yielding.dent(model.law, body)
    contact = elastic.contact_of(model, model.stiffness)
    touches = gap_0 < rest or free < rest or (slope_0 < 0.0 < slope)
    if drifts and (touches or pushed):
        mean, swing = mean_of_drift(model.slow, awake, state.z, model.table, model.rho)
    root = 0.0
    if residual_mode_kernels.there(model.residual_mode):
        mean += mean_residual
    mean += g[elastic.MA] * f_a
    if sloped:
        mean += g[elastic.MA1] * f_a1
    if touches:
        free_mean = sphere_0 + 0.5 * h * before_v - h * h * gravity / 6.0 - mean - own
        # A good start for Newton: no jump between steps, the slope extrapolated.
        guess1 = 2.0 * body[F_C1] - body[F_C1_BEFORE]
        f_c, f_c1, lost, evaluations, root = yielding.solve_contact(
            model.law,
            contact,
            body,
            gap_0,
            slope_0,
            free,
            slope,
            free_mean,
            before,
            body[F_C] + body[F_C1] + guess1,
            guess1,
        )
        counts[NEWTON_TOTAL] += evaluations
        counts[NEWTON_MAX] = max(counts[NEWTON_MAX], evaluations)
    if f_c != 0.0 or f_c1 != 0.0:
        x -= g[elastic.PX0] * f_c + g[elastic.PX1] * f_c1
        v -= g[elastic.PV0] * f_c + g[elastic.PV1] * f_c1
        y -= g[elastic.AC0] * f_c + g[elastic.AC1] * f_c1
        sphere, sphere_v = state_kernels.push(model, state, sphere, sphere_v, f_c, f_c1, lost)
    y = x if model.same_point else y + g[elastic.AA] * f_a
    if sloped and not model.same_point:
        y += g[elastic.AA1] * f_a1
    modal_gap = sphere - x - own_1
    force_1, body[STORED], root = yielding.settle(model.law, contact, state, modal_gap, root)
    state.balance[INJECTED] += f_a * (y - body[MODAL_Y])
    if sloped and pushed:
        if model.same_point:
            mean -= g[elastic.PM0] * f_c + g[elastic.PM1] * f_c1
        else:
            real, imaginary = model.table[MEAN_A_IM], model.table[MEAN_A_RE]
            mean = weighted(awake, state.z, real, imaginary)
            mean += g[elastic.MAA] * f_a + g[elastic.MAA1] * f_a1
            mean -= g[elastic.MAC0] * f_c + g[elastic.MAC1] * f_c1
        # Work of the slope, and of the contact on what the slope bends the spring by.
        state.balance[INJECTED] += f_a1 * (y + body[MODAL_Y] - 2.0 * mean) + 2.0 * bent * f_c
    push = 0.0
    if residual_mode_kernels.there(model.residual_mode):
        push_0, push_1 = -f_c, -f_c1
        if model.same_point:
            push_0 += f_a
            push_1 += f_a1
        residual_mode_kernels.pushed(model.residual_mode, state, push_0, push_1)
        push = push_0 + push_1
        v -= residual_mode_kernels.mobility(model.residual_mode) * push
    body[MODAL_X] = x
    body[MODAL_V] = v
    body[MODAL_Y] = y
    body[SWING] = swing + g[elastic.SWING0] * (f_a - f_c) - g[elastic.SWING1] * f_c1
    if sloped:
        body[SWING] += g[elastic.SWING1] * f_a1
    _observe(model, body, sphere, sphere_v, modal_gap, force_1, root, f_a, f_a1, push)
    _note(model.probe, model, body, drifted, f_c, f_c1, f_a, f_a1)
    body[F_C] = f_c
    body[F_C1_BEFORE] = body[F_C1]
    body[F_C1] = f_c1
    body[F_A] = f_a
    if sloped:
        body[F_A1] = f_a1
    counts[STEP] += 1
    return f_c
