"""Compiled kernels of the default scheme `modal`: energy-preserving exponential collocation.

Every mode is propagated exactly under a contact force that is linear over the step,
F(t) = F_0 + F_1 P(t), P = 2 t/h - 1; the two numbers are the projection of the contact law on
linear functions, so the scheme has order 4 (Hairer 2010 for the projection; Brugnano,
Iavernaro and Trigiante for the correction that makes the energy exact). The law is
integrated along the quartic through gap and velocity at both ends and the mean gap, which
the modes give exactly, over the part of the step that is in contact.

Modes left out act as a massless spring, `flexibility`, in series with the contact, or as one more
mode, `tail`, by which the plate's velocity follows a force at once. Signs and
one pass per step as in `discrete_gradient_kernels`, but z is Theta times the z there: velocity is
Re z - rho Im z, displacement Im z/Theta. The scalar equations of a step are in
`plant.contact.solve_kernels`, the passes over the modes in `collocation_modes_kernels`, the
energies in `collocation_books_kernels`.

Nothing here allocates: arrays are `borrowed`.
"""

from typing import Any, NamedTuple

import numpy as np

from jit import kernel
from plant.actuator import kernels as act
from plant.contact import plastic_solve_kernels as contact
from plant.contact import solve_kernels as solve
from plant.schemes import collocation_books_kernels as books
from plant.schemes import collocation_modes_kernels as modes
from plant.schemes import sphere_kernels as ball
from plant.schemes import state_kernels as pk
from plant.schemes import tail_kernels

# Further indices into the state's body: displacement and velocity at the contact and
# displacement at the actuator by the modes alone, energy stored in the contact (J), what the
# actuator bends the spring of the modes left out by (m), `swing` of `propagate_same_point`
# (m s; known after steps with force), F_C1 of the step before the last (N).
MODAL_X, MODAL_V, MODAL_Y, STORED, OWN, SWING, F_C1_BEFORE = range(pk.BODY_SIZE, pk.BODY_SIZE + 7)
BODY_SIZE = pk.BODY_SIZE + 7
# What a scheme offers beside `step`.
close_books, modal_energy = books.close_books, books.modal_energy


class CollocationState(NamedTuple):
    """What changes: z by modes, and scalars by the indices above; as PlantState."""

    z: np.ndarray  # (2, modes): real and imaginary parts, m/s
    free: np.ndarray  # z at step counts[FREE_SINCE], while no force acts
    body: np.ndarray
    books: np.ndarray
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
    law: Any  # of the contact, plant.contact.plastic_kernels; as the actuator's
    actuator: Any  # of plant.actuator_kernels; its type decides what is compiled
    tail: Any  # of plant.schemes.tail_kernels, the same
    air: Any  # collocation_books_kernels.Air, or None where no face radiates
    gains: np.ndarray
    table: np.ndarray


@kernel(inline=True, borrowed=True)
def has_slope(model):
    """Whether the actuator's force can change within a step."""
    return act.has_slope(model.actuator)


@kernel(inline=True, borrowed=True)
def yields(model):
    """Whether the contact has a deepest penetration to remember."""
    return contact.yields(model.law)


@kernel(inline=True, borrowed=True)
def _silence(state):
    """Leave out the modes of highest frequency that have died away, as in
    `discrete_gradient_kernels`."""
    n = state.counts[pk.ROWS]
    while n > 0 and abs(state.z[0, n - 1]) + abs(state.z[1, n - 1]) <= pk.SILENT_M:
        n -= 1
        state.z[0, n] = 0.0
        state.z[1, n] = 0.0
    state.counts[pk.ROWS] = n


@kernel(inline=True, borrowed=True)
def _observe(model, body, sphere, sphere_v, gap, force, root, f_a, f_a1, push):
    """Write what can be seen: gap and plate with the spring of the modes left out, which the
    contact force `force` (N, without damping) at the modal gap `gap` compresses; `root`: of the
    penetration; `push`: force on a damped tail at the step's end, N."""
    spring, h = model.flexibility_m_n, model.step_s
    plate, speed = body[MODAL_X], body[MODAL_V]
    if tail_kernels.there(model.tail):
        speed += tail_kernels.mobility(model.tail) * push
    if spring != 0.0:
        if model.same_point:
            plate += spring * f_a
            if act.has_slope(model.actuator):
                plate += spring * f_a1
                speed += 2.0 * spring * f_a1 / h
        if force > 0.0:
            plate -= spring * force
            by_gap = contact.slope(model.law, model, body, gap, root, sphere_v < speed)
            speed -= spring * by_gap * (sphere_v - speed)
    body[pk.V_P_OF_STEP] = body[pk.V_P]
    body[pk.A_P] = (speed - body[pk.V_P]) / h
    body[pk.XI] = sphere - plate
    body[pk.XI_S] = sphere
    body[pk.XI_P] = plate
    body[pk.V_P] = speed
    body[pk.XI_A] = plate if model.same_point else body[MODAL_Y]


@kernel(inline=True, borrowed=True)
def _bend_own_spring(model, state, gap, own):
    """Let the actuator's force at the start of a step bend the spring of the modes left out, `own`
    (m), at once; energy in the contact then (J), at the modal gap `gap`."""
    before = state.body[STORED]
    if own != state.body[OWN]:
        taken = state.books[pk.PLASTIC_DISSIPATED]
        after = contact.settle(model.law, model, state, gap, 0.0)[1]
        taken = state.books[pk.PLASTIC_DISSIPATED] - taken
        state.books[pk.INJECTED] += (after - before) + taken
        return after
    return before


@kernel(borrowed=True)
def step(model, state, command):
    """Advance one step under a commanded actuator force (N); returns the mean contact force (N)."""
    body, counts, g, h = state.body, state.counts, model.gains, model.step_s
    if counts[pk.STEP] > 0:
        books.settle_books(model, state)
    f0, f1, f_act = books.forces_on_plate(model, state)
    quiet = books.unforced(model, state, f0, f1, f_act)
    f_a, f_a1 = act.force(model.actuator, body, command)
    sloped = act.has_slope(model.actuator)
    pushed = f_a != 0.0 or (sloped and f_a1 != 0.0)
    if not quiet or pushed:
        counts[pk.ROWS] = state.z.shape[1]
    elif counts[pk.STEP] % pk.LOOK_EVERY == 0:
        _silence(state)
    awake = counts[pk.ROWS]
    swing = mean = 0.0
    drifts = quiet and model.same_point
    if drifts:
        x, v = modes.drift(awake, state.z, model.table, model.rho)
        y = x
    elif model.same_point:
        slow = model.slow
        x, v, swing = modes.propagate_same_point(
            slow, awake, state.z, model.table, model.rho, f0, f1
        )
        x_slow, v_slow, mean = modes.propagate_slow(slow, state.z, model.table, model.rho, f0, f1)
        x += x_slow
        v += v_slow
        mean += g[solve.MEAN_BY_SWING] * (swing - body[SWING])
        y = x
    else:
        if sloped and not quiet:
            modes.fold_slope(awake, state.z, model.table, body[pk.F_A1])
        x, v, mean, y = modes.propagate_two_points(
            awake, state.z, model.table, model.rho, f0, f1, f_act
        )
    x_tail, v_tail, mean_tail = tail_kernels.turned(model.tail, body)
    if tail_kernels.there(model.tail):
        x += x_tail
        v += v_tail
    x += g[solve.CA] * f_a
    v += g[solve.VA] * f_a
    if sloped:
        x += g[solve.CA1] * f_a1
        v += g[solve.VA1] * f_a1
    gravity = model.gravity_m_s2
    sphere_0, before_v, sphere, sphere_v = ball.flight(model, body, counts)
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
    if tail_kernels.there(model.tail) and model.same_point:
        slope_0 -= h * tail_kernels.mobility(model.tail) * (f_a - f_a1)
    f_c = 0.0
    f_c1 = 0.0
    lost = 0.0
    before = _bend_own_spring(model, state, gap_0, own_0)
    body[OWN] = own_1
    rest = -contact.dent(model.law, body)
    touches = gap_0 < rest or free < rest or (slope_0 < 0.0 < slope)
    if drifts and (touches or pushed):
        mean, swing = modes.mean_of_drift(model.slow, awake, state.z, model.table, model.rho)
    root = 0.0
    if tail_kernels.there(model.tail):
        mean += mean_tail
    mean += g[solve.MA] * f_a
    if sloped:
        mean += g[solve.MA1] * f_a1
    if touches:
        free_mean = sphere_0 + 0.5 * h * before_v - h * h * gravity / 6.0 - mean - own
        # A good start for Newton: no jump between steps, the slope extrapolated.
        guess1 = 2.0 * body[pk.F_C1] - body[F_C1_BEFORE]
        f_c, f_c1, lost, evaluations, root = contact.solve_contact(
            model.law,
            model,
            body,
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
        sphere, sphere_v = ball.push(model, state, sphere, sphere_v, f_c, f_c1, lost)
    y = x if model.same_point else y + g[solve.AA] * f_a
    if sloped and not model.same_point:
        y += g[solve.AA1] * f_a1
    modal_gap = sphere - x - own_1
    force_1, body[STORED], root = contact.settle(model.law, model, state, modal_gap, root)
    state.books[pk.INJECTED] += f_a * (y - body[MODAL_Y])
    if sloped and pushed:
        if model.same_point:
            mean -= g[solve.PM0] * f_c + g[solve.PM1] * f_c1
        else:
            real, imaginary = model.table[modes.MEAN_A_IM], model.table[modes.MEAN_A_RE]
            mean = modes.weighted(awake, state.z, real, imaginary)
            mean += g[solve.MAA] * f_a + g[solve.MAA1] * f_a1
            mean -= g[solve.MAC0] * f_c + g[solve.MAC1] * f_c1
        # Work of the slope, and of the contact on what the slope bends the spring by.
        state.books[pk.INJECTED] += f_a1 * (y + body[MODAL_Y] - 2.0 * mean) + 2.0 * bent * f_c
    push = 0.0
    if tail_kernels.there(model.tail):
        push_0, push_1 = -f_c, -f_c1
        if model.same_point:
            push_0 += f_a
            push_1 += f_a1
        tail_kernels.pushed(model.tail, state, push_0, push_1)
        push = push_0 + push_1
        v -= tail_kernels.mobility(model.tail) * push
    body[MODAL_X] = x
    body[MODAL_V] = v
    body[MODAL_Y] = y
    body[SWING] = swing + g[solve.SWING0] * (f_a - f_c) - g[solve.SWING1] * f_c1
    if sloped:
        body[SWING] += g[solve.SWING1] * f_a1
    _observe(model, body, sphere, sphere_v, modal_gap, force_1, root, f_a, f_a1, push)
    body[pk.F_C] = f_c
    body[F_C1_BEFORE] = body[pk.F_C1]
    body[pk.F_C1] = f_c1
    body[pk.F_A] = f_a
    if sloped:
        body[pk.F_A1] = f_a1
    counts[pk.STEP] += 1
    return f_c
