"""Textbook integrators on the modal equations of an uncontrolled impact.

q'' + w^2 q = -d F, x_s'' = F/m - g, gap = x_s - sum q, F = s max(-gap, 0)^1.5; q carries the
mode's weight at the contact point, d = lambda Phi^2. Each method moves the state y = (q, q', x_s,
v_s), shape (2 modes + 2,), on by `steps` steps of h, and writes the gap after every `every`-th.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from hertzloop.common.jit import kernel
from hertzloop.plant.schemes.registry import step
from hertzloop.plant.state_kernels import XI

GRAVITY = 9.81
# Textbook codes leave the order of a sum to the compiler.
_vectorised = njit(nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})


@kernel(allocates=True)
def hertz(stiffness, gap):
    """Contact force at a gap."""
    p = max(-gap, 0.0)
    return stiffness * p * math.sqrt(p)


@_vectorised
def slope(t, y, omega2, drive, stiffness, mass):
    """Right-hand side for y = (q, q', x_s, v_s), shape (2 modes + 2,)."""
    n = omega2.size
    plate = 0.0
    for i in range(n):
        plate += y[i]
    force = hertz(stiffness, y[2 * n] - plate)
    out = np.empty(2 * n + 2)
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = -omega2[i] * y[i] - drive[i] * force
    out[2 * n] = y[2 * n + 1]
    out[2 * n + 1] = force / mass - GRAVITY
    return out


@kernel(allocates=True)
def energy(y, omega2, drive, stiffness, mass):
    """Total energy of a state, J."""
    n = omega2.size
    total = 0.0
    plate = 0.0
    for i in range(n):
        plate += y[i]
        total += 0.5 * (y[n + i] * y[n + i] + omega2[i] * y[i] * y[i]) / drive[i]
    p = max(plate - y[2 * n], 0.0)
    total += 0.4 * stiffness * p * p * math.sqrt(p)
    return total + mass * (0.5 * y[2 * n + 1] * y[2 * n + 1] + GRAVITY * y[2 * n])


@_vectorised
def verlet(y, omega2, drive, stiffness, mass, h, steps, every, gaps):
    """Stoermer-Verlet, velocity form; stable below w h = 2."""
    n = omega2.size
    plate = 0.0
    for i in range(n):
        plate += y[i]
    force = hertz(stiffness, y[2 * n] - plate)
    for k in range(steps):
        y[2 * n + 1] += 0.5 * h * (force / mass - GRAVITY)
        y[2 * n] += h * y[2 * n + 1]
        plate = 0.0
        for i in range(n):
            v = y[n + i] + 0.5 * h * (-omega2[i] * y[i] - drive[i] * force)
            q = y[i] + h * v
            y[n + i] = v
            y[i] = q
            plate += q
        gap = y[2 * n] - plate
        force = hertz(stiffness, gap)
        for i in range(n):
            y[n + i] += 0.5 * h * (-omega2[i] * y[i] - drive[i] * force)
        y[2 * n + 1] += 0.5 * h * (force / mass - GRAVITY)
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = gap


@_vectorised
def rk4(y, omega2, drive, stiffness, mass, h, steps, every, gaps):
    """Classical Runge-Kutta; stable below w h = 2.83."""
    n = omega2.size
    for k in range(steps):
        a = slope(0.0, y, omega2, drive, stiffness, mass)
        b = slope(0.0, y + 0.5 * h * a, omega2, drive, stiffness, mass)
        c = slope(0.0, y + 0.5 * h * b, omega2, drive, stiffness, mass)
        d = slope(0.0, y + h * c, omega2, drive, stiffness, mass)
        for i in range(y.size):
            y[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i])
        if (k + 1) % every == 0:
            plate = 0.0
            for i in range(n):
                plate += y[i]
            gaps[(k + 1) // every - 1] = y[2 * n] - plate


@kernel(allocates=True)
def plant_steps(model, state, f_a, count):
    """`count` plant steps under the same actuator force."""
    for _ in range(count):
        step(model, state, f_a)


@kernel(allocates=True)
def two_pass_steps(z, turn, grown, count):
    """The obvious loop, as a yardstick: predict with one pass over all oscillators, then
    apply the force with a second one. Arrays are complex, shape (frequencies,)."""
    x = 0.0
    for _ in range(count):
        x = 0.0
        for i in range(z.size):
            z[i] *= turn[i]
            x += z[i].imag
        force = 1.0 - x
        for i in range(z.size):
            z[i] += grown[i] * force
    return x


@kernel(allocates=True)
def plant_gaps(model, state, every, gaps):
    """Step without control; the gap after every `every` steps."""
    for i in range(gaps.size):
        for _ in range(every):
            step(model, state, 0.0)
        gaps[i] = state.body[XI]


@kernel(allocates=True)
def many_slopes(y, omega2, drive, stiffness, mass, count):
    """The right-hand side of the modal equations, `count` times."""
    total = 0.0
    for i in range(count):
        total += slope(0.0, y, omega2, drive, stiffness, mass + 1e-9 * i)[0]
    return total


class Impact(NamedTuple):
    """All that decides an impact: modes as in `plant.structures.modes.Oscillators`, `loss`: eta w,
    1/s, or no modes and a `mobility` (m/(N s)); the contact; a force `push` (N) from the start."""

    omega: np.ndarray
    loss: np.ndarray
    at_contact: np.ndarray
    at_actuator: np.ndarray
    scale_per_kg: float
    mobility: float
    stiffness: float
    yield_m: float
    viscous_n_s_m: float
    hunt_crossley_s_m: float
    mass_kg: float
    push: float


@kernel
def thornton(stiffness, yield_m, p, deepest):
    """Thornton's force at a penetration, after a deepest one."""
    if p > deepest and p > yield_m:
        return stiffness * math.sqrt(yield_m) * (yield_m + 1.5 * (p - yield_m))
    if deepest > yield_m:
        most = stiffness * math.sqrt(yield_m) * (yield_m + 1.5 * (deepest - yield_m))
        back = most / (stiffness * math.sqrt(deepest))
        return most * (max(p - deepest + back, 0.0) / back) ** 1.5
    return stiffness * max(p, 0.0) ** 1.5


@_vectorised
def impact_slope(impact, y, deepest, out):
    """Right-hand side for y = (q, q', x_s, v_s, x of a plate without modes, J lost in the
    structure, J lost in the contact's damper)."""
    n = impact.omega.size
    x, v, lost = y[2 * n + 2], impact.mobility * impact.push, 0.0
    for i in range(n):
        x += impact.at_contact[i] * y[i]
        v += impact.at_contact[i] * y[n + i]
        lost += impact.loss[i] * y[n + i] * y[n + i]
    force = thornton(impact.stiffness, impact.yield_m, x - y[2 * n], deepest)
    damper = 0.0
    if force > 0.0:
        damper = impact.viscous_n_s_m + impact.hunt_crossley_s_m * force
    rate = v - y[2 * n + 1]
    force = (force + damper * rate) / (1.0 + damper * impact.mobility)
    rate -= impact.mobility * force
    for i in range(n):
        drive = impact.at_actuator[i] * impact.push - impact.at_contact[i] * force
        own = impact.loss[i] * y[n + i] + impact.omega[i] * impact.omega[i] * y[i]
        out[i] = y[n + i]
        out[n + i] = impact.scale_per_kg * drive - own
    away = impact.push - force
    out[2 * n] = y[2 * n + 1]
    out[2 * n + 1] = force / impact.mass_kg - GRAVITY
    out[2 * n + 2] = impact.mobility * away
    out[2 * n + 3] = lost / impact.scale_per_kg + impact.mobility * away * away
    out[2 * n + 4] = damper * rate * rate
    return x - y[2 * n]


@kernel(allocates=True)
def impact_gaps(impact, y, h, every, gaps):
    """Runge-Kutta over an impact; the gap after every `every` steps of h."""
    deepest = impact.yield_m
    a, b, c, d = np.empty_like(y), np.empty_like(y), np.empty_like(y), np.empty_like(y)
    for k in range(gaps.size):
        for _ in range(every):
            deepest = max(deepest, impact_slope(impact, y, deepest, a))
            impact_slope(impact, y + 0.5 * h * a, deepest, b)
            impact_slope(impact, y + 0.5 * h * b, deepest, c)
            impact_slope(impact, y + h * c, deepest, d)
            for i in range(y.size):
                y[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i])
        gaps[k] = -impact_slope(impact, y, deepest, a)


@kernel
def impact_energy(impact, y):
    """Energy of the modes, J."""
    n, total = impact.omega.size, 0.0
    for i in range(n):
        turn = impact.omega[i] * y[i]
        total += 0.5 * (y[n + i] * y[n + i] + turn * turn) / impact.scale_per_kg
    return total
