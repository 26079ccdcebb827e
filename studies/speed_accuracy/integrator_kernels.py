"""Textbook integrators on the modal equations of an uncontrolled impact.

q'' + eta w q' + w^2 q = -d F, x_s'' = F/m - g, gap = x_s - sum q, F = s max(-gap, 0)^1.5; q
carries the mode's weight at the struck point, d = lambda Phi^2. The explicit methods take a loss
factor eta, which costs nothing where it is left out. Each method moves the state y = (q, q', x_s,
v_s), shape (2 modes + 2,), on by `steps` steps of h, and writes the gap after every `every`-th.
"""

import math

import numpy as np

from jit import kernel

GRAVITY = 9.81


@kernel
def hertz(stiffness, gap):
    """Contact force at a gap."""
    p = max(-gap, 0.0)
    return stiffness * p * math.sqrt(p)


@kernel(fused=True, reordered=True)
def slope(t, y, omega2, drive, stiffness, mass, eta=0.0):
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
    if eta > 0.0:
        for i in range(n):
            out[n + i] -= eta * math.sqrt(omega2[i]) * y[n + i]
    out[2 * n] = y[2 * n + 1]
    out[2 * n + 1] = force / mass - GRAVITY
    return out


@kernel
def jacobian(y, omega2, drive, stiffness, mass):
    """Derivative of `slope` by y, shape (2 modes + 2, 2 modes + 2)."""
    n = omega2.size
    plate = 0.0
    for i in range(n):
        plate += y[i]
    rise = 1.5 * stiffness * math.sqrt(max(plate - y[2 * n], 0.0))  # dF/dp
    out = np.zeros((2 * n + 2, 2 * n + 2))
    for i in range(n):
        out[i, n + i] = 1.0
        for j in range(n):
            out[n + i, j] = -drive[i] * rise
        out[n + i, i] -= omega2[i]
        out[n + i, 2 * n] = drive[i] * rise
        out[2 * n + 1, i] = rise / mass
    out[2 * n, 2 * n + 1] = 1.0
    out[2 * n + 1, 2 * n] = -rise / mass
    return out


@kernel
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


@kernel(fused=True, reordered=True)
def verlet(y, omega2, drive, stiffness, mass, h, steps, every, gaps, eta=0.0):
    """Stoermer-Verlet, velocity form, the damping with the mean of the velocities half a step
    before and after, as in central differences; stable below w h = 2 whatever the damping."""
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
            if eta > 0.0:
                v -= 0.5 * h * eta * math.sqrt(omega2[i]) * y[n + i]
            q = y[i] + h * v
            y[n + i] = v
            y[i] = q
            plate += q
        gap = y[2 * n] - plate
        force = hertz(stiffness, gap)
        for i in range(n):
            y[n + i] += 0.5 * h * (-omega2[i] * y[i] - drive[i] * force)
            if eta > 0.0:
                y[n + i] /= 1.0 + 0.5 * h * eta * math.sqrt(omega2[i])
        y[2 * n + 1] += 0.5 * h * (force / mass - GRAVITY)
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = gap


@kernel(fused=True, reordered=True)
def leapfrog_lagged(y, omega2, drive, stiffness, mass, h, steps, every, gaps, eta):
    """Stoermer-Verlet with the velocities half a step behind, and the damping with those, as
    explicit finite-element codes take it; stable below w h = sqrt(4 + eta^2) - eta, where
    z^2 - (2 - eta w h - w^2 h^2) z + 1 - eta w h has the root -1."""
    n = omega2.size
    for k in range(steps):
        plate = 0.0
        for i in range(n):
            plate += y[i]
        force = hertz(stiffness, y[2 * n] - plate)
        plate = 0.0
        for i in range(n):
            y[n + i] -= h * (
                omega2[i] * y[i] + drive[i] * force + eta * math.sqrt(omega2[i]) * y[n + i]
            )
            y[i] += h * y[n + i]
            plate += y[i]
        y[2 * n + 1] += h * (force / mass - GRAVITY)
        y[2 * n] += h * y[2 * n + 1]
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = y[2 * n] - plate


@kernel(fused=True, reordered=True)
def rk4(y, omega2, drive, stiffness, mass, h, steps, every, gaps, eta=0.0):
    """Classical Runge-Kutta; stable below w h = 2.83, with damping 2.62 to 2.96."""
    n = omega2.size
    for k in range(steps):
        a = slope(0.0, y, omega2, drive, stiffness, mass, eta)
        b = slope(0.0, y + 0.5 * h * a, omega2, drive, stiffness, mass, eta)
        c = slope(0.0, y + 0.5 * h * b, omega2, drive, stiffness, mass, eta)
        d = slope(0.0, y + h * c, omega2, drive, stiffness, mass, eta)
        for i in range(y.size):
            y[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i])
        if (k + 1) % every == 0:
            plate = 0.0
            for i in range(n):
                plate += y[i]
            gaps[(k + 1) // every - 1] = y[2 * n] - plate


@kernel
def _meet(stiffness, free, gain):
    """Force with F = s max(-(free + gain F), 0)^1.5, by Newton inside a bracket."""
    if free >= 0.0:
        return 0.0
    low, high = 0.0, hertz(stiffness, free)
    force = 0.5 * high
    for i in range(200):
        gap = free + gain * force
        p = max(-gap, 0.0)
        wrong = force - stiffness * p * math.sqrt(p)
        if wrong > 0.0:
            high = force
        else:
            low = force
        trial = force - wrong / (1.0 + 1.5 * stiffness * math.sqrt(p) * gain)
        if not low < trial < high or i > 20:
            trial = 0.5 * (low + high)
        if abs(trial - force) <= 1e-15 * high:
            break
        force = trial
    return force


@kernel(fused=True, reordered=True)
def alpha_method(y, omega2, drive, stiffness, mass, h, steps, every, gaps, alpha):
    """Hilber-Hughes-Taylor done properly, -1/3 <= alpha <= 0; alpha = 0 is Newmark's average
    acceleration. The force is taken at the same weighted time as the spring."""
    n = omega2.size
    gamma, beta = 0.5 * (1.0 - 2.0 * alpha), 0.25 * (1.0 - alpha) ** 2
    plate = 0.0
    for i in range(n):
        plate += y[i]
    force = hertz(stiffness, y[2 * n] - plate)
    acc = np.empty(n)
    for i in range(n):
        acc[i] = -omega2[i] * y[i] - drive[i] * force
    acc_s = force / mass - GRAVITY
    gain = h * h * beta * (1.0 + alpha) / mass
    for i in range(n):
        gain += (
            h
            * h
            * beta
            * (1.0 + alpha)
            * drive[i]
            / (1.0 + (1.0 + alpha) * omega2[i] * beta * h * h)
        )
    for k in range(steps):
        # a1 (1 + (1+alpha) w^2 beta h^2) = -(1+alpha) (w^2 q~ + d F1) + alpha (w^2 q + d F)
        free = 0.0
        for i in range(n):
            bottom = 1.0 + (1.0 + alpha) * omega2[i] * beta * h * h
            ahead = y[i] + h * y[n + i] + h * h * (0.5 - beta) * acc[i]
            known = -(1.0 + alpha) * omega2[i] * ahead + alpha * (
                omega2[i] * y[i] + drive[i] * force
            )
            free += ahead + h * h * beta * known / bottom
        sphere_known = (-alpha * force) / mass - GRAVITY
        sphere = y[2 * n] + h * y[2 * n + 1] + h * h * ((0.5 - beta) * acc_s + beta * sphere_known)
        force_1 = _meet(stiffness, sphere - free, gain)
        plate = 0.0
        for i in range(n):
            bottom = 1.0 + (1.0 + alpha) * omega2[i] * beta * h * h
            ahead = y[i] + h * y[n + i] + h * h * (0.5 - beta) * acc[i]
            a1 = (
                -(1.0 + alpha) * (omega2[i] * ahead + drive[i] * force_1)
                + alpha * (omega2[i] * y[i] + drive[i] * force)
            ) / bottom
            y[n + i] += h * ((1.0 - gamma) * acc[i] + gamma * a1)
            y[i] = ahead + h * h * beta * a1
            acc[i] = a1
            plate += y[i]
        a1_s = sphere_known + (1.0 + alpha) * force_1 / mass
        y[2 * n] += h * y[2 * n + 1] + h * h * ((0.5 - beta) * acc_s + beta * a1_s)
        y[2 * n + 1] += h * ((1.0 - gamma) * acc_s + gamma * a1_s)
        acc_s = a1_s
        force = force_1
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = y[2 * n] - plate
