"""Compiled kernels of the default scheme `modal`: energy-preserving exponential collocation.

Every mode is propagated exactly under a contact force that is linear over the step,
F(t) = F_0 + F_1 P(t), P = 2 t/h - 1; the two numbers are the projection of the contact law on
linear functions, so the scheme has order 4 (Hairer 2010 for the projection; Brugnano,
Iavernaro and Trigiante for the correction that makes the energy exact). The law is
integrated along the quartic through gap and velocity at both ends and the mean gap, which
the modes give exactly, over the part of the step that is in contact.

Modes left out act as a massless spring, `flexibility`, in series with the contact. Signs and
one pass per step as in `plant.kernels`.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from plant import kernels as pk

# Columns of CollocationModel.table. ROT: e^(s h); C0, C1: change of z by a unit constant force
# and a unit P(t) at the contact; A: by a constant force at the actuator; MEAN: mean over
# the step from z at its end without force.
ROT_RE, ROT_IM, C0_RE, C0_IM, C1_RE, C1_IM, MEAN_RE, MEAN_IM, THETA = range(9)
A_RE, A_IM, B_C, B_A = range(9, 13)
# Energy lost in a step: a quadratic form of z at its end without forces and F_0, F_1, F_a; the
# terms without z are summed over all modes, in `gains`.
ENERGY, LOSS_RR, LOSS_RI, LOSS_II = range(13, 17)
LOSS_R0, LOSS_I0, LOSS_R1, LOSS_I1, LOSS_RA, LOSS_IA = range(17, 23)
COLUMNS = 23
# Further indices into the state's body: displacement and velocity at the contact and
# displacement at the actuator by the modes alone, energy stored in the contact (J), what the
# actuator bends the spring of the modes left out by (m).
MODAL_X, MODAL_V, MODAL_Y, STORED, OWN = range(pk.BODY_SIZE, pk.BODY_SIZE + 5)
BODY_SIZE = pk.BODY_SIZE + 5
# Indices into CollocationModel.gains: gap at the end, its velocity, its mean, by F_0 and F_1;
# then the plate's own displacement and velocity (up per force up on it).
# CA, VA, MA: the same by F_a; AC0, AC1, AA: displacement at the actuator; LOSS: energy lost.
X0, X1, V0, V1, M0, M1, PX0, PX1, PV0, PV1, PM0, PM1, CA, VA, MA, AC0, AC1, AA = range(18)
LOSS_00, LOSS_01, LOSS_11, LOSS_0A, LOSS_1A, LOSS_AA = range(18, 24)
GAINS = 24

_NODES = 4
_NEWTON_MOST = 12
_CORRECTIONS = 12
_ROUNDING, _BALANCED = 2e-16, 1e-13  # of the energies at hand: as good as can be, good enough
_HALVINGS = 90
_TIGHT = 1e-7  # of the force; Newton squares what is left
# Gauss-Legendre nodes and weights on (0, 1).
_half = 0.5 * np.polynomial.legendre.leggauss(_NODES)[0] + 0.5
_GAUSS_T = tuple(float(x) for x in _half)
_GAUSS_W = tuple(0.5 * float(x) for x in np.polynomial.legendre.leggauss(_NODES)[1])


class CollocationState(NamedTuple):
    """What changes: z by modes, and scalars by the indices above; as PlantState."""

    z: np.ndarray  # (2, modes): real and imaginary parts
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
    gains: np.ndarray
    table: np.ndarray


# Sums over modes may be reordered into vector lanes, once, when a pass is compiled: every caller
# gets the same bits on one kind of processor.
_SUMS = {"reassoc", "contract"}


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _drift(n, z, table, rho):
    """One step without force of the first `n` modes: displacement and velocity at the point."""
    x = 0.0
    v = 0.0
    for i in range(n):
        c = table[ROT_RE, i] * z[0, i] - table[ROT_IM, i] * z[1, i]
        d = table[ROT_RE, i] * z[1, i] + table[ROT_IM, i] * z[0, i]
        z[0, i] = c
        z[1, i] = d
        x += d
        v += table[THETA, i] * (c - rho * d)
    return x, v


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _mean_of_drift(n, z, table):
    """Mean displacement over the step that `_drift` has just made."""
    m = 0.0
    for i in range(n):
        m += table[MEAN_RE, i] * z[1, i] + table[MEAN_IM, i] * z[0, i]
    return m


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _propagate_same_point(n, z, table, rho, f0, f1):
    """Fold f0 + f1 P in, propagate one step; displacement, velocity, mean at the point."""
    x = 0.0
    v = 0.0
    m = 0.0
    for i in range(n):
        a = z[0, i] + table[C0_RE, i] * f0 + table[C1_RE, i] * f1
        b = z[1, i] + table[C0_IM, i] * f0 + table[C1_IM, i] * f1
        c = table[ROT_RE, i] * a - table[ROT_IM, i] * b
        d = table[ROT_RE, i] * b + table[ROT_IM, i] * a
        z[0, i] = c
        z[1, i] = d
        x += d
        v += table[THETA, i] * (c - rho * d)
        m += table[MEAN_RE, i] * d + table[MEAN_IM, i] * c
    return x, v, m


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _propagate_two_points(n, z, table, rho, f0, f1, f_a):
    """The same with the actuator elsewhere, and the displacement there."""
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
        x += table[B_C, i] * d
        v += table[B_C, i] * table[THETA, i] * (c - rho * d)
        m += table[B_C, i] * (table[MEAN_RE, i] * d + table[MEAN_IM, i] * c)
        y += table[B_A, i] * d
    return x, v, m, y


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy", forceinline=True)
def elastic(model, gap):
    """Contact force without damping (N) at a modal gap, the energy in the contact and in the
    spring of the modes left out (J), and the root of the penetration (m^0.5)."""
    if gap >= 0.0:
        return 0.0, 0.0, 0.0
    y = root_penetration(model, gap)
    force = model.stiffness * y * y * y
    return force, force * (0.4 * y * y + 0.5 * model.flexibility_m_n * force), y


@njit(cache=True, error_model="numpy", forceinline=True)
def _law(model, gap, rate):
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _quartic(t, x0, x1, d0, d1, q):
    """Gap and its derivative by t at t in (0, 1): ends, end slopes, excess of the mean."""
    u = 1.0 - t
    gap = (
        (1.0 + 2.0 * t) * u * u * x0 + t * t * (3.0 - 2.0 * t) * x1
        + t * u * u * d0 - t * t * u * d1 + 30.0 * t * t * u * u * q
    )  # fmt: skip
    slope = (
        6.0 * t * u * (x1 - x0) + u * (1.0 - 3.0 * t) * d0 + t * (3.0 * t - 2.0) * d1
        + 60.0 * t * u * (u - t) * q
    )  # fmt: skip
    return gap, slope


@njit(cache=True, error_model="numpy")
def _crossing(negative, positive, x0, x1, d0, d1, q):
    """Where the quartic changes sign between t = negative (gap < 0) and t = positive."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (negative + positive)
        if middle == negative or middle == positive:
            break
        if _quartic(middle, x0, x1, d0, d1, q)[0] < 0.0:
            negative = middle
        else:
            positive = middle
    return negative


@njit(cache=True, error_model="numpy", forceinline=True)
def _touching_part(x0, x1, d0, d1, q):
    """The part (from, to) of the step that is in contact; from = to if none is."""
    if x0 < 0.0 and x1 < 0.0:
        return 0.0, 1.0
    if x0 < 0.0:
        return 0.0, _crossing(0.0, 1.0, x0, x1, d0, d1, q)
    if x1 < 0.0:
        return _crossing(1.0, 0.0, x0, x1, d0, d1, q), 1.0
    if d0 < 0.0 and d1 > 0.0:  # it may dip in and out again
        lowest, at = 0.0, -1.0
        for i in range(1, 16):
            gap = _quartic(i / 16.0, x0, x1, d0, d1, q)[0]
            if gap < lowest:
                lowest, at = gap, i / 16.0
        if at > 0.0:
            return (
                _crossing(at, 0.0, x0, x1, d0, d1, q), _crossing(at, 1.0, x0, x1, d0, d1, q)
            )  # fmt: skip
    return 0.0, 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _project(model, x0, x1, d0, d1, mean):
    """Projection of the law along the quartic: F_0, F_1, what damping takes (J), and the
    derivatives of F_0 and F_1 by x1, d1 and the mean."""
    q = mean - 0.5 * (x0 + x1) - (d0 - d1) / 12.0
    start, end = _touching_part(x0, x1, d0, d1, q)
    f0 = f1 = lost = 0.0
    f0_x = f0_d = f0_m = f1_x = f1_d = f1_m = 0.0
    if start == end:
        return f0, f1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m
    h = model.step_s
    for i in range(_NODES):
        t = start + (end - start) * _GAUSS_T[i]
        w = (end - start) * _GAUSS_W[i]
        gap, slope = _quartic(t, x0, x1, d0, d1, q)
        if gap >= 0.0:
            continue
        force, damping, by_gap, by_rate = _law(model, gap, slope / h)
        by_slope = by_rate / h
        u = 1.0 - t
        lift = 30.0 * t * t * u * u
        turn = 60.0 * t * u * (u - t)
        by_q = by_gap * lift + by_slope * turn
        by_x = by_gap * t * t * (3.0 - 2.0 * t) + by_slope * 6.0 * t * u - 0.5 * by_q
        by_d = -by_gap * t * t * u + by_slope * t * (3.0 * t - 2.0) + by_q / 12.0
        p = 3.0 * (2.0 * t - 1.0)
        f0 += w * force
        f1 += w * p * force
        lost -= w * damping * slope
        f0_x += w * by_x
        f0_d += w * by_d
        f0_m += w * by_q
        f1_x += w * p * by_x
        f1_d += w * p * by_d
        f1_m += w * p * by_q
    return f0, f1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m


@njit(cache=True, error_model="numpy")
def _chord(model, x0, x1):
    """Discrete gradient between two modal gaps, damping included, and damping's part (N)."""
    if x0 >= 0.0 and x1 >= 0.0:
        return 0.0, 0.0
    a = root_penetration(model, x0) if x0 < 0.0 else 0.0
    b = root_penetration(model, x1) if x1 < 0.0 else 0.0
    s, share = model.stiffness, model.flexibility_m_n * model.stiffness
    if (x0 < 0.0) != (x1 < 0.0):
        force = (elastic(model, x1)[1] - elastic(model, x0)[1]) / (x0 - x1)
    else:
        five = b**4 + b**3 * a + b * b * a * a + b * a**3 + a**4
        six = five * b + a**5
        way = b + a + share * (b * b + b * a + a * a)
        force = s * (0.4 * five + 0.5 * share * six) / way
    rate = (b * b - a * a) / model.step_s
    damping = (model.viscous_n_s_m + model.hunt_crossley_s_m * force) * rate
    return force + damping, damping


@njit(cache=True, error_model="numpy")
def _solve_chord(model, x0, free_x):
    """Constant force over the step by the discrete gradient, by bisection: always ends."""
    gain = model.gains[X0]
    low = min(0.0, _chord(model, x0, free_x)[0])
    high = max(0.0, _chord(model, x0, free_x)[0])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if middle == low or middle == high:
            break
        if middle > _chord(model, x0, free_x + gain * middle)[0]:
            high = middle
        else:
            low = middle
    f0 = 0.5 * (low + high)
    x1 = free_x + gain * f0
    return f0, -_chord(model, x0, x1)[1] * (x1 - x0)


@njit(cache=True, error_model="numpy", forceinline=True)
def solve_contact(model, x0, d0, free_x, free_d, free_mean, before, guess0, guess1):
    """Contact force F_0 + F_1 P of a step from its modal gaps without it.

    x: gap (m) at the start and, free of force, at the end; d: its slope per step (m); mean:
    its mean; `before`: energy in the contact at the start (J). Returns F_0, F_1 (N), what
    damping takes (J), evaluations.

    Newton on the projection; then the smallest change of F_0 and F_1 that makes the work equal
    to what the contact gives and damping takes. Where Newton does not end, as with a step far
    too large, the discrete gradient with a constant force takes over.
    """
    g, h = model.gains, model.step_s
    f0, f1, lost = guess0, guess1, 0.0
    evaluations = 0
    done = False
    while not done and evaluations < _NEWTON_MOST:
        x1 = free_x + g[X0] * f0 + g[X1] * f1
        d1 = free_d + h * (g[V0] * f0 + g[V1] * f1)
        mean = free_mean + g[M0] * f0 + g[M1] * f1
        p0, p1, lost, f0_x, f0_d, f0_m, f1_x, f1_d, f1_m = _project(model, x0, x1, d0, d1, mean)
        evaluations += 1
        a = 1.0 - (f0_x * g[X0] + f0_d * h * g[V0] + f0_m * g[M0])
        b = -(f0_x * g[X1] + f0_d * h * g[V1] + f0_m * g[M1])
        c = -(f1_x * g[X0] + f1_d * h * g[V0] + f1_m * g[M0])
        d = 1.0 - (f1_x * g[X1] + f1_d * h * g[V1] + f1_m * g[M1])
        det = a * d - b * c
        r0, r1 = f0 - p0, f1 - p1
        if not det > 0.0:
            break
        c0 = (d * r0 - b * r1) / det
        c1 = (a * r1 - c * r0) / det
        f0 -= c0
        f1 -= c1
        done = abs(c0) + abs(c1) <= _TIGHT * (abs(f0) + abs(f1))
    if done:
        f0, f1, done = _balance(model, x0, free_x, free_mean, f0, f1, lost, before)
    if not done:
        f0, lost = _solve_chord(model, x0, free_x)
        f1 = 0.0
        evaluations += _HALVINGS
    return f0, f1, lost, evaluations


@njit(cache=True, error_model="numpy", forceinline=True)
def _balance(model, x0, free_x, free_mean, f0, f1, lost, before):
    """Least change of F_0, F_1 that closes the step's energy; whether it was found.

    `before`: energy in the contact at the start. The work of F_0 + F_1 P on the gap is
    F_0 (x1 - x0) + F_1 (x1 + x0 - 2 mean).
    """
    g = model.gains
    last = math.inf
    for _ in range(_CORRECTIONS):
        x1 = free_x + g[X0] * f0 + g[X1] * f1
        mean = free_mean + g[M0] * f0 + g[M1] * f1
        way, bend = x1 - x0, x1 + x0 - 2.0 * mean
        force, after, _ = elastic(model, x1)
        wrong = f0 * way + f1 * bend + (after - before) + lost
        size = abs(f0 * way) + abs(f1 * bend) + after + before
        if abs(wrong) <= _ROUNDING * size or abs(wrong) >= last:
            return f0, f1, abs(wrong) <= _BALANCED * size
        last = abs(wrong)
        by0 = way + f0 * g[X0] + f1 * (g[X0] - 2.0 * g[M0]) - force * g[X0]
        by1 = bend + f0 * g[X1] + f1 * (g[X1] - 2.0 * g[M1]) - force * g[X1]
        norm = by0 * by0 + by1 * by1
        if norm == 0.0:
            return f0, f1, wrong == 0.0
        f0 -= wrong * by0 / norm
        f1 -= wrong * by1 / norm
    return f0, f1, False


@njit(cache=True, error_model="numpy", fastmath=_SUMS)
def _dissipated_with_modes(z, table, f0, f1, f_a):
    """The terms of a step's loss that depend on z, J."""
    lost = 0.0
    for i in range(z.shape[1]):
        zr, zi = z[0, i], z[1, i]
        lost += zr * (table[LOSS_RR, i] * zr + table[LOSS_RI, i] * zi) + table[LOSS_II, i] * zi * zi
        lost += zr * (table[LOSS_R0, i] * f0 + table[LOSS_R1, i] * f1 + table[LOSS_RA, i] * f_a)
        lost += zi * (table[LOSS_I0, i] * f0 + table[LOSS_I1, i] * f1 + table[LOSS_IA, i] * f_a)
    return lost


@njit(cache=True, error_model="numpy", forceinline=True)
def _dissipated_in_step(model, state, f0, f1, f_a):
    """Energy that the modes lost in the step just done, J; forces up on the plate."""
    g = model.gains
    lost = _dissipated_with_modes(state.z, model.table, f0, f1, f_a)
    lost += g[LOSS_00] * f0 * f0 + g[LOSS_01] * f0 * f1 + g[LOSS_11] * f1 * f1
    return lost + f_a * (g[LOSS_0A] * f0 + g[LOSS_1A] * f1 + g[LOSS_AA] * f_a)


@njit(cache=True, error_model="numpy")
def _dissipated_in_flight(model, state, steps):
    """Energy that the modes lost in `steps` steps without force since the snapshot, J."""
    lost = 0.0
    duration = steps * model.step_s
    for i in range(state.z.shape[1]):
        th = model.table[THETA, i]
        size = math.exp(-model.rho * th * duration)
        er = size * math.cos(th * duration)
        ei = size * math.sin(th * duration)
        lost += model.table[ENERGY, i] * pk.dissipation(
            th, model.rho, duration, state.free[0, i], state.free[1, i], er, ei
        )
    return lost


@njit(cache=True, error_model="numpy", forceinline=True)
def _forces_on_plate(model, state):
    """Forces of the last step, up on the plate: F_0, F_1 at the contact, a separate actuator."""
    body = state.body
    if model.same_point:
        return body[pk.F_A] - body[pk.F_C], -body[pk.F_C1], 0.0
    return -body[pk.F_C], -body[pk.F_C1], body[pk.F_A]


@njit(cache=True, error_model="numpy", forceinline=True)
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
        state.free[:] = state.z
        counts[pk.FREE_SINCE] = step


@njit(cache=True, error_model="numpy")
def close_books(model, state):
    """Book the last step and the last flight; to be called once, after the last step."""
    if not model.damped or state.counts[pk.STEP] == 0:
        return
    settle_books(model, state)
    if state.counts[pk.FREE_SINCE] >= 0:
        flight = state.counts[pk.STEP] - state.counts[pk.FREE_SINCE]
        state.books[pk.MODAL_DISSIPATED] += _dissipated_in_flight(model, state, flight)


@njit(cache=True, error_model="numpy")
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
        th2 = table[THETA, i] * table[THETA, i]
        total += table[ENERGY, i] * th2 * (speed * speed + (1.0 + rho * rho) * zi * zi)
    return total


@njit(cache=True, error_model="numpy", forceinline=True)
def _silence(state):
    """Leave out the modes of highest frequency that have died away (see plant.kernels)."""
    n = state.counts[pk.ROWS]
    while n > 0 and abs(state.z[0, n - 1]) + abs(state.z[1, n - 1]) <= pk.SILENT_M:
        n -= 1
        state.z[0, n] = 0.0
        state.z[1, n] = 0.0
    state.counts[pk.ROWS] = n


@njit(cache=True, error_model="numpy", forceinline=True)
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


@njit(cache=True, error_model="numpy")
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
    mean_known = True
    mean = 0.0
    if not model.same_point:
        x, v, mean, y = _propagate_two_points(awake, state.z, model.table, model.rho, f0, f1, f_act)
    elif quiet:
        x, v = _drift(awake, state.z, model.table, model.rho)
        mean_known = False
        y = x
    else:
        x, v, mean = _propagate_same_point(awake, state.z, model.table, model.rho, f0, f1)
        y = x
    x += g[CA] * f_a
    v += g[VA] * f_a
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
        before = elastic(model, gap_0)[1]
        state.books[pk.INJECTED] += before - body[STORED]
        body[OWN] = own
    if gap_0 < 0.0 or free < 0.0 or (slope_0 < 0.0 < slope):
        if not mean_known:
            mean = _mean_of_drift(awake, state.z, model.table)
        mean += g[MA] * f_a
        free_mean = sphere_0 + 0.5 * h * before_v - h * h * gravity / 6.0 - mean - own
        # Linear extrapolation of the last step's force is a good start for Newton.
        guess1 = body[pk.F_C1]
        f_c, f_c1, lost, evaluations = solve_contact(
            model,
            gap_0,
            slope_0,
            free,
            slope,
            free_mean,
            before,
            body[pk.F_C] + 2.0 * guess1,
            guess1,
        )
        counts[pk.NEWTON_TOTAL] += evaluations
        counts[pk.NEWTON_MAX] = max(counts[pk.NEWTON_MAX], evaluations)
    if f_c != 0.0 or f_c1 != 0.0:
        x -= g[PX0] * f_c + g[PX1] * f_c1
        v -= g[PV0] * f_c + g[PV1] * f_c1
        y -= g[AC0] * f_c + g[AC1] * f_c1
        sphere += h * h / model.mass_kg * (0.5 * f_c - f_c1 / 6.0)
        sphere_v += h / model.mass_kg * f_c
        body[pk.FLIGHT_X] = sphere
        body[pk.FLIGHT_V] = sphere_v
        counts[pk.FLIGHT_STEP] = counts[pk.STEP] + 1
        counts[pk.CONTACT_STEPS] += 1
        state.books[pk.CONTACT_IMPULSE] += f_c * h
        state.books[pk.CONTACT_DISSIPATED] += lost
    y = x if model.same_point else y + g[AA] * f_a
    modal_gap = sphere - x - own
    force_1, body[STORED], root = elastic(model, modal_gap)
    state.books[pk.INJECTED] += f_a * (y - body[MODAL_Y])
    body[MODAL_X] = x
    body[MODAL_V] = v
    body[MODAL_Y] = y
    _observe(model, body, sphere, sphere_v, force_1, root, f_a)
    body[pk.F_C] = f_c
    body[pk.F_C1] = f_c1
    body[pk.F_A] = f_a
    counts[pk.STEP] += 1
    return f_c
