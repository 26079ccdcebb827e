"""Textbook integrators on the modal equations of an uncontrolled impact.

q'' + eta w q' + w^2 q = -d F, x_s'' = F/m - g, gap = x_s - sum q, F = s max(-gap, 0)^1.5; q
carries the mode's weight at the struck point, d = lambda Phi^2. The explicit methods take a loss
factor eta, which costs nothing where it is left out. Each method moves the state y = (q, q', x_s,
v_s), shape (2 modes + 2,), on by `steps` steps of h, and writes the gap after every `every`-th.
"""

import math

import numpy as np
from scipy.integrate._ivp import dop853_coefficients as _hairer

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


# Plain exponential collocation at Gauss nodes on the modal equations, graded towards the ends
# of contact.
#
# The contact force over a step is the polynomial through its values at s Gauss nodes; the modes
# answer to it exactly. After the touch F ~ t^1.5, and before the end likewise, so that equal steps
# have order 2.5 whatever s. Steps are therefore halved, from a bank of tables for h, h/2, h/4 ...:
# until the one with the touch or the end in it is the shortest, and within a contact to at most
# h (tau/T)^beta, where tau = p/|p'| is about the time to or from the end of contact.
#
# z = q'/w + i q as in the schemes above. Nodes count from 0, the end of the step is node s.

_NEWTON_MOST = 50
_BETA = 2.0 / 3.0


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _ahead(z, turn):
    """Displacement at the point after the free turn `turn`, (2, modes)."""
    x = 0.0
    for i in range(z.shape[1]):
        x += turn[0, i] * z[1, i] + turn[1, i] * z[0, i]
    return x


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _advance(z, turn):
    for i in range(z.shape[1]):
        c = turn[0, i] * z[0, i] - turn[1, i] * z[1, i]
        z[1, i] = turn[0, i] * z[1, i] + turn[1, i] * z[0, i]
        z[0, i] = c


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _push(z, change, force):
    for i in range(z.shape[1]):
        z[0, i] -= change[0, i] * force
        z[1, i] -= change[1, i] * force


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _speed(z, omega):
    v = 0.0
    for i in range(z.shape[1]):
        v += omega[i] * z[0, i]
    return v


@kernel(allocates=True)
def _meet_of_stages(free, gain, stiffness, force, gap, work):
    """Forces (s,) at the nodes, F_i = s max(-gap_i, 0)^1.5, gap = free + gain F, by Newton; `gap`
    (s + 1,) out. `work`: (s, s + 1)."""
    s = force.size
    for _ in range(_NEWTON_MOST):
        for i in range(s + 1):
            gap[i] = free[i]
            for j in range(s):
                gap[i] += gain[i, j] * force[j]
        for i in range(s):
            root = math.sqrt(max(-gap[i], 0.0))
            for j in range(s):
                work[i, j] = 1.5 * stiffness * root * gain[i, j]
            work[i, i] += 1.0
            work[i, s] = stiffness * root**3 - force[i]
        for c in range(s):  # Gauss; the diagonal leads
            for i in range(c + 1, s):
                part = work[i, c] / work[c, c]
                for j in range(c, s + 1):
                    work[i, j] -= part * work[c, j]
        change, size = 0.0, 0.0
        for i in range(s - 1, -1, -1):
            for j in range(i + 1, s):
                work[i, s] -= work[i, j] * work[j, s]
            work[i, s] /= work[i, i]
            force[i] += work[i, s]
            change = max(change, abs(work[i, s]))
            size = max(size, abs(force[i]))
        if change <= 1e-14 * size:
            break
    for i in range(s + 1):
        gap[i] = free[i]
        for j in range(s):
            gap[i] += gain[i, j] * force[j]


@kernel(allocates=True)
def collocation(
    z, body, omega, times, turns, changes, gains, speed_gains, stiffness, scale_s, every, gaps
):  # fmt: skip
    """Run gaps.size times `every` steps; returns the number of sub-steps.

    body: sphere displacement, velocity; gap and its velocity. For each level l of halving: times
    (levels, s + 1), turns (levels, s + 1, 2, modes), changes (levels, s, 2, modes) of z over a
    step by unit force at a node, gains (levels, s + 1, s) of the gap, speed_gains
    (levels, s) of the sphere's velocity. `scale_s`: T.
    """
    levels, s = gains.shape[0], gains.shape[2]
    force, gap, free = np.zeros(s), np.zeros(s + 1), np.zeros(s + 1)
    work = np.zeros((s, s + 1))
    units = 1 << (levels - 1)  # of the shortest sub-step in a step
    h = times[0, s]
    count = 0
    for k in range(every * gaps.size):
        at = 0
        while at < units:
            level = 0
            while at % (units >> level) != 0:  # sub-steps lie on the grid of their length
                level += 1
            below = body[2] < 0.0 or (body[2] == 0.0 and body[3] < 0.0)
            if below and body[2] == 0.0:
                level = levels - 1
            elif below:
                tau = -body[2] / max(abs(body[3]), 1e-300)
                longest = h * min(1.0, (tau / scale_s) ** _BETA)
                while level < levels - 1 and times[level, s] > longest:
                    level += 1
            while True:
                for i in range(s + 1):
                    t = times[level, i]
                    free[i] = body[0] + t * (body[1] - 0.5 * t * GRAVITY)
                    free[i] -= _ahead(z, turns[level, i])
                    gap[i] = free[i]
                    force[i % s] = 0.0
                if below or gap.min() < 0.0:
                    _meet_of_stages(free, gains[level], stiffness, force, gap, work)
                one_sided = gap.max() <= 0.0 if below else gap.min() >= 0.0
                # The touch and the end belong into the shortest sub-step.
                if one_sided or level == levels - 1:
                    break
                level += 1
            _advance(z, turns[level, s])
            t = times[level, s]
            body[0] += t * (body[1] - 0.5 * t * GRAVITY)
            body[1] -= t * GRAVITY
            for j in range(s):
                if force[j] != 0.0:
                    _push(z, changes[level, j], force[j])
                    body[1] += speed_gains[level, j] * force[j]
            plate = z[1].sum()
            body[0] = gap[s] + plate
            body[2] = gap[s]
            body[3] = body[1] - _speed(z, omega)
            at += units >> level
            count += 1
        if (k + 1) % every == 0:
            gaps[(k + 1) // every - 1] = body[2]
    return count


# A compiled DOP853 on the modal equations of an uncontrolled, undamped impact.
#
# Coefficients, error estimate, step control and dense output are Hairer's as in
# `scipy.integrate.DOP853` (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I,
# 2nd ed., II.5, II.6, II.10), from which the coefficients are imported. Three things, exact but
# for rounding, make it as fast as this problem allows:
#
# - The equations are of second order, so the velocities of the stages are eliminated: with
#   a_i the accelerations, q_i = q + c_i h v + h^2 sum_j (A A)_ij a_j.
# - a_j = -w^2 q_j - d F_j: the displacements of the stages are stored, and what the force adds is
#   one number a stage, so that a stage is one pass over the modes.
# - The dense output is that of the gap, which is linear in the state: numbers, not arrays.
#
# y = (q, q', x_s, v_s) as above.

STAGES, EXTENDED = 12, 16
_C = np.ascontiguousarray(_hairer.C)
_A = np.ascontiguousarray(_hairer.A)
_AA = _A @ _A
_D = np.ascontiguousarray(_hairer.D)
# Rows of END: weights of the accelerations (without and with one more factor of h) in the velocity
# and displacement at the end and in both error estimates of each.
_b = np.append(_hairer.B, np.zeros(EXTENDED - STAGES))
_e3, _e5 = (np.append(e, np.zeros(EXTENDED - STAGES - 1)) for e in (_hairer.E3, _hairer.E5))
_V, _Q, _E3V, _E3Q, _E5V, _E5Q = range(6)
_END = np.ascontiguousarray([_b, _b @ _A, _e3, _e3 @ _A, _e5, _e5 @ _A])
_END[abs(_END) < 1e-13] = 0.0
_AA[abs(_AA) < 1e-13] = 0.0
_SAFETY, _LEAST, _MOST = 0.9, 0.2, 10.0  # change of the step, as in SciPy
# Stages that the displacement of a stage takes up, padded with stage 0 of weight 0.
_WIDTH = 10
_TERMS = np.zeros((EXTENDED, _WIDTH), np.int64)
_WEIGHTS = np.zeros((EXTENDED, _WIDTH))
for _i in range(EXTENDED):
    _used = np.flatnonzero(_AA[_i])
    _TERMS[_i, : len(_used)] = _used
    _WEIGHTS[_i, : len(_used)] = _AA[_i, _used]
_USED = np.count_nonzero(_AA, axis=1)


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _stage_3(q, v, omega2, drive, out, a, b, c, wa, wb, wc, t, push):
    """out = q + t v - omega2 (wa a + wb b + wc c) - push drive; its sum, and that of omega2 out."""
    x = 0.0
    f = 0.0
    for i in range(q.size):
        turned = wa * a[i] + wb * b[i] + wc * c[i]
        new = q[i] + t * v[i] - omega2[i] * turned - push * drive[i]
        out[i] = new
        x += new
        f += omega2[i] * new
    return x, f


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _stage_6(q, v, omega2, drive, out, a, b, c, d, e, g, w, t, push):
    """The same of six stages, weights `w`."""
    x = 0.0
    f = 0.0
    wa, wb, wc, wd, we, wg = w[0], w[1], w[2], w[3], w[4], w[5]
    for i in range(q.size):
        turned = wa * a[i] + wb * b[i] + wc * c[i] + wd * d[i] + we * e[i] + wg * g[i]
        new = q[i] + t * v[i] - omega2[i] * turned - push * drive[i]
        out[i] = new
        x += new
        f += omega2[i] * new
    return x, f


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _stage_10(q, v, omega2, drive, out, k, w, t, push, terms):
    """The same of ten stages, rows `terms` of k."""
    x = 0.0
    f = 0.0
    a, b, c, d, e = k[terms[0]], k[terms[1]], k[terms[2]], k[terms[3]], k[terms[4]]
    g, p, m, n, o = k[terms[5]], k[terms[6]], k[terms[7]], k[terms[8]], k[terms[9]]
    w0, w1, w2, w3, w4 = w[0], w[1], w[2], w[3], w[4]
    w5, w6, w7, w8, w9 = w[5], w[6], w[7], w[8], w[9]
    for i in range(q.size):
        turned = w0 * a[i] + w1 * b[i] + w2 * c[i] + w3 * d[i] + w4 * e[i]
        turned += w5 * g[i] + w6 * p[i] + w7 * m[i] + w8 * n[i] + w9 * o[i]
        new = q[i] + t * v[i] - omega2[i] * turned - push * drive[i]
        out[i] = new
        x += new
        f += omega2[i] * new
    return x, f


@kernel(allocates=True)
def _stage(s, y_v, omega2, drive, k, h, force):
    """Stage `s` of the plate: sums of its displacements and of omega2 times them. `force`:
    contact forces of the stages so far, N."""
    push = 0.0
    for j in range(s):
        push += _AA[s, j] * force[j]
    push *= h * h
    terms = _TERMS[s]
    w = h * h * _WEIGHTS[s]
    t = _C[s] * h
    if _USED[s] <= 3:
        a, b, c = k[terms[0]], k[terms[1]], k[terms[2]]
        return _stage_3(k[0], y_v, omega2, drive, k[s], a, b, c, w[0], w[1], w[2], t, push)
    if _USED[s] <= 6:
        a, b, c, d, e, g = (
            k[terms[0]], k[terms[1]], k[terms[2]], k[terms[3]], k[terms[4]], k[terms[5]]
        )  # fmt: skip
        return _stage_6(k[0], y_v, omega2, drive, k[s], a, b, c, d, e, g, w, t, push)
    return _stage_10(k[0], y_v, omega2, drive, k[s], k, w, t, push, terms)


@kernel(fastmath={"contract", "reassoc"}, allocates=True)
def _end(v, omega2, drive, k, v1, h, weights, push, rtol, atol):
    """State at the end of a step into k[12], v1. Sums of displacement, velocity and omega2
    times displacement, and of the squares of both weighed error estimates over h."""
    q, q1 = k[0], k[STAGES]
    a3, a4, a5, a6, a7 = k[3], k[4], k[5], k[6], k[7]
    a8, a9, a10, a11 = k[8], k[9], k[10], k[11]
    x = 0.0
    u = 0.0
    f = 0.0
    five = 0.0
    three = 0.0
    w = weights[_Q]
    q0, q5, q6, q7, q8, q9, q10 = w[0], w[5], w[6], w[7], w[8], w[9], w[10]
    by_force = push[_Q]
    for i in range(q.size):
        by_q = q0 * q[i] + q5 * a5[i] + q6 * a6[i] + q7 * a7[i] + q8 * a8[i]
        by_q += q9 * a9[i] + q10 * a10[i]
        q_new = q[i] + h * v[i] - h * h * (omega2[i] * by_q + drive[i] * by_force)
        q1[i] = q_new
        x += q_new
        f += omega2[i] * q_new
    w = weights[_V]
    v0, v5, v6, v7, v8, v9, v10, v11 = w[0], w[5], w[6], w[7], w[8], w[9], w[10], w[11]
    by_force = push[_V]
    for i in range(q.size):
        by_v = v0 * q[i] + v5 * a5[i] + v6 * a6[i] + v7 * a7[i] + v8 * a8[i]
        by_v += v9 * a9[i] + v10 * a10[i] + v11 * a11[i]
        v_new = v[i] - h * (omega2[i] * by_v + drive[i] * by_force)
        v1[i] = v_new
        u += v_new
    w, e = weights[_E5V], weights[_E3V]
    v0, v5, v6, v7, v8, v9, v10, v11 = w[0], w[5], w[6], w[7], w[8], w[9], w[10], w[11]
    s0, s5, s6, s7, s8, s9, s10, s11 = e[0], e[5], e[6], e[7], e[8], e[9], e[10], e[11]
    push_5, push_3 = push[_E5V], push[_E3V]
    for i in range(q.size):
        by_5 = v0 * q[i] + v5 * a5[i] + v6 * a6[i] + v7 * a7[i] + v8 * a8[i]
        by_5 += v9 * a9[i] + v10 * a10[i] + v11 * a11[i]
        by_3 = s0 * q[i] + s5 * a5[i] + s6 * a6[i] + s7 * a7[i] + s8 * a8[i]
        by_3 += s9 * a9[i] + s10 * a10[i] + s11 * a11[i]
        scale = 1.0 / (atol + rtol * max(abs(v[i]), abs(v1[i])))
        by_5 = (omega2[i] * by_5 + drive[i] * push_5) * scale
        by_3 = (omega2[i] * by_3 + drive[i] * push_3) * scale
        five += by_5 * by_5
        three += by_3 * by_3
    w, e = weights[_E5Q], weights[_E3Q]
    q0, q3, q4, q5, q6, q7, q8 = w[0], w[3], w[4], w[5], w[6], w[7], w[8]
    q9, q10 = w[9], w[10]
    r0, r3, r4, r5, r6, r7, r8 = e[0], e[3], e[4], e[5], e[6], e[7], e[8]
    r9, r10 = e[9], e[10]
    push_5, push_3 = push[_E5Q], push[_E3Q]
    for i in range(q.size):
        by_5 = q0 * q[i] + q3 * a3[i] + q4 * a4[i] + q5 * a5[i] + q6 * a6[i]
        by_5 += q7 * a7[i] + q8 * a8[i] + q9 * a9[i] + q10 * a10[i]
        by_3 = r0 * q[i] + r3 * a3[i] + r4 * a4[i] + r5 * a5[i] + r6 * a6[i]
        by_3 += r7 * a7[i] + r8 * a8[i] + r9 * a9[i] + r10 * a10[i]
        scale = h / (atol + rtol * max(abs(q[i]), abs(q1[i])))
        by_5 = (omega2[i] * by_5 + drive[i] * push_5) * scale
        by_3 = (omega2[i] * by_3 + drive[i] * push_3) * scale
        five += by_5 * by_5
        three += by_3 * by_3
    return x, u, f, five, three


@kernel(allocates=True)
def _interpolate(x, h, gap, gap_1, rates):
    """Gap at the part x of a step, from the gap at its ends and its rates at all stages."""
    change = gap_1 - gap
    y = 0.0
    for i in range(7):
        row = 3 - i
        if row >= 0:
            part = 0.0
            for j in range(EXTENDED):
                part += _D[row, j] * rates[j]
            part *= h
        elif row == -1:
            part = 2.0 * change - h * (rates[STAGES] + rates[0])
        elif row == -2:
            part = h * rates[0] - change
        else:
            part = change
        y += part
        y *= x if i % 2 == 0 else 1.0 - x
    return gap + y


@kernel(allocates=True)
def dop853(y, omega2, drive, stiffness, mass, every_s, gaps, rtol, atol, first_step_s, same_step):
    """Integrate over gaps.size times `every_s` s; gap at the end of each into `gaps` (m).

    `same_step`: keep the first step whatever the error, for tests of the order. Returns accepted
    and rejected steps and evaluations of the right-hand side; all -1 if the step vanishes.
    """
    n = omega2.size
    k = np.empty((EXTENDED, n))
    k[0] = y[:n]
    v, v1 = y[n : 2 * n].copy(), np.empty(n)
    force, sphere_a, gap_a = np.zeros(EXTENDED), np.zeros(EXTENDED), np.zeros(EXTENDED)
    rates, push = np.zeros(EXTENDED), np.zeros(6)
    moved = drive.sum()
    x_s, v_s = y[2 * n], y[2 * n + 1]
    gap = x_s - k[0].sum()
    rate = v_s - v.sum()
    bent = (omega2 * k[0]).sum()
    t, h, sample = 0.0, first_step_s, 0
    end = every_s * gaps.size
    accepted, rejected, evaluations = 0, 0, 1
    after_rejection = False
    while sample < gaps.size:
        last = t + h >= end * (1.0 - 1e-12)
        if last:
            h = end - t
        for s in range(EXTENDED - 3):
            if s == 0:
                gap_s = gap
            elif s < STAGES:
                plate, bent = _stage(s, v, omega2, drive, k, h, force)
                sphere = x_s + _C[s] * h * v_s
                for j in range(s):
                    sphere += h * h * _AA[s, j] * sphere_a[j]
                gap_s = sphere - plate
            else:
                for i in range(6):
                    push[i] = 0.0
                    for j in range(STAGES):
                        push[i] += _END[i, j] * force[j]
                plate, speed, bent, five, three = _end(
                    v, omega2, drive, k, v1, h, _END, push, rtol, atol
                )
                x_1, v_1 = x_s + h * v_s, v_s
                parts = np.zeros(4)
                for j in range(STAGES):
                    x_1 += h * h * _END[_Q, j] * sphere_a[j]
                    v_1 += h * _END[_V, j] * sphere_a[j]
                    for i in range(4):
                        parts[i] += _END[2 + i, j] * sphere_a[j]
                scale_v = atol + rtol * max(abs(v_s), abs(v_1))
                scale_q = (atol + rtol * max(abs(x_s), abs(x_1))) / h
                five += (parts[2] / scale_v) ** 2 + (parts[3] / scale_q) ** 2
                three += (parts[0] / scale_v) ** 2 + (parts[1] / scale_q) ** 2
                gap_s = x_1 - plate
            force[s] = hertz(stiffness, gap_s)
            sphere_a[s] = force[s] / mass - GRAVITY
            gap_a[s] = sphere_a[s] + bent + moved * force[s]
        evaluations += STAGES
        error = 0.0
        if five != 0.0 or three != 0.0:
            error = h * five / math.sqrt((five + 0.01 * three) * (2 * n + 2))
        if not (error < 1.0 or same_step):
            h *= max(_LEAST, _SAFETY * error**-0.125)
            rejected += 1
            after_rejection = True
            if not h > 1e-16 * end:
                return -1, -1, -1
            bent = gap_a[0] - sphere_a[0] - moved * force[0]
            continue
        if last or t + h >= every_s * (sample + 1):
            for s in range(STAGES + 1, EXTENDED):
                plate, bent_s = _stage(s, v, omega2, drive, k, h, force)
                sphere = x_s + _C[s] * h * v_s
                for j in range(s):
                    sphere += h * h * _AA[s, j] * sphere_a[j]
                force[s] = hertz(stiffness, sphere - plate)
                sphere_a[s] = force[s] / mass - GRAVITY
                gap_a[s] = sphere_a[s] + bent_s + moved * force[s]
            evaluations += EXTENDED - STAGES - 1
            for s in range(EXTENDED):
                rates[s] = rate
                for j in range(s):
                    rates[s] += h * _A[s, j] * gap_a[j]
            while sample < gaps.size and (last or every_s * (sample + 1) <= t + h):
                x = (every_s * (sample + 1) - t) / h
                gaps[sample] = _interpolate(x, h, gap, gap_s, rates)
                sample += 1
        t += h
        k[0] = k[STAGES]
        v, v1 = v1, v
        x_s, v_s, gap, rate = x_1, v_1, gap_s, v_1 - speed
        accepted += 1
        if not same_step:
            factor = min(_MOST, _SAFETY * error**-0.125) if error > 0.0 else _MOST
            h *= min(1.0, factor) if after_rejection else factor
        after_rejection = False
    y[:n], y[n : 2 * n] = k[0], v
    y[2 * n], y[2 * n + 1] = x_s, v_s
    return accepted, rejected, evaluations
