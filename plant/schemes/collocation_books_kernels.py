"""Compiled kernels of the default scheme `modal`: energy of the modes, and what they lose.

See `plant.schemes.collocation_kernels` for the scheme. Nothing here allocates: arrays are
`borrowed`.
"""

import math
from typing import NamedTuple

import numpy as np

from jit import kernel
from jit.by_type import by_type
from plant.actuator import kernels as act
from plant.contact import solve_kernels as solve
from plant.schemes import collocation_modes_kernels as modes
from plant.schemes import state_kernels as pk
from plant.schemes import tail_kernels


class Air(NamedTuple):
    """What the modes lose to air: the same table and gains, of that part of their losses."""

    gains: np.ndarray
    table: np.ndarray


@kernel(inline=True, borrowed=True)
def _dissipated_in_step(model, state, g, table, f0, f1, f_a):
    """Energy that the modes lost in the step just done, by the losses in gains `g` and `table`, J;
    forces up on the plate."""
    count = state.z.shape[1]
    lost = modes.dissipated_with_modes(count, state.z, table, f0, f1)
    if f_a != 0.0:
        lost += f_a * modes.weighted(count, state.z, table[modes.LOSS_RA], table[modes.LOSS_IA])
    if act.has_slope(model.actuator) and not model.same_point:
        slope = state.body[pk.F_A1]
        by_slope = modes.weighted(count, state.z, table[modes.LOSS_RB], table[modes.LOSS_IB])
        by_slope += g[solve.LOSS_0B] * f0 + g[solve.LOSS_1B] * f1 + g[solve.LOSS_AB] * f_a
        lost += slope * (by_slope + g[solve.LOSS_BB] * slope)
    lost += g[solve.LOSS_00] * f0 * f0 + g[solve.LOSS_01] * f0 * f1 + g[solve.LOSS_11] * f1 * f1
    return lost + f_a * (g[solve.LOSS_0A] * f0 + g[solve.LOSS_1A] * f1 + g[solve.LOSS_AA] * f_a)


@kernel(borrowed=True)
def _dissipated_in_flight(model, state, table, steps):
    """Energy that the modes lost in `steps` steps without force since the snapshot, J."""
    lost = 0.0
    duration = steps * model.step_s
    for i in range(state.z.shape[1]):
        th = table[modes.THETA, i]
        rho = modes.of_mode(model.rho, i)
        size = math.exp(-rho * th * duration)
        er = size * math.cos(th * duration)
        ei = size * math.sin(th * duration)
        yr, yi = state.free[0, i] / th, state.free[1, i] / th
        lost += table[modes.ENERGY, i] * pk.dissipation(th, rho, duration, yr, yi, er, ei)
    return lost


@kernel(inline=True, borrowed=True)
def _no_air(air, model, state, f0, f1, f_a):
    return 0.0


@kernel(inline=True, borrowed=True)
def _no_air_in_flight(air, model, state, steps):
    return 0.0


@kernel(borrowed=True)
def _radiated(air, model, state, f0, f1, f_a):
    return _dissipated_in_step(model, state, air.gains, air.table, f0, f1, f_a)


@kernel(borrowed=True)
def _radiated_in_flight(air, model, state, steps):
    return _dissipated_in_flight(model, state, air.table, steps)


# The parts of both that go into air, known to be none when a caller is compiled.
_to_air_in_step = by_type({type(None): _no_air, Air: _radiated})
_to_air_in_flight = by_type({type(None): _no_air_in_flight, Air: _radiated_in_flight})


@kernel(inline=True, borrowed=True)
def forces_on_plate(model, state):
    """Forces of the last step, up on the plate: F_0, F_1 at the contact, a separate actuator."""
    body = state.body
    if model.same_point:
        if act.has_slope(model.actuator):
            return body[pk.F_A] - body[pk.F_C], body[pk.F_A1] - body[pk.F_C1], 0.0
        return body[pk.F_A] - body[pk.F_C], -body[pk.F_C1], 0.0
    return -body[pk.F_C], -body[pk.F_C1], body[pk.F_A]


@kernel(inline=True, borrowed=True)
def unforced(model, state, f0, f1, f_a):
    """Whether none of the last step's forces acted."""
    quiet = f0 == 0.0 and f1 == 0.0 and f_a == 0.0
    if act.has_slope(model.actuator):
        return quiet and state.body[pk.F_A1] == 0.0
    return quiet


@kernel(inline=True, borrowed=True)
def _book_flight(model, state, steps):
    """Book what the modes lost in `steps` steps without force since the snapshot."""
    state.books[pk.MODAL_DISSIPATED] += _dissipated_in_flight(model, state, model.table, steps)
    state.books[pk.AIR] += _to_air_in_flight(model.air, model, state, steps)


@kernel(inline=True, borrowed=True)
def settle_books(model, state):
    """Book the modal dissipation of the step just done. Called before z moves on."""
    if not model.damped:
        return
    counts = state.counts
    step = counts[pk.STEP]
    f0, f1, f_a = forces_on_plate(model, state)
    quiet = unforced(model, state, f0, f1, f_a)
    if quiet and counts[pk.FREE_SINCE] >= 0:
        return
    if counts[pk.FREE_SINCE] >= 0:
        steps = step - 1 - counts[pk.FREE_SINCE]
        _book_flight(model, state, steps)
        counts[pk.FREE_SINCE] = -1
    state.books[pk.MODAL_DISSIPATED] += _dissipated_in_step(
        model, state, model.gains, model.table, f0, f1, f_a
    )
    state.books[pk.AIR] += _to_air_in_step(model.air, model, state, f0, f1, f_a)
    if quiet:
        for i in range(state.z.shape[1]):
            state.free[0, i] = state.z[0, i]
            state.free[1, i] = state.z[1, i]
        counts[pk.FREE_SINCE] = step


@kernel(borrowed=True)
def close_books(model, state):
    """Book the last step and the last flight; to be called once, after the last step."""
    if not model.damped or state.counts[pk.STEP] == 0:
        return
    settle_books(model, state)
    if state.counts[pk.FREE_SINCE] >= 0:
        flight = state.counts[pk.STEP] - state.counts[pk.FREE_SINCE]
        _book_flight(model, state, flight)


@kernel(borrowed=True)
def modal_energy(model, state):
    """Kinetic and elastic energy of all oscillators and a damped tail at the present step, J."""
    f0, f1, f_a = forces_on_plate(model, state)
    table = model.table
    total = tail_kernels.energy(model.tail, state.body)
    for i in range(state.z.shape[1]):
        rho = modes.of_mode(model.rho, i)
        zr = state.z[0, i] + table[modes.C0_RE, i] * f0 + table[modes.C1_RE, i] * f1
        zi = state.z[1, i] + table[modes.C0_IM, i] * f0 + table[modes.C1_IM, i] * f1
        if not model.same_point:
            zr += table[modes.A_RE, i] * f_a
            zi += table[modes.A_IM, i] * f_a
            if act.has_slope(model.actuator):
                zr += table[modes.A1_RE, i] * state.body[pk.F_A1]
                zi += table[modes.A1_IM, i] * state.body[pk.F_A1]
        speed = zr - rho * zi
        total += table[modes.ENERGY, i] * (speed * speed + (1.0 + rho * rho) * zi * zi)
    return total
