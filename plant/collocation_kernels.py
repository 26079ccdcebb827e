"""Compiled kernels of the default scheme `modal`: energy-preserving exponential collocation.

Every mode is propagated exactly under a contact force that is linear over the step,
F(t) = F_0 + F_1 P(t), P = 2 t/h - 1; the two numbers are the projection of the contact law on
linear functions, so the scheme has order 4 (Hairer 2010 for the projection; Brugnano,
Iavernaro and Trigiante for the correction that makes the energy exact). The law is
integrated along the quartic through gap and velocity at both ends and the mean gap, which
the modes give exactly, over the part of the step that is in contact.

Modes left out act as a massless spring, `flexibility`, in series with the contact. Signs and
one pass per step as in `plant.kernels`, but z is Theta times the z there: velocity is
Re z - rho Im z, displacement Im z/Theta. The scalar equations of a step are in
`plant.contact_solve_kernels`.

Nothing here allocates, so kernels are compiled without Numba's reference counts (`_nrt=False`):
counting the arrays of model and state up and down took 0.15 us a step.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from plant import contact_solve_kernels as solve
from plant import kernels as pk

# Columns of CollocationModel.table. ROT: e^(s h); C0, C1: change of z by a unit constant force
# and a unit P(t) at the contact; A: by a constant force at the actuator; OUT, B_A: displacement
# at contact and actuator by Im z; B_C: velocity at the contact by z; MEAN: mean displacement
# over the step from z at its end without force.
ROT_RE, ROT_IM, OUT, C0_RE, C0_IM, C1_RE, C1_IM = range(7)
MEAN_RE, MEAN_IM, A_RE, A_IM, B_C, B_A, THETA, ENERGY = range(7, 15)
# Energy lost in a step: a quadratic form of z at its end without forces and F_0, F_1, F_a; the
# terms without z are summed over all modes, in `gains`.
LOSS_RR, LOSS_RI, LOSS_II, LOSS_R0, LOSS_I0, LOSS_R1, LOSS_I1, LOSS_RA, LOSS_IA = range(15, 24)
COLUMNS = 24
# Further indices into the state's body: displacement and velocity at the contact and
# displacement at the actuator by the modes alone, energy stored in the contact (J), what the
# actuator bends the spring of the modes left out by (m), `swing` of `_propagate_same_point`
# (m s; known after steps with force), F_C1 of the step before the last (N).
MODAL_X, MODAL_V, MODAL_Y, STORED, OWN, SWING, F_C1_BEFORE = range(pk.BODY_SIZE, pk.BODY_SIZE + 7)
BODY_SIZE = pk.BODY_SIZE + 7


class CollocationState(NamedTuple):
    """What changes: z by modes, and scalars by the indices above; as PlantState."""

    z: np.ndarray  # (2, modes): real and imaginary parts, m/s
    free: np.ndarray  # z at step counts[FREE_SINCE], while no force acts
    body: np.ndarray
    books: np.ndarray
    counts: np.ndarray


class CollocationModel(NamedTuple):
    """What does not change during a run; `table`: (COLUMNS, modes), `gains`:
    (GAINS,)."""

    step_s: float
    mass_kg: float
    gravity_m_s2: float
    stiffness: float
    flexibility_m_n: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    same_point: bool
    damped: bool
    rho: float
    slow: int  # the first modes, whose mean over a step is taken one by one
    gains: np.ndarray
    table: np.ndarray


# Sums over modes may be reordered into vector lanes, once, when a pass is compiled: every caller
# gets the same bits on one kind of processor.
_SUMS = {"reassoc", "contract"}


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _drift(n, z, table, rho):
    """One step without force of the first `n` modes: displacement and velocity at the point."""
    x = 0.0
    v = 0.0
    for i in range(n):
        c = table[ROT_RE, i] * z[0, i] - table[ROT_IM, i] * z[1, i]
        d = table[ROT_RE, i] * z[1, i] + table[ROT_IM, i] * z[0, i]
        z[0, i] = c
        z[1, i] = d
        x += table[OUT, i] * d
        v += c - rho * d
    return x, v


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _mean_of_drift(slow, n, z, table, rho):
    """Mean displacement over the step that `_drift` has just made, and `swing` at its end."""
    mean = 0.0
    swing = 0.0
    for i in range(n):
        mean += table[MEAN_RE, i] * z[1, i] + table[MEAN_IM, i] * z[0, i]
    for i in range(np.uint64(slow), np.uint64(n)):  # unsigned: no negative index to look for
        swing += table[OUT, i] * (table[OUT, i] * (z[0, i] + rho * z[1, i]))
    return mean, swing


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _propagate_slow(slow, z, table, rho, f0, f1):
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
        v += c - rho * d
        x += table[OUT, i] * d
        mean += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
    return x, v, mean


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _propagate_same_point(slow, n, z, table, rho, f0, f1):
    """The same for the other awake modes; displacement, velocity, swing at the point.

    `swing` is the sum of (Re z + rho Im z)/Theta^2, which falls by (1 + rho^2) times the time
    integral of the displacement while no force acts.
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
        swing += out * (out * (c + rho * d))
    return x, v - rho * w, swing


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _propagate_two_points(n, z, table, rho, f0, f1, f_a):
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
        v += table[B_C, i] * (c - rho * d)
        m += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
        y += table[B_A, i] * d
    return x, v, m, y


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _dissipated_with_modes(n, z, table, f0, f1):
    """The terms of a step's loss that depend on z and the force at the contact, J."""
    lost = 0.0
    for i in range(n):
        zr, zi = z[0, i], z[1, i]
        by_r = table[LOSS_R0, i] * f0 + table[LOSS_R1, i] * f1
        by_i = table[LOSS_I0, i] * f0 + table[LOSS_I1, i] * f1
        lost += zr * (table[LOSS_RR, i] * zr + table[LOSS_RI, i] * zi + by_r)
        lost += zi * (table[LOSS_II, i] * zi + by_i)
    return lost


@njit(cache=True, error_model="numpy", fastmath=_SUMS, _nrt=False)
def _dissipated_with_actuator(n, z, table):
    """The terms that depend on z and a unit force at a separate actuator, J/N."""
    lost = 0.0
    for i in range(n):
        lost += table[LOSS_RA, i] * z[0, i] + table[LOSS_IA, i] * z[1, i]
    return lost


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _dissipated_in_step(model, state, f0, f1, f_a):
    """Energy that the modes lost in the step just done, J; forces up on the plate."""
    g = model.gains
    modes = state.z.shape[1]
    lost = _dissipated_with_modes(modes, state.z, model.table, f0, f1)
    if f_a != 0.0:
        lost += f_a * _dissipated_with_actuator(modes, state.z, model.table)
    lost += g[solve.LOSS_00] * f0 * f0 + g[solve.LOSS_01] * f0 * f1 + g[solve.LOSS_11] * f1 * f1
    return lost + f_a * (g[solve.LOSS_0A] * f0 + g[solve.LOSS_1A] * f1 + g[solve.LOSS_AA] * f_a)


@njit(cache=True, error_model="numpy", _nrt=False)
def _dissipated_in_flight(model, state, steps):
    """Energy that the modes lost in `steps` steps without force since the snapshot, J."""
    lost = 0.0
    duration = steps * model.step_s
    for i in range(state.z.shape[1]):
        th = model.table[THETA, i]
        size = math.exp(-model.rho * th * duration)
        er = size * math.cos(th * duration)
        ei = size * math.sin(th * duration)
        yr, yi = state.free[0, i] / th, state.free[1, i] / th
        lost += model.table[ENERGY, i] * pk.dissipation(th, model.rho, duration, yr, yi, er, ei)
    return lost


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _forces_on_plate(model, state):
    """Forces of the last step, up on the plate: F_0, F_1 at the contact, a separate actuator."""
    body = state.body
    if model.same_point:
        return body[pk.F_A] - body[pk.F_C], -body[pk.F_C1], 0.0
    return -body[pk.F_C], -body[pk.F_C1], body[pk.F_A]


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def settle_books(model, state):
    """Book the modal dissipation of the step just done. Called before z moves on."""
    if not model.damped:
        return
    counts = state.counts
    step = counts[pk.STEP]
    f0, f1, f_a = _forces_on_plate(model, state)
    quiet = f0 == 0.0 and f1 == 0.0 and f_a == 0.0
    if quiet and counts[pk.FREE_SINCE] >= 0:
        return
    if counts[pk.FREE_SINCE] >= 0:
        steps = step - 1 - counts[pk.FREE_SINCE]
        state.books[pk.MODAL_DISSIPATED] += _dissipated_in_flight(model, state, steps)
        counts[pk.FREE_SINCE] = -1
    state.books[pk.MODAL_DISSIPATED] += _dissipated_in_step(model, state, f0, f1, f_a)
    if quiet:
        for i in range(state.z.shape[1]):
            state.free[0, i] = state.z[0, i]
            state.free[1, i] = state.z[1, i]
        counts[pk.FREE_SINCE] = step


@njit(cache=True, error_model="numpy", _nrt=False)
def close_books(model, state):
    """Book the last step and the last flight; to be called once, after the last step."""
    if not model.damped or state.counts[pk.STEP] == 0:
        return
    settle_books(model, state)
    if state.counts[pk.FREE_SINCE] >= 0:
        flight = state.counts[pk.STEP] - state.counts[pk.FREE_SINCE]
        state.books[pk.MODAL_DISSIPATED] += _dissipated_in_flight(model, state, flight)


@njit(cache=True, error_model="numpy", _nrt=False)
def modal_energy(model, state):
    """Kinetic and elastic energy of all oscillators at the present step, J."""
    f0, f1, f_a = _forces_on_plate(model, state)
    table = model.table
    total = 0.0
    rho = model.rho
    for i in range(state.z.shape[1]):
        zr = state.z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        zi = state.z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        if not model.same_point:
            zr += table[A_RE, i] * f_a
            zi += table[A_IM, i] * f_a
        speed = zr - rho * zi
        total += table[ENERGY, i] * (speed * speed + (1.0 + rho * rho) * zi * zi)
    return total


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _silence(state):
    """Leave out the modes of highest frequency that have died away (see plant.kernels)."""
    n = state.counts[pk.ROWS]
    while n > 0 and abs(state.z[0, n - 1]) + abs(state.z[1, n - 1]) <= pk.SILENT_M:
        n -= 1
        state.z[0, n] = 0.0
        state.z[1, n] = 0.0
    state.counts[pk.ROWS] = n


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)
def _observe(model, body, sphere, sphere_v, force, root, f_a):
    """Write what can be seen: gap and plate with the spring of the modes left out, which the
    contact force `force` (N, without damping) compresses; `root`: of the penetration."""
    spring, h = model.flexibility_m_n, model.step_s
    plate, speed = body[MODAL_X], body[MODAL_V]
    if spring > 0.0:
        if model.same_point:
            plate += spring * f_a
        if force > 0.0:
            plate -= spring * force
            by_gap = -3.0 * model.stiffness * root / (2.0 + 3.0 * spring * model.stiffness * root)
            speed -= spring * by_gap * (sphere_v - speed)
    body[pk.V_P_OF_STEP] = body[pk.V_P]
    body[pk.A_P] = (speed - body[pk.V_P]) / h
    body[pk.XI] = sphere - plate
    body[pk.XI_S] = sphere
    body[pk.XI_P] = plate
    body[pk.V_P] = speed
    body[pk.XI_A] = plate if model.same_point else body[MODAL_Y]


@njit(cache=True, error_model="numpy", _nrt=False)
def step(model, state, f_a):
    """Advance one step under the actuator force `f_a` (N); returns the mean contact force (N)."""
    body, counts, g, h = state.body, state.counts, model.gains, model.step_s
    if counts[pk.STEP] > 0:
        settle_books(model, state)
    f0, f1, f_act = _forces_on_plate(model, state)
    quiet = f0 == 0.0 and f1 == 0.0 and f_act == 0.0
    if not quiet or f_a != 0.0:
        counts[pk.ROWS] = state.z.shape[1]
    elif counts[pk.STEP] % pk.LOOK_EVERY == 0:
        _silence(state)
    awake = counts[pk.ROWS]
    swing = mean = 0.0
    drifts = quiet and model.same_point
    if drifts:
        x, v = _drift(awake, state.z, model.table, model.rho)
        y = x
    elif model.same_point:
        slow = model.slow
        x, v, swing = _propagate_same_point(slow, awake, state.z, model.table, model.rho, f0, f1)
        x_slow, v_slow, mean = _propagate_slow(slow, state.z, model.table, model.rho, f0, f1)
        x += x_slow
        v += v_slow
        mean += g[solve.MEAN_BY_SWING] * (swing - body[SWING])
        y = x
    else:
        x, v, mean, y = _propagate_two_points(awake, state.z, model.table, model.rho, f0, f1, f_act)
    x += g[solve.CA] * f_a
    v += g[solve.VA] * f_a
    # The sphere, ballistic since FLIGHT_STEP.
    t = (counts[pk.STEP] + 1 - counts[pk.FLIGHT_STEP]) * h
    gravity = model.gravity_m_s2
    sphere = body[pk.FLIGHT_X] + t * (body[pk.FLIGHT_V] - 0.5 * gravity * t)
    sphere_v = body[pk.FLIGHT_V] - gravity * t
    t0 = t - h
    sphere_0 = body[pk.FLIGHT_X] + t0 * (body[pk.FLIGHT_V] - 0.5 * gravity * t0)
    before_v = sphere_v + gravity * h
    # Modal gaps: without the spring of the modes left out, whose share of F_a is added.
    spring = model.flexibility_m_n
    own = spring * f_a if model.same_point else 0.0
    gap_0 = sphere_0 - body[MODAL_X] - own
    free = sphere - x - own
    slope_0 = h * (before_v - body[MODAL_V])
    slope = h * (sphere_v - v)
    f_c = 0.0
    f_c1 = 0.0
    lost = 0.0
    before = body[STORED]
    if own != body[OWN]:  # the actuator bends the spring of the modes left out at once
        before = solve.elastic(model, gap_0)[1]
        state.books[pk.INJECTED] += before - body[STORED]
        body[OWN] = own
    touches = gap_0 < 0.0 or free < 0.0 or (slope_0 < 0.0 < slope)
    if drifts and (touches or f_a != 0.0):
        mean, swing = _mean_of_drift(model.slow, awake, state.z, model.table, model.rho)
    root = 0.0
    if touches:
        mean += g[solve.MA] * f_a
        free_mean = sphere_0 + 0.5 * h * before_v - h * h * gravity / 6.0 - mean - own
        # A good start for Newton: no jump between steps, the slope extrapolated.
        guess1 = 2.0 * body[pk.F_C1] - body[F_C1_BEFORE]
        f_c, f_c1, lost, evaluations, root = solve.solve_contact(
            model,
            gap_0,
            slope_0,
            free,
            slope,
            free_mean,
            before,
            body[pk.F_C] + body[pk.F_C1] + guess1,
            guess1,
        )
        counts[pk.NEWTON_TOTAL] += evaluations
        counts[pk.NEWTON_MAX] = max(counts[pk.NEWTON_MAX], evaluations)
    if f_c != 0.0 or f_c1 != 0.0:
        x -= g[solve.PX0] * f_c + g[solve.PX1] * f_c1
        v -= g[solve.PV0] * f_c + g[solve.PV1] * f_c1
        y -= g[solve.AC0] * f_c + g[solve.AC1] * f_c1
        sphere += h * h / model.mass_kg * (0.5 * f_c - f_c1 / 6.0)
        sphere_v += h / model.mass_kg * f_c
        body[pk.FLIGHT_X] = sphere
        body[pk.FLIGHT_V] = sphere_v
        counts[pk.FLIGHT_STEP] = counts[pk.STEP] + 1
        counts[pk.CONTACT_STEPS] += 1
        state.books[pk.CONTACT_IMPULSE] += f_c * h
        state.books[pk.CONTACT_DISSIPATED] += lost
    y = x if model.same_point else y + g[solve.AA] * f_a
    modal_gap = sphere - x - own
    force_1, body[STORED], root = solve.elastic_near(model, modal_gap, root)
    state.books[pk.INJECTED] += f_a * (y - body[MODAL_Y])
    body[MODAL_X] = x
    body[MODAL_V] = v
    body[MODAL_Y] = y
    body[SWING] = swing + g[solve.SWING0] * (f_a - f_c) - g[solve.SWING1] * f_c1
    _observe(model, body, sphere, sphere_v, force_1, root, f_a)
    body[pk.F_C] = f_c
    body[F_C1_BEFORE] = body[pk.F_C1]
    body[pk.F_C1] = f_c1
    body[pk.F_A] = f_a
    counts[pk.STEP] += 1
    return f_c
