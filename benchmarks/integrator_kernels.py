"""Textbook integrators on the modal equations of an uncontrolled impact.

q'' + eta w q' + w^2 q = -d F, x_s'' = F/m - g, gap = x_s - sum q, F = s max(-gap, 0)^1.5; q
carries the mode's weight at the struck point, d = lambda Phi^2. The explicit methods take a loss
factor eta, which costs nothing where it is left out. Each method moves the state y = (q, q', x_s,
v_s), shape (2 modes + 2,), on by `steps` steps of h, and writes the gap after every `every`-th.
"""

import math

import numpy as np

from hertzloop.common.jit import kernel
from hertzloop.plant.schemes.registry import step
from hertzloop.plant.state_kernels import XI

GRAVITY = 9.81


@kernel(allocates=True)
def hertz(stiffness, gap):
    """Contact force at a gap."""
    p = max(-gap, 0.0)
    return stiffness * p * math.sqrt(p)


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
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


@kernel(allocates=True)
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


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
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


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
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


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
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


@kernel(allocates=True)
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


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
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


# Two more schemes of second order on the modal equations of an uncontrolled, undamped impact.
#
# Both start at rest at the first touch (gap zero) and take the plate's answer to a force exactly
# as the modes give it. A mode is z = q'/w + i q, its weight at the contact point included, and
# turns by e^(iwh) a step. Every run writes the gap at the end of every `every`-th step into
# `gaps`.


@kernel(inline=True, allocates=True)
def _root_slope(stiffness, gap):
    """Slope of psi = sqrt(2 V), V = 2/5 s p^(5/2), by the gap."""
    return -1.25 * math.sqrt(0.8 * stiffness * math.sqrt(max(-gap, 0.0)))


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _turn(z, table, force):
    """Fold the force of the last step in and propagate by one; displacement at the point."""
    x = 0.0
    for i in range(z.shape[1]):
        a = z[0, i] - table[2, i] * force
        b = z[1, i] - table[3, i] * force
        c = table[0, i] * a - table[1, i] * b
        d = table[0, i] * b + table[1, i] * a
        z[0, i] = c
        z[1, i] = d
        x += d
    return x


@kernel(allocates=True)
def quadratised(z, body, table, gain, stiffness, mass, h, every, gaps):
    """Non-iterative contact by a quadratised potential (Ducceschi and Bilbao 2019).

    V = psi^2/2 with psi a state of its own: psi_1 = psi_0 + g (xi_1 - xi_0), F = -g (psi_0 +
    psi_1)/2, and g = dpsi/dxi half-way to the gap without force. With xi_1 = xi_free + gain F the
    force is the solution of one linear equation. What is kept to rounding is the energy with
    psi^2/2 in place of the contact's; psi itself drifts from sqrt(2 V).

    z: (2, modes); table: (4, modes), turn and change of z by a unit force over a step; body: sphere
    displacement and velocity, gap, psi.
    """
    force = 0.0
    for k in range(every * gaps.size):
        free = body[0] + h * (body[1] - 0.5 * h * GRAVITY) - _turn(z, table, force)
        way = free - body[2]
        slope = _root_slope(stiffness, body[2] + 0.5 * way)
        force = -slope * (body[3] + 0.5 * slope * way) / (1.0 + 0.5 * slope * slope * gain)
        gap = free + gain * force
        body[3] += slope * (gap - body[2])
        body[0] += h * (body[1] + 0.5 * h * (force / mass - GRAVITY))
        body[1] += h * (force / mass - GRAVITY)
        body[2] = gap
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = gap
    for i in range(z.shape[1]):
        z[0, i] -= table[2, i] * force
        z[1, i] -= table[3, i] * force


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _weighed(kernel, force, count, offset):
    total = 0.0
    for j in range(count):
        total += kernel[offset + j] * force[j]
    return total


@kernel(allocates=True)
def convolution(response, force, speed, stiffness, h, every, gaps):
    """Gap as a direct sum over all past forces, by the trapezoidal rule.

    response: gap per impulse on it, sphere and plate together, at (n - 1) h ... h, 0, shape (n,)
    with n = steps + 1, so that every sum runs forward; it is zero at 0, so the newest force needs
    no equation. force: out, shape (n,), N. Work grows with the square of the steps.
    """
    n = response.size
    force[0] = 0.0
    for k in range(1, n):
        t = k * h
        gap = -t * (speed + 0.5 * GRAVITY * t)
        gap += h * _weighed(response, force, k, n - 1 - k)  # force[0] is zero: no half weight
        force[k] = hertz(stiffness, gap)
        if k % every == 0:
            gaps[k // every - 1] = gap


@kernel(allocates=True)
def sampled_response(omega, drive, mass, h, response):
    """The convolution's response at (n - 1) h ... 0 into `response`, m/(N s)."""
    n = response.size
    for k in range(n):
        response[n - 1 - k] = k * h / mass
    for i in range(omega.size):
        c, s = math.cos(omega[i] * h), math.sin(omega[i] * h)
        x, y = 1.0, 0.0
        share = drive[i] / omega[i]
        for k in range(n):
            response[n - 1 - k] += share * y
            x, y = c * x - s * y, c * y + s * x


@kernel(allocates=True)
def state_after(omega, drive, force, h, mass, speed, y):
    """State at the end of `convolution`: y = (q, q', x_s, v_s), by the same trapezoidal rule."""
    n, modes = force.size, omega.size
    for i in range(modes):
        c, s = math.cos(omega[i] * h), math.sin(omega[i] * h)
        re, im = 0.0, 0.0
        for k in range(n):
            weight = 0.5 if k == n - 1 else 1.0
            re, im = c * re - s * im + weight * force[k], c * im + s * re
        y[i] = -h * drive[i] / omega[i] * im
        y[modes + i] = -h * drive[i] * re
    t = (n - 1) * h
    y[2 * modes] = -t * (speed + 0.5 * GRAVITY * t)
    y[2 * modes + 1] = -speed - GRAVITY * t
    for k in range(n):
        weight = 0.5 if k == n - 1 else 1.0
        y[2 * modes] += h * (n - 1 - k) * h * force[k] / mass
        y[2 * modes + 1] += h * weight * force[k] / mass
